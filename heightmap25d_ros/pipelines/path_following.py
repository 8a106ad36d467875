# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, velocities out: the plan is followed while it is known to be safe."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.control.pure_pursuit import (
    STANDSTILL,
    PathFollower,
    Surroundings,
    Velocity,
)
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Area, HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.level_map import LevelMap
from heightmap25d_ros.pipelines.map_frames import MapFrames
from heightmap25d_ros.pipelines.silence import LOCALIZATION, ODOMETRY, Silence
from heightmap25d_ros.planning.plan import pose_2d
from heightmap25d_ros.planning.planner import Planner
from heightmap25d_ros.terrain.slices import LevelFollower, SurfaceStack

MAP = "map"
"""A source that can fall silent, see `Silence`."""

_CHECK_PERIOD = 0.2  # [s] between two looks at the path ahead
_MARGIN = 3.0  # [m] of map around the part of the path that is looked at
_RECENTER = 1.0  # [m] that the robot moves before that part of the map is cut out anew
_LONGEST_STEP = 0.1  # [s] between two poses: the acceleration is limited to that of this time
_SLOPE_AHEAD = 0.6  # [m] of the path whose slope counts


class PathFollowing:
    """Follows the newest plan; halts where it is not safe to do so.

    ``take_...`` take messages in, by duck type. `take_odometry` and `pass_time` return the velocity
    that is commanded.

    Parameters
    ----------
    params : Params

    Attributes
    ----------
    dropped : Drops
    fault : str
        Why the robot is halted, though there is a path; else empty.
    """

    def __init__(self, params: Params) -> None:
        self.dropped = Drops()
        self.fault = ""
        self._params = params
        self._frames = MapFrames(params, self.dropped)
        own = params.path_follower
        self._silences = {
            ODOMETRY: Silence([ODOMETRY], own.timeout),
            MAP: Silence([MAP], own.map_timeout),
            LOCALIZATION: Silence([LOCALIZATION], own.localization_timeout),
        }
        self._heard = {MAP: 0, LOCALIZATION: 0}
        self._is_lost = False
        self._plan_fault = ""
        self._follower: PathFollower | None = None
        self._levels = LevelMap(params.mapping.map_frame, self.dropped)
        self._level = LevelFollower()
        self._map: HeightMap | None = None
        self._local: _LocalTerrain | None = None
        self._stamp_ns: int | None = None
        self._checked_ns: int | None = None
        self._blocked = ""

    @property
    def has_path(self) -> bool:
        """Whether there is a path whose end has not been reached."""
        return self._follower is not None and not self._follower.is_done

    @property
    def remaining(self) -> float:
        """Length of the path that is left [m]."""
        return self._follower.remaining if self._follower is not None and self.has_path else 0.0

    def set_params(self, params: Params) -> None:
        """Apply new parameters, from the next path on."""
        self._params, self._local = params, None

    def take_plan(self, message: Any) -> None:
        """Take a nav_msgs/Path; an empty one ends the drive."""
        frame, self._follower = self._params.mapping.map_frame, None
        self._plan_fault = self.fault = ""
        path = self.dropped.decoded("plan", lambda m: decode.path_in(m, frame), message)
        if path is not None:
            self.set_path(path)

    def set_path(self, path: NDArray[np.float64]) -> None:
        """Follow a path (N, 3) of x, y and heading from now on, in the map; empty: none."""
        velocity = STANDSTILL if self._follower is None else self._follower.velocity
        self._checked_ns, self._blocked = None, ""
        self._follower = (
            PathFollower(path, self._params.path_follower, velocity) if len(path) else None
        )

    def take_plan_status(self, message: Any) -> None:
        """Take a heightmap25d_msgs/PlanStatus: a stale plan is not followed."""
        is_stale = message.code == message.TF_ERROR
        self._plan_fault = str(message.reason) if is_stale else ""

    def take_map(self, message: Any) -> None:
        """Take a heightmap25d_msgs/HeightGrid."""
        height_map = self._levels.take_lowest(message)
        if height_map is not None:
            self.set_map(height_map)

    def take_map_update(self, message: Any) -> None:
        """Take a heightmap25d_msgs/HeightGrid with what has changed of the map."""
        height_map = self._levels.take_update(message)
        if height_map is not None:
            self.set_map(height_map)

    def take_upper_surfaces(self, message: Any) -> None:
        """Take a heightmap25d_msgs/UpperSurfaces: what is above the surfaces of the map."""
        height_map = self._levels.take_upper(message)
        if height_map is not None:
            self.set_map(height_map)

    def set_map(self, height_map: HeightMap) -> None:
        """Look at the path ahead on a map from now on."""
        self._hear(MAP)
        self._map, self._local, self._checked_ns = height_map, None, None

    def take_correction(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped: the pose of odom in the map."""
        self._frames.take_correction(message)

    def take_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a tf2_msgs/TFMessage of /tf or /tf_static."""
        self._frames.take_transforms(message, is_static=is_static)

    def take_localization_status(self, message: Any) -> None:
        """Take a heightmap25d_msgs/LocalizationStatus: a lost robot does not drive."""
        self._hear(LOCALIZATION)
        self._is_lost = message.state == message.LOST

    def take_odometry(self, message: Any) -> Velocity:
        """Take a pose of the robot, see `robot_pose`; the velocity that it shall have now."""
        if self._frames.take_odometry(message):
            self._silences[ODOMETRY].hear(ODOMETRY)
            return self._commanded(decode.stamp_ns(message.header))
        return STANDSTILL

    def pass_time(self, now_ns: int) -> Velocity | None:
        """Let the time [ns] pass in which sources can fall silent, see `Silence`.

        Returns
        -------
        Velocity or None
            Standstill, where the odometry is silent: no other command comes then.
        """
        for silence in self._silences.values():
            silence.pass_time(now_ns)
        if not self._silences[ODOMETRY].silent:
            return None
        self.fault = self._find_fault(None) if self.has_path else ""
        self._halt()
        return STANDSTILL

    def _hear(self, source: str) -> None:
        self._silences[source].hear(source)
        self._heard[source] += 1

    def _halt(self) -> None:
        if self._follower is not None:
            self._follower.velocity = STANDSTILL

    def _commanded(self, stamp_ns: int) -> Velocity:
        before, self._stamp_ns = self._stamp_ns, stamp_ns
        T, follower = self._frames.robot(), self._follower
        if T is None or follower is None or follower.is_done:
            self.fault = ""
            return STANDSTILL
        self.fault = self._find_fault(T)
        if self.fault:
            self._halt()
            return STANDSTILL
        seconds = 0.0 if before is None else (stamp_ns - before) * 1e-9
        around = self._local.around(T, follower) if self._local is not None else Surroundings()
        return follower.command(T, min(max(seconds, 0.0), _LONGEST_STEP), around)

    def _find_fault(self, T: se3.Matrix | None) -> str:
        """Why the path is not to be followed now; else empty."""
        silence = self._silences[ODOMETRY]
        if silence.silent or T is None or self._follower is None:
            return silence.told or "no odometry has come yet"
        if self._is_lost:
            return "localization is LOST"
        return self._stale or self._plan_fault or self._off_path(T, self._follower)

    @property
    def _stale(self) -> str:
        """Which source besides the odometry is silent, in words; else empty.

        A map that came once is one that does not change; a localization that never spoke is none.
        """
        for source, heard in ((LOCALIZATION, 0), (MAP, 1)):
            if self._heard[source] > heard and self._silences[source].silent:
                return self._silences[source].told
        return ""

    def _off_path(self, T: se3.Matrix, follower: PathFollower) -> str:
        """That the robot is off its path, or the path is blocked; else empty."""
        offset, limit = follower.locate(T), self._params.path_follower.max_offset
        if offset > limit:
            return f"the robot is {offset:.2f} m from the path, more than {limit:g} m"
        return self._blockage(T, follower)

    def _blockage(self, T: se3.Matrix, follower: PathFollower) -> str:
        """What of the path ahead is not free on the newest map; else empty."""
        length = self._params.path_follower.check_length
        if self._map is None or length == 0.0:
            return ""
        now = self._stamp_ns or 0
        if self._checked_ns is not None and 0 <= now - self._checked_ns < _CHECK_PERIOD * 1e9:
            return self._blocked
        self._checked_ns = now
        if self._local is None or self._local.is_left(T):
            try:
                part = self._around(self._map, T, length + _MARGIN)
                self._local = _LocalTerrain(part, T, self._params)
            except InputError as error:
                return str(error)
        is_free = self._local.is_free(T, follower.ahead(length))
        self._blocked = "" if is_free else f"the next {length:g} m of the path are not free"
        return self._blocked

    def _around(self, height_map: HeightMap, T: se3.Matrix, reach: float) -> HeightMap:
        """The part of a map so far [m] around the robot, as it is for one on its level."""
        geometry, params = height_map.geometry, self._params
        iy, ix = geometry.cell_at(T[:2, 3])
        cells = math.ceil(reach / geometry.resolution)
        area = Area(int(iy), int(ix), 1, 1).grown(cells).within(Area(0, 0, *geometry.shape))
        part = height_map.part(area if area.rows and area.columns else Area(0, 0, 1, 1))
        if not len(height_map.upper):
            return part
        stack = SurfaceStack(part, params.levels, params.traversability)
        surface = self._level.surface(stack, *T[:3, 3].tolist())
        return (stack.lowest() if surface is None else stack.followed(surface)).height_map


class _LocalTerrain:
    """The part of a map around the robot, as the planner sees it.

    Parameters
    ----------
    part : HeightMap
        With one surface in each cell.
    T : (4, 4) float64
        Of the robot in the map.
    params : Params
    """

    def __init__(self, part: HeightMap, T: se3.Matrix, params: Params) -> None:
        resolution = part.geometry.resolution
        self._center = T[:2, 3].copy()
        self._radius = params.traversability.robot_radius
        self._planner = Planner.from_height_map(part, params.traversability, params.planner)
        occupied = self._planner.graph.occupied
        self._clearance = (
            ndimage.distance_transform_edt(~occupied) * resolution
            if occupied.any()
            else np.full(occupied.shape, np.inf)
        )

    def is_left(self, T: se3.Matrix) -> bool:
        """Whether the robot has moved on so far that another part is needed."""
        return bool(np.hypot(*(T[:2, 3] - self._center)) > _RECENTER)

    def is_free(self, T: se3.Matrix, points: NDArray[np.float64]) -> bool:
        """Whether the robot's rectangle fits along a path (N, 2) [m]."""
        if len(points) < 2:
            return True
        step = np.gradient(points, axis=0)
        poses = np.tile(np.eye(4), (len(points), 1, 1))
        poses[:, :2, 3], length = points, np.hypot(*step.T)
        poses[:, :2, 0] = step / np.maximum(length, 1e-9)[:, None]
        return self._planner.cost_along(poses, pose_2d(T)) is not None

    def around(self, T: se3.Matrix, follower: PathFollower) -> Surroundings:
        """Slope of the path ahead and distance of the obstacles."""
        geometry, gradient = self._planner.graph.geometry, self._planner.graph.gradient
        cells = geometry.cell_at(np.vstack([T[:2, 3], follower.ahead(_SLOPE_AHEAD)]))
        inside = cells[geometry.contains(cells)]
        if not len(inside):
            return Surroundings()
        rows, columns = inside.T
        steepest = np.hypot(gradient[0, rows, columns], gradient[1, rows, columns]).max()
        nearest = float(self._clearance[rows[0], columns[0]])
        return Surroundings(math.atan(float(steepest)), nearest - self._radius)
