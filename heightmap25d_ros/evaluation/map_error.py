# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Error of a map against the true surface of the world in which it was made.

Heights, coverage and blocked transitions are compared cell by cell; all figures are in `MapError`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.truth import Truth
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Area, Geometry, HeightMap
from heightmap25d_ros.params.sections import TraversabilityParams
from heightmap25d_ros.terrain.steps import NEIGHBOURS
from heightmap25d_ros.terrain.traversability import blocked_transitions

LARGE_ERROR = 0.10
"""Threshold of a large error of a height [m]: the robot's climbing height."""


FLAT, STEP = 0.02, 0.10
"""Height differences of neighbouring cells [m]: the world is flat up to the first and a slope up to
the second; larger ones are steps."""


SAME_HEIGHT = 0.5
"""How far off the height of a cell may be in a map that drifted [m]."""

LEAST_OVERLAP = 0.5
"""`overlap` below which a map is not of the world of the truth.

Measured on the maps of bags/, by both update rules: 0.64 (garage_1, whose odometry drifts in z) to
0.98 against the truth of their own world; less than 0.5 in 94 of 112 pairs with another world. The
others share a level floor or the same ramp with it (0.85: ramp against ramp_1).
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightError:
    """Stored minus true height [m] over a number of cells; None without cells."""

    cells: int
    bias_m: float | None
    median_absolute_m: float | None
    percentile_95_absolute_m: float | None
    share_beyond_10_cm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """Precision and recall of the blocked transitions of a map, with a tolerance of one cell.

    The position of a transition is the middle between its two cells; two transitions match when
    their positions are at most one cell apart, along x and along y.

    Attributes
    ----------
    predicted, true : int
        Blocked transitions of the map, and of the world between cells that the map knows.
    precision : float or None
        Share of the predicted ones that match a true one; None if nothing is predicted.
    recall : float or None
        Share of the true ones that match a predicted one.
    f1 : float or None
        Their harmonic mean.
    """

    predicted: int
    true: int
    precision: float | None
    recall: float | None
    f1: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class MapError:
    """The figures of a map.

    Attributes
    ----------
    known_cells : int
        Within the area of the truth.
    known_cells_outside : int
        Beyond that area.
    observable_cells : int
        Cells in which a noise-free laser measured a surface.
    coverage : float or None
        Share of the observable cells that are known.
    spurious : float or None
        Share of the known cells that are not observable.
    error_of_seen : HeightError
        Against the highest point that the lasers measured, over known observable cells.
    error_of_seen_on_flat, error_of_seen_on_slopes, error_of_seen_at_steps : HeightError
        The same by the relief around a cell: the true heights of the cell and its 8 neighbours
        differ by up to `FLAT`, by up to `STEP`, or by more.
    error_of_top : HeightError
        Against the top of the world, over all known cells: walls are higher than lasers see.
    blocked_transitions : Detection
    """

    known_cells: int
    known_cells_outside: int
    observable_cells: int
    coverage: float | None
    spurious: float | None
    error_of_seen: HeightError
    error_of_seen_on_flat: HeightError
    error_of_seen_on_slopes: HeightError
    error_of_seen_at_steps: HeightError
    error_of_top: HeightError
    blocked_transitions: Detection

    def as_dict(self) -> dict[str, Any]:
        """The figures by name, nested; shares and metres rounded to four digits."""
        return {name: _rounded(value) for name, value in asdict(self).items()}


def evaluate_map(height_map: HeightMap, params: TraversabilityParams, truth: Truth) -> MapError:
    """Compare a map with the truth.

    Parameters
    ----------
    height_map : HeightMap
    params : TraversabilityParams
        ``max_step`` decides which transitions are blocked, in the map and in the world.
    truth : Truth

    Raises
    ------
    InputError
        If the cells of the map do not coincide with those of the truth.
    """
    height_cm, known = on_cells_of(truth.geometry, height_map)
    height = height_cm * HEIGHT_RESOLUTION + height_map.geometry.ground_zero
    observable = np.isfinite(truth.seen)
    known_cells, known_observable = int(known.sum()), int((known & observable).sum())
    error_of_seen = (height - truth.seen)[known & observable]
    relief = _relief(truth.top)[known & observable]
    has_top = known & np.isfinite(truth.top)
    # Rounded down to whole centimetres; the summand is for 0.29 / 0.01 = 28.999...
    max_step_cm = int(params.max_step / HEIGHT_RESOLUTION + 1e-6)
    mask = blocked_transitions(height_cm, known, max_step_cm)
    return MapError(
        known_cells=known_cells,
        known_cells_outside=int(height_map.known.sum()) - known_cells,
        observable_cells=int(observable.sum()),
        coverage=_ratio(known_observable, int(observable.sum())),
        spurious=_ratio(known_cells - known_observable, known_cells),
        error_of_seen=_height_error(error_of_seen),
        error_of_seen_on_flat=_height_error(error_of_seen[relief <= FLAT]),
        error_of_seen_on_slopes=_height_error(error_of_seen[(relief > FLAT) & (relief <= STEP)]),
        error_of_seen_at_steps=_height_error(error_of_seen[relief > STEP]),
        error_of_top=_height_error((height - truth.top)[has_top]),
        blocked_transitions=detection(mask, truth.top, known, params.max_step),
    )


def overlap(height_map: HeightMap, truth: Truth) -> float:
    """Share of a map's known cells that the truth saw, at their height within `SAME_HEIGHT`.

    Raises
    ------
    InputError
        If the cells of the map are not those of the truth.
    """
    height_cm, known = on_cells_of(truth.geometry, height_map)
    error = np.abs(height_cm * HEIGHT_RESOLUTION - truth.seen)
    is_same = known & (error <= SAME_HEIGHT)
    return _ratio(int(is_same.sum()), int(height_map.known.sum())) or 0.0


def _relief(top: NDArray[np.float64]) -> NDArray[np.float64]:
    """(rows, columns) [m]: range of the known tops of a cell and its 8 neighbours."""
    is_known = np.isfinite(top)
    highest = maximum_filter(np.where(is_known, top, -np.inf), 3)
    lowest = minimum_filter(np.where(is_known, top, np.inf), 3)
    # Exact decimals would make a slope of 0.10 m a step.
    return np.asarray(np.where(is_known, highest - lowest - 1e-6, np.inf))


def on_cells_of(
    geometry: Geometry, height_map: HeightMap
) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """Heights [cm] of a map on the cells of the truth, and which of them are known."""
    offset = np.subtract(height_map.geometry.origin, geometry.origin) / geometry.resolution
    ix, iy = np.rint(offset).astype(int)
    is_same = np.isclose(height_map.geometry.resolution, geometry.resolution, rtol=1e-6)
    if not is_same or np.abs(offset - (ix, iy)).max() > 0.01:
        raise InputError(
            f"the map's cells of {height_map.geometry.resolution:g} m are not those of the truth, "
            f"{geometry.resolution:g} m with a corner at {geometry.origin}"
        )
    whole = Area(0, 0, *geometry.shape)
    mapped = Area(int(iy), int(ix), *height_map.geometry.shape)
    common = mapped.within(whole)
    height, known = np.zeros(geometry.shape, np.int16), np.zeros(geometry.shape, np.bool_)
    if common.rows and common.columns:
        height[common.slices(whole)] = height_map.height[common.slices(mapped)]
        known[common.slices(whole)] = height_map.known[common.slices(mapped)]
    return height, known


def _height_error(error: NDArray[np.float64]) -> HeightError:
    if not error.size:
        return HeightError(
            cells=0, bias_m=None, median_absolute_m=None, percentile_95_absolute_m=None,
            share_beyond_10_cm=None,
        )  # fmt: skip
    absolute = np.abs(error)
    return HeightError(
        cells=error.size,
        bias_m=float(error.mean()),
        median_absolute_m=float(np.median(absolute)),
        percentile_95_absolute_m=float(np.percentile(absolute, 95.0)),
        share_beyond_10_cm=float((absolute > LARGE_ERROR).mean()),
    )


def detection(
    mask: NDArray[np.uint8], top: NDArray[np.float64], known: NDArray[np.bool_], max_step: float
) -> Detection:
    """Blocked transitions of a map, as bits over `NEIGHBOURS`, against those of the surface."""
    positions = np.zeros((2 * top.shape[0] + 1, 2 * top.shape[1] + 1), np.bool_)
    predicted_at, true_at = positions.copy(), positions.copy()
    predicted, true = [], []
    for bit, (dy, dx) in enumerate(NEIGHBOURS[:4]):  # the other four are the same, reversed
        here, there = _ends(top.shape, dy, dx)
        rows, columns = (
            2 * index + 1 + d for index, d in zip(np.mgrid[here], (dy, dx), strict=True)
        )
        is_predicted = (mask[here] >> bit & 1).astype(np.bool_)
        with np.errstate(invalid="ignore"):  # infinity minus infinity
            is_true = np.abs(top[there] - top[here]) > max_step
        is_known = known[here] & known[there]
        predicted_at[rows[is_predicted], columns[is_predicted]] = True
        true_at[rows[is_true], columns[is_true]] = True
        predicted.append(np.stack([rows, columns])[:, is_predicted])
        true.append(np.stack([rows, columns])[:, is_true & is_known])
    # A cell is two positions wide, so one cell of tolerance is a square of five positions.
    is_near_true, is_near_predicted = (
        maximum_filter(at, size=5, mode="constant") for at in (true_at, predicted_at)
    )
    found_true = is_near_true[tuple(np.concatenate(predicted, axis=1))]
    found_predicted = is_near_predicted[tuple(np.concatenate(true, axis=1))]
    precision = _ratio(int(found_true.sum()), found_true.size)
    recall = _ratio(int(found_predicted.sum()), found_predicted.size)
    return Detection(
        predicted=found_true.size,
        true=found_predicted.size,
        precision=precision,
        recall=recall,
        f1=_f1(precision, recall),
    )


def open_detection(
    mask: NDArray[np.uint8], top: NDArray[np.float64], known: NDArray[np.bool_], max_step: float
) -> Detection:
    """Open transitions of a map between known cells against those of the surface, each for each."""
    both = predicted = true = 0
    for bit, (dy, dx) in enumerate(NEIGHBOURS[:4]):
        here, there = _ends(top.shape, dy, dx)
        is_known = known[here] & known[there]
        is_open = is_known & (mask[here] >> bit & 1 == 0)
        with np.errstate(invalid="ignore"):  # infinity minus infinity
            is_truly = is_known & (np.abs(top[there] - top[here]) <= max_step)
        both += int((is_open & is_truly).sum())
        predicted, true = predicted + int(is_open.sum()), true + int(is_truly.sum())
    precision, recall = _ratio(both, predicted), _ratio(both, true)
    return Detection(
        predicted=predicted, true=true, precision=precision, recall=recall,
        f1=_f1(precision, recall),
    )  # fmt: skip


def _ends(shape: tuple[int, int], dy: int, dx: int) -> tuple[tuple[slice, slice], ...]:
    """Slices of the cells with a neighbour at (dy, dx), and of these neighbours."""
    whole = Area(0, 0, *shape)
    here = Area(-dy, -dx, *shape).within(whole)
    there = Area(here.iy + dy, here.ix + dx, *here.shape)
    return here.slices(whole), there.slices(whole)


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _f1(precision: float | None, recall: float | None) -> float | None:
    if precision is None or recall is None:
        return None
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    return round(value, 4) if isinstance(value, float) else value
