# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places are taken as by one who counts all of them each time."""

import numpy as np
import pytest
from explored_worlds import CELL

from heightmap25d_ros.exploration import frontiers, stops
from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.exploration.sight import Outlook
from heightmap25d_ros.exploration.stops import Candidates, best_stops
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D

SPACING, LEAST, MOST = 4, 0.5, 6


@pytest.fixture(params=[0, 1, 2])
def survey(request):
    """Of a hall with boxes, of which patches have not been seen."""
    rng = np.random.default_rng(request.param)
    metres = np.zeros((90, 120))
    for _ in range(12):
        y, x = rng.integers(0, 90), rng.integers(0, 120)
        metres[y : y + rng.integers(2, 12), x : x + rng.integers(2, 12)] = rng.choice([1.0, np.nan])
    metres[60:, 80:] = np.nan
    metres[4:14, 4:14] = 0.0
    height_map = HeightMap.from_metres(metres, resolution=CELL)
    return Explorer(Params()).survey(height_map, Pose2D(1.0, 1.0, yaw=0.0))


def taken_by_counting_all(survey, least, most):
    """The rule, literally."""
    cells = [tuple(cell) for cell in frontiers.viewpoints(survey.costs, SPACING).tolist()]
    weight = Params().exploration.distance_weight
    outlook, found = Outlook(survey.scenery), []
    while len(found) < most:
        gains = np.array([outlook.gain(cell) for cell in cells]) * survey.cell_area
        costs = np.array([survey.costs[cell] for cell in cells])
        utility = np.where(gains >= least, gains * np.exp(-weight * costs), 0.0)
        best = int(utility.argmax())
        if utility[best] == 0.0:
            break
        outlook.show(cells[best])
        found.append((cells[best], gains[best]))
    return found


def test_they_are_those_of_the_literal_rule(survey, monkeypatch):
    monkeypatch.setattr(stops, "MOST_LOOKS", 10**6)
    cells = frontiers.viewpoints(survey.costs, SPACING)
    found = best_stops([Candidates(survey, cells, Params().exploration)], LEAST, MOST)
    literal = taken_by_counting_all(survey, LEAST, MOST)
    assert len(literal) >= 2
    assert [survey.cell_of(stop.place) for stop in found] == [cell for cell, _ in literal]
    assert [stop.gain for stop in found] == pytest.approx([gain for _, gain in literal])


def test_one_is_found_however_few_are_counted(survey, monkeypatch):
    monkeypatch.setattr(stops, "MOST_LOOKS", 0)
    cells = frontiers.viewpoints(survey.costs, SPACING)
    found = best_stops([Candidates(survey, cells, Params().exploration)], LEAST, MOST)
    (first, _), *_ = taken_by_counting_all(survey, LEAST, 1)
    assert [survey.cell_of(stop.place) for stop in found] == [first]
    assert best_stops([Candidates(survey, cells, Params().exploration)], 1e6, MOST) == []
