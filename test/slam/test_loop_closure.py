# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that is searched in an older submap of a corridor, by the crates that stand in it."""

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.loop_closure import LoopSearch, query_of, same_drift
from heightmap25d_ros.slam.map_registration import RegisteredMap, agreement
from heightmap25d_ros.slam.submaps import Submap

PARAMS = Params()
HALF = 1.27  # [m] width of the corridor
DRIFT = se3.from_xyz_rpy([1.4, -0.9, 0.0, 0.0, 0.0, 0.06])  # what brings the robot back


def returns_of(rng, length, crates):
    """Ground and walls (N, 3) of a corridor along x, with a crate of 0.5 m at each of some x."""
    count = int(800 * length)
    floor = np.column_stack([
        rng.uniform(0.0, length, count), rng.uniform(-HALF, HALF, count),
        rng.normal(0.0, 0.005, count),
    ])  # fmt: skip
    is_free = np.ones(count, bool)
    walls = [((0.0, -HALF), (length, -HALF)), ((0.0, HALF), (length, HALF))]
    for x in crates:
        walls += [((x, HALF), (x, HALF - 0.5)), ((x, HALF - 0.5), (x + 0.5, HALF - 0.5)),
                  ((x + 0.5, HALF), (x + 0.5, HALF - 0.5))]  # fmt: skip
        is_free &= (floor[:, 1] < HALF - 0.5) | (np.abs(floor[:, 0] - x - 0.25) > 0.25)
    places = [
        np.array(a) + np.linspace(0, 1, int(160 * np.hypot(*np.subtract(b, a))))[:, None]
        * np.subtract(b, a) for a, b in walls
    ]  # fmt: skip
    xy = np.concatenate(places)
    xy = xy + rng.normal(0.0, 0.005, xy.shape)
    return np.concatenate([floor[is_free], np.column_stack([xy, rng.uniform(0.2, 0.7, len(xy))])])


def submap_of(returns, T_map_base):
    submap = Submap(T_map_base, PARAMS)
    submap.integrate(
        Beams(
            origins=np.broadcast_to(T_map_base[:3, 3] + (0.0, 0.0, 1.0), returns.shape).copy(),
            ends=returns, is_hit=np.ones(len(returns), bool), is_lone=np.zeros(len(returns), bool),
        ),
        0.0,
    )  # fmt: skip
    submap.finish()
    return submap


def searched(crates, seen, x, radius=5.0, waiting=None):
    """A robot in the middle of 12 m with crates at ``seen``, that begin at x of the older map."""
    rng = np.random.default_rng(1)
    older = submap_of(returns_of(rng, 24.0, crates), se3.from_xyz_rpy([2.0, 0, 0, 0, 0, 0]))
    true = returns_of(rng, 12.0, seen) + (x, 0.0, 0.0)
    returns = se3.transform_points(se3.inverse(DRIFT), true)
    T_map_base = se3.inverse(DRIFT) @ se3.from_xyz_rpy([x + 6.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    query = query_of([submap_of(returns, T_map_base)], T_map_base, [returns[::4]], PARAMS)
    return LoopSearch(query, [older], radius, 0.2, PARAMS, waiting).finish(), T_map_base


def test_crates_tell_where_the_robot_is():
    found, T_map_base = searched(crates=[8.0, 9.5], seen=[3.0, 4.5], x=5.0)
    assert found.reason is Reason.ACCEPTED
    pose = se3.to_xyz_rpy(found.drift @ T_map_base)
    np.testing.assert_allclose(pose, [11.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=0.02)


def test_where_nothing_stands_it_may_be_anywhere():
    found, _ = searched(crates=[], seen=[], x=5.0)
    assert found.reason is Reason.AMBIGUOUS


def test_on_new_ground_a_place_that_agrees_but_for_what_stands_there_is_none():
    found, _ = searched(crates=[], seen=[3.0, 4.5], x=5.0)
    assert found.reason is Reason.HIGH_RESIDUAL
    assert not found.possible


def test_two_equal_places_are_both_possible():
    found, T_map_base = searched(crates=[4.0, 8.0, 12.0, 16.0, 20.0], seen=[3.0, 7.0, 11.0], x=5.0)
    assert found.reason is Reason.AMBIGUOUS
    assert len(found.possible) > 1
    assert any(same_drift(drift, DRIFT, T_map_base) for drift in found.possible)


@pytest.mark.parametrize("missing", [12.0, 16.0])
def test_of_places_that_look_alike_those_with_something_else_in_them_are_ruled_out(missing):
    crates = [x for x in (4.0, 8.0, 12.0, 16.0, 20.0) if x != missing]
    seen = [x - 5.0 for x in crates if 5.0 < x < 17.0]
    found, T_map_base = searched(crates, seen, x=5.0)
    assert found.reason is Reason.ACCEPTED
    assert same_drift(found.drift, DRIFT, T_map_base)


def test_a_loop_that_waits_is_looked_at_where_a_search_does_not_reach():
    found, T_map_base = searched(crates=[8.0, 9.5], seen=[3.0, 4.5], x=5.0, radius=0.4)
    assert found.reason is not Reason.ACCEPTED
    found, T_map_base = searched([8.0, 9.5], [3.0, 4.5], x=5.0, radius=0.4, waiting=DRIFT)
    assert found.reason is Reason.ACCEPTED
    assert same_drift(found.drift, DRIFT, T_map_base)


def test_a_loop_that_waits_is_ruled_out_by_what_stands_there():
    found, _ = searched(crates=[], seen=[3.0, 4.5], x=5.0, waiting=DRIFT)
    assert found.reason is Reason.HIGH_RESIDUAL
    assert not found.possible


@pytest.mark.parametrize(("height", "is_contradicted"), [(0.2, False), (0.4, True)])
def test_what_stands_where_nothing_was_contradicts_from_30_cm_on(height, is_contradicted):
    # Less is what rough ground looks like, seen from elsewhere.
    flat = np.zeros((32, 32))
    with_box = flat.copy()
    with_box[14:18, 14:18] = height
    first, second = (
        RegisteredMap(HeightMap.from_metres(metres, resolution=0.125), None, PARAMS)
        for metres in (flat, with_box)
    )
    found = agreement(np.eye(4), first, second, PARAMS)
    assert (found.walls, found.agreeing) == (16, 0)
    assert found.contradicted == (16 if is_contradicted else 0)
