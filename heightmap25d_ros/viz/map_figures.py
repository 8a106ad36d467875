# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of maps, as Fig. 2(c) and 2(d) of the paper. Needs matplotlib, no display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.axes_grid1 import make_axes_locatable
from mpl_toolkits.mplot3d import proj3d
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap
from heightmap25d_ros.terrain.traversability import OCCUPIED, ObstacleMap
from heightmap25d_ros.viz import block_mesh, palette, walls

Trajectory = NDArray[np.float64]
"""(N, 3) [m], map: positions of the robot."""

MAX_BLOCKS = 200_000
"""Largest number of blocks of the 3-D view; larger maps are shown with larger cells."""

_DPI = 150
_WIDTH, _HEIGHT = 7.9, 7.0
"""Largest size of a map from above [inch]: its labels are read on a page of 900 pixels."""
_FINE = 4
"""Points along a cell's side for the hatch."""
_ELEVATION, _AZIMUTH = 38.0, -62.0


def height_map(path: Path | str, shown: HeightMap, trajectory: Trajectory | None = None) -> None:
    """Draw the heights from above; unknown cells are black.

    Parameters
    ----------
    path : Path or str
        Of the picture; its suffix is the format.
    shown : HeightMap
    trajectory : (N, 3) float64 [m], map
        Drawn over it.

    Examples
    --------
    >>> height_map("heights.png", HeightMap.from_metres(np.eye(8)))
    """
    figure, axes = heights_from_above(shown)
    lines = _draw_trajectory(axes, trajectory)
    palette.legend_above(axes, [palette.unknown_entry(), *lines])
    save(figure, path)


def heights_from_above(shown: HeightMap) -> tuple[Figure, Axes]:
    """A figure of the heights from above, in metres, to draw more into."""
    shown = observed_part(shown)
    figure, axes = map_axes(shown.geometry)
    norm = palette.height_norm(shown.metres)
    draw_heights(axes, shown, norm)
    side = make_axes_locatable(axes).append_axes("right", size=0.14, pad=0.1)
    figure.colorbar(palette.height_scale(norm), cax=side, label="height [m]")
    return figure, axes


def draw_heights(axes: Axes, shown: HeightMap, norm: Normalize) -> None:
    """Draw the heights in colours and hillshade."""
    axes.set_facecolor(palette.UNKNOWN)
    picture = palette.relief(shown.metres, shown.geometry.resolution, norm)
    draw_picture(axes, shown.geometry, picture)


def draw_cells(axes: Axes, geometry: Geometry, cells: NDArray[np.bool_], colour: str) -> None:
    """Draw cells in one colour."""
    picture = np.zeros((*cells.shape, 4), np.uint8)
    picture[cells] = (*palette.rgb(colour), 255)
    draw_picture(axes, geometry, picture)


def draw_hatched(axes: Axes, geometry: Geometry, cells: NDArray[np.bool_]) -> None:
    """Hatch inflated cells; their heights stay visible."""
    if not cells.any():
        return
    fine = np.kron(np.pad(cells, 1), np.ones((_FINE, _FINE)))  # contours along the cells' borders
    size = geometry.resolution / _FINE
    x, y = (
        geometry.origin[axis] - geometry.resolution + size * (np.arange(fine.shape[1 - axis]) + 0.5)
        for axis in (0, 1)
    )
    hatch = palette.HATCH
    shown = axes.contourf(x, y, fine, [0.5, 1.5], colors="none", hatches=[hatch["hatch"]])
    shown.set(edgecolor=hatch["edgecolor"], linewidth=hatch["linewidth"])


def draw_picture(axes: Axes, geometry: Geometry, picture: NDArray[np.uint8]) -> Any:
    """Draw a picture (rows, columns, 4) of all cells of a map; returns matplotlib's image."""
    return axes.imshow(picture, origin="lower", extent=extent(geometry), interpolation="nearest")


def obstacle_map(
    path: Path | str,
    shown: ObstacleMap,
    trajectory: Trajectory | None = None,
    heights: HeightMap | None = None,
) -> None:
    """Draw the obstacle grid as Fig. 2(d): free white, unknown black, occupied red.

    Suspected drop-offs, where there are some, are orange.

    Parameters
    ----------
    path, trajectory :
        As of `height_map`.
    shown : ObstacleMap
    heights : HeightMap, optional
        Of that map, to tell walls without known ground from free cells.
    """
    suspected = (shown.occupancy < 0) & (shown.cost == OCCUPIED)
    area = _bounding_area((shown.occupancy >= 0) | suspected)
    geometry = shown.geometry.part(area)
    part = area.slices(_whole(shown.geometry))
    occupancy = shown.occupancy[part]
    layers = [
        (occupancy == 0, palette.FREE, palette.free_entry()),
        (occupancy == OCCUPIED, palette.OCCUPIED, palette.occupied_entry()),
    ]
    if heights is not None:
        hidden = walls.walls_without_ground(heights, shown.occupancy == OCCUPIED)[part]
        layers.append((hidden, palette.WALL, palette.wall_entry()))
    if suspected.any():
        layers.append((suspected[part], palette.SUSPECTED, palette.suspected_entry()))
    figure, axes = map_axes(geometry)
    axes.set_facecolor(palette.UNKNOWN)
    for cells, colour, _ in layers:
        draw_cells(axes, geometry, cells, colour)
    lines = _draw_trajectory(axes, trajectory)
    entries = [entry for _, _, entry in layers]
    palette.legend_above(axes, [*entries, palette.unknown_entry(), *lines])
    save(figure, path)


def blocks(path: Path | str, shown: HeightMap, trajectory: Trajectory | None = None) -> None:
    """Draw a 3-D view as Fig. 2(c): each known cell from its height to its lowest neighbour.

    Parameters
    ----------
    path, shown, trajectory :
        As of `height_map`. A map of more than `MAX_BLOCKS` cells is shown with larger cells.
    """
    shown = block_mesh.coarser(observed_part(shown), MAX_BLOCKS)
    metres = shown.metres
    norm = palette.height_norm(metres)
    faces = block_mesh.faces(shown.geometry, metres, np.radians(_AZIMUTH))
    colours = block_mesh.colours(faces, norm)
    limits = extent(shown.geometry)[:2], extent(shown.geometry)[2:], (norm.vmin, norm.vmax)
    figure = Figure(figsize=(9.6, 7.2))
    axes = _space(figure, np.array(limits))
    axes.add_collection(_Faces(faces.corners, colours), autolim=False)
    if trajectory is not None:
        axes.plot(*trajectory[:, :3].T, **palette.DRIVEN_LINE, clip_on=False)
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    drawn = _drawn_box(axes)
    x, y, height = drawn.x1 + 0.3, drawn.y0 + 0.25 * drawn.height, 0.5 * drawn.height
    width_height = figure.get_size_inches()
    side = figure.add_axes((x / width_height[0], y / width_height[1],
                            0.15 / width_height[0], height / width_height[1]))  # fmt: skip
    figure.colorbar(palette.height_scale(norm), cax=side, label="height [m]")
    figure.legend(
        handles=axes.lines, loc="lower left", frameon=False, fontsize=palette.LEGEND_SIZE,
        borderaxespad=0.0, borderpad=0.0,
        bbox_to_anchor=(x / width_height[0], (y + height + 0.25) / width_height[1]),
    )  # fmt: skip
    picture = Bbox.union([drawn, Bbox.from_bounds(x, y, 1.2, height + 0.45)]).padded(0.3)
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
    axes.set_box_aspect(lengths, zoom=0.95)
    for axis, length in zip((axes.xaxis, axes.yaxis, axes.zaxis), lengths, strict=True):
        axis.set_major_locator(MaxNLocator(nbins=max(1, round(12 * length / lengths.max()))))
        axis.set_pane_color((0.96, 0.96, 0.96, 1.0))
    axes.set_xlabel("x [m]", labelpad=46.0)
    axes.set_ylabel("y [m]", labelpad=18.0)
    if lengths[2] < lengths.max() / 15.0:
        axes.set_zticks([])  # too close to one another to be read; the colours show the height
    else:
        axes.set_zlabel("z [m]", labelpad=8.0)
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
    return shown.part(_bounding_area(shown.known))


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
    scale = min(_WIDTH / width, _HEIGHT / height)
    figure = Figure(figsize=(scale * width + 1.5, scale * height + 1.0))
    axes = figure.add_subplot()
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    return figure, axes


def extent(geometry: Geometry) -> tuple[float, float, float, float]:
    """West, east, south, north [m]."""
    x, y = geometry.cell_corner(geometry.shape)
    return geometry.origin[0], float(x), geometry.origin[1], float(y)


def _draw_trajectory(axes: Axes, trajectory: Trajectory | None) -> list[Artist]:
    """Draw the driven path; returns what a legend shows."""
    if trajectory is None:
        return []
    return list(axes.plot(trajectory[:, 0], trajectory[:, 1], **palette.DRIVEN_LINE))


def save(figure: Figure, path: Path | str, part: Bbox | str = "tight") -> None:
    """Write a figure, or a part of it, as a picture; reproducible to the byte."""
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=_DPI, bbox_inches=part, metadata={"Software": None})
