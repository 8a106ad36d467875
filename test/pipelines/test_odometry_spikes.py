# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses that are off for a moment are skipped; motion is not."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros import se3
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.sections import OdometryParams
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.odometry_gate import SKIPPED
from heightmap25d_ros.pipelines.odometry_spikes import OdometrySpikes

START = 10**18


def motion(seconds=4.0, rate=50.0, noise=0.0, seed=0):
    """Stamps [s] and (N, 6) poses of a robot that drives a curve over waves."""
    t = np.arange(round(seconds * rate)) / rate
    xyz_rpy = np.stack(
        [2 * np.sin(0.4 * t), 2 - 2 * np.cos(0.4 * t), 0.05 * np.sin(2 * t),
         0.03 * np.sin(3 * t), 0.04 * np.cos(2 * t), 0.4 * t], axis=1
    )  # fmt: skip
    return t, xyz_rpy + noise * np.random.default_rng(seed).normal(size=xyz_rpy.shape)


def admitted(t, xyz_rpy, **params):
    """Numbers of the poses that are used, in order; how many were used late; counts."""
    dropped = Drops()
    spikes = OdometrySpikes(OdometryParams(**params), dropped)
    used, late = [], 0
    for number, (seconds, T) in enumerate(zip(t, se3.from_xyz_rpy(xyz_rpy), strict=True)):
        odometry = Odometry(
            stamp_ns=START + round(seconds * 1e9), frame_id="odom", child_frame_id=str(number), T=T
        )
        now = [int(o.child_frame_id) for o in spikes.admit(odometry)]
        late += sum(n != number for n in now)
        used += now
    used += [int(o.child_frame_id) for o in spikes.finish()]
    assert all(a < b for a, b in pairwise(used))
    return used, late, dict(dropped)


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("rate", [10.0, 50.0, 200.0])
def test_motion_is_used_at_once(rate, noise):
    used, late, counts = admitted(*motion(rate=rate, noise=noise))
    assert (len(used), late, counts) == (4 * rate, 0, {})


def test_noise_that_is_usual_is_no_spike():
    used, _, _ = admitted(*motion(seconds=20.0, noise=0.03))
    assert len(used) > 0.97 * 1000


SPIKES = {
    "z": [0, 0, 0.15, 0, 0, 0], "pitch": [0, 0, 0, 0, np.radians(5), 0],
    "roll": [0, 0, 0, np.radians(-5), 0, 0], "yaw": [0, 0, 0, 0, 0, np.radians(6)],
    "sideways": [-0.1, 0.3, 0, 0, 0, 0],
}  # fmt: skip


@pytest.mark.parametrize("spike", SPIKES.values(), ids=SPIKES)
@pytest.mark.parametrize("length", [1, 3, 5])
def test_a_spike_is_skipped_and_nothing_else(spike, length):
    t, xyz_rpy = motion(noise=0.001)
    bad = [begin + n for begin in (60, 110, 160) for n in range(length)]
    xyz_rpy[bad] += spike
    used, _, counts = admitted(t, xyz_rpy)
    assert sorted(set(range(200)) - set(used)) == bad
    assert counts == {SKIPPED: 3 * length}


@pytest.mark.parametrize("spike", [*SPIKES.values(), [300, 0, 0, 0, 0, 1]], ids=[*SPIKES, "far"])
def test_a_step_that_stays_is_used_a_little_later(spike):
    t, xyz_rpy = motion()
    xyz_rpy[100:] += spike
    used, late, counts = admitted(t, xyz_rpy)
    assert used == list(range(200))
    assert 10 < late < 25
    assert counts == {}


def test_nothing_waits_where_that_is_not_wanted():
    t, xyz_rpy = motion()
    xyz_rpy[100] += SPIKES["z"]
    assert admitted(t, xyz_rpy, spike_time=0.0) == (list(range(200)), 0, {})


@draws(60)
@given(
    st.lists(st.tuples(st.integers(0, 99), st.integers(1, 30), st.floats(-2, 2)), max_size=5),
    st.sampled_from([5.0, 20.0, 100.0]),
)
def test_whatever_comes_the_poses_stay_in_order_and_wait_no_longer_than_they_should(steps, rate):
    t, xyz_rpy = motion(seconds=100 / rate, rate=rate)
    for begin, length, height in steps:
        xyz_rpy[begin : begin + length] += height
    used, _, counts = admitted(t, xyz_rpy)
    assert len(used) + counts.get(SKIPPED, 0) == 100
    assert np.diff(t[used], prepend=0.0).max() <= 0.6 + 1.0 / rate
