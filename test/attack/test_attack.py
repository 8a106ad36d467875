# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A short run of each attack on messages and files; `make attack` runs all of them at length."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
from damaged_files import damaged, damaged_arrays, damaged_yaml
from file_attack import attack_bags, attack_maps, attack_trajectories, attack_yaml
from message_attack import OTHERS, attack_messages, drive, sound
from mutated_messages import mutated
from node_attack import attack_saves
from tally import Tally, random_of

from heightmap25d_ros.errors import InputError

SEED = 14


def require_harmless(tally: Tally, *outcomes: str) -> None:
    assert tally.failures == []
    assert all(tally.outcomes[outcome] for outcome in outcomes), tally.row


def test_mutated_messages() -> None:
    require_harmless(attack_messages(SEED, 2000), "fed", "sound drives mapped afterwards")


def test_damaged_maps(tmp_path: Path) -> None:
    require_harmless(attack_maps(SEED, 300, tmp_path), "used", "refused")


def test_damaged_parameter_files(tmp_path: Path) -> None:
    require_harmless(attack_yaml(SEED, 300, tmp_path), "used", "refused")


def test_damaged_trajectories(tmp_path: Path) -> None:
    require_harmless(attack_trajectories(SEED, 200, tmp_path), "used", "refused")


@pytest.mark.slow
def test_damaged_bags(tmp_path: Path) -> None:
    require_harmless(attack_bags(SEED, 60, tmp_path), "used", "refused")


@pytest.mark.slow
def test_killed_while_saving(tmp_path: Path) -> None:
    require_harmless(attack_saves(SEED, 4, tmp_path), "used")


def test_what_fails_is_told_with_its_number() -> None:
    tally = Tally("of nothing")
    for number, error in enumerate([None, InputError("field: bad"), InputError(""), KeyError("x")]):
        with tally.case(number):
            if error is not None:
                raise error
    assert tally.outcomes == {"used": 1, "refused": 2}
    assert tally.failures[0] == "case 2: refused by ''"
    assert tally.failures[1].startswith("case 3: KeyError: 'x' (")
    assert tally.row == "| of nothing | 2 refused, 1 used | 2 |"


def test_attacks_change_what_they_are_given_and_are_repeatable() -> None:
    messages = [message for _, _, message in drive()[:40]] + [sound(topic, 0) for topic in OTHERS]
    data = bytes(range(256)) * 8
    for number, message in enumerate(messages):
        before = copy.deepcopy(message)
        first, again = (mutated(random_of(SEED, number), message) for _ in range(2))
        assert repr(first) == repr(again)
        assert repr(message) == repr(before)
        assert damaged(random_of(SEED, number), data) == damaged(random_of(SEED, number), data)
    assert len({repr(mutated(random_of(SEED, n), messages[0])) for n in range(30)}) > 15
    assert len({damaged(random_of(SEED, n), data) for n in range(30)}) > 25
    assert len({damaged_yaml(random_of(SEED, n), "a: 1\nb: 2\nc: 3") for n in range(30)}) > 20


def test_other_arrays_have_right_checksums(tmp_path: Path) -> None:
    """So that what is in them is looked at."""
    path = tmp_path / "arrays.npz"
    np.savez(path, height=np.ones((3, 4), np.int16), scale=np.array(2.0))
    for number in range(50):
        changed = tmp_path / "changed.npz"
        changed.write_bytes(damaged_arrays(random_of(SEED, number), path.read_bytes()))
        with np.load(changed, allow_pickle=True) as archive:
            assert all(archive[name] is not None for name in archive.files)
