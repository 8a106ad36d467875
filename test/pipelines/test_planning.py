# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, plans out, without ROS."""

import math
from dataclasses import replace
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import header, odometry, rosbags_type, tf_message
from planner_worlds import World, random_place
from repository import BAGS

from heightmap25d_msgs.msg import HeightGrid
from heightmap25d_ros import memory
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.planning.plan import Status

START = 10**18
BAG = BAGS / "ramp_1"
CELL = 0.125
SHAPE = 80, 80  # 10 m x 10 m
IY, IX = np.indices(SHAPE)
X, Y = (IX + 0.5) * CELL, (IY + 0.5) * CELL
FLAT = np.zeros(SHAPE, np.int16)
WEST, EAST = (2.0, 5.0), (8.0, 5.0)


def wall(*gaps):
    """A wall across the map with gaps, each from a y to a y [m]."""
    height = np.where(np.abs(X - 5.0) < 0.13, 150, 0)
    for low, high in gaps:
        height[(low < Y) & (high > Y)] = 0
    return height.astype(np.int16)


NEAR, FAR = (3.0, 4.6), (8.0, 9.8)


def grid(height, known=None, *, origin=(0.0, 0.0), frame_id="map", **changes):
    position = SimpleNamespace(x=origin[0], y=origin[1], z=0.0)
    rotation = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    info = SimpleNamespace(
        resolution=np.float32(CELL), width=height.shape[1], height=height.shape[0],
        origin=SimpleNamespace(position=position, orientation=rotation),
        map_load_time=SimpleNamespace(sec=0, nanosec=0),
    )  # fmt: skip
    known = np.ones(height.shape, bool) if known is None else known
    fields = {
        "header": header(START, frame_id),
        "info": info,
        "height_resolution": 0.01,
        "probability_threshold": 0.5,
        "height": height.ravel(),
        "probability": np.where(known, 255, 0).astype(np.uint8).ravel(),
    }
    return SimpleNamespace(**(fields | changes))


def turned(yaw):
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def pose_stamped(x, y, yaw=0.0, *, frame_id="map", quaternion=None):
    rotation = turned(yaw) if quaternion is None else quaternion
    pose = rosbags_type("geometry_msgs/msg/Pose")(
        position=rosbags_type("geometry_msgs/msg/Point")(x=x, y=y, z=0.0),
        orientation=rosbags_type("geometry_msgs/msg/Quaternion")(
            **dict(zip("xyzw", rotation, strict=True))
        ),
    )
    return rosbags_type("geometry_msgs/msg/PoseStamped")(header=header(START, frame_id), pose=pose)


def at(x, y, yaw=0.0):
    return odometry(START, (x, y, 0.0), turned(yaw))


def correction(x, y, yaw=0.0, **options):
    stamped = pose_stamped(x, y, yaw, **options)
    return SimpleNamespace(header=stamped.header, pose=SimpleNamespace(pose=stamped.pose))


def planning(height=None, robot=WEST, **values):
    planner = {"planner.timeout": 600.0, "planner.unknown": "cost"}
    p = Planning(with_values(Params(), planner | values))
    if height is not None:
        assert p.take_map(grid(height)) is None
    if robot is not None:
        assert p.take_odometry(at(*robot)) is None
    return p


def ends(plan):
    """((x, y) of the first pose, (x, y) of the last one); of a plan with a path."""
    assert plan.found
    first, last = plan.poses[[0, -1], :2, 3]
    return tuple(first.round(6)), tuple(last.round(6))


def crosses_wall_at(plan):
    """The y at which a path crosses the wall."""
    assert plan.found
    x, y = plan.poses[:, 0, 3], plan.poses[:, 1, 3]
    return float(np.interp(5.0, x, y))


def assert_refused(plan, status, text):
    assert plan.status is status
    assert text in plan.reason
    assert plan.poses.shape == (0, 4, 4)


def assert_plans(p):
    assert ends(p.take_goal(pose_stamped(*EAST))) == (WEST, EAST)


def test_a_goal_before_the_map_is_kept_and_planned_to_when_the_map_comes():
    p = planning()
    assert_refused(
        p.take_goal(pose_stamped(*EAST)), Status.UNKNOWN, "no map has come yet; the goal is kept"
    )
    assert ends(p.take_map(grid(FLAT))) == (WEST, EAST)
    assert p.take_map(grid(FLAT)) is None


def test_a_goal_before_odometry_is_kept_and_planned_to_when_odometry_comes():
    p = planning(FLAT, robot=None)
    assert_refused(
        p.take_goal(pose_stamped(*EAST)),
        Status.TF_ERROR,
        "no odometry has come yet; the goal is kept",
    )
    assert ends(p.take_odometry(at(*WEST))) == (WEST, EAST)
    assert p.take_odometry(at(*WEST)) is None


@pytest.mark.parametrize("first", ["map", "odometry"])
def test_a_goal_before_everything_is_planned_to_when_the_last_part_comes(first):
    p = planning(robot=None)
    p.take_goal(pose_stamped(2.0, 8.0))
    p.take_goal(pose_stamped(*EAST))  # in place of the one before
    take = {"map": lambda: p.take_map(grid(FLAT)), "odometry": lambda: p.take_odometry(at(*WEST))}
    assert take.pop(first)() is None
    (last,) = take.values()
    assert ends(last()) == (WEST, EAST)


def test_a_bad_goal_takes_the_place_of_one_that_waits():
    p = planning(robot=None)
    p.take_goal(pose_stamped(*EAST))
    assert_refused(p.take_goal(pose_stamped(math.nan, 5.0)), Status.UNKNOWN, "not a place")
    assert p.take_map(grid(FLAT)) is None
    assert p.take_odometry(at(*WEST)) is None


@pytest.mark.parametrize(
    ("goal", "status", "text"),
    [
        (pose_stamped(*EAST, frame_id="moon"), Status.TF_ERROR, "from 'moon' to 'map'"),
        (pose_stamped(*EAST, frame_id=""), Status.TF_ERROR, "frame_id"),
        (pose_stamped(math.nan, 5.0), Status.UNKNOWN, "not a place"),
        (pose_stamped(5.0, math.inf), Status.UNKNOWN, "not a place"),
        (pose_stamped(*EAST, quaternion=(0.0,) * 4), Status.UNKNOWN, "quaternion"),
        (pose_stamped(*EAST, quaternion=(0.0, 0.0, 0.0, 2.0)), Status.UNKNOWN, "quaternion"),
        (pose_stamped(*EAST, quaternion=(math.nan,) * 4), Status.UNKNOWN, "quaternion"),
    ],
)
def test_goals_that_cannot_be_used_are_refused_and_nothing_is_lost(goal, status, text):
    p = planning(FLAT)
    assert_refused(p.take_goal(goal), status, text)
    # No goal is left to be planned to.
    assert p.take_map(grid(wall(NEAR))) is None
    assert p.take_odometry(at(4.0, 9.0)) is None
    assert p.take_odometry(at(*WEST)) is None
    assert_plans(p)


def test_a_refused_goal_takes_the_place_of_the_one_before():
    p = planning(wall(NEAR))
    assert_plans(p)
    p.take_goal(pose_stamped(math.nan, 0.0))
    assert p.take_map(grid(wall(FAR))) is None


@pytest.mark.parametrize(
    ("goal", "status"),
    [((5.0, 8.0), Status.GOAL_OCCUPIED), ((-1.0, 5.0), Status.GOAL_OUTSIDE_MAP)],
)
def test_goals_where_the_robot_cannot_be(goal, status):
    plan = planning(wall(NEAR)).take_goal(pose_stamped(*goal))
    assert plan.status is status
    assert len(plan.poses) == 0


def test_a_goal_is_planned_to_at_once_and_with_its_heading():
    plan = planning(FLAT).take_goal(pose_stamped(*EAST, yaw=2.0))
    assert ends(plan) == (WEST, EAST)
    assert math.atan2(plan.poses[-1, 1, 0], plan.poses[-1, 0, 0]) == pytest.approx(2.0)


def test_a_new_goal_replaces_the_old_one():
    p = planning(wall(NEAR, FAR))
    assert_plans(p)
    assert ends(p.take_goal(pose_stamped(2.0, 8.0))) == (WEST, (2.0, 8.0))
    assert p.take_map(grid(wall(FAR))) is None  # only the first goal's way is closed


def test_a_map_that_closes_the_path_leads_to_another_one():
    p = planning(wall(NEAR, FAR))
    assert NEAR[0] < crosses_wall_at(p.take_goal(pose_stamped(*EAST))) < NEAR[1]
    plan = p.take_map(grid(wall(FAR)))
    assert ends(plan) == (WEST, EAST)
    assert FAR[0] < crosses_wall_at(plan) < FAR[1]
    assert p.take_map(grid(wall(FAR))) is None


def test_a_box_on_the_path_is_gone_around():
    p = planning(FLAT)
    assert_plans(p)
    box = np.where((np.abs(X - 5.0) < 0.3) & (np.abs(Y - 5.0) < 0.3), 80, 0).astype(np.int16)
    plan = p.take_map(grid(box))
    assert ends(plan) == (WEST, EAST)
    away = np.hypot(plan.poses[:, 0, 3] - 5.0, plan.poses[:, 1, 3] - 5.0)
    assert away.min() > 0.5


def test_a_change_that_does_not_matter_leads_to_nothing():
    p = planning(wall(NEAR, FAR))
    assert_plans(p)
    assert p.take_map(grid(wall(NEAR, FAR))) is None
    elsewhere = wall(NEAR, FAR)
    elsewhere[5:10, 5:10] = 90
    assert p.take_map(grid(elsewhere)) is None
    # Another way is closed, but not the one that is driven.
    assert p.take_map(grid(wall(NEAR))) is None


def test_a_map_that_grows_leaves_the_path_as_it_is():
    p = planning(wall(NEAR))
    assert_plans(p)
    larger = np.pad(wall(NEAR), 16)
    assert p.take_map(grid(larger, origin=(-2.0, -2.0))) is None
    # And a path over cells that it does not have any more is closed.
    plan = p.take_map(grid(wall(NEAR)[:, :56]))
    assert plan.status is Status.GOAL_OUTSIDE_MAP


def test_what_happens_behind_the_robot_does_not_matter():
    p = planning(wall(NEAR))
    plan = p.take_goal(pose_stamped(*EAST))
    for x, y in plan.poses[plan.poses[:, 0, 3] < 7.0, :2, 3]:
        assert p.take_odometry(at(x, y)) is None
    assert p.take_map(grid(wall())) is None


def test_a_much_better_way_that_opens_is_taken():
    p = planning(wall(FAR))
    before = p.take_goal(pose_stamped(*EAST))
    plan = p.take_map(grid(wall(NEAR, FAR)))
    assert NEAR[0] < crosses_wall_at(plan) < NEAR[1]
    assert plan.length < before.length


def test_a_way_that_is_hardly_better_is_not_taken():
    first = 6.5, 8.1
    p = planning(wall(first))
    assert_plans(p)
    assert p.take_map(grid(wall(first, NEAR))) is None
    eager = planning(wall(first), **{"planning.replan_gain": 0.0})
    assert_plans(eager)
    assert NEAR[0] < crosses_wall_at(eager.take_map(grid(wall(first, NEAR)))) < NEAR[1]


def test_a_goal_whose_way_is_closed_stays():
    p = planning(wall(NEAR))
    assert_plans(p)
    assert_refused(p.take_map(grid(wall())), Status.NO_VALID_PATH, "no drivable path")
    elsewhere = wall()
    elsewhere[5:10, 5:10] = 90
    assert p.take_map(grid(elsewhere)) is None  # said already
    assert p.take_odometry(at(2.0, 6.0)) is None
    plan = p.take_map(grid(wall(FAR)))
    assert ends(plan) == ((2.0, 6.0), EAST)


def test_a_goal_that_becomes_an_obstacle_and_free_again():
    p = planning(FLAT)
    assert_plans(p)
    box = np.where((np.abs(X - 8.0) < 0.3) & (np.abs(Y - 5.0) < 0.3), 80, 0).astype(np.int16)
    assert p.take_map(grid(box)).status is Status.GOAL_OCCUPIED
    assert ends(p.take_map(grid(FLAT))) == (WEST, EAST)


def test_a_robot_that_follows_the_path_gets_no_other_one():
    p = planning(wall(FAR))
    plan = p.take_goal(pose_stamped(*EAST))
    for T in plan.poses:
        assert p.take_odometry(at(*T[:2, 3])) is None


def test_a_robot_that_leaves_the_best_direction_gets_another_path():
    p = planning(FLAT)
    assert_plans(p)
    assert p.take_odometry(at(2.0, 5.2)) is None  # not far enough to tell
    plan = p.take_odometry(at(2.0, 5.4))
    assert ends(plan) == ((2.0, 5.4), EAST)
    # From there it is followed again.
    for T in plan.poses:
        assert p.take_odometry(at(*T[:2, 3])) is None


def test_a_robot_that_drives_back_gets_another_path():
    p = planning(FLAT)
    assert_plans(p)
    assert ends(p.take_odometry(at(1.6, 5.0))) == ((1.6, 5.0), EAST)


def test_a_robot_that_leaves_the_map_is_told_so():
    p = planning(FLAT)
    assert_plans(p)
    assert p.take_odometry(at(-3.0, 5.0)).status is Status.START_OUTSIDE_MAP


def test_a_goal_that_is_reached_is_not_planned_to_any_more():
    p = planning(FLAT)
    assert_plans(p)
    assert p.take_odometry(at(7.8, 5.0)) is None
    assert p.take_odometry(at(2.0, 2.0)) is None
    assert p.take_map(grid(wall())) is None
    assert ends(p.take_goal(pose_stamped(2.0, 8.0))) == ((2.0, 2.0), (2.0, 8.0))


def test_the_robot_is_where_the_correction_says():
    p = planning(wall(NEAR), robot=(1.0, 0.0))
    p.take_correction(correction(2.0, 4.0, math.pi / 2))
    assert ends(p.take_goal(pose_stamped(*EAST))) == (WEST, EAST)
    p.take_correction(correction(math.nan, 4.0))
    assert p.dropped == {"correction: bad pose.pose": 1}
    assert ends(p.take_goal(pose_stamped(*EAST))) == (WEST, EAST)


def test_unusable_odometry_and_maps_are_counted_and_leave_all_as_it_was():
    p = planning(wall(NEAR))
    assert_plans(p)
    assert p.take_odometry(at(math.nan, 0.0)) is None
    assert p.take_odometry(odometry(START, (9.0, 9.0, 0.0), child_frame_id="camera")) is None
    assert p.take_map(grid(wall(), height_resolution=0.02)) is None
    assert p.take_map(grid(wall(), probability=np.zeros(3, np.uint8))) is None
    assert p.take_map(grid(np.zeros((0, 0), np.int16))) is None
    assert p.take_map(grid(wall(), frame_id="odom")) is None
    assert p.dropped == {
        "odometry: bad pose.pose": 1,
        "odometry: of another frame": 1,
        "map: bad height_resolution": 1,
        "map: bad probability": 1,
        "map: bad info": 1,
        "map: bad header.frame_id": 1,
    }
    assert_plans(p)


def test_plans_between_any_two_poses_need_no_odometry():
    p = planning(robot=None)
    nowhere = pose_stamped(*WEST), pose_stamped(*EAST)
    assert_refused(p.answer(*nowhere, 0.0), Status.UNKNOWN, "no map")
    p.take_map(grid(wall(NEAR)))
    plan = p.answer(pose_stamped(*EAST, yaw=1.0), pose_stamped(*WEST, yaw=-1.0), 0.0)
    assert ends(plan) == (EAST, WEST)
    looks = np.arctan2(plan.poses[:, 1, 0], plan.poses[:, 0, 0])
    assert looks[[0, -1]] == pytest.approx([1.0, -1.0])
    assert_refused(p.answer(pose_stamped(*WEST, frame_id="a"), nowhere[1], 0.0),
                   Status.TF_ERROR, "start: no transform from 'a' to 'map'")  # fmt: skip
    assert_refused(p.answer(nowhere[0], pose_stamped(math.nan, 0.0), 0.0),
                   Status.UNKNOWN, "goal.pose")  # fmt: skip


def test_a_tolerance_between_poses_holds_for_that_question():
    p = planning(wall(NEAR))
    question = pose_stamped(*WEST), pose_stamped(5.0, 8.0)
    for tolerance in (0.0, -1.0, math.nan, math.inf, 0.2):
        assert p.answer(*question, tolerance).status is Status.GOAL_OCCUPIED
    for tolerance in (1.0, 1e9):
        _, (x, y) = ends(p.answer(*question, tolerance))
        assert 0.5 < math.hypot(x - 5.0, y - 8.0) < 0.9
    assert p.answer(*question, 0.0).status is Status.GOAL_OCCUPIED


def test_a_plan_between_poses_leaves_the_goal_as_it_is():
    p = planning(wall(NEAR, FAR))
    assert_plans(p)
    assert ends(p.answer(pose_stamped(1.0, 1.0), pose_stamped(2.0, 8.0), 0.0))
    assert ends(p.take_map(grid(wall(FAR)))) == (WEST, EAST)


def halfway(seed, length, width, poses):
    """A Planning whose robot has followed a path over a random map, and that map's heights."""
    rng = np.random.default_rng(seed)
    world = World.random(rng)
    p = planning(
        robot=None,
        **{
            "traversability.robot_radius": 0.3,
            "planner.robot_length": length,
            "planner.robot_width": width,
        },
    )
    start, goal = random_place(rng, world.enterable), random_place(rng, world.enterable)
    p.take_map(grid(world.height, world.known))
    p.take_odometry(at(start.x, start.y))
    plan = p.take_goal(pose_stamped(goal.x, goal.y))
    for T in plan.poses[: poses + 1 : 7]:
        assert p.take_odometry(at(*T[:2, 3], math.atan2(T[1, 0], T[0, 0]))) is None
    return p, world


# From there the search itself, whose ways are others, finds none on which the rectangle fits.
@pytest.mark.parametrize(("seed", "poses"), [(81, 28), (120, 7), (137, 28)])
def test_a_path_that_is_still_open_is_not_given_up(seed, poses):
    p, world = halfway(seed, 0.9, 0.5, poses)
    height = world.height.copy()
    height[0, 0] ^= 1  # one centimetre, far away
    assert p.take_map(grid(height, world.known)) is None


@pytest.mark.parametrize(("seed", "poses"), [(78, 7), (102, 14), (89, 63)])
def test_near_the_goal_a_change_far_away_leads_to_nothing(seed, poses):
    p, world = halfway(seed, 0.3, 0.3, poses)
    height = world.height.copy()
    height[0, 0] ^= 1
    assert p.take_map(grid(height, world.known)) is None


def test_a_correction_of_another_frame_is_not_used():
    p = planning(FLAT)
    p.take_correction(correction(3.0, 0.0, frame_id="somewhere"))
    assert ends(p.take_goal(pose_stamped(*EAST))) == (WEST, EAST)


def test_a_map_whose_frame_has_a_leading_slash():
    p = planning()
    p.take_map(grid(FLAT, frame_id="/map"))
    assert ends(p.take_goal(pose_stamped(*EAST))) == (WEST, EAST)


def test_a_robot_that_comes_from_where_it_could_not_start():
    p = planning(FLAT, robot=(-1.0, 5.0))
    assert p.take_goal(pose_stamped(*EAST)).status is Status.START_OUTSIDE_MAP
    assert p.take_odometry(at(*WEST)) is not None


def with_changes(**values):
    """The parameters of `planning`, some of them changed."""
    return with_values(Params(), {"planner.timeout": 600.0, "planner.unknown": "cost"} | values)


def test_a_robot_that_is_said_to_be_wider_does_not_take_the_narrow_gap():
    wide = (6.4, 9.4)
    p = planning(wall(NEAR, wide))
    assert NEAR[0] < crosses_wall_at(p.take_goal(pose_stamped(*EAST))) < NEAR[1]
    plan = p.set_params(with_changes(**{"traversability.robot_radius": 0.9}))
    assert plan is not None
    assert wide[0] < crosses_wall_at(plan) < wide[1]


def test_parameters_that_change_nothing_leave_the_path():
    p = planning(wall(NEAR, FAR))
    p.take_goal(pose_stamped(*EAST))
    assert p.set_params(with_changes(**{"planner.goal_tolerance": 0.1})) is None


@pytest.mark.parametrize(
    ("start_radius", "status"), [(0.0, Status.GOAL_OCCUPIED), (1.5, Status.NONE)]
)
def test_a_first_goal_needs_the_ground_that_the_lasers_do_not_see(start_radius, status):
    """A robot that stands, of which no laser sees the ground nearer than 1.4 m."""
    params = with_values(
        Params(),
        {"intake.scan_topics": ["/scan", "/scan_down"], "mapping.start_radius": start_radius},
    )
    mapping, planning = Mapping(params), Planning(params)
    with Bag(BAG) as bag:
        events = bag.events(["/scan", "/scan_down", "/odom", "/tf_static"])
        for event in islice(events, 60):
            feed(mapping, event.topic, event.message)
            if event.topic == "/odom":
                planning.take_odometry(event.message)
    message = HeightGrid()
    encode.fill_height_grid(message, mapping.maps()[0], mapping.stamp_ns, "map")
    planning.take_map(message)
    assert planning.take_goal(pose_stamped(0.7, 0.0)).status is status


def transform(parent, child, x, y, yaw=0.0, stamp_ns=START):
    return tf_message((stamp_ns, parent, child, (x, y, 0.0), turned(yaw)))


def goal_in(frame_id, x, y, yaw=0.0, stamp_ns=START):
    stamped = pose_stamped(x, y, yaw, frame_id=frame_id)
    return SimpleNamespace(header=header(stamp_ns, frame_id), pose=stamped.pose)


QUARTER = math.pi / 2


@pytest.mark.parametrize("stamp_ns", [START, 0])
@pytest.mark.parametrize("source", ["correction", "tf"])
def test_goals_in_any_frame_are_planned_to_where_they_are_in_the_map(source, stamp_ns):
    """The odometry is turned to the left in the map, and the robot in it once more."""
    p = planning(FLAT, robot=None)
    if source == "correction":
        p.take_correction(correction(6.0, 1.0, QUARTER))
    else:
        p.take_transforms(transform("map", "odom", 6.0, 1.0, QUARTER), is_static=False)
    p.take_transforms(transform("base_link", "arm", 0.5, 0.0), is_static=True)
    p.take_transforms(transform("earth", "map", 100.0, 0.0), is_static=True)
    p.take_odometry(at(2.0, 1.0, QUARTER))  # (5, 3) in the map, looking to the west
    expected = {
        ("odom", (4.0, 2.0)): (4.0, 5.0),
        ("/odom", (4.0, 2.0)): (4.0, 5.0),
        ("base_link", (1.0, -2.0)): (4.0, 5.0),
        ("arm", (1.0, -2.0)): (3.5, 5.0),
        ("earth", (104.0, 5.0)): (4.0, 5.0),
        ("map", (4.0, 5.0)): (4.0, 5.0),
    }
    for (frame, place), there in expected.items():
        plan = p.take_goal(goal_in(frame, *place, stamp_ns=stamp_ns))
        np.testing.assert_allclose(ends(plan), [(5.0, 3.0), there], atol=1e-6, err_msg=frame)
        answer = p.answer(
            goal_in("base_link", 0.0, 0.0, stamp_ns=0), goal_in(frame, *place, stamp_ns=stamp_ns), 0
        )
        np.testing.assert_allclose(ends(answer), [(5.0, 3.0), there], atol=1e-6, err_msg=frame)


def test_a_goal_is_transformed_at_its_stamp():
    p = planning(FLAT)
    later = START + 10**9
    p.take_odometry(odometry(later, (4.0, 5.0, 0.0)))
    for stamp, x in ((START, 4.0), (START + 5 * 10**8, 5.0), (later, 6.0), (0, 6.0)):
        _, there = ends(p.take_goal(goal_in("base_link", 2.0, 0.0, stamp_ns=stamp)))
        assert there == pytest.approx((x, 5.0))
    old = p.take_goal(goal_in("base_link", 2.0, 0.0, stamp_ns=START - 10**9))
    assert_refused(
        old, Status.TF_ERROR, "from 'base_link' to 'map' at 999999999.000 s: that is before"
    )


def test_a_goal_waits_for_the_transform_at_its_stamp():
    p = planning(FLAT)
    goal = goal_in("base_link", 2.0, 0.0, stamp_ns=START + 10**8)
    assert_refused(p.take_goal(goal), Status.TF_ERROR, "the goal is kept")
    plan = p.take_odometry(odometry(START + 2 * 10**8, (3.0, 5.0, 0.0)))
    assert ends(plan) == ((3.0, 5.0), (4.5, 5.0))
    assert_refused(
        p.answer(pose_stamped(*WEST), goal_in("base_link", 1.0, 0.0, stamp_ns=2 * START), 0.0),
        Status.TF_ERROR, "goal: no transform from 'base_link' to 'map'",
    )  # fmt: skip


def test_a_goal_in_the_robots_frame_that_came_before_odometry():
    p = planning(FLAT, robot=None)
    assert_refused(
        p.take_goal(goal_in("base_link", 1.0, 0.0)), Status.TF_ERROR, "no odometry has come yet"
    )
    assert ends(p.take_odometry(at(*WEST))) == (WEST, (3.0, 5.0))


def test_odometry_without_a_child_frame_is_the_bases():
    p = planning(FLAT, robot=None)
    assert p.take_odometry(odometry(START, (*WEST, 0.0), child_frame_id="")) is None
    assert_plans(p)
    assert len(p.dropped.notices) == 1


def test_a_robot_that_leaves_a_wall_along_its_path_gets_no_other_one():
    p = planning(wall(NEAR), robot=None)
    p.take_odometry(at(4.52, 6.0, QUARTER))  # 0.48 m from the middle of the wall
    plan = p.take_goal(pose_stamped(2.0, 8.0))
    assert ends(plan) == ((4.52, 6.0), (2.0, 8.0))
    for T in plan.poses:
        assert p.take_odometry(at(*T[:2, 3], math.atan2(T[1, 0], T[0, 0]))) is None
    p = planning(wall(NEAR), robot=None)
    p.take_odometry(at(4.52, 6.0, QUARTER))
    p.take_goal(pose_stamped(2.0, 8.0))
    elsewhere = wall(NEAR)
    elsewhere[5:10, 5:10] = 90
    assert p.take_map(grid(elsewhere)) is None


def test_maps_of_other_cells_than_robots_have_are_refused():
    for resolution in (0.001, 0.009, 11.0, math.nan, math.inf, 0.0, -0.125, 1e-9):
        p = planning(FLAT)
        message = grid(FLAT)
        message.info.resolution = np.float32(resolution)
        assert p.take_map(message) is None
        assert p.dropped == {"map: bad info.resolution": 1}
        assert_plans(p)  # over the one before
    for origin in ((1e18, 0.0), (0.0, -1e300), (math.nan, 0.0)):
        p = planning(FLAT)
        assert p.take_map(grid(FLAT, origin=origin)) is None
        assert p.dropped.total() == 1
        assert_plans(p)


def test_a_robot_too_large_for_the_cells_gets_a_reason_from_every_question():
    p = planning(FLAT)
    assert_plans(p)
    fine = grid(FLAT)
    fine.info.resolution = np.float32(0.01)
    large = with_values(Params(), {"traversability.robot_radius": 5.0})
    assert p.set_params(large) is None  # 40 cells of this map
    assert_refused(p.take_map(fine), Status.UNKNOWN, "robot_radius: 5 m is more than 100 cells")
    ends = pose_stamped(0.2, 0.2), pose_stamped(0.4, 0.4)
    assert_refused(p.answer(*ends, 0.0), Status.UNKNOWN, "robot_radius")
    assert_refused(p.take_goal(ends[1]), Status.UNKNOWN, "robot_radius")


def test_memory_is_estimated_before_it_is_taken(monkeypatch):
    p = planning(FLAT)
    monkeypatch.setattr(memory, "available_bytes", lambda: FLAT.size * 50)
    assert_refused(p.take_goal(pose_stamped(*EAST)), Status.UNKNOWN, "planning over this map needs")
    monkeypatch.undo()
    assert_plans(p)


def test_a_map_of_level_lasers_cannot_be_planned_on():
    p = Planning(Params())
    p.take_map(grid(FLAT, level_lasers=True))
    assert "level lasers" in p.trouble
    p.take_odometry(odometry(START, (*WEST, 0.0)))
    plan = p.take_goal(pose_stamped(*EAST))
    assert plan.status is Status.UNKNOWN
    assert "level lasers" in plan.reason
    assert p.take_map(grid(FLAT, header=header(START + 1, "map"))).found
    assert p.trouble == ""


def test_a_height_grid_says_that_level_lasers_made_it():
    for is_level in (False, True):
        message = HeightGrid()
        made = replace(HeightMap.from_metres(np.zeros((2, 3))), is_level=is_level)
        encode.fill_height_grid(message, made, START, "map")
        assert decode.height_map(message).is_level == is_level
