# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A driver that is stuck is told from a world that looks the same."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.pipelines.repeated_scans import RepeatedScans

NOISY = np.random.default_rng(0).normal(3.0, 0.01, (60, 50)).astype(np.float32)


def at(x):
    return se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, 0.0])


def told(scans, places):
    repeated = RepeatedScans()
    return [repeated.is_repeated("scan", s, at(x)) for s, x in zip(scans, places, strict=True)]


def test_a_scan_that_comes_again_and_again_while_the_robot_moves():
    scans = [*NOISY[:30], *[NOISY[30]] * 10, *NOISY[31:41]]
    found = told(scans, 0.05 * np.arange(50))
    assert [n for n, is_repeated in enumerate(found) if is_repeated] == list(range(31, 40))


def test_a_robot_that_stands_may_see_the_same():
    assert not any(told([*NOISY[:30], *[NOISY[30]] * 10], [0.0] * 40))


def test_lasers_without_noise_see_the_same_on_flat_ground():
    flat = np.full(50, 2.0, np.float32)
    object_ahead = flat.copy()
    object_ahead[20:30] = 1.5
    scans = [*[flat] * 10, *[object_ahead] * 10, *[flat] * 30]
    assert not any(told(scans, 0.05 * np.arange(50)))


def test_lasers_that_see_nothing_or_change_their_fan():
    nothing = np.full(50, np.inf, np.float32)
    assert not any(told([*NOISY[:30], *[nothing] * 10], 0.05 * np.arange(40)))
    odd = [scan[: 40 + n % 2] for n, scan in enumerate(NOISY)]
    assert not any(told(odd, 0.05 * np.arange(60)))
    with_nan = np.where(np.arange(50) < 5, np.nan, NOISY).astype(np.float32)
    assert sum(told([*with_nan[:30], *[with_nan[30]] * 5], 0.05 * np.arange(35))) == 4
