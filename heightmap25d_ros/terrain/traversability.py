# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The obstacle map of a dense height map: blocked transitions, obstacles and cost.

- A *transition* between known 8-neighbours is blocked when their heights differ by more than
  ``max_step``, up or down.
- A known cell is *occupied* when it is the upper end of a blocked transition (a wall occupies its
  own cells, a cliff its edge), or when the ground under a footprint centred on it is steeper than
  ``max_slope``.
- The *cost* of a free cell is the largest of three ratios: the largest step to a neighbour over
  ``max_step``, the gradient under the footprint over that of ``max_slope``, the roughness there
  over ``max_roughness``. Cells within ``robot_radius`` of an occupied one are inflated: a robot
  with its centre there touches it.
- An unknown cell in which a drop-off is suspected has the cost of an occupied one.
- In a map of level lasers alone, every known cell is occupied, and no ground is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Geometry, HeightMap
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.params.sections import TraversabilityParams
from heightmap25d_ros.terrain.ground_plane import Footprint, footprint, inflate, planes
from heightmap25d_ros.terrain.steps import (
    cropped,
    padded_surface,
    step_obstacles,
    transitions,
)

OCCUPIED = 100
"""Occupancy and cost of a cell that cannot be entered."""

INFLATED = 99
"""Cost of a free cell at which the robot would touch an occupied one."""

STEEPEST = 98
"""Cost of a free cell at a limit of step, slope or roughness."""

LARGEST_RADIUS = 100
"""Largest radius of the footprint [cells]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleMap:
    """A dense rectangle of the obstacle grid.

    Attributes
    ----------
    geometry : Geometry
    occupancy : (rows, columns) int8
        -1: unknown, 0: free, 100: occupied; not inflated.
    cost : (rows, columns) int8
        -1: unknown, 0 .. 98: free, 99: inflated, 100: occupied, or unknown where a drop-off is
        suspected.
    blocked : (rows, columns) uint8
        Bit k: the transition to ``NEIGHBOURS[k]`` is blocked.
    """

    geometry: Geometry
    occupancy: NDArray[np.int8]
    cost: NDArray[np.int8]
    blocked: NDArray[np.uint8]


def blocked_transitions(
    height: NDArray[np.int16], known: NDArray[np.bool_], max_step_cm: int
) -> NDArray[np.uint8]:
    """The steps to the 8 neighbours that are too high, up or down.

    Parameters
    ----------
    height : (rows, columns) int16 [cm]
    known : (rows, columns) bool
    max_step_cm : int [cm]

    Returns
    -------
    (rows, columns) uint8
        Bit k: the transition to ``NEIGHBOURS[k]``. Transitions of unknown cells are not blocked.

    Examples
    --------
    A step between two cells of a row:

    >>> blocked_transitions(np.array([[0, 11]], np.int16), np.ones((1, 2), bool), 10)
    array([[ 1, 16]], dtype=uint8)
    """
    blocked, _ = transitions(padded_surface(height, known, 1), max_step_cm)
    return cropped(blocked, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Properties of the ground of a dense map, from which obstacles and costs follow.

    Attributes
    ----------
    blocked : (rows, columns) uint8
        Bit k: the transition to ``NEIGHBOURS[k]`` is blocked.
    step : (rows, columns) int16 [cm]
        Largest difference to a neighbour whose transition is open.
    gradient : (2, rows, columns) float32 [cm per cell]
        Of the ground under the footprint, along x and along y; 0 where unknown.
    roughness : (rows, columns) float32 [cm]
        Of the ground under the footprint.
    """

    blocked: NDArray[np.uint8]
    step: NDArray[np.int16]
    gradient: NDArray[np.float32]
    roughness: NDArray[np.float32]


def analyse_ground(height_map: HeightMap, params: TraversabilityParams) -> Ground:
    """The ground of a dense map; all cells beyond the map are unknown.

    Raises
    ------
    InputError
        If the robot's radius is more than 100 cells.
    """
    disc = covering_disc(params, height_map.geometry.resolution)
    margin = max(disc.radius, 1)
    max_step_cm = _whole(params.max_step / HEIGHT_RESOLUTION)
    surface = padded_surface(height_map.height, height_map.known, margin)
    blocked, step = transitions(surface, max_step_cm)
    gradient, roughness = planes(surface, blocked, disc, max_step_cm)
    return Ground(
        blocked=cropped(blocked, margin),
        step=cropped(step, margin),
        gradient=np.stack([cropped(part, margin) for part in gradient]),
        roughness=cropped(roughness, margin),
    )


def to_obstacle_map(
    height_map: HeightMap,
    params: TraversabilityParams | None = None,
    ground: Ground | None = None,
) -> ObstacleMap:
    """Obstacles and cost of a dense map; all cells beyond the map are unknown.

    Parameters
    ----------
    height_map : HeightMap
    params : TraversabilityParams, optional
    ground : Ground, optional
        The result of `analyse_ground` for the two, if it has been computed already.

    Raises
    ------
    InputError
        If the robot's radius is more than 100 cells.

    Examples
    --------
    A step of 0.5 m; the obstacle is its upper end:

    >>> to_obstacle_map(HeightMap.from_metres([[0.0, 0.0, 0.5]])).occupancy
    array([[  0,   0, 100]], dtype=int8)
    """
    params = params or TraversabilityParams()
    if height_map.is_level:
        return _walls_alone(height_map)
    ground = analyse_ground(height_map, params) if ground is None else ground
    max_step_cm = _whole(params.max_step / HEIGHT_RESOLUTION)
    cell_cm = height_map.geometry.resolution / HEIGHT_RESOLUTION
    max_gradient = math.tan(params.max_slope) * cell_cm
    max_roughness = params.max_roughness / HEIGHT_RESOLUTION
    occupancy = step_obstacles(height_map.height, height_map.known, max_step_cm)
    cost = np.empty(occupancy.shape, np.int8)
    scales = tuple(STEEPEST / limit for limit in (max_step_cm, max_gradient, max_roughness))
    slopes = ground.gradient[0], ground.gradient[1]
    _grade(ground.step, *slopes, ground.roughness, scales, occupancy, cost)
    suspected = height_map.suspected
    if params.drop_offs != "none" and suspected.any():
        cost[suspected] = OCCUPIED
    disc = covering_disc(params, height_map.geometry.resolution)
    return ObstacleMap(
        geometry=height_map.geometry,
        occupancy=occupancy,
        cost=inflate(cost, disc, occupied=OCCUPIED, inflated=INFLATED),
        blocked=ground.blocked,
    )


def _walls_alone(height_map: HeightMap) -> ObstacleMap:
    """What level lasers have seen stands; of the ground nothing is known."""
    occupancy = np.where(height_map.known, np.int8(OCCUPIED), np.int8(-1))
    return ObstacleMap(
        geometry=height_map.geometry, occupancy=occupancy, cost=occupancy.copy(),
        blocked=np.zeros(occupancy.shape, np.uint8),
    )  # fmt: skip


def _whole(quantity: float) -> int:
    """Whole units in a quantity, robust against rounding (0.29 / 0.01 is 28.999...)."""
    return math.floor(quantity + 1e-6)


def covering_disc(params: TraversabilityParams, resolution: float) -> Footprint:
    """The disc that covers the robot, in cells.

    Raises
    ------
    InputError
        If its radius is more than `LARGEST_RADIUS`.
    """
    cells = params.robot_radius / resolution
    if cells > LARGEST_RADIUS:
        raise InputError(
            f"parameter traversability.robot_radius: {params.robot_radius:g} m is more than "
            f"{LARGEST_RADIUS} cells of {resolution:g} m"
        )
    return footprint(_whole(cells**2))


@kernel
def _grade(step, gradient_x, gradient_y, roughness, scales, occupancy, cost):
    for y in range(cost.shape[0]):
        for x in range(cost.shape[1]):
            slope = math.sqrt(gradient_x[y, x] ** 2 + gradient_y[y, x] ** 2) * scales[1]
            occupied = (occupancy[y, x] == OCCUPIED) | (slope > STEEPEST)
            share = max(slope, roughness[y, x] * scales[2], step[y, x] * scales[0])
            graded = np.int8(min(share, np.float64(STEEPEST)))
            graded = np.int8(OCCUPIED) if occupied else graded
            cost[y, x] = np.int8(-1) if occupancy[y, x] < 0 else graded
            occupancy[y, x] = np.int8(OCCUPIED) if occupied else occupancy[y, x]
