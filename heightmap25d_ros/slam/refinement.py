# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a whole drive after its end: all of them together, then the loops once more.

The shape of the drive comes from the bundle (`bundle`); where it closed loops, its submaps are
moved again to where the loops have them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.params.sections import ScanFilterParams
from heightmap25d_ros.slam.bundle import Refined, refined
from heightmap25d_ros.slam.map_pass import ScanPose, is_apart
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker
from heightmap25d_ros.slam.pose_graph import Edge, PoseGraph, between

_STEADY, _PLACE = 0.1, 0.005  # [m] of way, on either side; in which scans count as one
_RADIAN = 0.5  # [m] of way that wheels go while the robot turns by a radian
_LEAST_EDGE = np.diag(np.square([0.005, 0.005, 0.001, 0.002]))  # covariance of a submap's length


def refined_poses(tracker: OwnMapTracker, params: ScanFilterParams) -> list[ScanPose]:
    """Where each scan of a drive that is finished was taken.

    Of level lasers alone that is where localization on the own map has found it: each scan is held
    against the last metres as a whole already, and there are no tilts to be found.

    Parameters
    ----------
    tracker : OwnMapTracker
        That was recording.
    params : ScanFilterParams
    """
    keyframes = tracker.keyframes
    if len(keyframes) < 2 or tracker.is_level:
        return tracker.poses()
    before = np.array([
        tracker.submaps[keyframe.submap].T_map_submap @ keyframe.T_submap_odom
        for keyframe in keyframes
    ])  # fmt: skip
    marks = _submap_begins(tracker)
    # What was refined while the robot drove agrees with itself, also where it is wrong, and is hard
    # to leave: so all begins anew where scan after scan has led, unless loops have confirmed it.
    led = np.array([keyframe.T_map_odom for keyframe in keyframes])
    found = refined(keyframes, before if tracker.loops_closed else led, params, marks)
    if tracker.loops_closed:
        # What was too far off to be seen as one surface may be near enough now.
        found = refined(keyframes, _looped(tracker, before, found, marks), params, marks, found)
        found = found._replace(T_map_odom=_looped(tracker, before, found, marks))
    return _between_keyframes(tracker, found)


def disagreed(tracker: OwnMapTracker, poses: Sequence[ScanPose]) -> float:
    """Distance [m] travelled where refined poses are not what localization has found (`is_apart`).

    Parameters
    ----------
    tracker : OwnMapTracker
    poses : sequence of ScanPose
        Of all scans of its drive.
    """
    T_odom_base = np.array([placed.T_odom_base for placed in tracker.placed])
    T_odom_wheels = np.array([placed.T_odom_wheels for placed in tracker.placed])
    T_wheels_base = se3.inverse(T_odom_wheels) @ T_odom_base
    steps = np.diff(_distances(T_odom_base), append=np.inf)[:-1]
    apart = [
        is_apart(before.T_map_odom @ T, after.T_map_odom @ T)
        for before, after, T in zip(tracker.poses(), poses, T_wheels_base, strict=True)
    ]
    return float(steps[apart[1:]].sum())


def _submap_begins(tracker: OwnMapTracker) -> list[int]:
    """The first keyframe of each submap; of the one before, where it has none."""
    first, found = 0, []
    submap_of = [keyframe.submap for keyframe in tracker.keyframes]
    for number in range(len(tracker.submaps)):
        first = submap_of.index(number) if number in submap_of else first
        found.append(first)
    return found


def _looped(
    tracker: OwnMapTracker, before: se3.Matrix, found: Refined, marks: Sequence[int]
) -> se3.Matrix:
    """Poses (K, 4, 4) at the keyframes, with the submaps moved to where the loops have them.

    Along the drive they are joined by what the bundle has found, as well as it knows it: what the
    loops do not agree with is taken where nothing told how far the robot came.
    """
    graph = PoseGraph()
    for first, submap in zip(marks, tracker.submaps, strict=True):
        moved = found.T_map_odom[first] @ se3.inverse(before[first])
        graph.add(_planar(moved @ submap.T_map_submap @ submap.start))
    shape = graph.poses
    for k, covariance in enumerate(found.covariances):
        measured = between(shape[k], shape[k + 1])
        graph.join(Edge(k, k + 1, measured, np.linalg.inv(covariance + _LEAST_EDGE)))
    for edge in tracker.graph.edges:
        if edge.is_loop:
            graph.join(edge)
    graph.optimise()
    moves = np.array([_motion(*poses) for poses in zip(shape, graph.poses, strict=True)])
    T_odom_base = np.array([keyframe.T_odom_base for keyframe in tracker.keyframes])
    number, share = _shares(_distances(T_odom_base), marks)
    poses = found.T_map_odom @ T_odom_base
    following = np.minimum(number + 1, len(moves) - 1)
    moved = [
        _partly(one, other, part)
        for one, other, part in zip(
            moves[number] @ poses, moves[following] @ poses, share, strict=True
        )
    ]
    return np.array(moved) @ se3.inverse(T_odom_base)


def _shares(along: Array, marks: Sequence[int]) -> tuple[NDArray[np.int64], Array]:
    """Which mark each place is after, and how far it is on the way to the next one, 0 to 1."""
    places = np.arange(len(along))
    number = np.maximum(np.searchsorted(marks, places, side="right") - 1, 0)
    begins = along[np.append(marks, len(along) - 1)]
    length = np.maximum(begins[number + 1] - begins[number], 1e-9)
    return number, np.clip((along - begins[number]) / length, 0.0, 1.0)


def _between_keyframes(tracker: OwnMapTracker, found: Refined) -> list[ScanPose]:
    """Poses of all scans, as far along from one keyframe to the next as they are in odom."""
    T_odom_base = np.array([placed.T_odom_base for placed in tracker.placed])
    scans = [keyframe.scan for keyframe in tracker.keyframes]
    left, share = _shares(_distances(T_odom_base), scans)
    right = np.minimum(left + 1, len(scans) - 1)
    tilts = found.tilts[left] + share[:, None] * (found.tilts[right] - found.tilts[left])
    T_map_base = np.empty_like(T_odom_base)
    for i, (k, j, part, tilt) in enumerate(zip(left, right, share, tilts, strict=True)):
        one, other = found.T_map_odom[[k, j]] @ T_odom_base[i]
        between = _partly(one, other, part)
        T_map_base[i] = se3.tilt_about(between, tilt) @ between
    T_odom_wheels = np.array([placed.T_odom_wheels for placed in tracker.placed])
    T_map_odom = with_steady_tilts(T_map_base) @ se3.inverse(T_odom_base) @ T_odom_wheels
    return [
        ScanPose(placed.stamp_ns, T, placed.is_sure)
        for placed, T in zip(tracker.placed, T_map_odom, strict=True)
    ]


def with_steady_tilts(T_map_base: se3.Matrix) -> se3.Matrix:
    """Poses (N, 4, 4) of a drive with roll and pitch averaged over `_STEADY` of the way around.

    The error of an inclinometer wanders within fractions of a second, also while the robot stands;
    how the robot is tilted changes as its wheels come to other ground. (A cell keeps the highest
    of what it was told, and so each of these errors.)

    Parameters
    ----------
    T_map_base : (N, 4, 4) float64
        In the order of the drive, N >= 1.
    """
    xyz_rpy = se3.to_xyz_rpy(T_map_base)
    turns = np.abs(np.angle(np.exp(1j * np.diff(xyz_rpy[:, 5]))))
    steps = np.linalg.norm(np.diff(T_map_base[:, :3, 3], axis=0), axis=1) + _RADIAN * turns
    along = np.append(0.0, np.cumsum(np.minimum(steps, 2.0 * _STEADY)))
    place = np.rint(along / _PLACE).astype(np.int64)
    reach = round(_STEADY / _PLACE)
    weights = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1)
    scans, roll, pitch = (
        ndimage.correlate1d(np.bincount(place, of_scans), weights, mode="constant")[place]
        for of_scans in (np.ones(len(place)), *xyz_rpy[:, 3:5].T)
    )
    xyz_rpy[:, 3], xyz_rpy[:, 4] = roll / scans, pitch / scans
    return np.asarray(se3.from_xyz_rpy(xyz_rpy))


def _partly(one: se3.Matrix, other: se3.Matrix, part: float) -> se3.Matrix:
    """The pose (4, 4) that is a part of the way from one to another one, which is not far."""
    turn = part * se3.yaw(other @ se3.inverse(one))
    return np.asarray(se3.correction_about(one, part * (other - one)[:3, 3], turn) @ one)


def _distances(T_odom_base: se3.Matrix) -> Array:
    """(N,) [m]: travelled since the first of poses (N, 4, 4)."""
    steps = np.linalg.norm(np.diff(T_odom_base[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _planar(T_map_base: se3.Matrix) -> Array:
    """x, y, yaw, z (4,) of a pose (4, 4)."""
    x, y, z, _, _, yaw = se3.to_xyz_rpy(T_map_base)
    return np.array([x, y, yaw, z])


def _motion(before: Array, after: Array) -> se3.Matrix:
    """The motion (4, 4) that brings one x, y, yaw, z (4,) to another one."""
    x, y, yaw, z = before
    place = se3.from_xyz_rpy([x, y, z, 0.0, 0.0, yaw])
    u, v, turned, w = after
    return np.asarray(se3.from_xyz_rpy([u, v, w, 0.0, 0.0, turned]) @ se3.inverse(place))
