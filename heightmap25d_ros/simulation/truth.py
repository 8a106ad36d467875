# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ground truth of a world for the evaluation of maps; shares no code with the mapper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.simulation import goals
from heightmap25d_ros.simulation.robot import HEIGHT
from heightmap25d_ros.simulation.simulation import Simulation
from heightmap25d_ros.simulation.worlds import World

RESOLUTION = 0.125
"""Of a cell [m]."""

WINDOW = (-5.0, 1.5)
"""Heights above base_link [m] outside of which returns do not count as seen."""

_SAMPLES = 8
_BORDER = 0.001


class Levels:
    """The ground below overhead solids, and what a robot on these drives on.

    The second level has the tops of overhead solids, and the ground where there are none.

    Parameters
    ----------
    ground, underside : (rows, columns) float64 [m]
        The underside of what is overhead; infinite: nothing is.
    """

    def __init__(self, ground: Array, underside: Array) -> None:
        self._ground, self._underside = ground, underside
        self._is_below = np.isfinite(underside)
        self._seen = np.full((2, *ground.shape), -np.inf)

    def merge(self, at: tuple[NDArray[np.int64], ...], z: Array) -> None:
        """Add returns at heights [m] in cells: those from an underside or above are overhead."""
        is_overhead = z >= self._underside[at] - _BORDER
        for level, chosen in enumerate((~is_overhead, is_overhead | ~self._is_below[at])):
            rows, columns = at[0][chosen], at[1][chosen]
            np.maximum.at(self._seen[level], (rows, columns), z[chosen])

    @property
    def is_seen(self) -> NDArray[np.bool_]:
        """(2, rows, columns): whether a return was from that level."""
        return np.isfinite(self._seen)

    def tops(self, top: Array) -> Array:
        """(2, rows, columns) [m]: the highest points of each level."""
        return np.stack([np.where(self._is_below, self._ground, top), top])

    def drivable(self, top: Array, height: float) -> Array:
        """The same, infinite where a robot of a height [m] does not fit."""
        tops = self.tops(top)
        tops[0][self._underside - self._ground < height] = np.inf
        return tops

    def arrays(self, top: Array) -> dict[str, Any]:
        """For ``surface.npz``."""
        clearance = np.stack([self._underside - self._ground, np.full_like(top, np.inf)])
        clearance[1][~self._is_below] = clearance[0][~self._is_below]
        seen = np.where(self.is_seen, self._seen, np.nan)
        return {
            "level_top": self.tops(top).astype(np.float32),
            "level_seen": seen.astype(np.float32),
            "level_clearance": clearance.astype(np.float32),
        }


class Surface:
    """The surface of a world, and the part of it that the lasers of a drive measured.

    Parameters
    ----------
    world : World
    """

    def __init__(self, world: World) -> None:
        self._world = world
        (x0, x1), (y0, y1) = world.area
        self.origin = (x0, y0)
        self.shape = (round((y1 - y0) / RESOLUTION), round((x1 - x0) / RESOLUTION))
        self._levels: Levels | None = None
        if world.has_decks:
            _, ground, clearance = self.heights(0.0)
            self._levels = Levels(ground, ground + clearance)
        self._seen = np.full(self.shape, -np.inf)
        # Returns from movers: they count if the mover is still there at the end.
        self._met: list[tuple[Array, NDArray[np.int32], float]] = []
        self._way: list[Array] = []

    def add(self, simulation: Simulation) -> None:
        """Add the returns of the simulation's last step."""
        if simulation.is_at_pose:
            self._way.append(simulation.robot.T[:3, 3])
        for _, scan in simulation.scans:
            above = scan.ends[:, 2] - scan.base_z
            with np.errstate(invalid="ignore"):
                counts = (above >= WINDOW[0]) & (above <= WINDOW[1])
            self._merge(scan.ends[counts & (scan.mover < 0)])
            moving = counts & (scan.mover >= 0)
            if moving.any():
                self._met.append((scan.ends[moving], scan.mover[moving], scan.start))

    def heights(self, seconds: float) -> tuple[Array, Array, Array]:
        """Top, ground below overhead solids, and headroom above it: (rows, columns) [m]."""
        return self._by_cell(*self._samples(seconds))

    def write(self, directory: Path, seed: int, seconds: float) -> None:
        """Write ``surface.npz`` and ``goals.npz``; the world as it is at the end [s]."""
        directory.mkdir(parents=True)
        self._merge_what_stayed(seconds)
        seen = np.where(np.isfinite(self._seen), self._seen, np.nan)
        sampled = self._samples(seconds)
        top, ground, clearance = self._by_cell(*sampled)
        top = np.fmax(top, seen)
        np.savez_compressed(
            directory / "surface.npz",
            top=top.astype(np.float32),
            seen=seen.astype(np.float32),
            ground=ground.astype(np.float32),
            clearance=clearance.astype(np.float32),
            removed_at=self._removed(seconds).astype(np.float32),
            **({} if self._levels is None else self._levels.arrays(top)),
            resolution=np.float64(RESOLUTION),
            origin=np.array(self.origin),
            window=np.array(WINDOW),
            seed=np.int64(seed),
        )
        rng, way = np.random.default_rng([seed, 7]), np.array(self._way)
        heights = np.where(clearance < HEIGHT, np.inf, ground)[None]
        samples = np.where(sampled[2] < HEIGHT, np.inf, sampled[1])[None]
        seen_cells = np.isfinite(seen)[None]
        if self._levels is not None:
            heights, seen_cells = self._levels.drivable(top, HEIGHT), self._levels.is_seen
            samples = np.concatenate([samples, sampled[0][None]])
        chosen = goals.choose(heights, samples, seen_cells, self._cells(way), way[:, 2], rng)
        np.savez_compressed(
            directory / "goals.npz",
            start=self._places(chosen.start, heights),
            goal=self._places(chosen.goal, heights),
            reachable=chosen.reachable,
            observed=chosen.observed,
            footprint_observed=chosen.footprint_observed,
            radius=np.float64(goals.RADIUS),
            max_step=np.float64(goals.MAX_STEP),
            max_slope=np.float64(goals.MAX_SLOPE),
        )

    def _merge(self, points: Array) -> None:
        """Raise cells to points (N, 3) [m]."""
        cells = self._cells(points)
        rows, columns = cells.T
        inside = (rows >= 0) & (rows < self.shape[0]) & (columns >= 0) & (columns < self.shape[1])
        at, z = (rows[inside], columns[inside]), points[inside, 2]
        np.maximum.at(self._seen, at, z)
        if self._levels is not None:
            self._levels.merge(at, z)

    def _merge_what_stayed(self, seconds: float) -> None:
        movers = self._world.movers
        for ends, index, start in self._met:
            stays = [movers[i].center_at(start) == movers[i].center_at(seconds) for i in index]
            self._merge(ends[np.array(stays)])

    def _cells(self, points: Array) -> NDArray[np.int64]:
        """(N, 2): row and column of points."""
        offset = (points[:, 1::-1] - np.array(self.origin[::-1])) / RESOLUTION
        return np.asarray(np.floor(offset), np.int64)

    def _places(self, cells: NDArray[np.int64], heights: Array) -> Array:
        """(N, 3) [m], map: centres of cells (level, row, column), on the ground."""
        middle = np.array(self.origin) + RESOLUTION * (cells[:, :0:-1] + 0.5)
        return np.column_stack([middle, heights[tuple(cells.T)]])

    def _samples(self, seconds: float) -> tuple[Array, Array, Array]:
        """Top, ground below overhead solids, and headroom above that ground [m].

        Each (rows * 8, columns * 8): at 8 x 8 points of each cell, the outermost 1 mm within its
        border.
        """
        scene = self._world.scene()
        scene.set_time(seconds)
        points = _sampled(Geometry(resolution=RESOLUTION, origin=self.origin, shape=self.shape))
        top = scene.heights(points)
        ground, clearance = top, np.full(len(points), np.inf)
        if any(solid.is_overhead for solid in self._world.solids):
            ground = scene.heights(points, with_overhead=False)
            clearance = scene.undersides(points, ground) - ground
        shape = self.shape[0] * _SAMPLES, self.shape[1] * _SAMPLES
        return top.reshape(shape), ground.reshape(shape), clearance.reshape(shape)

    def _by_cell(self, top: Array, ground: Array, clearance: Array) -> tuple[Array, Array, Array]:
        """The highest, the highest and the least of the samples of each cell.

        Exact for boxes wider than 2 cm, and within 1 cm on slopes of up to 60 degrees.
        """
        return (
            _over_cells(top, self.shape, np.maximum),
            _over_cells(ground, self.shape, np.maximum),
            _over_cells(clearance, self.shape, np.minimum),
        )

    def _removed(self, seconds: float) -> Array:
        """(rows, columns) [s]: time at which a cell's mover was removed; NaN: never."""
        removed = np.full(self.shape, np.nan)
        times = np.arange(0.0, seconds, 0.02)
        for mover in self._world.movers:
            places = [mover.center_at(time) for time in times]
            present = [place for place in places if place is not None]
            if places[-1] is not None or len(set(present)) != 1:
                continue
            half = np.array(mover.solid.size[:2])
            low = self._cells(np.array([[*(np.array(present[0][:2]) - half), 0.0]]))[0]
            high = self._cells(np.array([[*(np.array(present[0][:2]) + half), 0.0]]))[0]
            removed[low[0] : high[0] + 1, low[1] : high[1] + 1] = times[len(present)]
        return removed


def tops_at(world: World, geometry: Geometry, T_world_map: se3.Matrix) -> Array:
    """What the cells of a map would hold that lies in the world at a planar pose.

    Parameters
    ----------
    world : World
        As it is at the beginning.
    geometry : Geometry
    T_world_map : (4, 4) float64
        A shift, and a turn by a yaw.

    Returns
    -------
    (rows, columns) float64 [m, map]
        Highest points over the cells; NaN where one is not all within the world.
    """
    return _heights_at(world, geometry, T_world_map, with_overhead=True)


def levels_at(world: World, geometry: Geometry, T_world_map: se3.Matrix) -> Array:
    """The same of each level of a world with decks: (2, rows, columns) float64 [m, map]."""
    return np.stack([
        _heights_at(world, geometry, T_world_map, with_overhead=with_overhead)
        for with_overhead in (False, True)
    ])  # fmt: skip


def _heights_at(
    world: World, geometry: Geometry, T_world_map: se3.Matrix, *, with_overhead: bool
) -> Array:
    scene = world.scene()
    scene.set_time(0.0)
    points = _sampled(geometry)
    points = points @ T_world_map[:2, :2].T + T_world_map[:2, 3]
    low, high = np.transpose(world.area)
    heights = np.full(len(points), np.nan)
    is_inside = ((points >= low) & (points <= high)).all(axis=1)
    found = scene.heights(points[is_inside], with_overhead=with_overhead)
    heights[is_inside] = found - T_world_map[2, 3]
    return _over_cells(heights, geometry.shape, np.maximum)


def _sampled(geometry: Geometry) -> Array:
    """(rows * 8 * columns * 8, 2) [m]: 8 x 8 points of each cell, the outermost 1 mm within it."""
    fractions = np.linspace(_BORDER, geometry.resolution - _BORDER, _SAMPLES)
    y, x = (
        (begin + geometry.resolution * np.arange(count)[:, None] + fractions).ravel()
        for begin, count in zip(geometry.origin[::-1], geometry.shape, strict=True)
    )
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _over_cells(samples: Array, shape: tuple[int, int], extreme: np.ufunc) -> Array:
    """The extreme (rows, columns) of the samples of each cell."""
    rows, columns = shape
    by_cell = samples.reshape(rows, _SAMPLES, columns, _SAMPLES)
    return np.asarray(extreme.reduce(by_cell, axis=(1, 3)))
