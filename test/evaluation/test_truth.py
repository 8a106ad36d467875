# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Truth files that are damaged, or of something else."""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from properties import draws
from repository import BAGS

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.truth import read_goals, read_ground, read_truth

READERS = {"surface": (read_truth, read_ground), "goals": (read_goals,)}


def small(name: str) -> bytes:
    """A truth file of a few cells, compressed."""
    fields = {
        "surface": {
            "top": np.zeros((8, 9)), "seen": np.full((8, 9), np.nan), "resolution": 0.125,
            "origin": np.zeros(2),
        },
        "goals": {
            "start": np.zeros((5, 3)), "goal": np.ones((5, 3)), "reachable": np.ones(5, bool),
            "observed": np.ones(5, bool),
        },
    }[name]  # fmt: skip
    file = io.BytesIO()
    np.savez_compressed(file, **fields)
    return file.getvalue()


@draws(300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["surface", "goals"]),
    st.lists(st.tuples(st.floats(0.0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.floats(0.5, 1.5),
)
def test_damage_is_refused_or_harmless(tmp_path: Path, name, changes, part) -> None:
    content = bytearray(small(name))
    for place, value in changes:
        content[int(place * len(content))] = value
    path = tmp_path / f"{name}.npz"
    path.write_bytes(content[: int(part * len(content))])
    for read in READERS[name]:
        with suppress(InputError):
            read(path)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("surface", {"top": np.zeros((8, 8))}),
        ("surface", {"top": np.zeros(8)}),
        ("surface", {"resolution": 1e-9}),
        ("surface", {"resolution": np.nan}),
        ("surface", {"origin": np.array([0.0, 1e18])}),
        ("surface", {"origin": np.zeros(3)}),
        ("surface", {"seen": np.array([0x7FFFFFFF], np.uint32).view("U1")}),
        ("goals", {"start": np.array(0.0)}),
        ("goals", {"start": np.zeros((4, 3))}),
        ("goals", {"goal": np.full((5, 3), np.inf)}),
        ("goals", {"goal": np.zeros((5, 1))}),
        ("goals", {"reachable": np.ones(4, bool)}),
        ("goals", {"observed": np.array(True)}),
        ("goals", {"observed": None}),
    ],
)
def test_other_content_is_refused_in_one_line(tmp_path: Path, name, changes) -> None:
    with np.load(io.BytesIO(small(name))) as archive:
        fields = dict(archive) | changes
    path = tmp_path / f"{name}.npz"
    np.savez(path, **{key: value for key, value in fields.items() if value is not None})
    with pytest.raises(InputError) as refusal:
        READERS[name][0](path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_recorded_truth_is_read() -> None:
    assert read_truth(BAGS / "ramp_1" / "truth" / "surface.npz").top.ndim == 2
    assert len(read_goals(BAGS / "ramp_1" / "truth" / "goals.npz").start)
