# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import functools
import itertools
import math
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_transitions import LiteralGround, rectangle_holds, squares_overlap
from planner_worlds import CELL, World, center, random_place, route_planner
from properties import draws
from scipy import ndimage
from small_terrain import SEEDS

from heightmap25d_ros.planning.plan import Pose2D, Status


def cell_of(place):
    return math.floor(place.y / CELL), math.floor(place.x / CELL)


def in_cells(poses):
    """(N, 3) y, x [cells] and heading of poses on the map."""
    heading = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    return np.column_stack([poses[:, 1, 3] / CELL, poses[:, 0, 3] / CELL, heading])


def assert_ends_as_asked(plan, start, goal):
    np.testing.assert_allclose(plan.poses[0, :2, 3], (start.x, start.y), atol=1e-9)
    np.testing.assert_allclose(plan.poses[-1, :2, 3], (goal.x, goal.y), atol=1e-9)
    looks = in_cells(plan.poses)[:, 2]
    for look, place in ((looks[-1], goal), (looks[0], start)):
        if place.yaw is not None and len(looks) > 1:
            assert abs(math.remainder(look - place.yaw, 2 * math.pi)) < 1e-6


def assert_sound(plan):
    """Poses are close together, and their orientations rotations."""
    poses = plan.poses
    steps = np.hypot(*np.diff(poses[:, :2, 3], axis=0).T)
    assert (steps <= 0.1 + 1e-6).all()
    rotation = poses[:, :3, :3]
    np.testing.assert_allclose(
        rotation @ rotation.transpose(0, 2, 1), np.eye(3)[None].repeat(len(poses), 0), atol=1e-6
    )
    assert (np.linalg.det(rotation) > 0).all()
    assert (poses[:, 3] == (0, 0, 0, 1)).all()
    assert plan.length >= steps.sum() - 1e-6


def driven(path):
    """Poses along a path, with its turns on the spot in steps of 3 degrees, but for the first."""
    steps = np.diff(path[:, :2], axis=0)
    along = np.arctan2(*steps.T)
    looks = path[0, 2] if len(path) == 1 else along[0]
    for i, (y, x, heading) in enumerate(path):
        for look in (looks, heading, *along[i : i + 1])[0 if i else 2 :]:
            turn = math.remainder(look - looks, 2 * math.pi)
            for share in np.linspace(0, 1, math.ceil(abs(turn) / math.radians(3)) + 1):
                yield y, x, looks + share * turn
            looks = look
        if i < len(along):
            yield (*(path[i, :2] + 0.5 * steps[i]), looks)


def assert_drivable(plan, graph, occupied, size):
    """Lines are open; the rectangle overlaps no cell but those at the start, which it leaves."""
    literal = LiteralGround.of(graph)
    path = in_cells(plan.poses)
    for p, q in pairwise(path[:, :2]):
        assert literal.line_is_open(p, q)
    cells = np.argwhere(occupied)
    size = size[0] / CELL, size[1] / CELL
    is_left, before = None, 0.0
    for pose in driven(path):
        near = cells[(np.abs(cells + 0.5 - pose[:2]) <= sum(size)).all(axis=1)]
        under = {(int(iy), int(ix)) for iy, ix in near[squares_overlap(pose, size, near)]}
        is_left = under if is_left is None else is_left
        assert under <= is_left
        if not under:
            is_left = set()
        if is_left:
            away = min(squared_distance(cell, pose) for cell in is_left)
            assert away >= before - 1e-6
            before = away


def squared_distance(cell, pose):
    """From a cell's square to a pose [cells]."""
    return sum(max(abs(c + 0.5 - p) - 0.5, 0.0) ** 2 for c, p in zip(cell, pose[:2], strict=True))


@given(SEEDS)
@draws(200)
def test_random_maps_with_a_robot_that_fits_wherever_its_disc_does(seed):
    rng = np.random.default_rng(seed)
    world = World.random(rng)
    side = (world.radius - 0.09) * math.sqrt(2)  # even off the middle of a cell
    planner = world.planner(robot_length=side, robot_width=side)
    enterable = world.enterable
    assert (planner.graph.enterable == enterable).all()
    labels, _ = ndimage.label(enterable)  # a diagonal needs its corners: straight steps suffice
    start, goal = random_place(rng, enterable), random_place(rng, enterable, rng.random() < 0.9)
    if not enterable[cell_of(start)]:
        return
    plan = planner.plan(start, goal, is_robot_there=False, is_field_wanted=bool(rng.random() < 0.5))
    if not enterable[cell_of(goal)]:
        assert plan.status is Status.GOAL_OCCUPIED
    elif labels[cell_of(start)] != labels[cell_of(goal)]:
        assert plan.status is Status.NO_VALID_PATH
    else:
        assert plan.found
        assert_ends_as_asked(plan, start, goal)
        assert_sound(plan)
        assert_drivable(plan, planner.graph, world.occupied, (side, side))
        assert plan.least_clearance > world.radius - 0.09
        return
    assert plan.poses.shape == (0, 4, 4)
    assert plan.reason


@given(SEEDS)
@draws(200)
def test_random_maps_with_a_robot_longer_than_its_disc(seed):
    rng = np.random.default_rng(seed)
    world = World.random(rng)
    size = 2.0 * world.radius + rng.uniform(0.1, 0.6), 2.0 * world.radius - 0.05
    planner = world.planner(robot_length=size[0], robot_width=size[1])
    enterable = world.enterable
    labels, _ = ndimage.label(enterable)
    start, goal = random_place(rng, enterable), random_place(rng, enterable)
    if not enterable[cell_of(start)]:
        return
    plan = planner.plan(start, goal, is_robot_there=False)
    if plan.found:
        assert labels[cell_of(start)] == labels[cell_of(goal)]
        assert_ends_as_asked(plan, start, goal)
        assert_sound(plan)
        assert_drivable(plan, planner.graph, world.occupied, size)
    else:
        assert plan.status in (Status.GOAL_OCCUPIED, Status.NO_VALID_PATH)


@given(SEEDS)
@draws(150)
def test_random_maps_with_the_robot_anywhere(seed):
    rng = np.random.default_rng(seed)
    world = World.random(rng)
    size = 1.6 * world.radius, 1.2 * world.radius
    planner = world.planner(robot_length=size[0], robot_width=size[1], goal_tolerance=1.0)
    start, goal = (random_place(rng, world.enterable, rng.random() < 0.3) for _ in range(2))
    start = Pose2D(start.x, start.y, start.yaw or 0.0)
    plan = planner.plan(start, goal, is_robot_there=True)
    if not plan.found:
        return
    end_x, end_y = plan.poses[-1, :2, 3]
    assert math.hypot(end_x - goal.x, end_y - goal.y) <= 1.0 + 1e-9
    assert_ends_as_asked(plan, start, Pose2D(end_x, end_y, goal.yaw))
    assert_sound(plan)
    # What is under the rectangle at the start is noise; all else is as it was.
    pose = start.y / CELL, start.x / CELL, start.yaw
    cells = np.argwhere(np.ones_like(world.known))
    inside, undecided = rectangle_holds(pose, (size[0] / CELL, size[1] / CELL), cells + 0.5)
    is_under = (inside | undecided).reshape(world.known.shape)
    assert_drivable(plan, plan.graph, world.occupied & ~is_under, size)
    for iy, ix in np.floor(in_cells(plan.poses)[:, :2]).astype(int):
        assert world.known[iy, ix] or is_under[iy, ix]
        assert not world.occupied[iy, ix] or is_under[iy, ix]
        if math.hypot(iy - pose[0], ix - pose[1]) > 20:
            assert world.enterable[iy, ix]


@pytest.mark.parametrize(("gx", "gy"), [(0.0, 0.0), (0.24, 0.0), (0.0, -0.16), (0.16, 0.24)])
def test_poses_lie_on_a_plane_and_are_inclined_as_it_is(gx, gy):
    y, x = (np.indices((60, 70)) + 0.5) * CELL
    height = 100 * (gx * x + gy * y) + 100
    names = ("climb", "descent", "cross_slope", "roughness")
    planner = route_planner(height, unknown="cost", **{f"{name}_weight": 0.0 for name in names})
    start, goal = Pose2D(1.3, 1.1, 0.3), Pose2D(7.4, 6.2, -2.0)
    plan = planner.plan(start, goal, is_robot_there=False)
    assert plan.found
    assert_ends_as_asked(plan, start, goal)
    assert_sound(plan)
    place = plan.poses[:, :3, 3]
    surface = gx * place[:, 0] + gy * place[:, 1] + 1.0
    np.testing.assert_allclose(place[5:-5, 2], surface[5:-5], atol=0.03)
    normal = np.array([-gx, -gy, 1.0]) / math.sqrt(1 + gx * gx + gy * gy)
    np.testing.assert_allclose(plan.poses[:, :3, 2], np.tile(normal, (len(place), 1)), atol=0.01)
    assert plan.steepest_slope == pytest.approx(math.atan(math.hypot(gx, gy)), abs=0.01)
    rise = gx * (7.4 - 1.3) + gy * (6.2 - 1.1)
    away = math.hypot(7.4 - 1.3, 6.2 - 1.1)
    assert plan.length == pytest.approx(math.hypot(away, rise), rel=0.02)
    assert plan.climb == pytest.approx(max(rise, 0.0), abs=0.06)
    assert plan.least_clearance == math.inf


FLAT = np.zeros((40, 40), np.int16)


def walled(first_row=0):
    """Flat ground, and a wall across it from a row on."""
    height = FLAT.copy()
    height[first_row:, 20] = 150
    return height


def status_of(planner, start, goal, *, is_robot_there=False):
    plan = planner.plan(start, goal, is_robot_there=is_robot_there)
    assert (len(plan.poses) > 0) == (plan.found)
    return plan.status


@pytest.mark.parametrize("place", [(-0.01, 2.0), (2.0, -0.01), (5.01, 2.0), (2.0, 5.01), (1e9, 0)])
def test_outside_of_the_map(place):
    planner = route_planner(FLAT)
    inside, outside = Pose2D(2.5, 2.5), Pose2D(*place)
    assert status_of(planner, inside, outside) is Status.GOAL_OUTSIDE_MAP
    assert status_of(planner, outside, inside) is Status.START_OUTSIDE_MAP
    assert status_of(planner, outside, inside, is_robot_there=True) is Status.START_OUTSIDE_MAP


def test_a_map_that_does_not_begin_at_zero():
    planner = route_planner(FLAT, origin=(-30.0, 10.0))
    start, goal = Pose2D(-29.0, 11.0), Pose2D(-26.0, 14.0)
    plan = planner.plan(start, goal, is_robot_there=False)
    assert_ends_as_asked(plan, start, goal)
    assert status_of(planner, Pose2D(1.0, 1.0), goal) is Status.START_OUTSIDE_MAP


def test_on_an_obstacle_and_beside_one():
    planner = route_planner(walled(10))
    free = center((20, 6))
    plan = planner.plan(free, center((20, 20)), is_robot_there=False)
    assert plan.status is Status.GOAL_OCCUPIED
    assert "on an obstacle" in plan.reason
    beside = planner.plan(free, center((20, 22)), is_robot_there=False)
    assert beside.status is Status.GOAL_OCCUPIED
    assert "0.25 m from an obstacle" in beside.reason
    start = planner.plan(center((20, 20)), free, is_robot_there=False)
    assert start.status is Status.START_OCCUPIED
    assert "on an obstacle" in start.reason


def test_unknown_ground():
    known = np.ones(FLAT.shape, bool)
    known[15:25, 25:35] = False
    planner = route_planner(FLAT, known)
    plan = planner.plan(center((20, 6)), center((20, 30)), is_robot_there=False)
    assert plan.status is Status.GOAL_OCCUPIED
    assert "unknown" in plan.reason
    near = planner.plan(center((20, 6)), center((20, 24)), is_robot_there=False)
    assert near.status is Status.GOAL_OCCUPIED
    assert "too near to unknown" in near.reason
    dear = route_planner(FLAT, known, unknown="cost")
    assert status_of(dear, center((20, 6)), center((20, 30))) is Status.NONE


def test_a_goal_that_no_path_leads_to():
    plan = route_planner(walled()).plan(center((20, 6)), center((20, 33)), is_robot_there=False)
    assert plan.status is Status.NO_VALID_PATH
    assert plan.reason


def test_start_and_goal_in_one_cell_and_at_one_place():
    planner = route_planner(FLAT)
    start = Pose2D(2.51, 2.52, 0.5)
    plan = planner.plan(start, Pose2D(2.6, 2.6, 1.0), is_robot_there=False)
    assert plan.found
    assert_ends_as_asked(plan, start, Pose2D(2.6, 2.6, 1.0))
    turned = planner.plan(start, Pose2D(2.51, 2.52, -2.0), is_robot_there=False)
    assert turned.found
    assert in_cells(turned.poses)[-1, 2] == pytest.approx(-2.0)
    assert turned.length == pytest.approx(0.0, abs=1e-9)


def test_the_goals_heading_is_kept_and_else_the_path_ends_as_it_comes():
    planner = route_planner(FLAT)
    start = Pose2D(1.0, 1.0)
    kept = planner.plan(start, Pose2D(4.0, 1.0, 2.0), is_robot_there=False)
    assert in_cells(kept.poses)[-1, 2] == pytest.approx(2.0)
    free = planner.plan(start, Pose2D(4.0, 1.0), is_robot_there=False)
    assert in_cells(free.poses)[-1, 2] == pytest.approx(0.0, abs=0.05)


@given(SEEDS, st.sampled_from([0.3, 1.0, 3.0]))
@draws(150)
def test_the_tolerance_picks_the_nearest_place_that_can_be_reached(seed, tolerance):
    rng = np.random.default_rng(seed)
    world = World.random(rng)
    side = (world.radius - 0.09) * math.sqrt(2)
    planner = world.planner(robot_length=side, robot_width=side, goal_tolerance=tolerance)
    labels, _ = ndimage.label(world.enterable)
    start, goal = random_place(rng, world.enterable), random_place(rng, world.enterable, False)
    if not labels[cell_of(start)]:
        return
    reached = np.argwhere(labels == labels[cell_of(start)])
    away = np.hypot(*((reached + 0.5) * CELL - (goal.y, goal.x)).T)
    plan = planner.plan(start, goal, is_robot_there=False)
    if labels[cell_of(goal)] == labels[cell_of(start)]:
        assert_ends_as_asked(plan, start, goal)
        assert not plan.reason
    elif away.min() <= tolerance:
        assert plan.found
        end_x, end_y = plan.poses[-1, :2, 3]
        assert math.hypot(end_x - goal.x, end_y - goal.y) == pytest.approx(away.min(), abs=1e-6)
        assert_ends_as_asked(plan, start, Pose2D(end_x, end_y, goal.yaw))
        assert f"{away.min():.2f} m from the goal" in plan.reason
    else:
        assert plan.status in (Status.GOAL_OCCUPIED, Status.NO_VALID_PATH)


def test_noise_under_the_robot_does_not_hold_it():
    height = FLAT.copy()
    height[19, 21] = 60
    start, goal = center((20, 20), 0.4), center((20, 34))
    planner = route_planner(height)
    assert status_of(planner, start, goal, is_robot_there=True) is Status.NONE
    assert status_of(planner, center((19, 21)), goal, is_robot_there=True) is Status.NONE
    assert status_of(planner, center((19, 21)), goal) is Status.START_OCCUPIED


def test_unknown_cells_under_the_robot_are_ground():
    known = np.ones(FLAT.shape, bool)
    known[18:23, 18:23] = False  # 0.625 m: what the lasers do not see of where it starts
    planner = route_planner(FLAT, known)
    for is_robot_there in (True, False):
        start, goal = center((20, 20), 0.0), center((20, 34))
        plan = planner.plan(start, goal, is_robot_there=is_robot_there)
        assert plan.found
        assert_ends_as_asked(plan, start, goal)


def test_a_robot_beside_a_wall_may_move_away_but_not_through():
    planner = route_planner(walled(10), robot_length=0.5, robot_width=0.4)
    for is_robot_there in (True, False):
        start = center((30, 17), math.pi / 2)  # 0.375 m from the wall, which its radius is not
        plan = planner.plan(start, center((30, 6)), is_robot_there=is_robot_there)
        assert plan.found
        assert_sound(plan)
        around = planner.plan(start, center((30, 33)), is_robot_there=is_robot_there)
        assert around.found
        assert around.length > 5.0  # around the end of the wall
        assert_drivable(around, around.graph, walled(10) > 0, (0.5, 0.4))


def test_a_robot_over_the_edge_of_a_wall_does_not_pass_through_it():
    """A wall that reaches under the rectangle is noise there, and a wall behind it."""
    height = FLAT.copy()
    height[:, 20:24] = 150
    start = center((20, 17), 0.0)  # its nose in the wall
    planner = route_planner(height)
    assert status_of(planner, start, center((20, 34)), is_robot_there=True) is Status.NO_VALID_PATH
    assert status_of(planner, start, center((20, 6)), is_robot_there=True) is Status.NONE


def test_a_deadline_that_has_passed(monkeypatch):
    side = 1100  # more cells than are searched between two looks at the clock
    planner = route_planner(np.zeros((side, side), np.int16), timeout=2.0)
    hours = itertools.count(0.0, 3600.0)
    with monkeypatch.context() as changed:
        changed.setattr(time, "monotonic", lambda: next(hours))
        plan = planner.plan(
            center((9, 9)), center((9, 1090)), is_robot_there=False, is_field_wanted=True
        )
    assert plan.status is Status.TIMEOUT
    assert len(plan.poses) == 0
    assert "2 s" in plan.reason


def test_heights_along_a_path_up_a_slope():
    x = (np.indices((60, 70))[1] + 0.5) * 0.125
    planner = route_planner(100 * 0.4 * x, unknown="cost", cross_slope_weight=0.0)
    plan = planner.plan(Pose2D(1.3, 3.0), Pose2D(7.0, 3.0), is_robot_there=False)
    error = plan.poses[:, 2, 3] - 0.4 * plan.poses[:, 0, 3]
    np.testing.assert_allclose(error[8:-8], 0.0, atol=0.01)
    np.testing.assert_allclose(error, 0.0, atol=0.03)


def test_a_deadline_holds_on_a_small_map_too(monkeypatch):
    height = np.zeros((40, 40), np.int16)
    height[:, 20] = 150
    height[15:18, 20] = 0
    planner = route_planner(height, radius=0.1, robot_length=1.5, robot_width=1.5, timeout=2.0)
    hours = itertools.count(0.0, 3600.0)
    with monkeypatch.context() as changed:
        changed.setattr(time, "monotonic", lambda: next(hours))
        plan = planner.plan(center((16, 8)), center((16, 32)), is_robot_there=False)
    assert plan.status is Status.TIMEOUT


def test_noise_under_the_nose_of_a_robot_whose_disc_is_free():
    height = np.zeros((40, 60), np.int16)
    height[:16] = height[25:] = 150  # a corridor
    height[20, 24] = 60  # 0.5 m ahead, beyond the disc, within the rectangle
    planner = route_planner(
        height, radius=0.3, robot_length=1.2, robot_width=0.5, unknown="cost"
    )  # fmt: skip
    start, goal = center((20, 20), 0.0), center((20, 50))
    assert planner.plan(start, goal, is_robot_there=True).status is Status.NONE


ROOMS = (0.005, 0.01, 0.02, 0.05)


WALL = 24  # column


@functools.cache
def walled_planner(rows):
    """Of a robot of 0.78 m x 0.64 m beside a long wall of some columns."""
    height = np.zeros((64, 48), np.int16)
    height[:, WALL : WALL + rows] = 150
    return route_planner(height, unknown="cost", robot_length=0.78, robot_width=0.64)


def beside_a_wall(offset, room, yaw):
    """A start beside the wall, which begins somewhere within its cell."""
    reach = 0.5 * (0.78 * abs(math.cos(yaw)) + 0.64 * abs(math.sin(yaw)))
    return Pose2D((WALL + offset[1]) * CELL - room - reach, (32 + offset[0]) * CELL, yaw)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, 3])
@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("degrees", [90, 75, 180, 45])
def test_a_robot_close_beside_a_wall_leaves_and_never_through_it(rows, room, degrees):
    """At 25 places within a cell, to goals away from the wall, along it, and behind it."""
    for offset in itertools.product(np.linspace(0.02, 0.98, 5), repeat=2):
        planner, wall = walled_planner(rows), (WALL + 0.5) * CELL
        start = beside_a_wall(offset, room, math.radians(degrees))
        for goal in (Pose2D(1.0, 4.0), Pose2D(1.8, 7.0, 1.0)):
            plan = planner.plan(start, goal, is_robot_there=True)
            assert plan.found, plan.reason
            assert_ends_as_asked(plan, start, goal)
            x = plan.poses[:, 0, 3]
            free = int((x < wall - 0.5).argmax())
            assert x[free] < wall - 0.5
            assert (np.diff(x[: free + 1]) <= 1e-9).all()  # only away from the wall
            assert (x[free:] < wall - 0.4).all()
        behind = planner.plan(start, Pose2D(5.0, 4.0), is_robot_there=True)
        assert behind.status is Status.NO_VALID_PATH


def test_a_robot_in_a_dead_end_is_told_that_it_is_the_start():
    """Walls on three sides, and one close in front: no line leads away from all of them."""
    height = np.zeros((48, 48), np.int16)
    height[20, 18:30] = height[26, 18:30] = height[20:27, 18] = height[20:27, 30] = 150
    planner = route_planner(height, unknown="cost")
    plan = planner.plan(center((23, 24), 0.0), center((40, 40)), is_robot_there=True)
    assert plan.status is Status.START_OCCUPIED
    assert plan.reason.startswith("the start is 0.38 m from an obstacle")


def test_a_robot_does_not_turn_into_a_wall_where_it_can_drive_on():
    """In a corridor in which it fits but cannot turn, it drives out and around."""
    height = np.zeros((48, 64), np.int16)
    height[14, 20:40] = height[20, 20:40] = 150  # 0.625 m wide
    planner = route_planner(height, radius=0.37, unknown="cost", robot_length=0.7, robot_width=0.4)
    plan = planner.plan(center((17, 34), 0.0), center((17, 12)), is_robot_there=True)
    assert plan.found
    assert_drivable(plan, plan.graph, height > 0, (0.7, 0.4))
    assert plan.length > 5.0
    assert abs(in_cells(plan.poses)[:10, 2]).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [-155, 25, -140])
def test_a_robot_between_two_rocks_drives_straight_on_before_it_turns(degrees):
    """At 25 places within the one cell that is open there, to goals on both sides."""
    height = np.zeros((64, 64), np.int16)
    height[36:41, 26:31] = height[24:29, 34:41] = height[29, 37:40] = 60
    size = 0.78, 0.64
    planner = route_planner(height, unknown="cost", robot_length=size[0], robot_width=size[1])
    for offset in itertools.product(np.linspace(0.02, 0.98, 5), repeat=2):
        start = Pose2D((32 + offset[1]) * CELL, (32 + offset[0]) * CELL, math.radians(degrees))
        for goal in (Pose2D(1.5, 3.5), Pose2D(6.5, 4.5)):
            plan = planner.plan(start, goal, is_robot_there=True)
            assert plan.found, plan.reason
            assert_ends_as_asked(plan, start, goal)
            assert_drivable(plan, plan.graph, height > 0, size)
