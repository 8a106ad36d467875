# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bytes of messages that come often, held against what rosbags and rclpy make of them."""

import numpy as np
import pytest
from bag_writer import STORE, laser_scan, odometry, rclpy_type, tf_message
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from rclpy.serialization import serialize_message

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode, message_bytes

numbers = st.tuples(*[st.floats(allow_nan=False)] * 3)
names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20)
transforms = st.lists(
    st.tuples(st.integers(0, 2**31 * 10**9 - 1), names, names, numbers, numbers), max_size=6
)


@draws(200)
@given(transforms)
def test_what_is_read_is_what_was_written(entries):
    written = tf_message(*((*e[:4], (*e[4], 1.0)) for e in entries))
    data = bytes(STORE.serialize_cdr(written, "tf2_msgs/msg/TFMessage"))
    read = message_bytes.tf_message(data)
    assert len(read.transforms) == len(entries)
    for one, other in zip(read.transforms, written.transforms, strict=True):
        assert one.child_frame_id == other.child_frame_id
        assert one.header.frame_id == other.header.frame_id
        stamps = [(t.header.stamp.sec, t.header.stamp.nanosec) for t in (one, other)]
        assert stamps[0] == stamps[1]
        for part, axes in (("translation", "xyz"), ("rotation", "xyzw")):
            for axis in axes:
                parts = [getattr(getattr(t.transform, part), axis) for t in (one, other)]
                assert parts[0] == parts[1]


def test_rclpy_stores_them_in_the_same_way():
    entries = [
        (5, "a" * n, "b" * m, (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))
        for n in range(1, 9) for m in range(1, 9)
    ]  # fmt: skip
    message = tf_message(*entries, type_of=rclpy_type)
    read = decode.transforms(message_bytes.tf_message(bytes(serialize_message(message))).transforms)
    for one, other in zip(read, decode.transforms(message.transforms), strict=True):
        assert (one.parent, one.child, one.stamp_ns) == (other.parent, other.child, 5)
        np.testing.assert_array_equal(one.T, other.T)


@draws(300)
@given(st.binary(max_size=300), st.booleans())
def test_other_bytes_are_refused_or_read(data, has_header):
    try:
        read = message_bytes.tf_message((b"\0\1\0\0" if has_header else b"") + data)
    except InputError:
        return
    for one in read.transforms:
        assert one.header.frame_id == one.parent
        assert one.transform.rotation is not None


@pytest.mark.parametrize("length", range(8, 120, 7))
def test_a_message_that_ends_too_early_is_refused(length):
    data = bytes(
        STORE.serialize_cdr(
            tf_message((5, "map", "odom", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))),
            "tf2_msgs/msg/TFMessage",
        )
    )
    if length < len(data):
        with pytest.raises(InputError, match="transforms: "):
            message_bytes.tf_message(data[:length])


def test_what_is_kept_of_a_message_is_small():
    entry = 5, "p" * 10**6, "c" * 10**6, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)
    data = bytes(STORE.serialize_cdr(tf_message(entry), "tf2_msgs/msg/TFMessage"))
    (read,) = message_bytes.tf_message(data).transforms
    assert sum(map(len, read)) < 2000
    with pytest.raises(InputError, match="is not the name of a frame"):
        decode.transforms([read])


def numbers_of(pose):
    place, turn = pose.position, pose.orientation
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


@draws(100)
@given(st.integers(0, 2**31 * 10**9 - 1), names, st.lists(st.floats(width=32), max_size=9))
def test_scans_are_those_that_were_written(stamp, frame, ranges):
    written = laser_scan(stamp, ranges, frame)
    data = bytes(STORE.serialize_cdr(written, "sensor_msgs/msg/LaserScan"))
    read = message_bytes.laser_scan(data)
    assert (read.header.frame_id, read.header.stamp.sec) == (frame, stamp // 10**9)
    assert read.header.stamp.nanosec == stamp % 10**9
    np.testing.assert_array_equal(read.ranges, np.float32(ranges))
    for name in ("angle_min", "angle_max", "angle_increment", "time_increment", "range_min"):
        assert getattr(read, name) == np.float32(getattr(written, name))
    assert read.range_max == np.float32(written.range_max)
    for length in range(0, len(data), 5):
        with pytest.raises(InputError, match=r"^ranges: "):
            message_bytes.laser_scan(data[:length])


@pytest.mark.parametrize(("frame", "child"), [("odom", "base_link"), ("o", "ba"), ("", "b")])
def test_odometry_is_that_which_was_written(frame, child):
    written = odometry(5 * 10**9 + 7, (1.0, -2.0, 3.0), (0.1, 0.5, -0.7, 0.5), frame, child)
    data = bytes(STORE.serialize_cdr(written, "nav_msgs/msg/Odometry"))
    read = message_bytes.odometry(data)
    assert (read.header.frame_id, read.child_frame_id) == (frame, child)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (5, 7)
    assert numbers_of(read.pose.pose) == numbers_of(written.pose.pose)
    for length in range(0, len(data), 50):
        with pytest.raises(InputError, match=r"^pose: "):
            message_bytes.odometry(data[:length])
