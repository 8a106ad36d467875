# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, maps out, without ROS."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import header, laser_scan, odometry, rosbags_type, tf_message

from heightmap25d_ros import memory
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.terrain.traversability import to_obstacle_map

START = 10**18
MS = 10**6
ALONG_X = (0.0, 0.0, 0.0, 1.0)
NOTHING = (math.nan,)
VALUES = {"grid.extent": 64.0, "intake.mounts": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]}


def mapping(**values):
    return Mapping(with_values(Params(), VALUES | values))


def pose(milliseconds, x=0.0, z=0.0):
    return odometry(START + milliseconds * MS, (x, 0.0, z))


def scan(milliseconds, *ranges):
    return laser_scan(START + milliseconds * MS, ranges, angle_min=0.0, angle_max=0.1 * len(ranges))


def correction(frame_id, x, milliseconds=0):
    pose_type = rosbags_type("geometry_msgs/msg/Pose")
    point, quaternion = (
        rosbags_type(f"geometry_msgs/msg/{name}") for name in ("Point", "Quaternion")
    )
    covariance = rosbags_type("geometry_msgs/msg/PoseWithCovariance")(
        pose=pose_type(
            position=point(x=x, y=0.0, z=0.0), orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        ),
        covariance=np.zeros(36),
    )
    return rosbags_type("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=header(START + milliseconds * MS, frame_id), pose=covariance
    )


def heights(mapping, max_cells=None):
    """{(x, y) of a known cell's corner [m]: height [cm]}."""
    height_map, _ = mapping.maps(max_cells)
    cells = np.argwhere(height_map.known)
    corners = height_map.geometry.cell_corner(cells)
    return {
        tuple(corner): int(height_map.height[tuple(cell)])
        for corner, cell in zip(corners, cells, strict=True)
    }


def test_a_scan_between_two_poses_is_merged_where_the_robot_was():
    m = mapping()
    m.take_odometry(pose(0, x=0.0))
    assert m.take_scan("scan", scan(10, 2.05)) == []
    (reading,) = m.take_odometry(pose(20, x=0.2, z=0.1))
    assert reading.topic == "scan"
    assert heights(m) == {(2.125, 0.0): 55}  # 0.1 + 2.05 m ahead, 0.05 + 0.5 m up
    assert m.stamp_ns == START + 10 * MS
    assert m.merged["scans"] == m.merged["returns"] == 1


def test_mounts_from_tf_are_used_when_no_parameter_gives_them():
    m = mapping(**{"intake.mounts": []})
    static = tf_message((START, "base_link", "laser", (1.0, 0.0, 0.25), ALONG_X))
    m.take_transforms(static, is_static=True)
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, 2.05))
    m.take_odometry(pose(20))
    assert heights(m) == {(3.0, 0.0): 25}


def test_a_correction_in_the_maps_frame_moves_later_scans():
    m = mapping()
    m.take_correction(correction("odom", 5.0))
    m.take_correction(correction("map", 10.0))
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, 2.05))
    m.settle()
    assert heights(m) == {(12.0, 0.0): 50}
    assert m.dropped == {"correction: bad header.frame_id": 1}


def test_malformed_messages_are_counted_by_kind_and_field():
    m = mapping()
    m.take_odometry(odometry(START, (math.nan, 0.0, 0.0)))
    m.take_scan("scan", laser_scan(START, [2.0], angle_increment=math.nan))
    m.take_transforms(
        tf_message((START, "base_link", "laser", (0.0, 0.0, 0.0), (0.0,) * 4)), is_static=True
    )
    assert m.dropped == {
        "odometry: bad pose.pose": 1,
        "scan: bad angle_increment": 1,
        "transforms: bad transforms": 1,
    }


def test_returns_that_do_not_fit_into_the_map_are_counted():
    fast = {"odometry.max_speed": 1e6, "odometry.max_climb_rate": 1e6}
    m = mapping(**{"sensor.max_height": 327.0} | fast)
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, 1.0))
    m.take_odometry(pose(20, x=30.0, z=400.0))
    m.take_scan("scan", scan(20, 1.0, 1.0, 9.0, 9.0))
    m.settle()
    assert m.merged == {"scans": 2, "returns": 1}
    assert m.dropped == {
        "return: more than 327 m from ground zero": 2, "return: beyond grid.extent": 2,
    }  # fmt: skip
    assert sorted(heights(m).values()) == [50]


def test_before_the_first_scan_the_map_is_one_unknown_tile():
    height_map, obstacle_map = mapping().maps()
    assert height_map.height.shape == obstacle_map.occupancy.shape == (16, 16)
    assert not height_map.known.any()
    assert (obstacle_map.occupancy == -1).all()


def test_what_a_wild_pose_wrote_far_off_is_left_out_until_the_map_is_cleared():
    m = mapping(**{"grid.extent": 4096.0, "mapping.max_cells": 1e5})
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, 2.05))
    m.settle()
    near = heights(m)
    assert near
    m.take_odometry(pose(60_000, x=1000.0))
    m.take_scan("scan", scan(60_000, 2.05))
    m.settle()
    assert heights(m) == near
    height_map, obstacle_map = m.maps()
    assert height_map.geometry == obstacle_map.geometry == m.layers(height_map.geometry).geometry
    assert height_map.height.size <= 1e5
    (notice,) = m.dropped.notices
    assert "mapping.max_cells" in notice
    assert len(heights(m, max_cells=math.inf)) > len(near)
    m.clear()
    assert heights(m) == {}


def test_a_map_that_is_all_connected_is_refused_where_it_is_too_large():
    m = mapping(**{"mapping.max_cells": 256})
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, *[2.05] * 12))
    m.settle()
    with pytest.raises(InputError, match=r"mapping\.max_cells"):
        m.maps()
    assert heights(m, max_cells=math.inf)


def test_memory_for_a_map_is_estimated_before_it_is_taken(monkeypatch):
    m = mapping()
    monkeypatch.setattr(memory, "available_bytes", lambda: 1000)
    with pytest.raises(InputError, match="the map needs about"):
        m.maps()


def test_the_stamp_follows_a_clock_that_jumped_back():
    m = mapping()
    for milliseconds in (0, 5000, 0):
        m.take_odometry(pose(milliseconds))
        m.take_scan("scan", scan(milliseconds, 2.05))
    m.settle()
    assert m.stamp_ns == START


def test_clearing_forgets_and_a_loaded_map_goes_on():
    m = mapping()
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, 2.05))
    m.settle()
    saved, _ = m.maps()
    m.clear()
    assert heights(m) == {}
    m.clear(saved)
    m.take_odometry(pose(20))
    m.take_scan("scan", scan(20, 3.05))
    m.settle()
    assert set(heights(m)) == {(2.0, 0.0), (3.0, 0.0)}


def test_a_map_that_does_not_fit_is_refused_and_the_running_one_stays():
    m = mapping()
    m.take_odometry(pose(0))
    m.take_scan("scan", scan(0, 2.05))
    m.settle()
    other, _ = mapping(**{"grid.resolution": 0.25}).maps()
    with pytest.raises(ValueError, match="resolution"):
        m.clear(other)
    assert len(heights(m)) == 1


def test_other_parameters_convert_the_whole_map_anew_and_leave_the_heights():
    made = mapping()
    for x in (0.0, 4.0):
        for milliseconds in (0, 20):
            made.take_odometry(pose(1000 * int(x) + milliseconds, x))
        made.take_scan("scan", scan(1000 * int(x) + 10, 2.0, 2.2, 1.5))
    before, _ = made.maps()
    changed = with_values(Params(), VALUES | {"traversability.robot_radius": 0.2})
    made.set_params(changed)
    height_map, obstacle_map = made.maps()
    np.testing.assert_array_equal(height_map.height, before.height)
    whole = to_obstacle_map(height_map, changed.traversability)
    np.testing.assert_array_equal(obstacle_map.cost, whole.cost)
    np.testing.assert_array_equal(obstacle_map.occupancy, whole.occupancy)


def test_a_lower_ceiling_counts_from_the_next_scan_on():
    made = mapping()
    made.set_params(with_values(Params(), VALUES | {"sensor.max_height": 0.4}))
    made.take_odometry(pose(0))
    made.take_odometry(pose(20))
    made.take_scan("scan", scan(10, 2.0))
    assert made.merged["scans"] == 1
    assert heights(made) == {}  # the laser is 0.5 m above base_link


def begun(m, at=0, x=0.5, pitch=0.0, ranges=NOTHING):
    """Heights after a scan of a robot that is 1 m to the left, 0.2 m up and pitched."""
    turn = (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2))
    for milliseconds in (at, at + 20):
        m.take_odometry(odometry(START + milliseconds * MS, (x, 1.0, 0.2), turn))
    assert m.take_scan("scan", scan(at + 10, *ranges))
    return heights(m)


def test_a_map_begins_with_the_plane_that_the_robot_stands_on():
    pitch = math.radians(-10.0)
    around = begun(mapping(**{"mapping.start_radius": 1.2}), pitch=pitch)
    assert len(around) == pytest.approx(math.pi * 1.2**2 / 0.125**2, rel=0.05)
    for (x, y), height in around.items():
        dx, dy = x + 0.0625 - 0.5, y + 0.0625 - 1.0
        assert math.hypot(dx, dy) <= 1.2
        assert height == pytest.approx(20 - 100 * dx * math.tan(pitch), abs=1.0)
    assert begun(mapping()) == {}


def test_what_is_seen_replaces_the_ground_that_a_map_began_with():
    m = mapping(**{"mapping.start_radius": 1.2})
    assert begun(m)[(1.25, 1.0)] == 20
    for at in (100, 200, 300):
        seen = begun(m, at, ranges=(0.8,))
    assert seen[(1.25, 1.0)] == 70


def test_a_loaded_map_is_not_added_to_and_a_cleared_one_begins_again():
    m = mapping(**{"mapping.start_radius": 1.2})
    before = begun(m)
    content, _ = m.maps()
    m.clear(content)
    assert begun(m, at=1000, x=3.0) == before
    m.clear()
    assert heights(m) == {}
    after = begun(m, at=1200, x=3.0)
    assert {(x - 2.5, y) for x, y in after} == set(before)


# Odometry that jumps.


def drive(m, begin, end, x=0.0):
    """20 ms of odometry and a scan between, at 1 m/s: from and to milliseconds."""
    for milliseconds in range(begin, end, 20):
        m.take_odometry(pose(milliseconds, x=x + milliseconds / 1000))
        m.take_scan("scan", scan(milliseconds + 10, 2.05))
    return m.merged["scans"]


def status(milliseconds, state):
    head = header(START + milliseconds * MS, "map")
    return SimpleNamespace(header=head, state=state, TRACKING=0, DEGRADED=1, LOST=2)


def lost_after_a_jump():
    """One second of mapping, two seconds without odometry, and it is 300 m off."""
    m = mapping(**{"grid.extent": 2048.0})
    assert drive(m, 0, 1000) == 49  # the last scan waits
    before = heights(m)
    drive(m, 3000, 4000, x=300.0)
    assert (m.merged["scans"], heights(m)) == (49, before)
    assert "302 m in 2.02 s" in m.trouble
    assert "not mapping: the odometry jumped" in m.trouble
    assert m.dropped["scan: the pose is unknown since the odometry jumped"] > 40
    return m, before


def test_a_jump_is_bridged_and_the_map_goes_on_where_it_was():
    undisturbed, jumped = mapping(), mapping()
    drive(undisturbed, 0, 2000)
    drive(jumped, 0, 1000)
    drive(jumped, 1000, 2000, x=300.0)
    assert heights(jumped) == heights(undisturbed)
    assert jumped.trouble == ""
    assert jumped.T_map_odom[0, 3] == pytest.approx(-300.0)
    assert "300 m in 0.02 s" in str(jumped.dropped)


def test_one_odd_stamp_does_not_undo_what_was_bridged():
    m = mapping()
    drive(m, 0, 1000)
    drive(m, 1000, 2000, x=300.0)
    m.take_odometry(pose(12_000, x=302.0))
    assert drive(m, 2020, 3000, x=300.0) > 40
    assert m.T_map_odom[0, 3] == pytest.approx(-300.0)
    assert m.dropped["poses: clock jumped back"] == 1
    assert max(x for x, _ in heights(m)) < 6.0


def test_one_odd_stamp_does_not_make_an_unknown_pose_known():
    m, before = lost_after_a_jump()
    m.take_odometry(pose(14_000, x=304.0))
    drive(m, 4020, 5000, x=300.0)
    assert "not mapping: the odometry jumped" in m.trouble
    assert heights(m) == before


def test_mapping_stops_where_the_robot_may_have_moved():
    lost_after_a_jump()


def test_mapping_goes_on_when_localization_tracks_and_has_said_where():
    m, before = lost_after_a_jump()
    m.take_correction(correction("map", 10.0, 900))  # of before the jump
    m.take_localization_status(status(3500, 1))
    m.take_localization_status(status(900, 0))
    assert drive(m, 4000, 4500, x=300.0) == 49
    m.take_localization_status(status(4400, 0))
    m.take_correction(correction("map", -290.0, 4500))
    assert m.trouble == ""
    assert drive(m, 4500, 5000, x=300.0) > 60
    added = set(heights(m)) - set(before)
    assert min(x for x, _ in added) == pytest.approx(300.0 + 4.5 + 2.05 - 290.0, abs=0.15)
    assert m.T_map_odom[0, 3] == pytest.approx(-290.0)


def test_mapping_goes_on_when_the_pose_comes_back():
    m, before = lost_after_a_jump()
    assert drive(m, 4000, 4500) > 60
    assert m.trouble == ""
    assert m.T_map_odom[0, 3] == 0.0
    assert max(x for x, _ in set(heights(m)) - set(before)) == pytest.approx(6.5, abs=0.15)


def test_mapping_goes_on_after_the_map_is_cleared():
    m, _ = lost_after_a_jump()
    m.clear()
    assert m.trouble == ""
    assert drive(m, 4000, 4500, x=300.0) > 60
    assert min(x for x, _ in heights(m)) == pytest.approx(306.0, abs=0.15)
    assert m.T_map_odom[0, 3] == 0.0


def test_a_map_that_is_loaded_does_not_tell_where_the_robot_is():
    m, _ = lost_after_a_jump()
    content, _ = m.maps()
    m.clear(content)
    assert m.trouble


def test_a_correction_of_before_a_jump_and_one_of_after_it_say_the_same():
    """Localization sees the jump as well: what it says then is about the new frame."""
    m = mapping()
    m.take_correction(correction("map", 5.0))
    drive(m, 0, 1000)
    drive(m, 1000, 1500, x=300.0)
    assert m.T_map_odom[0, 3] == pytest.approx(-295.0)
    m.take_correction(correction("map", -294.5, 1400))
    assert m.T_map_odom[0, 3] == pytest.approx(-294.5)
    m.take_correction(correction("map", 6.0, 900))  # late
    assert m.T_map_odom[0, 3] == pytest.approx(-294.0)


def test_a_bag_that_loops_begins_in_its_first_frame_again():
    m = mapping()
    drive(m, 5000, 6000)
    drive(m, 6000, 6500, x=300.0)
    drive(m, 0, 500)
    assert m.T_map_odom[0, 3] == 0.0
