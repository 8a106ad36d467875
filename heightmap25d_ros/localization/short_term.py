# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Short-term maps: the robot's surroundings along its last metres, placed by odometry alone.

Errors of the odometry that are known are taken out: they would bend the map.
Several of staggered age are kept, as in Schultz and Adams (1998): when the oldest one is dropped,
the next one is mature already, and drift within one of them stays small.

Most of them are never looked at, while single scans are held to the map. So a short-term map keeps
what it is to be made of, and is made when it is asked for.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_grid import TILE, HeightGrid
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap, stored_probability
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.localization import surface
from heightmap25d_ros.localization.odometry_errors import corrected
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import GridParams, LevelsParams, Params

_RADIAN = 0.5  # [m] of travel equivalent to one radian of turning

_MOST_WAITING = 100_000
"""Beams that wait to be integrated into a map: of a laser at 75 Hz and 181 beams those of 7 s."""


@dataclass(frozen=True, slots=True)
class LocalCells:
    """The known cells of a short-term map.

    Attributes
    ----------
    xyz : (N, 3) float64 [m], odom
        Position of a cell's newest return at about its height, and its height; as of the robot's
        newest pose.
    is_edge : (N,) bool
        As in `surface.edges`.
    age : (N,) float64 [m]
        Distance travelled since that return.
    """

    xyz: NDArray[np.float64]
    is_edge: NDArray[np.bool_]
    age: NDArray[np.float64]


class ShortTermMap:
    """One map, in a grid centred on the position at which it was started.

    Its frame is odom as it was then, from which odom drifts away.

    Parameters
    ----------
    start : (3,) float64 [m], odom
        Position of the robot.
    distance, stamp_ns : float [m], int [ns]
        Distance travelled by the robot, and time, at the start of the map.
    params : Params
    """

    def __init__(
        self, start: NDArray[np.float64], distance: float, stamp_ns: int, params: Params
    ) -> None:
        self.distance, self.stamp_ns = distance, stamp_ns
        self._start = start
        self._T_start_odom = np.eye(4)
        self._params = params
        self._threshold = params.mapper.probability_threshold
        self._tolerance = round(params.mapper.height_tolerance / HEIGHT_RESOLUTION)
        self._edge_step = params.registration.edge_step
        self._waiting: deque[Callable[[], None]] = deque()  # motions and beams, in their order
        self._beams_waiting = 0

    def follow(self, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, errors: Array) -> None:
        """The robot moved by odometry, with errors (4,) as of `OdometryErrors.mean`."""
        self._waiting.append(partial(self._follow, T_odom_before, T_odom_base, errors))

    def integrate(self, beams: Beams, distance: float) -> None:
        """Integrate beams, in odom, taken at a distance travelled [m]."""
        self._waiting.append(partial(self._integrate, beams, distance))
        self._beams_waiting += len(beams.ends)
        while self._beams_waiting > _MOST_WAITING:
            self._waiting.popleft()()

    def _follow(self, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, errors: Array) -> None:
        self._T_start_odom = corrected(self._T_start_odom, T_odom_before, T_odom_base, errors)

    def _integrate(self, beams: Beams, distance: float) -> None:
        self._beams_waiting -= len(beams.ends)
        ends = se3.transform_points(self._T_start_odom, beams.ends) - self._start
        is_hit = beams.is_hit & ~beams.is_lone
        origins = se3.transform_points(self._T_start_odom, beams.origins) - self._start
        grid = self._mapper.grid
        self._mapper.integrate(replace(beams, origins=origins, ends=ends))
        _store_newest(
            ends, is_hit, distance - self.distance, grid.height.cells, grid.geometry.origin,
            grid.geometry.resolution, self._tolerance, self._newest,
        )  # fmt: skip

    @cached_property
    def _mapper(self) -> Mapper:
        params = self._params
        extent = 2.0 * (sources.max_range(params) + params.short_term.length)
        geometry = GridParams(resolution=params.grid.resolution, extent=extent)
        grid = HeightGrid(geometry, levels=LevelsParams(max_surfaces=1))
        return Mapper(grid, params.sensor, params.mapper)

    @cached_property
    def _newest(self) -> NDArray[np.float32]:
        """x, y and distance travelled of each cell's newest return; float32 suffices for this."""
        newest = np.zeros((*self._mapper.grid.geometry.shape, 3), np.float32)
        newest[:, :, 2] = -1.0
        return newest

    @property
    def _grid(self) -> HeightGrid:
        """The map as it is, with all that has waited."""
        while self._waiting:
            self._waiting.popleft()()
        return self._mapper.grid

    def height_map(self) -> HeightMap:
        """The map in its frame, on a lattice of its own, above a ground zero in whole metres."""
        height_map = self._grid.read(self._threshold)
        x, y, z = self._start
        geometry = height_map.geometry
        origin = (geometry.origin[0] + float(x), geometry.origin[1] + float(y))
        ground_zero = math.floor(z + 0.5)
        shift = np.int16(round((z - ground_zero) / HEIGHT_RESOLUTION))
        return replace(
            height_map,
            geometry=replace(geometry, origin=origin, ground_zero=float(ground_zero)),
            height=np.where(height_map.probability > 0, height_map.height + shift, 0).astype(
                np.int16
            ),
        )

    def local_cells(self, distance: float) -> LocalCells:
        """Its known cells, with their ages at a distance travelled [m]."""
        grid = self._grid
        area = grid.observed_area()
        height_map = grid.read(self._threshold, area)
        newest = self._newest[area.slices(grid.area)]
        is_used = height_map.known & (newest[:, :, 2] >= 0.0)
        # Not `HeightMap.metres`: edges are found in single precision, as on the long-term map.
        height = height_map.height * np.float32(HEIGHT_RESOLUTION)
        heights = np.where(height_map.known, height, np.float32(np.nan))
        xyz = np.column_stack([newest[is_used][:, :2], height[is_used]])
        T_odom_start = se3.inverse(self._T_start_odom)
        return LocalCells(
            xyz=se3.transform_points(T_odom_start, xyz.astype(np.float64) + self._start),
            is_edge=surface.edges(heights, self._edge_step)[is_used],
            age=distance - self.distance - newest[is_used][:, 2].astype(np.float64),
        )

    @property
    def known_cells(self) -> int:
        """Number of known cells."""
        grid = self._grid
        probability = grid.probability.read(grid.observed_area())
        return int((probability >= stored_probability(self._threshold)).sum())


@kernel
def _store_newest(ends, is_hit, distance, heights, corner, resolution, tolerance, newest):
    """Store the positions of returns whose height is about that of their cells."""
    for i in range(len(ends)):
        ix = int(np.floor((ends[i, 0] - corner[0]) / resolution))
        iy = int(np.floor((ends[i, 1] - corner[1]) / resolution))
        if not is_hit[i] or not (0 <= iy < newest.shape[0] and 0 <= ix < newest.shape[1]):
            continue
        height = heights[iy // TILE, ix // TILE, iy % TILE, ix % TILE]
        if abs(ends[i, 2] / HEIGHT_RESOLUTION - height) <= tolerance:
            newest[iy, ix, 0], newest[iy, ix, 1] = ends[i, 0], ends[i, 1]
            newest[iy, ix, 2] = distance


class ShortTermMaps:
    """Short-term maps of staggered age.

    Parameters
    ----------
    params : Params

    Attributes
    ----------
    params : Params
        Used by maps that are started from now on.
    errors : (4,) float64
        Of the odometry, as of `OdometryErrors.mean`: taken out of motions from now on.
    distance : float [m]
        Travelled so far, as of `distance_travelled`.
    """

    def __init__(self, params: Params) -> None:
        self.distance = 0.0
        self.params = params
        self.errors = np.zeros(4)
        self._stamp_ns = 0
        self._T_odom_base: se3.Matrix | None = None
        self._maps: list[ShortTermMap] = []

    def clear(self) -> None:
        """Drop all maps: past readings are not consistent with future ones."""
        self._maps.clear()
        self._T_odom_base = None

    def integrate(self, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int) -> None:
        """Integrate beams, in odom, taken at a pose (4, 4) of the robot."""
        params, T_odom_base = (
            self.params.short_term,
            T_odom_base.copy(),
        )  # not all of a scan's poses
        if self._T_odom_base is not None:
            self.distance += distance_travelled(self._T_odom_base, T_odom_base)
            for short_term_map in self._maps:
                short_term_map.follow(self._T_odom_base, T_odom_base, self.errors)
        self._T_odom_base, self._stamp_ns = T_odom_base, stamp_ns
        spacing = params.length / params.maps
        if self._maps and self.distance - self._maps[0].distance > params.length:
            self._maps.pop(0)
        if not self._maps or self.distance - self._maps[-1].distance >= spacing:
            self._maps.append(
                ShortTermMap(T_odom_base[:3, 3].copy(), self.distance, stamp_ns, self.params)
            )
        for short_term_map in self._maps:
            short_term_map.integrate(beams, self.distance)

    def mature(self) -> ShortTermMap | None:
        """The oldest map, if it is old enough and has enough known cells."""
        if not self._maps:
            return None
        oldest, params = self._maps[0], self.params.short_term
        is_old = (
            self.distance - oldest.distance >= params.mature_distance
            or self._stamp_ns - oldest.stamp_ns >= params.mature_time * 1e9
        )
        return oldest if is_old and oldest.known_cells >= params.mature_cells else None


def distance_travelled(T_before: se3.Matrix, T_after: se3.Matrix) -> float:
    """Distance [m] from a pose (4, 4) to the next; a radian of turning counts as half a metre.

    Examples
    --------
    >>> half_turn = se3.from_xyz_rpy([1.0, 0.0, 0.0, 0.0, 0.0, np.pi])
    >>> round(distance_travelled(np.eye(4), half_turn), 3)
    2.571
    """
    motion = se3.inverse(T_before) @ T_after
    turn = abs(se3.yaw(motion))
    return float(np.linalg.norm(motion[:3, 3]) + _RADIAN * turn)
