# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Patches of the surface, which are not known either, and what they tell of poses together.

Returns of all poses of a drive are sorted into cubes. Where those of a cube are of one plane, each
is held to it, with the plane's offset and its tilts as unknowns of their own. These are eliminated
from the normal equations (Schur complement), so that what remains is what returns tell of poses
*beside one another*, as in the bundle adjustment of planes (Liu and Zhang 2021, BALM).

What a level laser sees of a wall and of a slope looks the same: a row at one height. A row is taken
for a wall, unless it moves up the slope by more than the robot's pitch would move it on a wall.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import inlined_kernel, kernel

STATES = 7
"""Of each pose in the normal equations: x, y, yaw, z, roll, pitch, slip."""

_SIZES = (0.25, 0.5)  # [m] sides of the cubes
_LEAST_RETURNS = 12
_LEAST_INLIERS = 0.6  # share of the returns
_FITS = 3
_MOST_ACROSS = 0.03  # [m] standard deviation across a patch
_SMEARED = 0.5  # of the tolerance: likewise, while poses are not yet found
_ROW = 0.015  # [m] added to the heights' standard deviation: a row of returns stands upright
_LEAST_LONG = 0.04  # [m] standard deviation along a patch
_LEAST_FLATNESS = 4.0  # variance along the shorter axis of a patch over that across it
_BEHIND = 0.1  # sine of the angle from a beam to a patch, above which it was seen from behind
_GRAZING = 0.03  # sine of the angle from a beam to a patch, below which its range tells nothing
_RANGE_ERROR = 0.06  # [m] at most: what is farther from a patch than by that is so for its pose
_PARALLEL = 0.05  # mean sine of the angle from beams to what may be a patch that they have seen
_STEEP = 0.7  # vertical component of the normal, up to which a patch is steep
_NOISE, _GROUND_NOISE = 0.015, 0.025  # [m] of a return from a patch that is steep, or not
_CONTACT = 64.0  # returns that a wheel counts as: its height errs by 1 cm, and alone
_FREE = (1e-3, 1.0, 1.0)  # precision of offset [1/m^2] and tilts [1/rad^2], for an inverse


class NormalEquations(NamedTuple):
    """Of the errors of poses: ``matrix @ errors + gradient = 0``.

    Attributes
    ----------
    matrix : (D, D) float64
        `STATES` rows for each pose, and as many of what is common to all, of which the first is
        the height of the robot above the ground. It is symmetric: what is below the diagonal is
        not used.
    gradient : (D,) float64
    """

    matrix: Array
    gradient: Array

    @classmethod
    def zero(cls, size: int) -> NormalEquations:
        """Without any information."""
        return cls(np.zeros((size, size)), np.zeros(size))


class Returns(NamedTuple):
    """Returns of all poses.

    Attributes
    ----------
    seen : (N, 3) float64 [m]
        From the robot, along the axes of the map.
    beams : (N, 3) float64
        Directions along which they were seen, of length one.
    pose_of : (N,) int64
        From which pose each was seen.
    is_contact : (N,) bool
        Where a wheel stands; the beam is down, and the height of the robot above it is unknown.
    """

    seen: Array
    beams: Array
    pose_of: NDArray[np.int64]
    is_contact: NDArray[np.bool_]


def add_patches(
    returns: Returns, positions: Array, share: float, tolerance: float, equations: NormalEquations
) -> int:
    """Add what returns tell of the poses that they were seen from.

    Parameters
    ----------
    returns : Returns
    positions : (P, 3) float64 [m, map]
        Of the robot.
    share : float
        Of its information that a return counts, since returns of a moment err alike.
    tolerance : float [m]
        Distance from a patch at which returns count little (Geman-McClure).
    equations : NormalEquations
        To which it is added.

    Returns
    -------
    int
        Number of patches.
    """
    at = returns.seen + positions[returns.pose_of]
    most_across = max(_MOST_ACROSS, _SMEARED * tolerance)
    settings = share / len(_SIZES), tolerance**2, most_across**2
    used = 0
    for size, shift in itertools.product(_SIZES, (0.0, 0.5)):  # what a border cuts is whole once
        order, starts = by_cube(at / size + shift, returns.pose_of)
        ordered = tuple(part[order] for part in returns)
        used += _add(
            at[order], ordered, starts, settings, equations, STATES * len(positions),
        )  # fmt: skip
    return used


def by_cube(at: Array, pose_of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order of returns by cube and pose, and where each cube begins; the last one ends there.

    Parameters
    ----------
    at : (N, 3) float64
        In sides of the cubes.
    pose_of : (N,) int64
    """
    index = np.floor(at).astype(np.int64)
    index -= index.min(axis=0)
    cube = np.ravel_multi_index(tuple(index.T), tuple(index.max(axis=0) + 1))
    order = np.lexsort((pose_of, cube))
    starts = np.flatnonzero(np.diff(cube[order], prepend=-1, append=-1))
    return order, starts


@kernel
def _add(at, returns, starts, settings, equations, height):
    seen, beams, pose_of, is_contact = returns
    weights = np.empty(len(at))
    centre, spread, axes = np.empty(3), np.empty(3), np.empty((3, 3))
    used = 0
    for cube in range(len(starts) - 1):
        first, end = starts[cube], starts[cube + 1]
        if end - first < _LEAST_RETURNS or pose_of[first] == pose_of[end - 1]:
            continue
        part = at[first:end]
        if _fit(
            part, beams[first:end], pose_of[first:end], settings[1:], weights[: end - first],
            centre, spread, axes,
        ):  # fmt: skip
            add_patch(
                part, seen[first:end], beams[first:end], pose_of[first:end], is_contact[first:end],
                centre, spread[0], axes, settings, equations, height,
            )  # fmt: skip
            used += 1
    return used


@kernel
def _fit(at, beams, pose_of, limits, weights, centre, spread, axes):
    """Whether returns are of one patch; its centre, the axes (rows), the variances along them.

    The first axis is the normal, to where most returns were seen from. What was seen from behind is
    of another surface: the other face of a thin wall. A plane along which beams run is none that
    they can have seen: it is a row at the height of a level laser, smeared by what poses err. The
    normal of a row is that of each pose's own line.
    """
    tolerance, most_across = limits
    own, is_row, in_front = np.empty((len(at), 3)), False, len(at)
    weights[:] = 1.0
    for fit in range(_FITS + 2):
        total = weights.sum()
        centre[:] = 0.0
        for i in range(len(at)):
            centre += weights[i] / total * at[i]
        if is_row:
            _centres(at, pose_of, own)
        else:
            own[:] = centre
        _axes(at, own, weights, spread, axes)
        _turn_to_front(beams, weights, axes)
        in_front = 0
        for i in range(len(at)):
            distance = np.dot(axes[0], at[i] - centre)
            weights[i] = 1.0 / (1.0 + distance**2 / tolerance) ** 2
            if np.dot(axes[0], beams[i]) > _BEHIND:
                weights[i] = 0.0
            else:
                in_front += 1
        if fit == _FITS - 1:
            sine = 0.0
            for i in range(len(at)):
                sine += weights[i] / total * abs(np.dot(axes[0], beams[i]))
            is_row = sine < _PARALLEL
            if not is_row:
                break
            weights[:] = 1.0
    spread[0] = max(spread[0] - (_ROW * axes[0, 2]) ** 2, 0.0)
    return (
        in_front >= _LEAST_RETURNS
        and total >= _LEAST_INLIERS * in_front
        and spread[0] <= most_across
        and (is_row or spread[1] >= _LEAST_FLATNESS * spread[0])
        and spread[2] >= max(_LEAST_LONG**2, _LEAST_FLATNESS * spread[0])
    )


@inlined_kernel
def _axes(at, centres, weights, spread, axes):
    """Principal axes of returns about their centres, upright ones if they are a row."""
    scatter, total = np.zeros((3, 3)), weights.sum()
    for i in range(len(at)):
        for a in range(3):
            for b in range(3):
                scatter[a, b] += (
                    weights[i] / total * (at[i, a] - centres[i, a]) * (at[i, b] - centres[i, b])
                )
    scatter[2, 2] += _ROW**2
    values, columns = np.linalg.eigh(scatter)
    spread[:], axes[:, :] = values, columns.T


@inlined_kernel
def _turn_to_front(beams, weights, axes):
    """Turn the normal against the beams, or most of them."""
    along = 0.0
    for i in range(len(beams)):
        along += weights[i] * np.dot(axes[0], beams[i])
    if along > 0.0:
        axes[0] *= -1.0


@inlined_kernel
def _centres(at, pose_of, centres):
    """Of each return the mean of all of its pose."""
    first = 0
    for end in range(1, len(at) + 1):
        if end == len(at) or pose_of[end] != pose_of[first]:
            for a in range(3):
                centres[first:end, a] = at[first:end, a].mean()
            first = end


@kernel
def add_patch(  # noqa: C901, PLR0913
    at, seen, beams, pose_of, is_contact, centre, across, axes, settings, equations, height,
):  # fmt: skip
    """Hold returns to a patch whose offset and tilts are eliminated."""
    matrix, gradient = equations
    share, tolerance, _ = settings
    poses = _count(pose_of)
    # The last one stands for what all poses have in common, of which the first is the height.
    common, of_pose = np.zeros((poses + 1, 6, 3)), np.zeros((poses + 1, 6))
    of_patch, patch_gradient = np.diag(np.array(_FREE)), np.zeros(3)
    numbers = np.empty(poses + 1, np.int64)
    numbers[poses] = height // STATES
    row, patch_row = np.empty(6), np.empty(3)
    noise = _NOISE if abs(axes[0, 2]) < _STEEP else _GROUND_NOISE
    information, k = share / (noise**2 + across), -1
    for i in range(len(at)):
        if k < 0 or pose_of[i] != numbers[k]:
            k += 1
            numbers[k] = pose_of[i]
        if np.dot(axes[0], beams[i]) > _BEHIND:
            continue
        residual = _rows(at[i] - centre, seen[i], beams[i], axes, row, patch_row)
        weight = information / (1.0 + residual**2 / tolerance) ** 2
        weight *= _CONTACT if is_contact[i] else 1.0
        begin = STATES * pose_of[i]
        for a in range(6):
            of_pose[k, a] += weight * row[a] * residual
            for b in range(6):
                matrix[begin + a, begin + b] += weight * row[a] * row[b]
            for b in range(3):
                common[k, a, b] += weight * row[a] * patch_row[b]
        for a in range(3):
            patch_gradient[a] += weight * patch_row[a] * residual
            for b in range(3):
                of_patch[a, b] += weight * patch_row[a] * patch_row[b]
        if is_contact[i]:
            lower = np.dot(axes[0], beams[i])
            of_pose[poses, 0] += weight * lower * residual
            common[poses, 0] += weight * lower * patch_row
            matrix[begin : begin + 6, height] += weight * lower * row
            matrix[height, height] += weight * lower**2
    inverse = np.linalg.inv(of_patch)
    for k in range(poses + 1):
        eliminated = common[k] @ inverse
        begin = STATES * numbers[k]
        gradient[begin : begin + 6] += of_pose[k] - eliminated @ patch_gradient
        for j in range(k, poses + 1):
            _subtract(eliminated, common[j], matrix, begin, STATES * numbers[j])


@inlined_kernel
def _subtract(one, other, matrix, row, column):
    """Subtract the product of one (6, 3) and the other (6, 3) transposed from a block."""
    for a in range(6):
        for b in range(6):
            matrix[row + a, column + b] -= (
                one[a, 0] * other[b, 0] + one[a, 1] * other[b, 1] + one[a, 2] * other[b, 2]
            )


@inlined_kernel
def _count(pose_of):
    """How many poses there are in a sorted list."""
    return 1 + np.count_nonzero(pose_of[1:] != pose_of[:-1])


@inlined_kernel
def _rows(at, seen, beam, axes, row, patch_row):
    """Distance of a return from its patch; how the errors of pose and patch change it.

    Ranges err along the beam, so that a return which is below the ground is also too far ahead.
    Rows are those of where the beam meets the patch: the return's own place errs with the distance,
    and where beams graze the surface this would draw all poses together.
    """
    normal = axes[0]
    distance = normal[0] * at[0] + normal[1] * at[1] + normal[2] * at[2]
    sine = normal[0] * beam[0] + normal[1] * beam[1] + normal[2] * beam[2]
    beyond = distance * sine / (sine**2 + _GRAZING**2)
    beyond = min(max(beyond, -_RANGE_ERROR), _RANGE_ERROR)
    x, y, z = at[0] - beyond * beam[0], at[1] - beyond * beam[1], at[2] - beyond * beam[2]
    u, v = seen[0] - beyond * beam[0], seen[1] - beyond * beam[1]
    row[0], row[1], row[3] = normal[0], normal[1], normal[2]
    row[2] = normal[1] * u - normal[0] * v
    row[4], row[5] = normal[2] * v, -normal[2] * u
    patch_row[0] = -1.0
    patch_row[1] = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
    patch_row[2] = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
    return distance
