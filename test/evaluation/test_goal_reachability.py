# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals
from heightmap25d_ros.evaluation.truth import GoalPairs, read_goals
from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.terrain.traversability import ObstacleMap

#             x: 0    1    2    3   4   5   6
COST = np.array([
    [0, 0, 0, 99, 0, 0, 0],
    [0, 0, 0, 100, 0, 0, 0],
    [0, 98, 0, -1, 0, 50, 0],
], np.int8)  # fmt: skip


def obstacle_map(cost):
    geometry = Geometry(resolution=1.0, origin=(0.0, 0.0), shape=cost.shape)
    return ObstacleMap(geometry=geometry, occupancy=cost, cost=cost, blocked=cost.view(np.uint8))


def pairs(*rows):
    start, goal, reachable, observed = zip(*rows, strict=True)
    return GoalPairs(
        start=np.array(start, float),
        goal=np.array(goal, float),
        reachable=np.array(reachable),
        observed=np.array(observed),
    )


def test_inflated_occupied_and_unknown_cells_connect_nothing():
    left, far_left, right = (0.5, 1.5), (0.5, 2.5), (6.5, 0.5)
    figures = evaluate_goals(
        obstacle_map(COST),
        pairs(
            (left, far_left, True, True),  # found, over a cell of cost 98
            (left, right, True, True),  # not found
            (left, right, True, False),  # nobody saw its way
            (left, right, False, False),  # refused
            (left, far_left, False, False),  # wrongly found
        ),
    )
    assert figures.as_dict() == {
        "observed_goals": 2, "found": 1, "unreachable_goals": 2, "refused": 1,
    }  # fmt: skip


def test_a_way_around_is_found_and_a_goal_may_be_a_cell_off():
    cost = COST.copy()
    cost[0, 3] = 98
    figures = evaluate_goals(
        obstacle_map(cost),
        pairs(((0.5, 1.5), (3.5, 1.5), True, True), ((0.5, 1.5), (9.5, 1.5), True, True)),
    )
    assert (figures.observed_goals, figures.found) == (2, 1)


def test_goals_are_read_and_others_refused(tmp_path):
    np.savez(
        tmp_path / "goals.npz", start=np.zeros((2, 3)), goal=np.ones((2, 3)),
        reachable=[True, False], observed=[True, False],
    )  # fmt: skip
    assert read_goals(tmp_path / "goals.npz").goal.tolist() == [[1, 1, 1], [1, 1, 1]]
    np.savez(tmp_path / "other.npz", start=np.zeros((2, 3)))
    for name in ("other.npz", "missing.npz"):
        with pytest.raises(InputError, match=name):
            read_goals(tmp_path / name)
