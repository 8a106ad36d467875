# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of small maps, worked out by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from repository import BAGS

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.map_error import LEAST_OVERLAP, HeightError, evaluate_map, overlap
from heightmap25d_ros.evaluation.truth import Truth, read_truth
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.params.sections import TraversabilityParams

BAG_TRUTH = BAGS / "ramp" / "truth" / "surface.npz"
PARAMS = TraversabilityParams(max_step=0.10)
NAN = np.nan
ORIGIN = (3.0, -1.0)


def truth_of(top: Any, seen: Any = None) -> Truth:
    top = np.array(top, float)
    geometry = Geometry(resolution=0.5, origin=ORIGIN, shape=top.shape)
    return Truth(geometry=geometry, top=top, seen=top if seen is None else np.array(seen, float))


def map_of(height_cm: Any, origin: tuple[float, float] = ORIGIN) -> HeightMap:
    """None stands for unknown; an unknown cell's height is nonsense."""
    height = np.array([[12345 if z is None else z for z in row] for row in height_cm], np.int16)
    known = np.array([[z is not None for z in row] for row in height_cm])
    return HeightMap(
        geometry=Geometry(resolution=0.5, origin=origin, shape=height.shape),
        height=height,
        probability=np.where(known, 60000, 20000).astype(np.uint16),
        probability_threshold=0.5,
    )


def test_heights_are_told_apart_by_the_relief_around_them() -> None:
    top = [[0.0, 0.02, 0.04, 0.10, 0.20, 0.31, NAN]]
    figures = evaluate_map(map_of([[1, 2, 4, 10, 20, 31, 0]]), PARAMS, truth_of(top))
    assert figures.error_of_seen_on_flat.cells == 1  # the first, 2 cm from the second
    assert figures.error_of_seen_on_flat.bias_m == pytest.approx(0.01)
    assert figures.error_of_seen_on_slopes.cells == 2  # 4 cm and 8 cm around the next two
    assert figures.error_of_seen_at_steps.cells == 3  # 16, 21 and 11 cm


def test_figures_of_a_row() -> None:
    truth = truth_of([[0, 0, 0, 1, 1, 1]], [[0, 0, NAN, 1, 1, 1]])
    figures = evaluate_map(map_of([[0, 2, 0, 100, 85, None]]), PARAMS, truth)
    by_relief = "error_of_seen_on_flat", "error_of_seen_on_slopes", "error_of_seen_at_steps"
    table = figures.as_dict()
    # Flat are the first two cells; at the step 100 cm; the last but one is flat, but 15 cm off.
    assert [table.pop(name)["cells"] for name in by_relief] == [3, 0, 1]
    assert table == {
        "known_cells": 5,
        "known_cells_outside": 0,
        "observable_cells": 5,
        "coverage": 0.8,
        "spurious": 0.2,
        "error_of_seen": {  # 0, 0.02, 0, -0.15
            "cells": 4,
            "bias_m": -0.0325,
            "median_absolute_m": 0.01,
            "percentile_95_absolute_m": 0.1305,
            "share_beyond_10_cm": 0.25,
        },
        "error_of_top": {  # 0, 0.02, 0, 0, -0.15
            "cells": 5,
            "bias_m": -0.026,
            "median_absolute_m": 0.0,
            "percentile_95_absolute_m": 0.124,
            "share_beyond_10_cm": 0.2,
        },
        # The true step lies between the third and the fourth cell; so does the first of the two
        # that the map has, and the second is one cell from there.
        "blocked_transitions": {
            "predicted": 2,
            "true": 1,
            "precision": 1.0,
            "recall": 1.0,
            "f1": 1.0,
        },
    }
    json.dumps(figures.as_dict(), allow_nan=False)


def detection(height_cm: Any, top: Any) -> tuple[Any, ...]:
    found = evaluate_map(map_of(height_cm), PARAMS, truth_of(top)).blocked_transitions
    return found.predicted, found.true, found.precision, found.recall, found.f1


def test_step_two_cells_away_does_not_count() -> None:
    assert detection([[0, 0, 0, 50, 50]], [[0, 0, 1, 1, 1]]) == (1, 1, 1.0, 1.0, 1.0)
    assert detection([[0, 0, 0, 0, 50]], [[0, 0, 1, 1, 1]]) == (1, 1, 0.0, 0.0, 0.0)
    assert detection([[0], [0], [0], [0], [50]], [[0], [0], [1], [1], [1]])[2:4] == (0.0, 0.0)


def test_step_one_cell_and_a_half_away_does_not_count() -> None:
    # The only true one leads across, from the third row to the fourth.
    top = [[0, 0], [0, 0], [0, NAN], [NAN, 1]]
    beside = [[None, None], [0, 50], [None, None], [None, None]]
    assert detection(beside, top) == (1, 0, 0.0, None, None)
    above = [[None, None], [None, None], [0, 50], [None, None]]
    assert detection(above, top) == (1, 0, 1.0, None, None)


def test_precision_and_recall_differ() -> None:
    # Predicted at 1 | 2 and 5 | 6, true at 1 | 2 only.
    heights = [[0, 0, 50, 50, 50, 50, 0]]
    assert detection(heights, [[0, 0, 1, 1, 1, 1, 1]]) == (2, 1, 0.5, 1.0, pytest.approx(2 / 3))
    # Predicted at 1 | 2 only, true at 1 | 2 and 5 | 6.
    heights = [[0, 0, 50, 50, 50, 50, 50]]
    assert detection(heights, [[0, 0, 1, 1, 1, 1, 0]]) == (1, 2, 1.0, 0.5, pytest.approx(2 / 3))


def test_diagonal_transitions_count() -> None:
    # A post in a corner: one step along x, one along y, one across.
    assert detection([[0, 0], [0, 50]], [[0, 0], [0, 1]]) == (3, 3, 1.0, 1.0, 1.0)
    assert detection([[0, None], [None, 50]], [[0, 0], [0, 1]]) == (1, 1, 1.0, 1.0, 1.0)
    assert detection([[None, 0], [50, None]], [[0, 0], [1, 0]]) == (1, 1, 1.0, 1.0, 1.0)


def test_steps_to_unknown_cells_are_neither_predicted_nor_missed() -> None:
    assert detection([[0, 0, None, 50]], [[0, 0, 1, 1]]) == (0, 0, None, None, None)
    assert detection([[0, 0, 0, 0]], [[0, 0, 1, 1]]) == (0, 1, None, 0.0, None)
    # But the true step beside an unknown cell bears out a prediction one cell away.
    assert detection([[0, 50, None]], [[0, 0, 1]]) == (1, 0, 1.0, None, None)


def test_step_as_high_as_the_limit_is_open() -> None:
    assert detection([[0, 10]], [[0, 0.1]])[:2] == (0, 0)
    assert detection([[0, 11]], [[0, 0.11]])[:2] == (1, 1)
    assert detection([[0, -11]], [[0, -0.11]])[:2] == (1, 1)


def test_only_what_both_cover_is_compared() -> None:
    # The map begins one cell right and one cell below, and reaches beyond the truth.
    truth = truth_of([[0.0, 0.2], [0.0, 0.4]])
    heights = [[None, 1, 2], [20, 3, 4]]
    figures = evaluate_map(map_of(heights, (3.5, -1.5)), PARAMS, truth)
    assert figures.known_cells == 1
    assert figures.known_cells_outside == 4
    assert figures.coverage == 0.25
    assert figures.error_of_top.bias_m == 0.0
    elsewhere = evaluate_map(map_of(heights, (90.0, 90.0)), PARAMS, truth)
    assert (elsewhere.known_cells, elsewhere.known_cells_outside) == (0, 5)
    assert elsewhere.spurious is None
    assert elsewhere.error_of_top == HeightError(
        cells=0,
        bias_m=None,
        median_absolute_m=None,
        percentile_95_absolute_m=None,
        share_beyond_10_cm=None,
    )


def test_overlap_counts_known_cells_that_the_truth_saw_at_their_height() -> None:
    truth = truth_of([[0.0, 0.0, 3.0, 3.0]], [[0.0, NAN, 3.0, 3.0]])
    # The same; not seen; 0.6 m too low; 0.4 m too low; beyond the truth.
    assert overlap(map_of([[0, 0, 240, 260, 0]]), truth) == 2 / 5
    assert overlap(map_of([[None, None, 300, None]]), truth) == 1.0
    assert overlap(map_of([[0, 0]], (90.0, 90.0)), truth) == overlap(map_of([[None]]), truth) == 0


@pytest.mark.parametrize(
    ("kind", "told"), [("directory", "it is a directory"), ("text", "it is no npz file")]
)
def test_what_is_no_truth_is_told_for_what_it_is(tmp_path: Path, kind: str, told: str) -> None:
    path = tmp_path / "surface.npz"
    path.mkdir() if kind == "directory" else path.write_text("0 0 1\n")
    with pytest.raises(InputError, match=f"^{path}: is not a true surface: {told}$"):
        read_truth(path)


def test_the_truth_of_another_world_is_told_apart() -> None:
    truth = read_truth(BAG_TRUTH)
    own = HeightMap(
        geometry=truth.geometry,
        height=np.rint(np.nan_to_num(truth.seen) * 100).astype(np.int16),
        probability=np.where(np.isfinite(truth.seen), 65535, 0).astype(np.uint16),
        probability_threshold=0.5,
    )
    assert overlap(own, truth) > 0.99
    for name in ("room_1", "rough_1", "street_1", "garage_1"):
        assert overlap(own, read_truth(BAGS / name / "truth" / "surface.npz")) < LEAST_OVERLAP


def test_nothing_where_the_world_has_no_surface() -> None:
    truth = truth_of([[-np.inf, -np.inf, 0.0]], [[NAN, NAN, NAN]])
    figures = evaluate_map(map_of([[7, 7, 7]]), PARAMS, truth)
    assert figures.error_of_top.cells == 1
    assert figures.coverage is None
    assert figures.spurious == 1.0


def test_cells_that_do_not_coincide() -> None:
    truth = truth_of([[0.0, 0.0]])
    with pytest.raises(InputError, match=r"cells of 0\.5 m"):
        evaluate_map(map_of([[0, 0]], (3.2, -1.0)), PARAMS, truth)
    coarse = HeightMap(
        geometry=Geometry(resolution=1.0, origin=ORIGIN, shape=(1, 1)),
        height=np.zeros((1, 1), np.int16),
        probability=np.zeros((1, 1), np.uint16),
        probability_threshold=0.5,
    )
    with pytest.raises(InputError, match="cells of 1 m"):
        evaluate_map(coarse, PARAMS, truth)


def test_truth_itself_is_a_perfect_map() -> None:
    truth = read_truth(BAG_TRUTH)
    perfect = HeightMap(
        geometry=truth.geometry,
        height=np.rint(truth.top * 100).astype(np.int16),
        probability=np.full(truth.geometry.shape, 65535, np.uint16),
        probability_threshold=0.5,
    )
    figures = evaluate_map(perfect, PARAMS, truth)
    assert figures.known_cells == 64 * 256
    assert figures.coverage == 1.0
    assert figures.error_of_top.share_beyond_10_cm == 0.0
    assert abs(figures.error_of_top.percentile_95_absolute_m) <= 0.005 + 1e-6
    assert figures.blocked_transitions.f1 == 1.0
    assert figures.blocked_transitions.predicted == figures.blocked_transitions.true > 1000


def test_files_that_are_no_truth(tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    fields = {
        "top": np.zeros((2, 3)),
        "seen": np.zeros((2, 3)),
        "resolution": 0.5,
        "origin": np.zeros(2),
    }
    with pytest.raises(InputError, match="No such file"):
        read_truth(path)
    for damage in (b"", b"nonsense", b"PK\x03\x04 cut"):
        path.write_bytes(damage)
        with pytest.raises(InputError, match="not a true surface"):
            read_truth(path)
    for changes in ({"top": np.zeros(3)}, {"seen": np.zeros((3, 2))}, {"origin": np.zeros(3)},
                    {"resolution": np.zeros(2)}, {"top": np.array([None])}):  # fmt: skip
        np.savez(path, **(fields | changes))
        with pytest.raises(InputError) as refusal:
            read_truth(path)
        assert "\n" not in str(refusal.value)
    with path.open("wb") as file:
        np.save(file, np.zeros((2, 3)))
    with pytest.raises(InputError, match="not a true surface"):
        read_truth(path)
    np.savez(path, top=np.zeros((2, 3)))
    with pytest.raises(InputError, match="seen"):
        read_truth(path)
    np.savez(path, **fields)
    assert read_truth(path).geometry.shape == (2, 3)
