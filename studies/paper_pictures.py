# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of paper_figures.py that `heightmap25d_ros.render` does not draw."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MultipleLocator, PercentFormatter
from numpy.typing import NDArray
from PIL import Image, ImageOps

from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap

DPI = 150
CUBE, SURFACE, TRUTH, TRACE = "#f2b98a", "#1f6fb4", "black", "#c020d0"
HIDDEN, FOUND = "#c0392b", "#1e8449"
# Colours and widths in the order drawn: lines that coincide are all seen.
HIDDEN_LINES = (("#e67e22", 1.5), (HIDDEN, 4.0), ("#b79be0", 2.5), (SURFACE, 1.2))


@dataclass(frozen=True)
class Box:
    """A box on flat ground [m]."""

    x: tuple[float, float]
    ground: float
    height: float


def hidden_obstacle(
    path: Path,
    box: Box,
    cubes: NDArray[np.int64],
    maps: tuple[HeightMap, HeightMap],
    tried: tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]],
) -> None:
    """Fig. 1: side view of the evidence grid, of the 2 1/2-D map, and what each hides."""
    figure = Figure(figsize=(14.0, 3.1), layout="constrained")
    in_cubes, in_heights, shares = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.1))
    for axes, heights in zip((in_cubes, in_heights), maps, strict=True):
        axes.set(xlim=(0.7, 1.4), ylim=(0.0, 0.4), xlabel="x [m]", aspect="equal")
        side = heights.geometry.resolution
        axes.xaxis.set_major_locator(MultipleLocator(side))
        axes.yaxis.set_major_locator(MultipleLocator(side))
        axes.grid(color="0.85", linewidth=0.8)
        axes.set_axisbelow(True)
        x = (0.0, box.x[0], box.x[0], box.x[1], box.x[1], 2.0)
        z = box.ground + box.height * np.array([0, 0, 1, 1, 0, 0])
        axes.plot(x, z, color=TRUTH, linewidth=1.8, zorder=4)
        axes.text(1.2, 0.21, f"box of {box.height:.2f} m", ha="center", va="bottom")
    side = maps[0].geometry.resolution
    _squares(in_cubes, cubes[:, ::2], side, 0.0)
    _squares_of_heights(in_heights, maps[1])
    in_cubes.set_ylabel("z [m]")
    for axes, heights, verdict, colour in (
        (in_cubes, maps[0], "is climbed", HIDDEN), (in_heights, maps[1], "is an obstacle", FOUND),
    ):  # fmt: skip
        _mark_step(axes, heights, verdict, colour)
    in_cubes.set_title("(a) 3-D grid: height of the cell's centre")
    in_heights.set_title("(b) 2½-D map: height stored in cm")

    for (name, share), (colour, width) in zip(tried[1].items(), HIDDEN_LINES, strict=True):
        shares.plot(tried[0], share, "o-", color=colour, linewidth=width, markersize=2.5 + width,
                    label=name)  # fmt: skip
    shares.axvspan(0.1, 0.25, color="0.95", zorder=0)
    shares.text(0.104, 1.08, "too high to climb", color="0.3", fontsize=9, va="center")
    shares.set(xlim=(0.0, 0.25), ylim=(-0.04, 1.16), xlabel="height of the box [m]",
               ylabel="share of ground heights")  # fmt: skip
    shares.yaxis.set_major_formatter(PercentFormatter(1.0))
    shares.set_yticks(np.arange(0.0, 1.01, 0.25))
    shares.grid(color="0.9")
    shares.legend(frameon=False, loc="upper right", bbox_to_anchor=(1.0, 0.93), fontsize=9)
    shares.set_title("(c) how often nothing is blocked at a box")
    figure.savefig(path, dpi=DPI, metadata={"Software": None})


def _mark_step(axes: Axes, heights: HeightMap, verdict: str, colour: str) -> None:
    """Dots at the heights that a map gives, the highest step between two of them, and a verdict."""
    side = heights.geometry.resolution
    z = heights.metres[0]
    x = (np.arange(len(z)) + 0.5) * side
    axes.plot(x, z, "o", color=colour, markersize=6, zorder=5)
    upper = int(np.nanargmax(np.abs(np.diff(z)))) + 1
    step = z[upper] - z[upper - 1]
    axes.plot([x[upper - 1], x[upper]], [z[upper - 1]] * 2, color=colour, linestyle=":", zorder=5)
    axes.annotate("", (x[upper], z[upper]), (x[upper], z[upper - 1]), zorder=6,
                  arrowprops={"arrowstyle": "<->", "color": colour, "shrinkA": 0, "shrinkB": 0,
                              "linewidth": 1.6})  # fmt: skip
    axes.annotate(f"step of {step:.2f} m {verdict}", (x[upper], z[upper]), (0.73, 0.33),
                  color=colour, fontsize=11, fontweight="bold", zorder=6)  # fmt: skip


def profile(
    path: Path,
    cubes: NDArray[np.int64],
    lowest: float,
    heights: HeightMap,
    top: NDArray[np.float64],
    trajectory: NDArray[np.float64],
) -> None:
    """Fig. 2(b) from the side: a row of the evidence grid (column, layer), heights, truth."""
    geometry = heights.geometry
    row = int(geometry.cell_at((0.0, 0.0))[0])
    x = geometry.origin[0] + geometry.resolution * np.arange(geometry.shape[1] + 1)
    metres = heights.metres[row]
    figure = Figure(figsize=(12.0, 4.9), layout="constrained")
    whole, detail = figure.subplots(2, 1, height_ratios=(1.0, 1.5))
    for axes, x_limits, z_limits in (
        (whole, (2.5, 18.0), (-1.75, 0.3)),
        (detail, (7.0, 12.0), (-1.08, -0.1)),
    ):
        _squares(axes, cubes, geometry.resolution, lowest, geometry.origin[0])
        axes.plot(trajectory[:, 0], trajectory[:, 2], color=TRACE, linewidth=1.2,
                  label="trace of the robot (true pose)")  # fmt: skip
        axes.stairs(metres, x, baseline=None, color=SURFACE, linewidth=2.6,
                    label="2½-D map")  # fmt: skip
        axes.stairs(top, x, baseline=None, color=TRUTH, linewidth=0.9,
                    label="true highest point of each cell")  # fmt: skip
        axes.set(xlim=x_limits, ylim=z_limits, aspect="equal", ylabel="z [m]")
        axes.set_axisbelow(True)
        axes.grid(color="0.92")
    detail.xaxis.set_major_locator(MultipleLocator(0.5))
    detail.yaxis.set_major_locator(MultipleLocator(0.125))
    detail.set_xlabel("x [m]")
    handles, labels = whole.get_legend_handles_labels()
    square = Rectangle((0, 0), 1, 1, facecolor=CUBE, edgecolor="0.3", linewidth=0.5)
    figure.legend([square, *handles], ["occupied cells of the 3-D grid", *labels],
                  loc="outside upper center", ncol=4, frameon=False)  # fmt: skip
    figure.savefig(path, dpi=DPI, metadata={"Software": None})


def cubes(
    path: Path,
    cells: NDArray[np.int64],
    lowest: float,
    geometry: Geometry,
    part: Area,
    trajectory: NDArray[np.float64],
) -> None:
    """Fig. 2(b): a part of the evidence grid in space; cells (N, 3) as (column, row, layer)."""
    shown = cells - (part.ix, part.iy, 0)
    shown = shown[geometry.contains(shown[:, 1::-1])]
    floor = shown[:, 2].min()
    filled = np.zeros((part.columns, part.rows, np.ptp(shown[:, 2]) + 1), bool)
    filled[shown[:, 0], shown[:, 1], shown[:, 2] - floor] = True
    side = geometry.resolution
    starts = (*geometry.origin, lowest + floor * side)
    corners: Any = [
        start + side * np.arange(count + 1)
        for start, count in zip(starts, filled.shape, strict=True)
    ]
    layer = np.arange(filled.shape[2]) / max(filled.shape[2] - 1, 1)
    colours = np.broadcast_to(colormaps["viridis"](layer), (*filled.shape, 4))
    figure = Figure(figsize=(12.0, 8.0))
    axes: Any = figure.add_axes((0.1, 0.0, 0.9, 1.0), projection="3d")
    axes.set_proj_type("ortho")
    axes.view_init(elev=30.0, azim=-62.0)
    axes.voxels(*np.meshgrid(*corners, indexing="ij"), filled, facecolors=colours,
                edgecolors=(0.1, 0.1, 0.1, 0.5), linewidth=0.25)  # fmt: skip
    axes.set_box_aspect(filled.shape, zoom=1.15)
    driven = trajectory[(trajectory[:, 0] > corners[0][0]) & (trajectory[:, 0] < corners[0][-1])]
    axes.plot(*driven.T, color=TRACE, linewidth=2.0, zorder=1e6)
    axes.set_xlabel("x [m]", labelpad=16.0)
    axes.set_ylabel("y [m]", labelpad=8.0)
    axes.set_zlabel("z [m]")
    axes.zaxis.set_major_locator(MultipleLocator(0.5))
    figure.savefig(path, dpi=DPI, bbox_inches="tight", metadata={"Software": None})


def shrink(path: Path) -> None:
    """Store a picture with 256 colours and without the white around it."""
    with Image.open(path) as opened:
        picture = opened.convert("RGB")
    drawn = picture.crop(ImageOps.invert(picture).getbbox())
    framed = ImageOps.expand(drawn, border=20, fill="white")
    framed.quantize(256, kmeans=2, dither=Image.Dither.NONE).save(path, optimize=True)


def _squares(
    axes: Axes, cells: NDArray[np.int64], side: float, lowest: float, first_x: float = 0.0
) -> None:
    """Cells (N, 2) as (column, layer) from the side."""
    squares = [Rectangle(corner, side, side) for corner in cells * side + (first_x, lowest)]
    axes.add_collection(PatchCollection(squares, facecolor=CUBE, edgecolor="0.35", linewidth=0.5))


def _squares_of_heights(axes: Axes, heights: HeightMap) -> None:
    """A row of cells from the side, each filled up to its height."""
    side = heights.geometry.resolution
    bars = np.nan_to_num(heights.metres)[0]
    axes.bar(side * np.arange(len(bars)), bars, width=side, align="edge", color="#a9cbe8",
             edgecolor="0.35", linewidth=0.5)  # fmt: skip
