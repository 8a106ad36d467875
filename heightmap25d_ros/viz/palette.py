# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The colours of all pictures, RViz markers and viewers: heights, cells, lines, legend entries.

Heights are the upper three quarters of matplotlib's viridis, which is perceptually uniform and
ordered by lightness for every kind of colour vision. No other colour is near it, with normal and
with deficient colour vision: cells are red (occupied), cyan (frontier), grey or black; lines have
a rim of the opposite lightness.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize, to_rgb
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

UNKNOWN, FREE, OCCUPIED = "#000000", "#ffffff", "#c8102e"
WALL = "#a6a6a6"
"""Of the tops of walls without known ground around them: nothing in the map shows a step."""
SUSPECTED = "#ffa000"
"""Of unknown cells in which a drop-off is suspected."""
FRONTIER = "#00e5ff"
DRIVEN = CORRECTED = "#c020d0"
PLANNED, ODOMETRY, TRUTH = "#ffffff", "#ff7f0e", "#ffffff"
FOOTPRINT, ROBOT, SLOPE, GROUND = "#000000", "#ffffff", "#2060c0", "#d0d0d0"
DARK_RIM, LIGHT_RIM = "#202020", "#ffffff"

HEIGHTS = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.25, 1.0, 256)), "heights")
"""Colormap of heights; without viridis's dark end, to be seen beside the unknown."""
SCORES = "cividis"
"""Colormap of what is no height."""
LEAST_SPAN = 0.5
"""Least range of heights of the colours [m], so that noise does not look like terrain."""
LEGEND_SIZE = 9.0
TITLE_SIZE = 10.0
"""Font sizes of legends and of panels' titles [pt]."""

_LIGHT = np.array([-1.0, 1.0]) / np.sqrt(2.0)
"""Direction to the light, x and y: north-west, as on printed maps."""
_SLOPE_SHADE, _SLOPE_SCALE = 0.22, 0.4
_EDGE_SHADE, _EDGE_SCALE = 0.28, 0.03
"""Largest change of the brightness, and the slope or the height [m] that makes 76 % of it."""
_ENTRY_WIDTH = 1.75
"""Width of a column of a legend [inch]."""


def height_norm(metres: NDArray[np.float64]) -> Normalize:
    """Range of the colours over the finite heights [m], at least half a metre."""
    known = metres[np.isfinite(metres)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    missing = max(LEAST_SPAN - (high - low), 0.0)
    return Normalize(low - missing / 2, high + missing / 2)


def hillshade(metres: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """Brightness of the cells of a height map; 1 on level ground.

    Slopes towards the light are brighter. A step is bright along its upper edge and dark along its
    lower one, whatever its direction: with the light alone, steps along its direction would vanish.

    Parameters
    ----------
    metres : (rows, columns) float64 [m]
        Heights, NaN where unknown.
    resolution : float [m]

    Returns
    -------
    (rows, columns) float64, 0.5 .. 1.5

    Examples
    --------
    >>> step = np.tile([0.0, 0.0, 0.0, 0.1, 0.1, 0.1], (3, 1))
    >>> hillshade(step, 0.125)[1].round(2)
    array([1.  , 1.  , 0.88, 1.39, 1.  , 1.  ])
    """
    rows, columns = metres.shape
    padded = np.pad(metres, 1, constant_values=np.nan)
    slope, above = np.zeros(metres.shape), np.zeros(metres.shape)
    for dy, dx in np.argwhere(np.ones((3, 3))) - 1:
        there = padded[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns]
        rise = np.nan_to_num(there - metres)  # beside the unknown, as if level
        above -= rise / 8.0
        if dx * dy == 0:
            slope -= rise * (_LIGHT @ (dx, dy)) / (2.0 * resolution)
    edge = np.copysign(np.tanh((above / _EDGE_SCALE) ** 2), above)  # noise of 1 cm: 10 %
    return np.asarray(1.0 + _SLOPE_SHADE * np.tanh(slope / _SLOPE_SCALE) + _EDGE_SHADE * edge)


def lit(colours: NDArray[np.float64], brightness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colours (..., 3) at a brightness (...): below 1 towards black, above 1 towards white."""
    dark, light = np.minimum(brightness, 1.0)[..., None], np.maximum(brightness, 1.0)[..., None]
    return colours * dark + (1.0 - colours) * (light - 1.0)


def relief(metres: NDArray[np.float64], resolution: float, norm: Normalize) -> NDArray[np.uint8]:
    """Picture (rows, columns, 4) of heights [m] in colours and hillshade; NaN is transparent."""
    known = np.isfinite(metres)
    picture = np.zeros((*metres.shape, 4), np.uint8)
    colours = HEIGHTS(norm(metres[known]))[:, :3]
    brightness = hillshade(metres, resolution)[known]
    picture[known, :3] = np.rint(255.0 * lit(colours, brightness))
    picture[known, 3] = 255
    return picture


def height_scale(norm: Normalize) -> ScalarMappable:
    """What a colour bar of heights needs."""
    return ScalarMappable(norm, HEIGHTS)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour, 0 .. 255."""
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue


def _line(colour: str, label: str, width: float, rim: str, **style: Any) -> dict[str, Any]:
    around = [Stroke(linewidth=width + 1.6, foreground=rim), Normal()]
    return {"color": colour, "label": label, "linewidth": width, "path_effects": around, **style}


DRIVEN_LINE = _line(DRIVEN, "driven path", 1.6, LIGHT_RIM, solid_capstyle="round")
PLANNED_LINE = _line(PLANNED, "planned path", 1.5, DARK_RIM, solid_capstyle="round")
CORRECTED_LINE = _line(CORRECTED, "corrected", 1.4, LIGHT_RIM)
ODOMETRY_LINE = _line(ODOMETRY, "odometry alone", 1.4, DARK_RIM)
TRUTH_LINE = _line(TRUTH, "truth", 3.6, DARK_RIM)
FOOTPRINT_LINE: dict[str, Any] = {"color": FOOTPRINT, "linewidth": 0.7}
START_MARK: dict[str, Any] = {
    "marker": "o", "color": "white", "markeredgecolor": "black", "markersize": 8,
    "linestyle": "none", "label": "start",
}  # fmt: skip
GOAL_MARK: dict[str, Any] = START_MARK | {"marker": "*", "markersize": 14, "label": "goal"}
HATCH: dict[str, Any] = {"hatch": "/////", "edgecolor": OCCUPIED, "linewidth": 0.0}
"""Of inflated cells, over heights."""


def without_rim(style: dict[str, Any]) -> dict[str, Any]:
    """The style of a line on a plain background."""
    return {name: value for name, value in style.items() if name != "path_effects"}


def line_entry(style: dict[str, Any]) -> Line2D:
    """The legend entry of a line or a mark with a label."""
    return Line2D([], [], **style)


def cell_entry(colour: str, label: str) -> Patch:
    """The legend entry of the cells of a colour."""
    return Patch(facecolor=colour, edgecolor="black", linewidth=0.6, label=label)


def unknown_entry() -> Patch:
    """The legend entry of unknown cells."""
    return cell_entry(UNKNOWN, "unknown")


def free_entry() -> Patch:
    """The legend entry of free cells."""
    return cell_entry(FREE, "free")


def occupied_entry() -> Patch:
    """The legend entry of occupied cells."""
    return cell_entry(OCCUPIED, "occupied")


def suspected_entry() -> Patch:
    """The legend entry of `SUSPECTED` cells."""
    return cell_entry(SUSPECTED, "suspected drop-off")


def wall_entry() -> Patch:
    """The legend entry of `WALL` cells."""
    return cell_entry(WALL, "wall or ledge without known ground")


def inflated_entry() -> Patch:
    """The legend entry of hatched cells."""
    return Patch(facecolor="white", label="inflated", **HATCH)


def footprint_entry(label: str = "footprint") -> Patch:
    """The legend entry of the robot's outline."""
    return Patch(facecolor="none", edgecolor=FOOTPRINT, linewidth=0.9, label=label)


def legend_above(axes: Axes, entries: Sequence[Artist], title: str | None = None) -> Legend:
    """A legend above axes, in as many columns as the width of the figure allows."""
    figure = axes.get_figure(root=True)
    width = figure.get_figwidth() if figure is not None else 0.0
    columns = min(len(entries), max(1, int(width / _ENTRY_WIDTH)))
    return axes.legend(
        handles=list(entries), loc="lower left", bbox_to_anchor=(0.0, 1.01), ncol=columns,
        frameon=False, borderaxespad=0.0, fontsize=LEGEND_SIZE, handlelength=1.6, columnspacing=1.4,
        title=title, title_fontsize=TITLE_SIZE, alignment="left",
    )  # fmt: skip
