# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beyond the head of a ramp the ground below is known: there may be a deck, or nothing."""

from dataclasses import replace

import numpy as np
import pytest
from explored_worlds import CELL, at

from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.exploration.unseen_decks import edges
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D

FOOT, HEAD, SLOPE = 2.0, 10.0, 0.15
RISE = SLOPE * (HEAD - FOOT)
LANE = 2.5, 5.5  # y of the ramp
START = Pose2D(1.0, 4.0, yaw=0.0, z=0.0)


def ramp_to_nowhere():
    """A yard of 16 m x 8 m of which all is known, with walls around it, and a ramp in it."""
    height = np.zeros((round(8.0 / CELL), round(16.0 / CELL)))
    height[[0, -1]] = height[:, [0, -1]] = 4.0
    x = (np.arange(height.shape[1]) + 0.5) * CELL
    up = at(height, (FOOT, HEAD), LANE)
    height[up] = (SLOPE * (x - FOOT))[up[1]]
    return HeightMap.from_metres(height, resolution=CELL)


def with_deck(height_map, until):
    """The same, with what is seen of a deck that goes on from the head of the ramp to x [m]."""
    y, x = at(height_map.height, (HEAD, until), LANE)
    cells = np.argwhere(np.ones((y.stop - y.start, x.stop - x.start))) + (y.start, x.start)
    top = round(100 * RISE)
    upper = UpperSurfaces.of(cells, [top] * len(cells), [top - 20] * len(cells))
    return replace(height_map, upper=upper)


def doubting(params=None):
    explorer = Explorer(params or Params())
    explorer.doubt_obstacles()
    return explorer


def visited(explorer, height_map, most=30):
    """The places that a robot looks from in turn, until none is left."""
    place, places = START, []
    for _ in range(most):
        goal = explorer.choose(explorer.survey(height_map, place)).goal
        if goal is None:
            return places
        place = replace(goal, yaw=0.0)
        places.append(place)
        explorer.note_look(explorer.survey(height_map, place))
    return pytest.fail("it looks for ever")


def test_beyond_the_head_of_a_ramp_a_deck_is_looked_for_from_its_upper_end():
    shown, explorer = ramp_to_nowhere(), doubting()
    places = visited(explorer, shown)
    at_head = [place for place in places if place.x > HEAD - 3.0 and LANE[0] < place.y < LANE[1]]
    assert at_head
    for place in at_head:
        assert place.z == pytest.approx(SLOPE * (place.x - FOOT), abs=0.02)


def test_only_when_nothing_else_is_left():
    explorer = Explorer(Params())
    assert explorer.choose(explorer.survey(ramp_to_nowhere(), START)).goal is None


def test_not_on_maps_of_one_level():
    explorer = doubting(with_values(Params(), {"levels.max_surfaces": 1}))
    assert explorer.choose(explorer.survey(ramp_to_nowhere(), START)).goal is None


def test_what_is_seen_of_the_deck_is_followed_at_once():
    """Not only when nothing else is left: it is there."""
    shown, explorer = with_deck(ramp_to_nowhere(), HEAD + 1.5), Explorer(Params())
    goal = explorer.choose(explorer.survey(shown, START)).goal
    assert goal is not None
    assert goal.z == pytest.approx(min(RISE, SLOPE * (goal.x - FOOT)), abs=0.05)
    assert goal.z > RISE - 0.5
    unseen = explorer.survey(shown, goal).unseen_around(goal)
    on_deck = unseen[(unseen[:, 1] > LANE[0]) & (unseen[:, 1] < LANE[1])]
    assert on_deck[:, 0].min() > HEAD - 1.0
    assert on_deck[:, 0].max() > HEAD + 2.5


def test_a_loading_dock_is_looked_at_and_ends():
    """Level ground 1 m high, with a ramp up to it; nothing goes on from its edges."""
    shown = ramp_to_nowhere()
    height = shown.metres
    height[at(height, (HEAD, 13.0), LANE)] = RISE
    places = visited(doubting(), HeightMap.from_metres(height, resolution=CELL))
    assert any(place.x > HEAD for place in places)


def test_a_parapet_is_no_edge():
    shown = ramp_to_nowhere()
    height = shown.metres
    for rail in (
        at(height, (HEAD - 0.5, HEAD), LANE),
        at(height, (FOOT, HEAD), (LANE[0] - 0.25, LANE[0])),
        at(height, (FOOT, HEAD), (LANE[1], LANE[1] + 0.25)),
    ):
        height[rail] = RISE + 0.7
    explorer = doubting()
    survey = explorer.survey(HeightMap.from_metres(height, resolution=CELL), START)
    assert survey.costs[survey.cell_of(Pose2D(8.0, 4.0))] < 20.0
    assert survey.wanted_area == 0.0


def test_steep_ground_is_no_edge():
    x = (np.arange(64) + 0.5) * CELL
    height = np.tile(np.where(x < 2.0, 0.0, -0.5 * (x - 2.0)), (8, 1)).astype(np.float32)
    ground = height == 0.0
    known = np.ones_like(ground)
    found = edges(ground, known, height, depth=12.0, clear_height=0.7, max_step=0.1)
    assert found is None or not found.beyond[:, :20].any()


def test_below_a_deck_that_was_seen_first_the_ground_goes_on():
    """A yard of which half is covered by a deck; what is below the deck has not been seen."""
    shown = ramp_to_nowhere()
    height = shown.metres
    height[at(height, (HEAD, 15.75), (0.25, 7.75))] = RISE
    explorer = doubting()
    looked = visited(explorer, HeightMap.from_metres(height, resolution=CELL))
    below = [place for place in looked if place.z < 0.1]
    assert below
    assert all(HEAD - 3.5 < place.x < HEAD for place in below)
