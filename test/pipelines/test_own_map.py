# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on the map made so far, on a recorded drive against its truth."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from bag_writer import odometry
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from localization_bags import PARAMS, drive, events_of, truth_of
from nav_msgs.msg import Path
from repository import BAGS

from heightmap25d_msgs.msg import LocalizationStatus
from heightmap25d_ros import se3
from heightmap25d_ros.io import decode, encode, map_directory
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording
from heightmap25d_ros.simulation.simulation import Simulation

OWN = with_values(PARAMS, {"localization.own_map": True})


@pytest.fixture(scope="module")
def start():
    return events_of(BAGS / "room_1", 9.0)


@pytest.fixture(scope="module")
def driven(start):
    return drive(start, None, params=OWN)


@pytest.mark.slow
def test_the_robot_is_where_it_says_on_the_map_that_it_makes(start, driven):
    error = driven.errors(start)[:, 0]
    alone = drive(start, None).errors(start)[:, 0]
    assert error.max() < 0.08 < 0.2 < alone.max()
    assert driven.states[-1] is State.TRACKING
    told = np.sqrt(np.linalg.eigvalsh(driven.localizer.pose.covariance[:2, :2])[-1])
    assert error[-1] < 4.0 * told


@pytest.mark.slow
def test_roll_and_pitch_are_told_as_the_map_has_them():
    """The odometry's err by 0.3 degrees: of flat ground ahead that makes steps of centimetres."""
    noise = recording.noise_of(noise_free=False, true_odometry=False)
    mounted = recording.mounted_sensors(12.5)
    simulation = Simulation(recording.world_of("ramp", 1), 1, noise, mounted, step=0.02)
    localizer, told, alone, true = Localizer(OWN), [], [], []
    events = simulation.begin()
    while simulation.seconds < 25.0:
        for event in events:
            feed(localizer, event.topic, event.message)
            if event.topic == "/odom" and simulation.seconds > 12.0:  # it has turned around once
                told.append(localizer.pose.T_map_base)
                alone.append(decode.odometry(event.message).T)
                true.append(simulation.robot.T)
        events = simulation.step(0.0, 0.6)
    own, of_odometry = (
        np.sqrt(np.mean(np.square(tilt_of(poses) - tilt_of(true)))) for poses in (told, alone)
    )
    assert own < 0.85 * of_odometry


def tilt_of(poses):
    return se3.to_xyz_rpy(np.array(poses))[:, 3:5]


@pytest.mark.slow
def test_odometry_that_jumps_does_not_move_the_robot(start, driven):
    begin = start[0].stamp_ns + 5 * 10**9
    torn = []
    for event in start:
        message = event.message
        if event.topic == "/odom" and event.stamp_ns > begin:
            message = copy.deepcopy(message)
            message.pose.pose.position.x += 7.0
        torn.append(event._replace(message=message))
    jumped = drive(torn, None, params=OWN)
    assert jumped.errors(start)[:, 0].max() < 0.1
    assert jumped.states[-1] is State.TRACKING


def test_without_a_saved_map_there_is_nothing_to_search():
    assert not Localizer(OWN).request_search()


SHELF = (4.7, -0.4)  # free floor, which the robot passes


def saved_map(start):
    """The map of these seconds with true poses, and a shelf on it that is there no more."""
    mapping = Mapping(PARAMS)
    for event in start:
        topic = {"/ground_truth": "/odom", "/odom": ""}.get(event.topic, event.topic)
        if topic:
            feed(mapping, topic, event.message)
    height_map = mapping.maps()[0]
    layers = mapping.layers(height_map.geometry)
    shelf = around(height_map.geometry, SHELF)
    assert (height_map.height[shelf] < 5).all()
    height_map.height[shelf] = 50
    return height_map, layers


def around(geometry, place):
    iy, ix = geometry.cell_at(place)
    return slice(iy - 1, iy + 2), slice(ix - 1, ix + 2)


@pytest.mark.slow
def test_a_robot_goes_on_from_a_saved_map_and_updates_what_has_changed(start, tmp_path):
    """From its middle, with a frame of the odometry that has nothing to do with the map's."""
    saved, layers = saved_map(start)
    map_directory.save(tmp_path, saved, layers=layers)
    localizer, mapping = Localizer(OWN, 0.01), Mapping(PARAMS)
    localizer.set_long_term(saved, layers)
    mapping.load(tmp_path)
    stamps, truth = truth_of(start)
    errors = []
    for event in start:
        if event.stamp_ns < start[0].stamp_ns + 3e9 and event.topic != "/tf_static":
            continue
        if event.topic == "/ground_truth":
            continue
        message = elsewhere(event.message) if event.topic == "/odom" else event.message
        feed(localizer, event.topic, message)
        follow(mapping, localizer)
        pose = localizer.pose
        if pose is not None and localizer.state is not State.LOST:
            true = interpolate(stamps, truth, [min(pose.stamp_ns, stamps[-1])])[0]
            errors.append(np.linalg.norm((true - pose.T_map_base)[:2, 3]))
        feed(mapping, event.topic, message)
    assert len(errors) > 200
    assert max(errors) < 0.06
    assert mapping.dropped["scan: localization is lost"] > 20  # until it was found
    now = mapping.maps()[0]
    assert now.geometry.origin == saved.geometry.origin
    apart = np.abs(now.metres - saved.metres)
    assert np.nanmedian(apart) == 0.0
    assert np.nanmean(apart > 0.1) < 0.01
    np.testing.assert_allclose(now.metres[around(now.geometry, SHELF)], 0.0, atol=0.05)
    assert localizer.request_search()  # at any time; until it is found anew nothing is mapped
    assert localizer.state is State.LOST


def follow(mapping, localizer):
    """Tell mapping what the nodes tell it."""
    pose = localizer.pose
    if pose is None:
        return
    told = PoseWithCovarianceStamped()
    encode.fill_pose(told, pose.T_map_odom, pose.covariance, pose.vertical, pose.stamp_ns, "map")
    mapping.take_correction(told)
    status = LocalizationStatus(state=int(localizer.state))
    encode.fill_header(status.header, pose.stamp_ns, "map")
    mapping.take_localization_status(status)


@pytest.mark.slow
def test_a_robot_goes_on_from_the_upper_deck_of_a_saved_map():
    """From a told pose, 13 cm off; before, it was held against the deck below and off by 2 m."""
    garage = events_of(BAGS / "garage_1")
    true = Mapping(PARAMS)
    for event in garage:
        topic = {"/ground_truth": "/odom", "/odom": ""}.get(event.topic, event.topic)
        if topic:
            feed(true, topic, event.message)
    saved = true.maps()[0]
    localizer, mapping = Localizer(OWN), Mapping(PARAMS)
    layers = true.layers(saved.geometry)
    localizer.set_long_term(saved, layers)
    mapping.clear(saved, layers)
    begun = garage[0].stamp_ns + 56 * 10**9
    stamps, truth = truth_of(garage)
    x, y, z, _, _, yaw = se3.to_xyz_rpy(interpolate(stamps, truth, [begun])[0])
    assert z > 2.0
    localizer.begin_at([x + 0.1, y - 0.08, z, yaw + 0.03])
    errors = []
    for event in garage:
        if event.topic == "/ground_truth" or (
            begun > event.stamp_ns and event.topic != "/tf_static"
        ):
            continue
        message = elsewhere(event.message) if event.topic == "/odom" else event.message
        feed(localizer, event.topic, message)
        follow(mapping, localizer)
        feed(mapping, event.topic, message)
        if event.topic == "/odom" and localizer.state is not State.LOST:
            pose = localizer.pose
            expected = interpolate(stamps, truth, [min(pose.stamp_ns, stamps[-1])])[0]
            errors.append(np.abs((expected - pose.T_map_base)[:3, 3]))
    assert len(errors) > 500
    assert np.max(errors) < 0.15
    assert np.max(errors[-100:]) < 0.05
    below = mapping.maps()[0].metres - saved.metres
    is_under_deck = np.zeros(below.shape, bool)
    is_under_deck[tuple(saved.upper.cell.T)] = True
    assert np.nanmean(np.abs(below[is_under_deck]) > 0.1) < 0.005


def elsewhere(message):
    """The same odometry, seen from another frame."""
    T = se3.from_xyz_rpy([3.0, -2.0, 0.0, 0.0, 0.0, 1.0]) @ decode.odometry(message).T
    stamp = decode.stamp_ns(message.header)
    return odometry(stamp, T[:3, 3].tolist(), se3.to_quaternion(T[None])[0].tolist())


@pytest.mark.slow
def test_when_a_loop_is_closed_the_map_follows_its_submaps(start):
    """Poses that drift, by another shift and turn in each submap, and are mended at the end."""
    true, mended = Mapping(PARAMS), Mapping(PARAMS)
    begun = start[0].stamp_ns
    drifts, poses = [], []
    for event in start:
        topic = {"/ground_truth": "/odom", "/odom": ""}.get(event.topic, event.topic)
        if not topic:
            continue
        if topic == "/odom" and event.stamp_ns >= begun + 2e9 * len(poses):
            number = len(poses)
            T = decode.odometry(event.message).T
            drifts.append(se3.from_xyz_rpy([0.2 * number, 0.0, 0.0, 0.0, 0.0, 0.05 * number]))
            poses.append(T)
            told = np.array(drifts) @ np.array(poses)
            assert not mended.take_submaps(path_of(told, begun))
            correction = PoseWithCovarianceStamped()
            encode.fill_pose(correction, drifts[-1], np.eye(3), np.ones(3), event.stamp_ns, "map")
            mended.take_correction(correction)
        for mapping in (true, mended):
            feed(mapping, topic, event.message)
    expected = true.maps()[0]
    before, _ = differing(mended.maps()[0], expected)
    assert mended.take_submaps(path_of(poses, begun))
    after, known = differing(mended.maps()[0], expected)
    assert after < 0.03 < 0.1 < before
    assert known > 0.9
    assert not mended.take_submaps(path_of(poses, begun))
    layers, again = (m.layers(m.maps()[0].geometry) for m in (true, mended))
    walls = landmarks_of(true.maps()[0], layers).walls.shape[0]
    assert landmarks_of(mended.maps()[0], again).walls.shape[0] == pytest.approx(walls, rel=0.15)
    assert not mended.take_submaps(path_of(poses, begun + 1))  # another map: this one stays
    assert not mended.take_submaps(path_of(np.array(poses) @ drifts[1], begun, "elsewhere"))
    assert [name for name in mended.dropped if name.startswith("submaps")]


def path_of(poses, begun, frame="map"):
    message = Path()
    encode.fill_path(message, PoseStamped, np.array(poses), begun, frame)
    return message


def differing(one, other):
    """Shares of the cells that both know with heights > 10 cm apart, and of those of the other."""
    dy, dx = np.rint(
        (np.array(other.geometry.origin) - one.geometry.origin)[::-1] / one.geometry.resolution
    ).astype(int)
    cells = np.argwhere(other.known)
    inside = one.geometry.contains(cells + (dy, dx))
    here, there = cells[inside] + (dy, dx), cells[inside]
    apart = np.abs(one.metres[tuple(here.T)] - other.metres[tuple(there.T)])
    return np.nanmean(apart > 0.1), np.isfinite(apart).mean()
