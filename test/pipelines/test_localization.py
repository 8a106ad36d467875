# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Continuous localization on recorded drives against their truth, and on what goes wrong."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from bag_writer import odometry, rosbags_type
from localization_bags import (
    PARAMS,
    SCANS,
    drive,
    events_of,
    heights,
    map_of_another_drive,
    truth_of,
)
from repository import BAGS

from heightmap25d_ros import cli, se3
from heightmap25d_ros.localization.tracker import Kind
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.pipelines import odometry_gate
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.replay import feed

pytestmark = pytest.mark.slow  # whole drives


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return heights(map_of_another_drive("room", tmp_path_factory.mktemp("room")))


@pytest.fixture(scope="module")
def lap():
    return events_of(BAGS / "room_1")


@pytest.fixture(scope="module")
def start(lap):
    """The first eight metres."""
    return [event for event in lap if event.stamp_ns <= lap[0].stamp_ns + 10 * 10**9]


def test_the_lap_of_the_paper(lap, room):
    driven = drive(lap, room)
    error = driven.errors(lap)
    uncorrected = drive([event for event in lap if event.topic not in SCANS], None).errors(lap)
    assert error[-1, 0] <= 0.03 < 0.1 < uncorrected[-1, 0]
    assert abs(error[-1, 2]) <= 0.3 < 3.0 < abs(uncorrected[-1, 2])
    assert np.sqrt(np.mean(error[:, 0] ** 2)) <= 0.04
    assert error[:, 0].max() <= 0.10
    assert np.abs(error[:, 1]).max() <= 0.03
    assert driven.localizer.state is State.TRACKING
    assert driven.localizer.dropped.total() == 0


def test_told_poses_move_no_faster_than_allowed_and_not_at_all_when_standing(start, room):
    driven = drive(start, room)
    corrections, standing = [], []
    localizer = Localizer(PARAMS)
    localizer.set_long_term(room)
    before, before_odom = None, None
    for event in start:
        feed(localizer, event.topic, event.message)
        if event.topic == "/odom":
            T, position = localizer.pose.T_map_odom, event.message.pose.pose.position
            here = np.array([position.x, position.y])
            if before is not None:
                robot = localizer.pose.T_map_base[:3, 3]
                odom = np.linalg.inv(T) @ np.append(robot, 1.0)
                moved = np.linalg.norm(robot - (before @ odom)[:3])
                (standing if np.array_equal(here, before_odom) else corrections).append(moved)
            before, before_odom = T, here
    assert max(standing) == 0.0
    allowed = PARAMS.localization.correction_speed * 0.02
    assert 0.5 * allowed < max(corrections) <= allowed * 1.01
    assert driven.attempts


def test_the_same_messages_give_the_same_poses(start, room):
    first, second = drive(start, room), drive(start, room)
    np.testing.assert_array_equal(first.poses, second.poses)


def begin_far_off(localizer):
    localizer.begin_at(np.array([4.0, 2.0, 0.5, 2.0]))


@pytest.mark.parametrize("search_slice", [np.inf, 0.002])
def test_a_wrong_initial_pose_is_noticed_and_mended(start, room, search_slice):
    """The whole map is searched, at once or while scans go on to come."""
    driven = drive(start, room, begin=begin_far_off, search_slice=search_slice)
    kinds = {attempt.kind for attempt in driven.attempts}
    assert State.LOST in driven.states
    assert {Kind.SEARCH, Kind.CONFIRMATION} <= kinds
    assert driven.states[-1] is State.TRACKING
    assert driven.errors(start)[-1, 0] <= 0.10
    wrong = driven.errors(start)[:, 0] > 0.5
    assert not (wrong & (np.array(driven.states) == State.TRACKING)).any()


def test_without_relocalization_it_stays_lost(start, room):
    params = with_values(PARAMS, {"localization.relocalize_when_lost": False})
    driven = drive(start, room, params=params, begin=begin_far_off)
    assert driven.states[-1] is State.LOST
    assert {attempt.kind for attempt in driven.attempts} == {Kind.TRACKING}


def test_a_search_that_is_asked_for_finds_the_robot(start, room):
    params = with_values(PARAMS, {"localization.relocalize_when_lost": False})

    def begin(localizer):
        begin_far_off(localizer)
        assert localizer.request_search()

    driven = drive(start, room, params=params, begin=begin)
    assert driven.states[-1] is State.TRACKING
    assert driven.errors(start)[-1, 0] <= 0.10
    assert not Localizer(PARAMS).request_search()


def test_in_a_map_of_another_place_it_is_never_sure(start, tmp_path):
    truth = ["--odom-topic", "/ground_truth"]
    assert cli.main(["map", str(BAGS / "rough_1"), "-o", str(tmp_path / "rough"), *truth]) == 0
    other = heights(tmp_path / "rough")
    driven = drive(start[: len(start) // 2], other)
    assert State.TRACKING not in driven.states
    assert driven.states[-1] is State.LOST


def test_a_person_who_walks_does_not_drag_it(tmp_path_factory):
    events = events_of(BAGS / "moving_1", 20.0)
    hall = heights(map_of_another_drive("moving", tmp_path_factory.mktemp("moving"), 6.25))
    error = drive(events, hall).errors(events)
    assert error[:, 0].max() <= 0.10
    assert np.abs(error[:, 2]).max() <= 1.5


def test_a_stretch_without_scans_is_bridged(lap, room):
    begin = lap[0].stamp_ns
    dark = [
        event
        for event in lap
        if event.stamp_ns < begin + 15 * 10**9
        and not (event.topic in SCANS and 5.0 < (event.stamp_ns - begin) * 1e-9 < 10.0)
    ]
    driven = drive(dark, room)
    assert driven.errors(dark)[-1, 0] <= 0.06
    assert driven.states[-1] is State.TRACKING
    seconds = (np.array(driven.stamps) - begin) * 1e-9
    deviation = np.array(driven.deviations)
    assert deviation[np.searchsorted(seconds, 9.9)] > 2 * deviation[np.searchsorted(seconds, 4.9)]


def jumped(message, shift):
    message = copy.deepcopy(message)
    message.pose.pose.position.x += shift[0]
    message.pose.pose.position.y += shift[1]
    return message


def torn_odometry(events, shift, until):
    """Events whose odometry is shifted from 5 s after the first one on, for a time [s]."""
    begin = events[0].stamp_ns + 5 * 10**9
    return [
        event._replace(message=jumped(event.message, shift))
        if event.topic == "/odom" and 0 < event.stamp_ns - begin <= until * 1e9
        else event
        for event in events
    ]


@pytest.mark.parametrize(
    ("shift", "until", "counted"),
    [
        ((7.0, -3.0), 1e3, {odometry_gate.BRIDGED: 1}),
        ((0.0, 1.0), 1e3, {odometry_gate.BRIDGED: 1}),
        ((7.0, -3.0), 2.0, {odometry_gate.BRIDGED: 1, odometry_gate.RETURNED: 1}),
        ((7.0, -3.0), 0.02, {odometry_gate.SKIPPED: 1}),
    ],
)
def test_odometry_that_jumps_does_not_move_the_robot(start, room, shift, until, counted):
    torn = torn_odometry(start, shift, until)
    driven = drive(torn, room)
    error = driven.errors(torn)
    assert error[:, 0].max() <= 0.10
    dropped = driven.localizer.dropped
    assert {r: n for r, n in dropped.items() if r in odometry_gate.JUMPS} == counted
    assert driven.states[-1] is State.TRACKING


def test_a_bag_that_loops_starts_over(start, room):
    once = drive(start, room)
    twice = drive([*start, *start], room)
    half = len(once.poses)
    assert twice.localizer.dropped["poses: clock jumped back, localization starts over"] == 1
    np.testing.assert_allclose(twice.poses[half:], once.poses, atol=0.02)


def states_in_time(events, room):
    """[s] and state after each event, by a clock that runs with the events."""
    localizer = Localizer(PARAMS)
    localizer.set_long_term(room)
    states = []
    for event in events:
        localizer.pass_time(event.stamp_ns)
        feed(localizer, event.topic, event.message)
        states.append((_seconds(event, events), localizer.state))
    return states


def test_three_seconds_of_useless_odometry_are_noticed_and_over_by_themselves(start, room):
    disturbed = []
    for event in start:
        if event.topic == "/odom" and 5.0 <= _seconds(event, start) < 8.0:
            message = copy.deepcopy(event.message)
            message.pose.pose.position.x = np.nan
            event = event._replace(message=message)  # noqa: PLW2901
        disturbed.append(event)
    states = states_in_time(disturbed, room)
    assert {state for s, state in states if 4.0 < s < 5.9} == {State.TRACKING}
    assert {state for s, state in states if 6.1 < s < 7.9} == {State.DEGRADED}
    assert states[-1][1] is State.TRACKING


def test_driving_without_scans_is_degraded_and_over_by_itself(start, room):
    blind = [e for e in start if e.topic not in SCANS or not 4.0 <= _seconds(e, start) < 7.0]
    states = states_in_time(blind, room)
    assert {state for s, state in states if 3.0 < s < 4.9} == {State.TRACKING}
    assert {state for s, state in states if 5.1 < s < 6.9} == {State.DEGRADED}
    assert states[-1][1] is State.TRACKING


def _seconds(event, events):
    return (event.stamp_ns - events[0].stamp_ns) * 1e-9


def initial_pose(xyz, yaw, covariance=None, frame_id="map"):
    """geometry_msgs/PoseWithCovarianceStamped as RViz sends it."""
    pose = odometry(0, xyz, (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)), frame_id)
    matrix = np.zeros((6, 6)) if covariance is None else covariance
    pose.pose.covariance[:] = matrix.reshape(-1)
    return rosbags_type("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=pose.header, pose=pose.pose
    )


def test_initial_pose_searches_as_far_as_its_covariance(start, room):
    """A pose off by 0.8 m: within the window of a wide covariance, outside of a narrow one."""
    _, truth = truth_of(start)
    x, y, _, _, _, yaw = se3.to_xyz_rpy(truth[0])
    wide, narrow = np.zeros((6, 6)), np.zeros((6, 6))
    wide[(0, 1, 5), (0, 1, 5)] = 0.5**2, 0.5**2, 0.2**2
    narrow[(0, 1, 5), (0, 1, 5)] = 0.05**2, 0.05**2, 0.02**2
    params = with_values(PARAMS, {"localization.relocalize_when_lost": False})
    ends = {}
    cases = ("wide", wide, np.inf), ("in slices", wide, 0.002), ("narrow", narrow, np.inf)
    for name, covariance, search_slice in cases:

        def begin(localizer, covariance=covariance):
            localizer.take_initial_pose(
                initial_pose((x + 0.6, y - 0.5, 0.0), yaw + 0.1, covariance)
            )

        driven = drive(start, room, params=params, begin=begin, search_slice=search_slice)
        searches = [a for a in driven.attempts if a.kind is Kind.TRACKING]
        ends[name] = driven.errors(start)[-1, 0], searches[0].registration.is_accepted
    for name in ("wide", "in slices"):
        assert ends[name][1]
        assert ends[name][0] <= 0.06
    assert not ends["narrow"][1]


def test_an_initial_pose_that_is_sure_of_one_axis_is_usable(start, room):
    sure = np.zeros((6, 6))
    sure[0, 0] = 0.25

    def begin(localizer):
        localizer.take_initial_pose(initial_pose((0.0, 0.0, 0.0), 0.0, sure))

    driven = drive(start[: len(start) // 3], room, begin=begin)
    assert driven.attempts
    assert np.isfinite(driven.poses).all()


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (initial_pose((0, 0, 0), 0.0, frame_id="odom"), "initialpose: bad header.frame_id"),
        (initial_pose((np.nan, 0, 0), 0.0), "initialpose: bad pose.pose"),
        (initial_pose((0, 0, 0), 0.0, -np.eye(6)), "initialpose: bad pose.covariance"),
        (initial_pose((0, 0, 0), 0.0, np.full((6, 6), np.inf)), "initialpose: bad pose.covariance"),
    ],
)
def test_a_bad_initial_pose_changes_nothing(message, reason):
    localizer = Localizer(PARAMS)
    localizer.take_odometry(odometry(10**9, (1.0, 2.0, 0.0)))
    before = localizer.pose
    localizer.take_initial_pose(message)
    localizer.take_odometry(odometry(2 * 10**9, (1.0, 2.0, 0.0)))
    np.testing.assert_array_equal(localizer.pose.T_map_base, before.T_map_base)
    assert localizer.dropped[reason] == 1


@pytest.mark.parametrize("variance", [1.0, 99999.0, 1e16, 1e300])
@pytest.mark.parametrize("axis", [0, 5])
def test_an_initial_pose_of_any_variance_leaves_a_finite_pose(start, room, variance, axis):
    unsure = np.diag([0.25, 0.25, 0.0, 0.0, 0.0, 0.07])
    unsure[axis, axis] = variance
    localizer = Localizer(PARAMS)
    localizer.set_long_term(room)
    for index, event in enumerate(start[: len(start) // 4]):
        if index == len(start) // 8:
            localizer.take_initial_pose(initial_pose((1.0, 0.0, 0.0), 0.1, unsure))
            assert np.sqrt(localizer.pose.covariance.diagonal()).max() <= 3.1
        feed(localizer, event.topic, event.message)
        if localizer.pose is not None:
            assert np.isfinite(localizer.pose.T_map_base).all()
            assert np.isfinite(localizer.pose.covariance).all()


def test_the_height_at_an_initial_pose_is_the_maps(room):
    raised = dataclasses.replace(room, height=room.height + np.int16(150))
    localizer = Localizer(PARAMS)
    localizer.set_long_term(raised)
    localizer.take_odometry(odometry(10**9))
    localizer.take_initial_pose(initial_pose((1.0, 0.0, 0.0), 0.5))
    localizer.take_odometry(odometry(2 * 10**9))
    assert localizer.pose.T_map_base[:3, 3] == pytest.approx((1.0, 0.0, 1.5), abs=0.05)
    assert se3.to_xyz_rpy(localizer.pose.T_map_base)[5] == pytest.approx(0.5)


def test_without_a_long_term_map_poses_go_on_by_odometry(start):
    driven = drive(start, None)
    assert not driven.attempts
    position = [e.message.pose.pose.position for e in start if e.topic == "/odom"][-1]
    assert driven.poses[-1][:2, 3] == pytest.approx((position.x, position.y))
