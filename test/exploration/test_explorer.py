# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small worlds, explored to the end by a robot that sees along true lines of sight."""

import math
from dataclasses import replace

import numpy as np
import pytest
from explored_worlds import CELL, at, explore, seen
from level_worlds import bridge_height, overpass

from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D

WALL = 1.5


def room(width, depth):
    """Flat ground of so many metres, with walls around it."""
    height = np.zeros((round(depth / CELL), round(width / CELL)))
    height[[0, -1]] = height[:, [0, -1]] = WALL
    return height


def test_one_room_is_seen_from_where_the_robot_is():
    visit = explore(room(6.0, 6.0), (3.0, 3.0))
    assert visit.has_ended
    assert len(visit.places) == 1
    assert visit.known.all()


def test_a_long_room_ends_with_all_of_it_known():
    visit = explore(room(20.0, 5.0), (2.0, 2.5))
    assert visit.has_ended
    assert visit.known[at(visit.known, (1, 19), (1, 4))].all()
    assert all(a.x < b.x for a, b in zip(visit.places, visit.places[1:], strict=False))


def test_a_corridor_with_a_side_room():
    height = room(16.0, 10.0)
    height[at(height, (0.0, 16.0), (3.0, 3.25))] = WALL  # the corridor's wall
    height[at(height, (10.0, 10.25), (3.0, 10.0))] = WALL  # the room is from 0 to 10 m
    height[at(height, (6.0, 7.5), (3.0, 3.25))] = 0.0  # its door
    visit = explore(height, (2.0, 1.5))
    assert visit.has_ended
    inside = at(height, (1.0, 9.0), (4.0, 9.0))
    assert visit.known[inside].mean() > 0.98
    assert any(place.y > 3.25 for place in visit.places) or visit.known[inside].all()
    beyond = at(height, (11.0, 15.0), (4.0, 9.0))
    assert not visit.known[beyond].any()  # no door leads there


def test_a_narrow_door_is_no_end():
    """The unknown that is seen through it is less than ``min_gain``."""
    height = room(14.0, 6.0)
    height[at(height, (6.0, 6.5), (0.0, 6.0))] = WALL
    height[at(height, (6.0, 6.5), (2.25, 3.75))] = 0.0
    known = np.zeros(height.shape, bool)
    known[at(height, (0.0, 6.5), (0.0, 6.0))] = True
    shown = HeightMap.from_metres(np.where(known, height, np.nan), resolution=CELL)
    explorer = Explorer(with_values(Params(), {"exploration.min_gain": 4.0}))
    choice = explorer.choose(explorer.survey(shown, Pose2D(2.0, 3.0, yaw=0.0)))
    assert choice.goal is not None
    assert choice.gain < 4.0
    small = height.copy()
    small[at(height, (6.5, 14.0), (0.0, 6.0))] = WALL
    known[:] = True
    niche = at(height, (6.5, 7.5), (2.0, 4.0))
    small[niche], known[niche] = 0.0, False
    shown = HeightMap.from_metres(np.where(known, small, np.nan), resolution=CELL)
    assert explorer.choose(explorer.survey(shown, Pose2D(2.0, 3.0, yaw=0.0))).goal is None


def test_an_island_that_cannot_be_reached_does_not_keep_the_robot_busy():
    height = room(12.0, 12.0)
    height[at(height, (7.0, 11.0), (7.0, 11.0))] = -1.5  # a pit, with a plateau in its middle
    height[at(height, (8.5, 9.5), (8.5, 9.5))] = 0.0
    visit = explore(height, (2.0, 2.0))
    assert visit.has_ended
    assert np.isinf(visit.survey.costs[at(height, (8.5, 9.5), (8.5, 9.5))]).all()
    assert visit.known[at(height, (1.0, 6.0), (1.0, 11.0))].all()


def test_a_shadow_that_never_clears_is_given_up():
    height = room(10.0, 10.0)
    hidden = np.zeros(height.shape, bool)
    hidden[at(height, (5.0, 8.0), (5.0, 8.0))] = True  # wet ground, from which no beam returns
    params = with_values(Params(), {"exploration.min_gain": 0.5})  # 1 % of the ground is 0.9 m^2
    visit = explore(height, (2.0, 2.0), hidden=hidden, params=params)
    assert visit.has_ended
    assert len(visit.places) < 15
    assert visit.known[~hidden & (height < WALL)].mean() > 0.99


def test_a_boundary_through_a_door_is_not_passed():
    height = room(16.0, 6.0)
    height[at(height, (8.0, 8.25), (0.0, 6.0))] = WALL
    height[at(height, (8.0, 8.25), (2.0, 4.0))] = 0.0
    boundary = [(0, 0), (8.1, 0), (8.1, 6), (0, 6)]
    visit = explore(height, (2.0, 3.0), boundary=boundary)
    assert visit.has_ended
    assert all(place.x < 8.1 for place in visit.places)
    assert np.isinf(visit.survey.costs[:, round(8.1 / CELL) :]).all()
    free = explore(height, (2.0, 3.0))
    assert any(place.x > 8.25 for place in free.places)


def test_a_start_in_a_dead_end():
    height = room(12.0, 12.0)
    height[at(height, (0.0, 9.0), (3.0, 3.25))] = WALL  # the dead end is below, open at its right
    visit = explore(height, (1.5, 1.5))
    assert visit.has_ended
    assert visit.known[at(height, (1.0, 11.0), (4.0, 11.0))].mean() > 0.99


def test_a_ramp_is_driven_and_a_drop_is_not():
    height = room(14.0, 8.0)
    x = (np.arange(height.shape[1]) + 0.5) * CELL
    height[8:-8, :] = np.interp(x, [4.0, 8.0], [0.0, 0.8])  # up, to a terrace
    height[8:-8, round(11 / CELL) :] = 0.0  # that ends in a drop
    height[[0, -1]] = height[:, [0, -1]] = WALL
    visit = explore(height, (2.0, 4.0))
    assert visit.has_ended
    assert max(place.x for place in visit.places) > 6.0
    assert all(place.x < 11.0 - 0.4 for place in visit.places if 1.5 < place.y < 6.5)


def test_places_that_were_given_up_are_not_chosen_again():
    shown = HeightMap.from_metres(
        np.where(seen(room(20.0, 5.0), (20, 16)), room(20.0, 5.0), np.nan), resolution=CELL
    )
    explorer = Explorer(Params())
    robot = Pose2D(2.0625, 2.5625, yaw=0.0)
    goals = []
    while (choice := explorer.choose(explorer.survey(shown, robot))).goal is not None:
        goals.append(choice.goal)
        explorer.give_up(choice.goal)
    assert 1 < len(goals) < 60
    apart = [math.hypot(a.x - b.x, a.y - b.y) for a in goals for b in goals if a is not b]
    assert min(apart) >= 0.6
    explorer.forget()
    assert explorer.choose(explorer.survey(shown, robot)).goal == goals[0]


def test_looks_are_of_cells_of_the_world_however_the_map_grows():
    height = room(10.0, 10.0)
    height[at(height, (5.0, 8.0), (5.0, 8.0))] = np.nan
    explorer, robot = Explorer(Params()), Pose2D(3.0, 3.0, yaw=0.0)
    before = explorer.survey(HeightMap.from_metres(height, resolution=CELL), robot)
    assert before.scenery.wanted.any()
    explorer.note_look(before)
    grown = np.full((height.shape[0] + 7, height.shape[1] + 3), np.nan)
    grown[7:, 3:] = height
    after = explorer.survey(
        HeightMap.from_metres(grown, resolution=CELL, origin=(-3 * CELL, -7 * CELL)), robot
    )
    once = explorer.survey(HeightMap.from_metres(height, resolution=CELL), robot)
    assert np.array_equal(after.scenery.wanted[7:, 3:], once.scenery.wanted)
    assert after.wanted_area < before.wanted_area


def test_what_was_looked_for_in_vain_is_looked_for_again_by_who_is_near():
    height = room(30.0, 4.0)
    height[at(height, (24.0, 29.0), (0.2, 3.8))] = np.nan
    shown = HeightMap.from_metres(height, resolution=CELL)
    explorer, near, far = Explorer(Params()), Pose2D(20.6, 2.0), Pose2D(2.0, 2.0)
    assert explorer.choose(explorer.survey(shown, far)).goal is not None
    explorer.note_look(explorer.survey(shown, near))
    assert explorer.choose(explorer.survey(shown, far)).goal is None
    again = explorer.choose(explorer.survey(shown, near)).goal
    assert again is not None
    explorer.note_look(explorer.survey(shown, replace(again, yaw=0.0)))
    assert explorer.choose(explorer.survey(shown, near)).goal is None


def ramp_of_which_3_m_are_known(foot):
    """A hall of 30 m x 4 m, in which the ground rises from x = foot on."""
    height = room(30.0, 4.0)
    x = (np.arange(height.shape[1]) + 0.5) * CELL
    up = at(height, (foot, 29.75), (0.25, 3.75))
    height[up] = (0.2 * (x - foot))[up[1]]
    height[at(height, (foot + 3.0, 29.75), (0.25, 3.75))] = np.nan
    return HeightMap.from_metres(height, resolution=CELL)


@pytest.mark.parametrize("min_gain", [2.0, 5.0])
def test_a_ramp_that_was_looked_for_from_its_foot_is_driven_up_before_the_end(min_gain):
    """Nothing hides its upper part there, but scanners see nothing above themselves.

    4.5 m^2 of it are in sight from below: more, or less, but they open the way.
    """
    shown = ramp_of_which_3_m_are_known(20.0)
    explorer = Explorer(with_values(Params(), {"exploration.min_gain": min_gain}))
    foot, far = Pose2D(19.5, 2.0), Pose2D(2.0, 2.0)
    for _ in range(2):
        explorer.note_look(explorer.survey(shown, foot))
    assert explorer.survey(shown, far).wanted_area == 0.0
    explorer.doubt_obstacles()
    goal = explorer.choose(explorer.survey(shown, far)).goal
    assert goal is not None
    assert 20.0 < goal.x < 23.0
    explorer.note_look(explorer.survey(shown, replace(goal, yaw=0.0)))
    assert explorer.choose(explorer.survey(shown, far)).goal is None


def test_doubtful_looks_that_show_no_ground_to_drive_on_are_made_three_times_at_most():
    """Three strips of ground too high for the robot, each of which two looks have missed."""
    height = room(40.0, 4.0)
    for x in (8.0, 16.0, 24.0, 32.0):
        height[at(height, (x, x + 2.5), (2.0, 3.75))] = np.nan
    shown = HeightMap.from_metres(height, resolution=CELL)
    explorer, places = Explorer(Params()), []
    for place in (Pose2D(x, 1.0, yaw=0.0) for x in (4.5, 12.5, 20.5, 28.5, 36.5)):
        for _ in range(4):
            explorer.note_look(explorer.survey(shown, place))
    explorer.doubt_obstacles()
    place = Pose2D(2.0, 1.0)
    for _ in range(20):
        goal = explorer.choose(explorer.survey(shown, place)).goal
        if goal is None:
            break
        place = replace(goal, yaw=0.0)
        places.append(place)
        explorer.note_look(explorer.survey(shown, place))
    assert len(places) == 3


@pytest.mark.parametrize(("driven", "is_worth"), [(0.0, True), (20.0, False), (60.0, True)])
def test_a_doubtful_look_costs_half_of_the_way_so_far_at_most(driven, is_worth):
    """17.5 m to a ramp that was missed from its foot; 0: nobody tells how far it has driven."""
    shown = ramp_of_which_3_m_are_known(20.0)
    explorer, foot, far = Explorer(Params()), Pose2D(19.5, 2.0), Pose2D(2.0, 2.0)
    for _ in range(2):
        explorer.note_look(explorer.survey(shown, foot), driven)
    explorer.doubt_obstacles()
    goal = explorer.choose(explorer.survey(shown, far), driven).goal
    assert (goal is not None) == is_worth


def test_a_robot_that_has_hardly_moved_looks_at_what_it_doubts_all_the_same():
    """After the first turn, with 2 cm of odometry, half of the way so far is nothing."""
    shown = ramp_of_which_3_m_are_known(8.0)
    explorer, foot = Explorer(Params()), Pose2D(7.5, 2.0)
    for _ in range(2):
        explorer.note_look(explorer.survey(shown, foot), 0.01)
    explorer.doubt_obstacles()
    assert explorer.choose(explorer.survey(shown, foot), 0.02).goal is not None


def test_a_way_on_that_was_missed_from_afar_is_looked_at_from_near_before_the_end():
    """Two looks from 4 m show little of what a rise hides; half a place may lie behind it."""
    height = room(30.0, 4.0)
    height[at(height, (16.0, 29.75), (0.25, 3.75))] = np.nan
    shown = HeightMap.from_metres(height, resolution=CELL)
    explorer, place, near = Explorer(Params()), Pose2D(12.4, 2.0), Pose2D(8.0, 2.0)
    for _ in range(4):
        explorer.note_look(explorer.survey(shown, place))
    assert explorer.choose(explorer.survey(shown, near)).goal is None
    explorer.doubt_obstacles()
    assert explorer.choose(explorer.survey(shown, Pose2D(2.0, 2.0))).goal is None
    goal = explorer.choose(explorer.survey(shown, near)).goal
    assert goal is not None
    assert 13.0 < goal.x < 16.0
    for _ in range(3):  # what one look leaves wanted beside it is looked at as well
        survey = explorer.survey(shown, near)
        goal = explorer.choose(survey).goal
        if goal is None:
            break
        explorer.note_look(explorer.survey(shown, replace(goal, yaw=0.0)))
    assert explorer.choose(explorer.survey(shown, near)).goal is None


def test_the_gain_is_what_a_full_turn_shows():
    height = room(10.0, 6.0)
    height[at(height, (6.0, 6.25), (2.0, 4.0))] = WALL
    known = np.zeros(height.shape, bool)
    known[at(height, (0.0, 5.0), (0.0, 6.0))] = True
    known[at(height, (0.0, 6.25), (2.0, 4.0))] = True
    shown = HeightMap.from_metres(np.where(known, height, np.nan), resolution=CELL)
    params = with_values(Params(), {"exploration.frontier_depth": 50.0})
    survey = Explorer(params).survey(shown, Pose2D(2.0, 3.0, yaw=0.0))
    place = Pose2D(4.0625, 3.0625)
    truth = seen(np.where(known, height, 0.0), survey.cell_of(place), blind=1.4)
    expected = (truth & survey.scenery.wanted).sum() * survey.cell_area
    assert survey.gain_of(place) == pytest.approx(expected, rel=0.1)
    assert survey.gain_of(Pose2D(-50.0, 0.0)) == 0.0


def test_a_robot_beyond_the_map_has_nowhere_to_go():
    survey = Explorer(Params()).survey(HeightMap.from_metres(room(5.0, 5.0)), Pose2D(99.0, 0.0))
    assert np.isinf(survey.costs).all()
    assert survey.covered_area == 0.0


# Several levels


def test_the_far_half_of_a_bridge_is_looked_for_from_the_bridge():
    """The ground below it is known; that it ends there is not."""
    whole = overpass()
    seen = whole.upper.where(whole.upper.cell[:, 1] < round(6.0 / CELL))
    shown = replace(whole, upper=seen)
    values = {"traversability.max_slope": 0.6, "exploration.min_gain": 0.5}
    explorer = Explorer(with_values(Params(), values))
    robot = Pose2D(6.0, 1.0, yaw=0.0, z=0.0)
    survey = explorer.survey(shown, robot)
    goal = explorer.choose(survey).goal
    assert goal is not None
    assert goal.z == pytest.approx(float(bridge_height(goal.x)), abs=0.1)
    assert goal.z > 1.0
    on, under = (survey.cost_of(Pose2D(x, 5.0, z=z)) for x, z in ((5.1, 2.0), (6.0, 0.0)))
    assert under + 2.0 < on < 30.0
    assert 40.0 < survey.covered_area < 120.0
    # On the bridge nothing more is to be seen: so it ends there.
    there = replace(goal, yaw=0.0)
    for _ in range(4):
        explorer.note_look(explorer.survey(shown, there))
    assert explorer.survey(shown, there).gain_of(there) == 0.0
