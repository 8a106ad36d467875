# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of several levels against exact truth."""

from dataclasses import replace

import numpy as np
import pytest
from level_worlds import BRIDGE, overpass

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals_on_levels
from heightmap25d_ros.evaluation.level_error import evaluate_levels
from heightmap25d_ros.evaluation.truth import GoalPairs, LevelTruth, read_levels
from heightmap25d_ros.grid.levels import NO_UPPER
from heightmap25d_ros.params.sections import LevelsParams, TraversabilityParams

WORLD = overpass()
TERRAIN = TraversabilityParams(max_slope=0.6)
SETTINGS = LevelsParams(), TERRAIN


def truth():
    ground = WORLD.metres
    deck = ground.copy()
    deck[tuple(WORLD.upper.cell.T)] = WORLD.upper.top / 100
    clearance = np.full((2, *ground.shape), np.inf)
    clearance[0][tuple(WORLD.upper.cell.T)] = WORLD.upper.bottom / 100
    top = np.stack([ground, deck])
    return LevelTruth(geometry=WORLD.geometry, top=top, seen=top, clearance=clearance)


def test_the_world_itself_is_right_on_both_levels():
    errors = evaluate_levels(WORLD, *SETTINGS, truth())
    assert errors.cells == errors.lower.cells == errors.upper.cells == len(WORLD.upper)
    assert errors.both_tops_right == errors.lower.tops_right == errors.upper.tops_right == 1.0
    for level in (errors.lower, errors.upper):
        assert level.blocked_transitions.f1 == level.open_transitions.f1 == 1.0


def test_a_map_of_one_level_has_one_of_them_right():
    lowest = replace(WORLD, upper=NO_UPPER)
    errors = evaluate_levels(lowest, *SETTINGS, truth())
    assert errors.lower.tops_right == 1.0
    assert errors.upper.tops_right == errors.both_tops_right == 0.0
    assert errors.as_dict()["upper"]["tops_right"] == 0.0


def test_goals_are_on_the_level_of_their_z():
    (x0, x1), (y0, y1) = BRIDGE
    over = ((x0 + x1) / 2, (y0 + y1) / 2, 2.0)
    under, road, aloft = (*over[:2], 0.0), (6.0, 1.0, 0.0), (6.0, 1.0, 2.0)
    goals = [over, under, aloft, over]
    pairs = GoalPairs(
        start=np.array([road, road, road, under]),
        goal=np.array(goals),
        reachable=np.array([True, True, False, True]),
        observed=np.array([True, True, False, True]),
    )
    found = evaluate_goals_on_levels(WORLD, *SETTINGS, pairs)
    assert (found.observed_goals, found.found) == (3, 3)
    assert (found.unreachable_goals, found.refused) == (1, 1)


def test_levels_are_read_and_others_refused(tmp_path):
    path = tmp_path / "surface.npz"
    levels, place = np.zeros((2, 3, 4)), {"resolution": 0.125, "origin": np.zeros(2)}
    names = ("level_top", "level_seen", "level_clearance")
    np.savez(path, **dict.fromkeys(names, levels), **place)
    assert read_levels(path).top.shape == (2, 3, 4)
    np.savez(path, **dict.fromkeys(names, levels[:1]), **place)
    with pytest.raises(InputError, match="are not grids of two levels"):
        read_levels(path)
    np.savez(path, top=levels[0], **place)
    assert read_levels(path) is None
