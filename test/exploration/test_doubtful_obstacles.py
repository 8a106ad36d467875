# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of which little was seen, across a corridor that goes on behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from heightmap25d_ros.exploration.doubtful_obstacles import doubtful
from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.grid.height_map import HeightMap, stored_probability
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D

PARAMS = Params()
ROBOT = Pose2D(3.0, 2.0)


def corridor(step, probability=0.7):
    """4 m wide and known up to x = 10 m, with a step [m] at x = 7 m that was seen so seldom."""
    metres = np.full((34, 160), np.nan)
    metres[:, :80] = 0.0
    metres[0], metres[-1], metres[:, 0] = 2.0, 2.0, 2.0
    metres[1:-1, 56:58] = step
    height_map = HeightMap.from_metres(metres)
    belief = height_map.probability.copy()
    belief[1:-1, 56:58] = stored_probability(probability)
    return replace(height_map, probability=belief)


def goal(explorer, height_map):
    return explorer.choose(explorer.survey(height_map, ROBOT)).goal


def with_shelf(height_map):
    """The same, with two levels: a shelf behind the robot, 2.5 m above the ground."""
    cells = np.argwhere(np.ones((30, 4))) + (2, 4)
    upper = UpperSurfaces.of(cells, [250] * len(cells), [230] * len(cells))
    return replace(height_map, upper=upper)


@pytest.mark.parametrize("with_levels", [lambda height_map: height_map, with_shelf])
def test_they_are_looked_at_when_nothing_else_is_left(with_levels):
    explorer, height_map = Explorer(PARAMS), with_levels(corridor(step=0.15))
    assert goal(explorer, height_map) is None
    assert explorer.doubt_obstacles()
    found = goal(explorer, height_map)
    assert 5.0 < found.x < 7.0
    assert not explorer.doubt_obstacles()


def test_a_map_that_is_begun_anew_is_not_doubted():
    explorer, height_map = Explorer(PARAMS), corridor(step=0.15)
    explorer.doubt_obstacles()
    explorer.forget()
    assert goal(explorer, height_map) is None


@pytest.mark.parametrize(("step", "probability"), [(2.0, 0.7), (0.15, 0.99)])
def test_walls_and_what_is_believed_are_no_way(step, probability):
    explorer, height_map = Explorer(PARAMS), corridor(step, probability)
    explorer.doubt_obstacles()
    assert goal(explorer, height_map) is None


def test_after_looks_in_vain_it_ends():
    explorer, height_map = Explorer(PARAMS), corridor(step=0.15)
    explorer.doubt_obstacles()
    place = ROBOT
    for _ in range(20):
        survey = explorer.survey(height_map, place)
        found = explorer.choose(survey).goal
        if found is None:
            break
        place = Pose2D(found.x, found.y, yaw=0.0)
        explorer.note_look(explorer.survey(height_map, place))
    else:
        pytest.fail("it looks at the same step for ever")


def test_a_cell_is_doubted_where_one_beside_it_is():
    """Of two cells that make a step the one that was seen well may be marked."""
    metres = np.zeros((5, 5))
    metres[2, 2] = 0.2
    height_map = HeightMap.from_metres(metres)
    belief = height_map.probability.copy()
    belief[2, 3] = stored_probability(0.6)
    occupied = metres > 0.1
    assert not doubtful(occupied, height_map, 0.1).any()
    found = doubtful(occupied, replace(height_map, probability=belief), 0.1)
    np.testing.assert_array_equal(found, occupied)
