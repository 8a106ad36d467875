# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of maps, as Fig. 2(c) and 2(d) of the paper. Needs matplotlib, no display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.axes_grid1 import make_axes_locatable
from mpl_toolkits.mplot3d import proj3d
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap
from heightmap25d_ros.terrain.traversability import ObstacleMap
from heightmap25d_ros.viz import block_mesh

Trajectory = NDArray[np.float64]
"""(N, 3) [m], map: positions of the robot."""

MAX_BLOCKS = 200_000
"""Largest number of blocks of the 3-D view; larger maps are shown with larger cells."""

_DPI = 150
UNKNOWN_COLOUR, _FREE, OCCUPIED_COLOUR = "black", "white", "#e4572e"
TRAJECTORY: dict[str, Any] = {"color": "#c020d0", "linewidth": 1.6, "solid_capstyle": "round"}
_LEAST_SPAN = 0.5
"""Least range of heights of the colours [m], so that noise does not look like terrain."""
_ELEVATION, _AZIMUTH = 38.0, -62.0


def height_map(path: Path, shown: HeightMap, trajectory: Trajectory | None = None) -> None:
    """Draw the heights from above; unknown cells are black.

    Parameters
    ----------
    path : Path
        Of the picture; its suffix is the format.
    shown : HeightMap
    trajectory : (N, 3) float64 [m], map
        Drawn over it.
    """
    figure, axes = heights_from_above(shown)
    _draw_trajectory(axes, trajectory)
    save(figure, path)


def heights_from_above(shown: HeightMap) -> tuple[Figure, Axes]:
    """A figure of the heights from above, in metres, to draw more into."""
    shown = observed_part(shown)
    metres = shown.metres
    figure, axes = map_axes(shown.geometry)
    axes.set_facecolor(UNKNOWN_COLOUR)
    image = axes.imshow(
        metres, cmap=terrain_colours(), norm=height_norm(metres), origin="lower",
        extent=extent(shown.geometry), interpolation="nearest",
    )  # fmt: skip
    side = make_axes_locatable(axes).append_axes("right", size=0.14, pad=0.1)
    figure.colorbar(image, cax=side, label="height [m]")
    return figure, axes


def obstacle_map(path: Path, shown: ObstacleMap, trajectory: Trajectory | None = None) -> None:
    """Draw the obstacle grid as Fig. 2(d): free white, unknown black, obstacles coloured.

    Parameters
    ----------
    path, trajectory :
        As of `height_map`.
    shown : ObstacleMap
    """
    area = _bounding_area(shown.occupancy >= 0)
    geometry = shown.geometry.part(area)
    occupancy = shown.occupancy[area.slices(_whole(shown.geometry))]
    figure, axes = map_axes(geometry)
    axes.imshow(
        np.searchsorted([-1, 0, 100], occupancy),
        cmap=ListedColormap([UNKNOWN_COLOUR, _FREE, OCCUPIED_COLOUR]),
        vmin=0, vmax=2, origin="lower", extent=extent(geometry), interpolation="nearest",
    )  # fmt: skip
    patches = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.6, label=label)
        for colour, label in (
            (_FREE, "free"),
            (OCCUPIED_COLOUR, "obstacle"),
            (UNKNOWN_COLOUR, "unknown"),
        )
    ]
    axes.legend(
        handles=patches, loc="lower right", bbox_to_anchor=(1.0, 1.01), ncol=3, frameon=False,
        borderaxespad=0.0,
    )  # fmt: skip
    _draw_trajectory(axes, trajectory)
    save(figure, path)


def blocks(path: Path, shown: HeightMap, trajectory: Trajectory | None = None) -> None:
    """Draw a 3-D view as Fig. 2(c): each known cell from its height to its lowest neighbour.

    Parameters
    ----------
    path, shown, trajectory :
        As of `height_map`. A map of more than `MAX_BLOCKS` cells is shown with larger cells.
    """
    shown = block_mesh.coarser(observed_part(shown), MAX_BLOCKS)
    metres = shown.metres
    norm = height_norm(metres)
    faces = block_mesh.faces(shown.geometry, metres, np.radians(_AZIMUTH))
    colours = terrain_colours()(norm(faces.height))[:, :3] * faces.shade[:, None]
    limits = extent(shown.geometry)[:2], extent(shown.geometry)[2:], (norm.vmin, norm.vmax)
    figure = Figure(figsize=(12.0, 9.0))
    axes = _space(figure, np.array(limits))
    axes.add_collection(_Faces(faces.corners, colours), autolim=False)
    if trajectory is not None:
        axes.plot(*trajectory[:, :3].T, **TRAJECTORY, clip_on=False)
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    drawn = _drawn_box(axes)
    x, y, height = drawn.x1 + 0.3, drawn.y0 + 0.25 * drawn.height, 0.5 * drawn.height
    width_height = figure.get_size_inches()
    side = figure.add_axes((x / width_height[0], y / width_height[1],
                            0.15 / width_height[0], height / width_height[1]))  # fmt: skip
    figure.colorbar(ScalarMappable(norm, terrain_colours()), cax=side, label="height [m]")
    picture = Bbox.union([drawn, Bbox.from_bounds(x, y, 0.9, height)]).padded(0.25)
    save(figure, path, picture)


def _drawn_box(axes: Any) -> Bbox:
    """The part of its figure that a 3-D view covers [inch]; mplot3d's box is the whole figure."""
    corners = np.stack(np.meshgrid(*(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())), axis=-1)
    x, y, _ = proj3d.proj_transform(*corners.reshape(-1, 3).T, axes.get_proj())
    points = axes.transData.transform(np.stack([x, y], axis=-1))
    labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    box = Bbox.union([Bbox.from_extents(*points.min(axis=0), *points.max(axis=0)), *labels])
    return box.transformed(axes.figure.dpi_scale_trans.inverted())


def _space(figure: Figure, limits: NDArray[np.float64]) -> Any:
    """Axes of a 3-D view at one scale; limits (3, 2) [m]."""
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    axes.set_proj_type("ortho")
    axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
    lengths = limits[:, 1] - limits[:, 0]
    axes.set_box_aspect(lengths, zoom=1.3)
    for axis, length in zip((axes.xaxis, axes.yaxis, axes.zaxis), lengths, strict=True):
        axis.set_major_locator(MaxNLocator(nbins=max(1, round(12 * length / lengths.max()))))
        axis.set_pane_color((0.96, 0.96, 0.96, 1.0))
    axes.set_xlabel("x [m]", labelpad=26.0)
    axes.set_ylabel("y [m]", labelpad=12.0)
    if lengths[2] < lengths.max() / 15.0:
        axes.set_zticks([])  # too close to one another to be read; the colours show the height
    else:
        axes.set_zlabel("z [m]", labelpad=2.0)
    return axes


class _Faces(PolyCollection):
    """Polygons of a 3-D view that are drawn in the order given.

    mplot3d sorts polygons by their mean depth, which is wrong for tall faces beside small ones.

    Parameters
    ----------
    corners : (N, 4, 3) float64 [m], the ones farther from the viewer first
    colours : (N, 3) float64
    """

    def __init__(self, corners: NDArray[np.float64], colours: NDArray[np.float64]) -> None:
        super().__init__(
            [], facecolors=colours, edgecolors=colours * 0.8, linewidths=0.15, clip_on=False
        )
        self._corners = corners

    def do_3d_projection(self) -> float:
        """Project the corners; called by mplot3d before drawing. Returns the nearest depth."""
        axes: Any = self.axes
        x, y, depth = proj3d.proj_transform(*self._corners.reshape(-1, 3).T, axes.get_proj())
        self.set_verts(list(np.stack([x, y], axis=-1).reshape(-1, 4, 2)))
        return float(np.min(depth, initial=0.0))


def observed_part(shown: HeightMap) -> HeightMap:
    """The bounding box of the known cells of a map, with a margin of two cells."""
    area = _bounding_area(shown.known)
    part = area.slices(_whole(shown.geometry))
    return HeightMap(
        geometry=shown.geometry.part(area),
        height=shown.height[part],
        probability=shown.probability[part],
        probability_threshold=shown.probability_threshold,
    )


def _bounding_area(known: NDArray[np.bool_]) -> Area:
    """Bounding box of the known cells with a margin of two; the whole map without known cells."""
    whole = Area(0, 0, *known.shape)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return whole
    height, width = int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1
    return Area(int(rows[0]), int(columns[0]), height, width).grown(2).within(whole)


def _whole(geometry: Geometry) -> Area:
    return Area(0, 0, *geometry.shape)


def map_axes(geometry: Geometry) -> tuple[Figure, Axes]:
    """A figure whose axes show the map from above, in metres, at one scale."""
    height, width = (cells * geometry.resolution for cells in geometry.shape)
    scale = min(11.0 / width, 9.0 / height)
    figure = Figure(figsize=(scale * width + 1.5, scale * height + 1.0))
    axes = figure.add_subplot()
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    return figure, axes


def extent(geometry: Geometry) -> tuple[float, float, float, float]:
    """West, east, south, north [m]."""
    x, y = geometry.cell_corner(geometry.shape)
    return geometry.origin[0], float(x), geometry.origin[1], float(y)


def terrain_colours() -> LinearSegmentedColormap:
    """Colours of matplotlib's terrain without its darkest blue and its white."""
    return LinearSegmentedColormap.from_list(
        "terrain", matplotlib.colormaps["terrain"](np.linspace(0.15, 0.97, 256))
    )


def height_norm(metres: NDArray[np.float64]) -> Normalize:
    """Range of the colours over the finite heights [m], at least half a metre."""
    known = metres[np.isfinite(metres)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    missing = max(_LEAST_SPAN - (high - low), 0.0)
    return Normalize(low - missing / 2, high + missing / 2)


def _draw_trajectory(axes: Axes, trajectory: Trajectory | None) -> None:
    if trajectory is not None:
        axes.plot(trajectory[:, 0], trajectory[:, 1], **TRAJECTORY)


def save(figure: Figure, path: Path, part: Bbox | str = "tight") -> None:
    """Write a figure, or a part of it, as a picture; reproducible to the byte."""
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=_DPI, bbox_inches=part, metadata={"Software": None})
