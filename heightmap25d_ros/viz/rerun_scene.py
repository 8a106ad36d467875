# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 3-D scene for the viewer rerun: blocks, obstacles, frontier, the robot and its trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.terrain.traversability import OCCUPIED, to_obstacle_map
from heightmap25d_ros.viz import markers
from heightmap25d_ros.viz.map_figures import OCCUPIED_COLOUR

try:
    import rerun
    import rerun.blueprint
except ImportError:
    raise InputError("view needs rerun: pip install -r requirements/view.txt") from None

TIMELINE = "bag"
"""Name of the timeline: seconds of the bag."""

_OBSTACLE = tuple(int(OCCUPIED_COLOUR[i : i + 2], 16) for i in (1, 3, 5))
_FRONTIER, _TRAJECTORY, _ROBOT = (255, 0, 200), (25, 255, 0), (220, 30, 30)
_BODY_HEIGHT = 0.55
"""Height of the box that represents the robot [m]."""

_EYE = (-0.12, -0.55, 0.45)
"""Viewpoint relative to the centre of the map, in multiples of its longest side."""


class Scene3d:
    """The scene of a viewer; each call replaces objects of its kind from the current time on.

    Parameters
    ----------
    title : str
    terrain : TraversabilityParams
    robot : PlannerParams
        Its footprint is drawn as a box.
    path : Path, optional
        The recording is written to this file, not sent to a viewer.
    """

    def __init__(
        self,
        title: str,
        terrain: TraversabilityParams,
        robot: PlannerParams,
        path: Path | None = None,
    ) -> None:
        self._terrain = terrain
        self._size = (robot.robot_length, robot.robot_width, _BODY_HEIGHT)
        self._title = title
        self._corners = np.zeros((1, 3))  # of the newest map's blocks
        self._has_time = False
        self._recording = rerun.RecordingStream("heightmap25d", recording_id=title)
        if path is not None:
            self._recording.save(path)
        self._log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP)

    def open_window(self) -> None:
        """Show the scene in a viewer window."""
        self._recording.spawn()

    def serve(self, port: int) -> str:
        """Serve the scene to browsers as long as this process runs; returns its address.

        Raises
        ------
        InputError
            If the port, or rerun's own 9876, is in use.
        """
        try:
            address = self._recording.serve_grpc()
            rerun.serve_web_viewer(web_port=port, open_browser=False, connect_to=address)
        except RuntimeError as error:
            raise InputError(f"--web {port}: {error}") from None
        return f"http://127.0.0.1:{port}/?url={quote(address, safe='')}"

    def finish(self) -> None:
        """Set the view to the newest map, and wait until all data is written or sent."""
        low, high = self._corners.min(axis=0), self._corners.max(axis=0)
        middle, size = (low + high) / 2, float((high - low).max())
        eye: dict[str, Any] = {}
        if hasattr(rerun.blueprint, "EyeControls3D"):  # 0.23 chooses the viewpoint by itself
            eye["eye_controls"] = rerun.blueprint.EyeControls3D(
                position=middle + size * np.array(_EYE), look_target=middle
            )
        view = rerun.blueprint.Spatial3DView(origin="/", name=self._title, **eye)
        layout = rerun.blueprint.Blueprint(view, collapse_panels=True)
        self._recording.send_blueprint(layout)
        self._recording.flush()

    def at(self, seconds: float) -> None:
        """Set the current time of the bag [s]."""
        self._has_time = True
        self._recording.set_time(TIMELINE, duration=seconds)

    def show_map(self, height_map: HeightMap) -> None:
        """Show a map: blocks, and obstacles and frontier cells as points on their tops."""
        corners, colours = markers.blocks(height_map)
        self._corners = corners.reshape(-1, 3) if len(corners) else self._corners
        first = 4 * np.arange(len(corners))[:, None]
        triangles = (first[:, :, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        mesh = rerun.Mesh3D(
            vertex_positions=corners.reshape(-1, 3),
            triangle_indices=triangles,
            vertex_colors=np.repeat(np.rint(255 * colours).astype(np.uint8), 4, axis=0),
        )
        obstacles = to_obstacle_map(height_map, self._terrain)
        radius = 0.3 * height_map.geometry.resolution
        occupied = height_map.known & (obstacles.occupancy == OCCUPIED)
        frontier = markers.frontier(height_map, obstacles).known
        self._log("map/blocks", mesh)
        for name, cells, colour in (
            ("map/obstacles", occupied, _OBSTACLE),
            ("map/frontier", frontier, _FRONTIER),
        ):
            tops = _tops(height_map, cells)
            self._log(name, rerun.Points3D(tops, colors=colour, radii=radius))

    def show_trajectory(self, positions: NDArray[np.float64]) -> None:
        """Show the trajectory of the robot: (N, 3) [m], map."""
        self._log("trajectory", rerun.LineStrips3D([positions], colors=_TRAJECTORY, radii=0.03))

    def show_robot(self, T_map_base: se3.Matrix) -> None:
        """Show the robot at a pose."""
        pose = rerun.Transform3D(translation=T_map_base[:3, 3], mat3x3=T_map_base[:3, :3])
        box = rerun.Boxes3D(
            sizes=[self._size], centers=[(0.0, 0.0, _BODY_HEIGHT / 2)], colors=_ROBOT
        )
        self._log("robot", pose, box)

    def _log(self, name: str, *content: object) -> None:
        self._recording.log(name, *content, static=not self._has_time)


def _tops(height_map: HeightMap, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N, 3) [m]: centres of the tops of cells."""
    cells = np.argwhere(chosen)
    return np.column_stack([
        height_map.geometry.cell_center(cells),
        height_map.height[tuple(cells.T)] * HEIGHT_RESOLUTION,
    ])  # fmt: skip
