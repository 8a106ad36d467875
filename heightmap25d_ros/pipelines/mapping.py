# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, maps out: what the mapping node and ``heightmap25d map`` both drive."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heightmap25d_ros import memory, se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, anchor_at
from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Area,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.io import decode, layers_file, map_directory
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.localization.layers import LayerMap, LocalizationLayers
from heightmap25d_ros.mapping import cloud, sensor_model
from heightmap25d_ros.mapping.drop_offs import DropOffs
from heightmap25d_ros.mapping.ground_evidence import BELOW, see_ground
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines import scan_queue
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.pipelines.sensor_intake import SensorIntake
from heightmap25d_ros.pipelines.silence import LOCALIZATION, Silence
from heightmap25d_ros.pipelines.submap_poses import SubmapPoses
from heightmap25d_ros.slam import moved_parts
from heightmap25d_ros.slam.moved_parts import CellParts, PartedMap, moved
from heightmap25d_ros.terrain import slices
from heightmap25d_ros.terrain.explanation import Explanation, Waiting, explain, surroundings
from heightmap25d_ros.terrain.obstacle_grid import ObstacleGrid, covering
from heightmap25d_ros.terrain.shown_level import ShownLevel
from heightmap25d_ros.terrain.traversability import ObstacleMap, to_obstacle_map

GIVEN_UP = 60
"""Timeouts of silence after which localization is given up, and mapping goes on without it.

A node that searches a large map may be silent for many seconds, and is lost meanwhile.
"""

ENOUGH_LEVEL_SCANS = 50
"""Scans without any ground, after which the lasers are taken for level ones."""

_LEVEL = (
    "the lasers are level and see no ground: the map shows what stands as occupied and the rest as "
    "unknown; it cannot be planned on"
)
_SCRATCH_EXTENT = 32.0  # [m] of a grid that is thrown away


def compile_kernels(params: Params) -> None:
    """Compile, or load from numba's cache, all that the first scan and the first map need.

    It takes seconds when nothing is cached: too long for a node whose messages queue up.
    """
    if params.intake.cloud_topics:
        cloud.compile_kernels()
    scratch = Mapping(replace(params, grid=replace(params.grid, extent=_SCRATCH_EXTENT)))
    scratch.merge(scan_queue.sample_reading())
    scratch.maps()
    slices.compile_kernels()
    moved_parts.compile_kernels()
    se3.to_quaternion(np.eye(4))  # of transforms that are published


_BYTES_OF_CELL = 4  # height and probability
_BYTES_OF_MAPS = 16  # of a cell, with its occupancy and cost, and what is between
_BYTES_OF_MOVED = 250  # of a cell, with its layers before and after


_NO_TILES = np.empty((0, 2), np.int64)


class Size(NamedTuple):
    """Bounding box of a map [cells], and what heights and probabilities take [bytes]."""

    columns: int
    rows: int
    bytes: int


class Mapping(SensorIntake[Reading]):
    """A map in the making.

    Each ``take_...`` takes a message in, by duck type, and returns the readings that it
    completed and that were merged. A bad message is counted and changes nothing.

    Parameters
    ----------
    params : Params

    Attributes
    ----------
    grid : HeightGrid
    merged : Counter of str
        Scans and returns.
    dropped : Drops
    stamp_ns : int [ns]
        Of the scan merged last; 0 before the first.
    """

    def __init__(self, params: Params) -> None:
        super().__init__(params)
        self.merged: Counter[str] = Counter()
        self.stamp_ns = 0
        self._correction_ns = self._tracking_ns = -1
        self._is_lost = self._is_localized = False
        self._silence = Silence([LOCALIZATION], params.intake.timeout)
        self._layers: LocalizationLayers | None = None
        self._submaps = SubmapPoses(self._params.grid.resolution)
        self._robot: tuple[float, float, float] | None = None  # its position in the map
        self._was_level = False
        self.clear()

    def clear(self, content: HeightMap | None = None, layers: LayerMap | None = None) -> None:
        """Start a new map, empty or with a loaded map and its localization layers in it.

        An empty one is anchored at the first pose that is mapped (`anchor_at`), a loaded one in
        its middle, with its ground zero. Without layers a loaded map gets none: they would know
        only what is seen from now on.

        Raises
        ------
        ValueError
            If the content does not fit the grid; the running map stays.
        """
        if content is None:
            grid = HeightGrid(self._params.grid, levels=self._params.levels)
            self._queue.correction.begin_anew()
        else:
            x, y = content.geometry.cell_corner(np.floor_divide(content.geometry.shape, 2))
            anchor = (float(x), float(y), content.geometry.ground_zero)
            grid = HeightGrid(self._params.grid, anchor, self._params.levels)
            grid.write(content)
        self._has_begun = False
        self._sees_ground = content is not None and not content.is_level
        # z [m] in the map; what is loaded stands, whatever its height.
        self._lowest_laser = np.inf if content is None else -np.inf
        self._scans = ENOUGH_LEVEL_SCANS if content is not None else 0
        self._use_grid(grid)
        if self._layers is None or content is None:
            return
        if layers is None:
            self._layers = None
            self.dropped.notice("the loaded map has no localization layers: it gets none")
        else:
            self._layers.write(layers)

    def load(self, directory: Path) -> None:
        """Start with the map of a map directory, and its localization layers.

        Raises
        ------
        InputError
            If it cannot be read, is in another frame, or does not fit the grid; the running map
            stays.
        """
        mapping = self._params.mapping
        threshold = self.probability_threshold
        height_map = map_directory.load_in(directory, threshold, mapping.map_frame)
        layers = layers_file.load(directory, height_map) if mapping.localization_layers else None
        try:
            self.clear(height_map, layers)
        except ValueError as error:
            raise InputError(f"{directory}: {error}") from None

    def _use_grid(self, grid: HeightGrid) -> None:
        self.grid = grid
        self._parts = CellParts(grid)
        self._layers = (
            LocalizationLayers(grid, grid.upper.count)
            if self._params.mapping.localization_layers
            else None
        )
        self._use_params()

    def set_params(self, params: Params) -> None:
        """Go on with other parameters: sensor, mapper, traversability, limits; the map stays."""
        self._params = params
        self._use_params()

    def _use_params(self) -> None:
        self._mapper = Mapper(self.grid, self._params.sensor, self._params.mapper)
        terrain, threshold = self._params.traversability, self.probability_threshold
        self._obstacles = ObstacleGrid(self.grid.geometry, terrain)
        self._level = ShownLevel(self._params.mapping.slice, self._params.levels, terrain)
        self._drop_offs: DropOffs | None = None
        if terrain.drop_offs != "none":
            self._drop_offs = DropOffs(self.grid, terrain, threshold)
        self._changed = covering(_NO_TILES)
        self.grid.mark_changed()

    @property
    def odometry(self) -> Odometry | None:
        """The newest pose of the robot in its odometry's frame."""
        return self._queue.odometry

    def take_correction(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped in: the pose of odom in the map."""
        frame = self._params.mapping.map_frame
        pose = self.dropped.decoded("correction", lambda m: decode.pose_in(m, frame), message)
        stamp = self.dropped.decoded("correction", lambda m: decode.stamp_ns(m.header), message)
        if pose is not None and stamp is not None:
            self._queue.set_correction(pose, stamp)
            self._correction_ns = stamp
            self._resume()

    def take_localization_status(self, message: Any) -> None:
        """Take a heightmap25d_msgs/LocalizationStatus in: a lost robot does not map.

        From now on mapping relies on localization, see `pass_time`.
        """
        self._is_localized = True
        self._silence.hear(LOCALIZATION)
        self._is_lost = message.state == message.LOST
        stamp = self.dropped.decoded("localization", lambda m: decode.stamp_ns(m.header), message)
        self._tracking_ns = -1
        if stamp is not None and message.state == message.TRACKING:
            self._tracking_ns = stamp
            self._resume()

    def take_submaps(self, message: Any) -> bool:
        """Take a nav_msgs/Path in: the beginnings of the submaps of localization's own map.

        Where they were moved, the map follows, see `slam.moved_parts`; whether it has.
        """
        frame = self._params.mapping.map_frame
        begun_ns = self._submaps.begun_ns
        motions = self.dropped.decoded("submaps", lambda m: self._submaps.take(m, frame), message)
        if self._submaps.begun_ns != begun_ns:  # of a new map: what there is stays where it is
            self._parts = CellParts(self.grid)
        if motions is None or not self.grid.observed_cells:
            return False
        try:
            self._move(motions)
        except InputError as error:
            self.dropped.notice(f"submaps were moved, and the map does not follow: {error}")
            return False
        return True

    def _move(self, motions: Array) -> None:
        """Move (K, 4, 4) what was seen from each submap."""
        area = self.grid.observed_area()
        memory.require(area.rows * area.columns * _BYTES_OF_MOVED, "the map, moved with submaps")
        height_map = self.grid.read(self.probability_threshold, area)
        layers = None if self._layers is None else self._layers.read(area)
        source = PartedMap(height_map, layers, self._parts.read(area))
        found = moved(source, motions, self.grid.geometry)
        grid = HeightGrid(self._params.grid, self.grid.anchor, self._params.levels)
        grid.write(found.height_map)
        self._use_grid(grid)
        self._parts.write(grid.area_of(found.height_map.geometry), found.parts)
        if self._layers is not None and found.layers is not None:
            self._layers.write(found.layers)

    def pass_time(self, now_ns: int) -> None:
        """Let the time [ns] pass in which localization can fall silent, see `Silence`.

        After ``intake.timeout`` mapping pauses, whatever the last status was. After `GIVEN_UP`
        times as long localization is taken for gone: mapping goes on with the last correction, as
        it does where there has never been a localization, until the next status.
        """
        self._silence.pass_time(now_ns)
        limit = GIVEN_UP * self._params.intake.timeout
        if self._is_localized and self._silence.seconds(LOCALIZATION) > limit:
            self._is_localized = self._is_lost = False
            self.dropped.notice(
                f"localization has been silent for {limit:g} s: mapping goes on without it, with "
                "its last correction"
            )

    @property
    def _is_paused(self) -> bool:
        """Whether localization is relied on, and silent."""
        return self._is_localized and bool(self._silence.silent)

    def settle(self) -> list[Reading]:
        """Merge what has its poses now, without waiting for the other lasers."""
        return self._use(self._queue.settle())

    def begin_drive(self) -> None:
        """The next messages are of another drive, with poses in the same frame; the map stays.

        Scans that still wait for their poses are not used, see `flush`.
        """
        self._queue.begin_drive()

    def maps(self, max_cells: float | None = None) -> tuple[HeightMap, ObstacleMap]:
        """Height map and converted map of all that was observed; of an unknown tile at first.

        The converted map is that of one level, see ``mapping.slice``.

        Where one wild pose has stretched it to more than ``mapping.max_cells``, what is far off and
        small is left out, see `HeightGrid.main_area`.

        Parameters
        ----------
        max_cells : float, optional
            In place of ``mapping.max_cells``.

        Raises
        ------
        InputError
            If what is connected has more cells, or the memory for it is not available.
        """
        area = self.area(max_cells)
        obstacles = self.obstacles(area)
        return self.heights(area), obstacles

    @property
    def is_level(self) -> bool:
        """Whether level lasers alone have made the map, so that no ground is known."""
        return not self._sees_ground and self._scans >= ENOUGH_LEVEL_SCANS

    def heights(self, area: Area) -> HeightMap:
        """The height map of an area of the grid; of level lasers what stands alone."""
        found = self.grid.read(self.probability_threshold, area)
        if not self.is_level:
            return found
        stands = ~(found.metres < self._lowest_laser - BELOW)
        probability = np.where(stands, found.probability, np.uint16(0))
        return replace(found, probability=probability, is_level=True)

    def upper(self, area: Area) -> UpperSurfaces:
        """The surfaces of an area of the grid above the lowest ones."""
        return self.grid.upper_surfaces(self.probability_threshold, area)

    @property
    def probability_threshold(self) -> float:
        """Below which a cell is unknown."""
        return self._params.mapper.probability_threshold

    def area(self, max_cells: float | None = None) -> Area:
        """The cells of the grid that `maps` shows; parameters and errors are its."""
        limit = self._params.mapping.max_cells if max_cells is None else max_cells
        area = self.grid.main_area(limit)
        is_cut = area != self.grid.observed_area()
        if not area.rows:
            area = Area(area.iy, area.ix, TILE, TILE)
        if area.rows * area.columns > limit:
            raise InputError(
                f"the map has {area.columns} x {area.rows} cells, more than the {limit:.0f} of "
                "parameter mapping.max_cells; clear it, or allow more"
            )
        if is_cut:
            self.dropped.notice(
                "the map reaches farther than mapping.max_cells allows: what is far off and small "
                "is neither published nor saved; ~/clear_map forgets it"
            )
        memory.require(area.rows * area.columns * _BYTES_OF_MAPS, "the map")
        return area

    def obstacles(self, area: Area) -> ObstacleMap:
        """The converted map of an area of the grid."""
        self._convert()
        if self.is_level:
            return to_obstacle_map(self.heights(area), self._params.traversability)
        return self._obstacles.read(area)

    def take_changed(self) -> Area:
        """The smallest area with all cells that were converted since the last call."""
        self._convert()
        changed, self._changed = self._changed, covering(_NO_TILES)
        return changed

    def _convert(self) -> None:
        threshold = self.probability_threshold
        if self.is_level != self._was_level:
            self._was_level = self.is_level
            self.grid.mark_changed()
        if self.is_level:
            self.dropped.notice(_LEVEL)
        shown = self.grid.main_area(self._params.mapping.max_cells)
        self._level.update(self.grid, threshold, shown, self._robot)
        tiles = self._obstacles.update(self.grid, threshold, self._level)
        self._changed = self._changed.hull(covering(tiles))

    def explain(self, message: Any) -> Explanation:
        """Why the cell at a geometry_msgs/PointStamped is occupied, dear or unknown.

        Raises
        ------
        InputError
            If the point is not in the frame of the map or of the odometry, or is no place.
        """
        point, grid = self._point_in_map(message), self.grid
        window = surroundings(grid.geometry, point[:2], self._params.traversability)
        height_map = grid.read(self.probability_threshold, window)
        iy, ix = (int(index) for index in grid.geometry.cell_at(point[:2]))
        cell = Area(iy, ix, 1, 1)
        believed = float(grid.candidate_probability.read(cell)[0, 0]) / PROBABILITY_SCALE
        waits = float(grid.candidate_height.read(cell)[0, 0]) * HEIGHT_RESOLUTION
        waiting = Waiting(height=waits + grid.geometry.ground_zero, probability=believed)
        params = self._params.traversability
        return explain(height_map, point[:2], params, waiting if believed else None)

    def _point_in_map(self, message: Any) -> Array:
        """(3,) [m], map, of a geometry_msgs/PointStamped."""
        frame = decode.frame_name(message.header.frame_id, "header.frame_id")
        point = decode.point(message.point)
        map_frame, odometry = self._params.mapping.map_frame, self._queue.odometry
        if frame == map_frame:
            return point
        if odometry is not None and frame == odometry.frame_id:
            return np.asarray(self.T_map_odom[:3, :3] @ point + self.T_map_odom[:3, 3])
        known = [map_frame] if odometry is None else [map_frame, odometry.frame_id]
        raise InputError(f"header.frame_id: is {frame!r}, not {' or '.join(map(repr, known))}")

    def layers(self, geometry: Geometry) -> LayerMap | None:
        """The localization layers of cells of the grid; None without them."""
        if self._layers is None:
            return None
        return self._layers.read(self.grid.area_of(geometry))

    def size(self) -> Size:
        """How large the map is now."""
        area = self.grid.observed_area()
        return Size(area.columns, area.rows, self.grid.observed_cells * _BYTES_OF_CELL)

    @property
    def trouble(self) -> str:
        """Why nothing is mapped now; empty where something can be."""
        if self._is_paused:
            return f"not mapping: {self._silence.told}"
        if self._queue.gate.unknown_since_ns is None or self._queue.gate.jump is None:
            return ""
        return (
            f"not mapping: the odometry jumped ({self._queue.gate.jump.detail}), and the robot may "
            "have moved; until localization is TRACKING, the pose comes back, or ~/clear_map"
        )

    @property
    def T_map_odom(self) -> se3.Matrix:
        """Pose (4, 4) of the odometry's frame in the map: the correction, over its jumps."""
        newest = self._queue.odometry
        return self._queue.correction.T_map_odom(0 if newest is None else newest.stamp_ns)

    def _resume(self) -> None:
        """Localization knows the pose again, and has said both so and which one."""
        since = self._queue.gate.unknown_since_ns
        if since is not None and min(self._tracking_ns, self._correction_ns) >= since:
            self._queue.gate.locate()

    def _known(self, readings: list[Reading]) -> list[Reading]:
        """The readings of a known pose in the map; the others are counted."""
        if not readings:
            return readings
        if self._is_lost:
            self.dropped.record("scan: localization is lost", count=len(readings))
            return []
        if self._is_paused:
            self.dropped.record("scan: localization is silent", count=len(readings))
            return []
        if self._params.mapping.needs_localization and not self._is_localized:
            self.dropped.record("scan: nothing from localization yet", count=len(readings))
            return []
        known = [r for r in readings if self._queue.gate.is_known(r.scan.stamp_ns)]
        unknown = len(readings) - len(known)
        self.dropped.record("scan: the pose is unknown since the odometry jumped", count=unknown)
        return known

    def _use(self, readings: list[Reading]) -> list[Reading]:
        readings = self._known(readings)
        for reading in readings:
            self.merge(reading)
        return readings

    def merge(self, reading: Reading) -> None:
        """Merge a scan whose pose in the map is known."""
        if not self._has_begun:
            self._begin(reading.T_map_base[0])
        beams = reading.beams(self._params)
        result = self._mapper.integrate(beams)
        self._scans += 1
        if not self._sees_ground:
            self._sees_ground = see_ground(beams)
            self._lowest_laser = min(
                self._lowest_laser, float(beams.origins[:, 2].min(initial=np.inf))
            )
        if self._layers is not None:
            self._layers.integrate(beams)
        if self._submaps.newest:
            self._parts.integrate(beams, self._submaps.newest)
        if self._drop_offs is not None:
            self._drop_offs.integrate(beams)
        self.watch.observe_ranges(
            reading.scan, sources.sensor_of(self._params, reading.topic).no_return, self.dropped
        )
        self.merged["scans"] += 1
        self.merged["returns"] += result.hits
        self.dropped.record("return: more than 327 m from ground zero", count=result.out_of_range)
        self.dropped.record("return: beyond grid.extent", count=result.outside)
        self.dropped.record("return: above levels.max_surfaces", count=result.surplus)
        self.stamp_ns = reading.scan.stamp_ns
        self._robot = tuple(reading.T_map_base[-1][:3, 3].tolist())

    def _begin(self, T_map_base: se3.Matrix) -> None:
        """Anchor an empty map at the robot, on ground that no laser sees under and around it."""
        if not self.grid.observed_cells:
            resolution = self._params.grid.resolution
            anchor = anchor_at(T_map_base[:3, 3], resolution)
            self._use_grid(HeightGrid(self._params.grid, anchor, self._params.levels))
            radius = self._params.mapping.start_radius
            if radius > 0.0:
                self._mapper.integrate(
                    _ground_around(T_map_base, radius, self._params.grid.resolution)
                )
        self._has_begun = True


def _ground_around(T_map_base: se3.Matrix, radius: float, resolution: float) -> sensor_model.Beams:
    """The plane of base_link as returns, one in each cell with its centre within a radius [m]."""
    position, normal = T_map_base[:3, 3], T_map_base[:3, 2]
    side = np.arange(np.ceil(-radius / resolution), np.ceil(radius / resolution) + 1.0)
    centre = (np.floor(position[:2] / resolution) + 0.5) * resolution
    x, y = (axis.ravel() for axis in np.meshgrid(*(centre[:, None] + side * resolution)))
    is_near = np.hypot(x - position[0], y - position[1]) <= radius
    x, y = x[is_near], y[is_near]
    z = position[2] - (normal[0] * (x - position[0]) + normal[1] * (y - position[1])) / normal[2]
    places = np.column_stack([x, y, z])
    return sensor_model.Beams(
        origins=places,
        ends=places,
        is_hit=np.ones(len(places), bool),
        is_lone=np.zeros(len(places), bool),
    )
