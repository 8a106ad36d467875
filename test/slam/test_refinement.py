# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a whole drive, from those of its keyframes and from its loops."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from heightmap25d_ros import se3
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam import refinement
from heightmap25d_ros.slam.bundle import Keyframe, Refined
from heightmap25d_ros.slam.own_map_tracker import Placed
from heightmap25d_ros.slam.pose_graph import Edge, PoseGraph

SIDE = np.array([4.0, 0.0, np.pi / 2, 0.0])
CORNERS = np.array([[0, 0, 0], [4, 0, np.pi / 2], [4, 4, np.pi], [0, 4, -np.pi / 2], [0, 0, 0]])


def planar(x, y, yaw):
    return se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw])


def square():
    """A drive around a square, a submap and a keyframe for each side; odometry is right."""
    graph, submaps, keyframes, placed = PoseGraph(), [], [], []
    nothing = np.empty((0, 3), np.float32)
    for number, corner in enumerate(CORNERS):
        T = planar(*corner)
        graph.add(np.array([*corner, 0.0]))
        submaps.append(SimpleNamespace(T_map_submap=np.eye(4), start=T))
        keyframes.append(Keyframe(2 * number, number, np.eye(4), T, np.eye(4), *3 * [nothing]))
        for k, pose in enumerate((T, T @ planar(2.0, 0.0, 0.0))):
            stamp = 10 * number + k
            placed.append(Placed(stamp, pose, np.eye(4), number, np.eye(4), np.zeros((3, 3)), True))
        if number:
            graph.join(Edge(number - 1, number, SIDE, 100.0 * np.eye(4), distance=4.0))
    graph.join(Edge(0, 4, np.zeros(4), 1e6 * np.eye(4), is_loop=True))
    return SimpleNamespace(
        graph=graph, submaps=submaps, keyframes=keyframes, placed=placed, loops_closed=1,
        is_level=False,
        poses=lambda: [refinement.ScanPose(p.stamp_ns, np.eye(4), True) for p in placed],
    )  # fmt: skip


def refined(monkeypatch, T_map_odom, tilts=None, deviations=(0.1,) * 4):
    """Poses, of a bundle that knows them as well from each side's beginning to its end [m]."""
    covariances = np.array([np.eye(4) * deviation**2 for deviation in deviations])
    found = Refined(T_map_odom, np.zeros((5, 2)) if tilts is None else tilts, covariances)
    monkeypatch.setattr(refinement, "refined", lambda *_: found)
    tracker = square()
    return tracker, refinement.refined_poses(tracker, Params().scan_filter)


def test_loops_that_agree_change_nothing(monkeypatch):
    tracker, poses = refined(monkeypatch, np.broadcast_to(np.eye(4), (5, 4, 4)))
    for pose in poses:
        np.testing.assert_allclose(pose.T_map_odom, np.eye(4), atol=1e-6)
    assert refinement.disagreed(tracker, poses) == 0.0


def test_a_loop_brings_the_end_back(monkeypatch):
    drifted = np.array([planar(0.05 * k, 0.0, 0.0) for k in range(5)])
    _, poses = refined(monkeypatch, drifted)
    away = [np.hypot(*pose.T_map_odom[:2, 3]) for pose in poses[::2]]
    assert away[0] == pytest.approx(0.0, abs=1e-6)
    assert away[4] == pytest.approx(0.0, abs=1e-3)
    assert max(away) < 0.15


def test_what_a_loop_brings_back_is_taken_where_nothing_told_how_far_the_robot_came(monkeypatch):
    drifted = np.array([planar(0.2 if k > 2 else 0.0, 0.0, 0.0) for k in range(5)])
    _, poses = refined(monkeypatch, drifted, deviations=(0.002, 0.002, 0.2, 0.002))
    away = [np.hypot(*pose.T_map_odom[:2, 3]) for pose in poses]  # also between the keyframes
    np.testing.assert_allclose(away, 0.0, atol=0.005)


@pytest.mark.parametrize("loops_closed", [0, 1])
def test_all_poses_begin_where_scan_after_scan_has_led_unless_loops_were_closed(
    monkeypatch, loops_closed
):
    """Where refinements have moved the submaps to, these agree with their own errors."""
    begun = []

    def bundle(_, T_map_odom, *__):
        begun.append(T_map_odom)
        return Refined(np.array(T_map_odom), np.zeros((5, 2)), np.array([np.eye(4)] * 4))

    monkeypatch.setattr(refinement, "refined", bundle)
    tracker, moved = square(), planar(1.0, 1.0, 0.5)
    tracker.loops_closed = loops_closed
    led = [planar(0.1 * k, 0.0, 0.0) for k in range(5)]
    tracker.keyframes = [
        keyframe._replace(T_map_odom=T, T_submap_odom=moved)
        for keyframe, T in zip(tracker.keyframes, led, strict=True)
    ]
    refinement.refined_poses(tracker, Params().scan_filter)
    np.testing.assert_array_equal(begun[0], [moved] * 5 if loops_closed else led)


def test_scans_between_keyframes_share_in_both(monkeypatch):
    moved = np.array([planar(0.0, 0.1 * k, 0.0) for k in range(5)])
    monkeypatch.setattr(
        refinement, "_looped", lambda _tracker, _before, found, _marks: found.T_map_odom
    )
    tilts = np.column_stack([0.01 * np.arange(5), np.zeros(5)])
    _, poses = refined(monkeypatch, moved, tilts)
    half = poses[1].T_map_odom  # 2 m of the 4 m to the next keyframe
    assert half[1, 3] == pytest.approx(0.05)
    assert se3.to_xyz_rpy(half)[3] == pytest.approx(0.005, abs=1e-6)


def test_where_the_bundle_moves_the_robot_far_is_told(monkeypatch):
    moved = np.array([planar(0.0, 0.0, 0.0)] * 3 + [planar(0.0, 1.0, 0.0)] * 2)
    monkeypatch.setattr(
        refinement, "_looped", lambda _tracker, _before, found, _marks: found.T_map_odom
    )
    tracker, poses = refined(monkeypatch, moved)
    assert 4.0 <= refinement.disagreed(tracker, poses) <= 10.0


def test_of_level_lasers_alone_poses_stay_as_localization_has_found_them(monkeypatch):
    monkeypatch.setattr(refinement, "refined", lambda *_: pytest.fail("nothing is to be refined"))
    tracker = square()
    tracker.is_level = True
    found = refinement.refined_poses(tracker, Params().scan_filter)
    np.testing.assert_array_equal(
        [pose.T_map_odom for pose in found], np.eye(4)[None].repeat(10, 0)
    )


def driven(steps, roll, pitch, turns=0.0):
    """Poses of a drive ahead, by steps [m] and turns [rad], and with these tilts [rad]."""
    values = np.zeros((len(steps), 6))
    values[:, 0], values[:, 5] = np.cumsum(steps), np.cumsum(np.broadcast_to(turns, len(steps)))
    values[:, 3], values[:, 4] = roll, pitch
    return se3.from_xyz_rpy(values)


def test_an_inclinometer_that_wanders_while_the_robot_stands_tilts_no_scan():
    wandering = np.radians(0.3) * np.random.default_rng(1).normal(size=(2, 400))
    standing = driven(np.zeros(400), *wandering)
    tilts = se3.to_xyz_rpy(refinement.with_steady_tilts(standing))[:, 3:5]
    np.testing.assert_allclose(tilts, wandering.mean(axis=1)[None].repeat(400, 0), atol=1e-12)


def test_ground_that_bends_evenly_keeps_its_tilts():
    steps = np.full(200, 0.01)
    pitch = 0.2 * np.cumsum(steps)
    steady = se3.to_xyz_rpy(refinement.with_steady_tilts(driven(steps, -pitch, pitch)))
    np.testing.assert_allclose(steady[15:-15, 3], -pitch[15:-15], atol=2e-4)
    np.testing.assert_allclose(steady[15:-15, 4], pitch[15:-15], atol=2e-4)


def test_tilts_of_places_that_are_farther_apart_do_not_mix():
    pitch = np.where(np.arange(40) < 20, 0.0, 0.3)
    for steps, turns in ((np.full(40, 0.15), 0.0), (np.zeros(40), 0.3), (np.full(40, 1e9), 0.0)):
        found = se3.to_xyz_rpy(refinement.with_steady_tilts(driven(steps, 0.0, pitch, turns)))
        np.testing.assert_allclose(found[:, 4], pitch, atol=1e-6)


@given(
    fives=arrays(np.int64, 30, elements=st.integers(0, 10)),
    tilts=arrays(np.float64, (2, 30), elements=st.floats(-0.3, 0.3)),
)
def test_steady_tilts_are_means_weighted_by_how_near_scans_are(fives, tilts):
    given_poses = driven(0.005 * fives, *tilts)
    found = se3.to_xyz_rpy(refinement.with_steady_tilts(given_poses))
    at = np.cumsum(fives)
    for scan in range(30):
        weights = [max(0.0, 1.0 - abs(at[scan] - other) / 21.0) for other in at]
        for angle in (0, 1):
            assert found[scan, 3 + angle] == pytest.approx(
                np.average(tilts[angle], weights=weights), abs=1e-9
            )
    others = [0, 1, 2, 5]
    np.testing.assert_allclose(found[:, others], se3.to_xyz_rpy(given_poses)[:, others], atol=1e-12)
