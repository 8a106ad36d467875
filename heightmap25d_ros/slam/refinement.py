# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a whole drive after its end: all of them together, then the loops once more.

The shape of the drive comes from the bundle (`bundle`); where it closed loops, its submaps are
moved again to where the loops have them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.params.sections import ScanFilterParams
from heightmap25d_ros.slam.bundle import Refined, refined
from heightmap25d_ros.slam.map_pass import ScanPose, is_apart
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker
from heightmap25d_ros.slam.pose_graph import PoseGraph, between


def refined_poses(tracker: OwnMapTracker, params: ScanFilterParams) -> list[ScanPose]:
    """Where each scan of a drive that is finished was taken.

    Parameters
    ----------
    tracker : OwnMapTracker
        That was recording.
    params : ScanFilterParams
    """
    keyframes = tracker.keyframes
    if len(keyframes) < 2:
        return tracker.poses()
    before = np.array([
        tracker.submaps[keyframe.submap].T_map_submap @ keyframe.T_submap_odom
        for keyframe in keyframes
    ])  # fmt: skip
    found = refined(keyframes, before, params)
    if tracker.loops_closed:
        found = found._replace(T_map_odom=_looped(tracker, before, found.T_map_odom))
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
    steps = np.diff(_distances(T_odom_base), append=np.inf)[:-1]
    apart = [
        is_apart(before.T_map_odom @ T, after.T_map_odom @ T)
        for before, after, T in zip(tracker.poses(), poses, T_odom_base, strict=True)
    ]
    return float(steps[apart[1:]].sum())


def _looped(tracker: OwnMapTracker, before: se3.Matrix, found: se3.Matrix) -> se3.Matrix:
    """Poses (K, 4, 4) at the keyframes, with the submaps moved to where the loops have them."""
    graph, first = PoseGraph(), 0
    submap_of = [keyframe.submap for keyframe in tracker.keyframes]
    for number, submap in enumerate(tracker.submaps):
        first = submap_of.index(number) if number in submap_of else first
        moved = found[first] @ se3.inverse(before[first])
        graph.add(_planar(moved @ submap.T_map_submap @ submap.start))
    shape = graph.poses
    for edge in tracker.graph.edges:
        measured = between(shape[edge.first], shape[edge.second])
        graph.join(edge if edge.is_loop else edge._replace(measured=measured))
    graph.optimise()
    moves = [_motion(*poses) for poses in zip(shape, graph.poses, strict=True)]
    return np.array([moves[number] @ T for number, T in zip(submap_of, found, strict=True)])


def _between_keyframes(tracker: OwnMapTracker, found: Refined) -> list[ScanPose]:
    """Poses of all scans, as far along from one keyframe to the next as they are in odom."""
    T_odom_base = np.array([placed.T_odom_base for placed in tracker.placed])
    along = _distances(T_odom_base)
    scans = np.array([keyframe.scan for keyframe in tracker.keyframes])
    numbers = np.arange(len(along))
    left = np.clip(np.searchsorted(scans, numbers, side="right") - 1, 0, len(scans) - 2)
    start, length = along[scans[left]], np.maximum(np.diff(along[scans])[left], 1e-9)
    share = np.clip((along - start) / length, 0.0, 1.0)
    tilts = found.tilts[left] + share[:, None] * (found.tilts[left + 1] - found.tilts[left])
    poses = []
    for placed, k, part, tilt in zip(tracker.placed, left, share, tilts, strict=True):
        one, other = (T @ placed.T_odom_base for T in found.T_map_odom[k : k + 2])
        turn = part * se3.yaw(other @ se3.inverse(one))
        T = se3.correction_about(one, part * (other - one)[:3, 3], turn) @ found.T_map_odom[k]
        T = _tilted(T @ placed.T_odom_base, tilt) @ T
        poses.append(ScanPose(placed.stamp_ns, T, placed.is_sure))
    return poses


def _tilted(T_map_base: se3.Matrix, tilt: Array) -> se3.Matrix:
    """The motion (4, 4) that tilts a pose (4, 4) by angles (2,) [rad] about x and y."""
    turn = se3.from_xyz_rpy([0.0, 0.0, 0.0, *tilt, 0.0])
    turn[:3, 3] = T_map_base[:3, 3] - turn[:3, :3] @ T_map_base[:3, 3]
    return turn


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
