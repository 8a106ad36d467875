# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Upright edges, and what they tell of poses together: ends of walls, corners of crates, jambs.

Along a wall nothing tells how far the robot came, but its end does. A level laser sees it as a jump
of its range: the nearer side is the edge. It is a point in x and y, which is not known either.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.slam.patches import STATES, NormalEquations, Returns, add_patch, by_cube

_LEVEL = 0.1  # vertical component of a beam at most: others end at upper and lower rims, too
_JUMP = 0.3  # [m] of the range, at least
_DENSE = 0.08  # [m] from the edge to the next return on its own side, at most
_STEEPER = 3.0  # times that, by which the jump is larger: no wall that beams graze
_NOTHING = 1e3  # [m] where no return is
_AREA = 0.5  # [m] side of the squares in which edges are the same one
_SHIFTS = 0.0, 0.5  # of their borders, in sides
_MOST_APART = 0.25  # [m] tolerance up to which they are
_LEAST_EDGES = 8  # of a square
_LEAST_INLIERS = 0.6  # share of these
_MOST_ACROSS = 0.03  # [m] standard deviation
_SMEARED = 0.5  # of the tolerance: likewise, while poses are not yet found
_INSIDE = 4.0  # standard deviations from the middle one


def edges_of(beams: Beams) -> Array:
    """(E, 3) float64 [m, the frame of the beams]: the edges between neighbouring beams."""
    way = beams.ends - beams.origins
    ranges = np.linalg.norm(way, axis=1)
    aimed = way / np.maximum(ranges, 1e-6)[:, None]
    is_solid = beams.is_hit & ~beams.is_lone
    ranges = np.where(beams.is_hit, ranges, _NOTHING)
    found, near = [np.empty((0, 3))], np.arange(1, len(ranges) - 1)
    for side in (1, -1):
        step = np.abs(ranges[near] - ranges[near - side])
        apart = np.linalg.norm(beams.ends[near] - beams.ends[near - side], axis=1)
        is_edge = is_solid[near] & is_solid[near - side] & (apart < _DENSE)
        is_edge &= ranges[near + side] - ranges[near] > _JUMP + _STEEPER * step
        edge = near[is_edge & (np.abs(aimed[near, 2]) < _LEVEL)]
        between = aimed[edge] + aimed[edge + side]
        between *= (ranges[edge] / np.linalg.norm(between, axis=1))[:, None]
        found.append(beams.origins[edge] + between)
    return np.concatenate(found)


def add_edges(
    edges: Returns, positions: Array, share: float, tolerance: float, equations: NormalEquations
) -> int:
    """Add what edges tell of the poses that they were seen from, once these are nearly right.

    Parameters
    ----------
    edges : Returns
        Of which only x and y count.
    positions : (P, 3) float64 [m, map]
        Of the robot.
    share, tolerance : float, float [m]
        As of `patches.add_patches`: also edges of a moment err alike, by where beams are.
    equations : NormalEquations
        To which it is added.

    Returns
    -------
    int
        Number of edges that were seen from several poses.
    """
    if tolerance > _MOST_APART or not len(edges.seen):
        return 0
    level = edges._replace(seen=edges.seen * (1.0, 1.0, 0.0), beams=np.zeros_like(edges.beams))
    at = level.seen + positions[edges.pose_of] * (1.0, 1.0, 0.0)
    most_across = max(_MOST_ACROSS, _SMEARED * tolerance)
    settings = share / len(_SHIFTS), tolerance**2, most_across**2
    used = 0
    for shift in _SHIFTS:  # what a border cuts is whole once
        order, starts = by_cube(at / _AREA + shift, edges.pose_of)
        ordered = tuple(part[order] for part in level)
        used += _add(
            at[order], ordered, starts, settings, equations, STATES * len(positions),
        )  # fmt: skip
    return used


@kernel
def _add(at, returns, starts, settings, equations, height):
    seen, beams, pose_of, is_contact = returns
    centre, axes = np.zeros(3), np.zeros((3, 3))
    used = 0
    for square in range(len(starts) - 1):
        first, end = starts[square], starts[square + 1]
        if end - first < _LEAST_EDGES or pose_of[first] == pose_of[end - 1]:
            continue
        part = at[first:end]
        centre[0], centre[1] = np.median(part[:, 0]), np.median(part[:, 1])
        across = _variance(part, centre, settings[2])
        if across > settings[2]:
            continue
        for a in range(2):  # along x and along y, as a patch that does not tilt
            axes[0] = 0.0
            axes[0, a] = 1.0
            add_patch(
                part, seen[first:end], beams[first:end], pose_of[first:end], is_contact[first:end],
                centre, across, axes, settings, equations, height,
            )  # fmt: skip
        used += 1
    return used


@kernel
def _variance(at, centre, most):
    """Of places about the middle one, along each axis; infinite if few of them are there."""
    total, inside = 0.0, 0
    for i in range(len(at)):
        apart = (at[i, 0] - centre[0]) ** 2 + (at[i, 1] - centre[1]) ** 2
        if apart < _INSIDE**2 * most:
            total, inside = total + apart, inside + 1
    is_one = inside >= max(_LEAST_EDGES, _LEAST_INLIERS * len(at))
    return 0.5 * total / inside if is_one else np.inf
