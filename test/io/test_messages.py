# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of rclpy and of rosbags, sound and unsound; what is published, byte by byte."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import (
    STORE,
    header,
    laser_scan,
    odometry,
    rclpy_type,
    rosbags_type,
    tf_message,
)
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry, HeightMap, stored_probability
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.planning.plan import Plan, Status

NAN, INF = math.nan, math.inf
HALF = math.sqrt(0.5)


@pytest.fixture(params=[rclpy_type, rosbags_type], ids=["rclpy", "rosbags"])
def type_of(request):
    return request.param


def test_scan_takes_every_field(type_of):
    message = laser_scan(
        12_000_000_034, [1.5, INF, NAN, -INF], type_of=type_of, time_increment=-0.001
    )
    scan = decode.scan(message)
    assert (scan.stamp_ns, scan.frame_id) == (12_000_000_034, "laser")
    np.testing.assert_array_equal(scan.ranges, np.array([1.5, INF, NAN, -INF], np.float32))
    assert scan.ranges.dtype == np.float32
    assert scan.angle_min == pytest.approx(-0.5)
    assert scan.angle_increment == pytest.approx(0.1)
    assert scan.time_increment == pytest.approx(-0.001)
    assert (scan.range_min, scan.range_max) == pytest.approx((0.1, 30.0))


def test_scan_does_not_copy_its_ranges(type_of):
    message = laser_scan(0, np.ones(361), type_of=type_of)
    scan = decode.scan(message)
    message.ranges[7] = 5.0
    assert scan.ranges[7] == 5.0


def test_scan_of_a_single_beam(type_of):
    message = laser_scan(0, [2.0], type_of=type_of, angle_increment=0.0)
    assert decode.scan(message).ranges.tolist() == [2.0]


def test_scan_of_an_upside_down_laser(type_of):
    turned = {"angle_min": 0.5, "angle_max": 0.3, "angle_increment": -0.1}
    assert decode.scan(laser_scan(0, type_of=type_of, **turned)).angle_increment < 0.0


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 4])
def test_scan_may_disagree_with_itself_about_its_last_beams(type_of, steps):
    message = laser_scan(0, [1.0] * 3, type_of=type_of, angle_max=-0.5 + 0.1 * steps)
    assert len(decode.scan(message).ranges) == 3


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("angle_min", NAN),
        ("angle_max", INF),
        ("angle_increment", NAN),
        ("angle_increment", 0.0),
        ("time_increment", INF),
        ("time_increment", 40.0),
        ("range_min", NAN),
        ("range_min", 31.0),
        ("range_max", NAN),
        ("range_max", INF),
        ("range_min", -INF),
    ],
)
def test_scan_with_a_bad_field_is_refused_by_its_name(type_of, field, value):
    with pytest.raises(InputError, match=rf"^{field}: "):
        decode.scan(laser_scan(0, type_of=type_of, **{field: value}))


@pytest.mark.parametrize(("ranges", "angle_max"), [([], -0.5), ([1.0] * 3, 0.1), ([1.0], 0.5)])
def test_scan_with_the_wrong_number_of_ranges_is_refused(type_of, ranges, angle_max):
    with pytest.raises(InputError, match=r"^ranges: "):
        decode.scan(laser_scan(0, ranges, type_of=type_of, angle_max=angle_max))


def turn(degrees=360.0, step=0.5, **changes):
    """Angles of a laser that turns, with one beam for each step [degrees]."""
    count = round(degrees / step) + 1
    half, increment = math.radians(degrees) / 2, math.radians(step)
    angles = {"angle_min": -half, "angle_max": half, "angle_increment": increment}
    return laser_scan(0, np.ones(count), **(angles | changes))


def test_scan_of_a_whole_turn_may_have_one_step_more():
    assert len(decode.scan(turn(360.0)).ranges) == 721
    assert len(decode.scan(turn(360.5)).ranges) == 722


@pytest.mark.parametrize(
    ("message", "field", "numbers"),
    [
        (turn(362.0), "angle_max", ("6.31809", "more than a turn")),
        (
            laser_scan(0, np.ones(181), angle_min=-90.0, angle_max=90.0, angle_increment=1.0),
            "angle_max",
            ("-90", "90", "180 rad", "degrees"),
        ),
        (turn(180.0, angle_increment=0.5), "angle_increment", ("361", "0.5 rad", "180 rad")),
        (turn(180.0, angle_increment=-math.radians(0.5)), "angle_increment", ("-0.00872665",)),
        (laser_scan(0, [1.0] * 3, angle_max=-0.9), "angle_increment", ("0.1", "-0.5", "-0.9")),
        (turn(180.0, angle_increment=math.radians(1.0)), "ranges", ("361", "181 beams")),
        (turn(180.0, range_min=5.0, range_max=2.0), "range_min", ("5", "2")),
    ],
    ids=["over a turn", "degrees", "increment in degrees", "sign", "other sign", "count", "limits"],
)
def test_scan_that_contradicts_itself_is_refused_with_the_numbers(message, field, numbers):
    with pytest.raises(InputError, match=rf"^{field}: ") as refusal:
        decode.scan(message)
    for number in numbers:
        assert number in str(refusal.value)


def test_negative_stamps_are_refused(type_of):
    for message, read in ((laser_scan(0, type_of=type_of), decode.scan),
                          (odometry(0, type_of=type_of), decode.odometry)):  # fmt: skip
        message.header.stamp.sec = -1
        with pytest.raises(InputError, match=r"^header\.stamp: "):
            read(message)


def test_nanoseconds_that_make_a_second_are_refused(type_of):
    message = header(0, "", type_of)
    message.stamp.nanosec = 10**9
    with pytest.raises(InputError, match=r"^header\.stamp: "):
        decode.stamp_ns(message)


def test_odometry_is_the_pose_of_the_child_in_the_frame(type_of):
    # Turned by 90 degrees to the left at (1, 2, 3): what is ahead lies along y.
    read = decode.odometry(odometry(7, (1.0, 2.0, 3.0), (0.0, 0.0, HALF, HALF), type_of=type_of))
    assert (read.stamp_ns, read.frame_id, read.child_frame_id) == (7, "odom", "base_link")
    np.testing.assert_allclose(read.T @ (1.0, 0.0, 0.0, 1.0), (1.0, 3.0, 3.0, 1.0), atol=1e-12)


def test_leading_slashes_of_frames_are_dropped(type_of):
    message = odometry(0, frame_id="/odom", child_frame_id="/base_link", type_of=type_of)
    read = decode.odometry(message)
    assert (read.frame_id, read.child_frame_id) == ("odom", "base_link")
    assert decode.scan(laser_scan(0, frame_id="/a/b", type_of=type_of)).frame_id == "a/b"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"position": (0.0, NAN, 0.0)}, "pose.pose"),
        ({"position": (0.0, 0.0, -INF)}, "pose.pose"),
        ({"position": (2e8, 0.0, 0.0)}, "pose.pose"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "pose.pose"),
        ({"quaternion": (0.0, NAN, 0.0, 1.0)}, "pose.pose"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.98)}, "pose.pose"),
        ({"quaternion": (0.0, 0.0, 0.2, 1.0)}, "pose.pose"),
        ({"frame_id": ""}, "header.frame_id"),
        ({"child_frame_id": "/"}, "child_frame_id"),
    ],
)
def test_odometry_with_a_bad_field_is_refused_by_its_name(type_of, changes, field):
    with pytest.raises(InputError, match=rf"^{field}: "):
        decode.odometry(odometry(0, type_of=type_of, **changes))


@given(
    arrays.arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(
        lambda q: np.linalg.norm(q) > 0.1
    ),
    st.floats(0.991, 1.009),
)
def test_quaternions_are_normalised(quaternion, norm):
    unit = quaternion / np.linalg.norm(quaternion)
    read = decode.odometry(odometry(0, quaternion=unit * norm))
    np.testing.assert_allclose(read.T[:3, :3], Rotation.from_quat(unit).as_matrix(), atol=1e-9)


def test_transforms_are_poses_of_children_in_parents(type_of):
    message = tf_message(
        (5, "/base_link", "laser", (0.5, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0)),
        (6, "odom", "base_link", (1.0, 2.0, 3.0), (0.0, 0.0, HALF, HALF)),
        type_of=type_of,
    )
    mount, drive = decode.transforms(message.transforms)
    assert (mount.parent, mount.child, mount.stamp_ns) == ("base_link", "laser", 5)
    assert (drive.parent, drive.child, drive.stamp_ns) == ("odom", "base_link", 6)
    laser_in_odom = drive.T @ mount.T @ (0.0, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(laser_in_odom, (1.0, 2.5, 3.2, 1.0), atol=1e-12)


GOOD = (0, "a", "b", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
BAD = [
    (0, "a", "c", (NAN, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    (0, "a", "c", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
    (0, "", "c", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    (0, "a", "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    (-1, "a", "c", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
]


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_transform_does_not_take_the_good_ones_away(type_of, bad):
    read = decode.transforms(tf_message(bad, GOOD, bad, type_of=type_of).transforms)
    assert [transform.child for transform in read] == ["b"]
    np.testing.assert_array_equal(read[0].T[:3, 3], (1.0, 0.0, 0.0))


@pytest.mark.parametrize("bad", BAD)
def test_transforms_that_are_all_bad_are_refused(type_of, bad):
    with pytest.raises(InputError, match=r"transforms\[0\]|header\.stamp"):
        decode.transforms(tf_message(bad, bad, type_of=type_of).transforms)


def test_no_transforms(type_of):
    assert decode.transforms(tf_message(type_of=type_of).transforms) == []


def a_map(probability, threshold=0.5, height=None, resolution=0.125):
    probability = np.asarray(probability, np.uint16)
    height = np.zeros(probability.shape, np.int16) if height is None else height
    return HeightMap(
        geometry=Geometry(resolution=resolution, origin=(-1.0, 2.0), shape=probability.shape),
        height=np.asarray(height, np.int16),
        probability=probability,
        probability_threshold=threshold,
    )


def check_info(message, stamp, columns, rows):
    """The origin is the outer corner of cell (0, 0), and the orientation is valid."""
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == stamp
    assert message.header.frame_id == "map"
    assert message.info.map_load_time == message.header.stamp
    assert (message.info.width, message.info.height) == (columns, rows)
    assert message.info.resolution == 0.125
    origin = message.info.origin
    assert (origin.position.x, origin.position.y, origin.position.z) == (-1.0, 2.0, 0.0)
    rotation = origin.orientation
    assert (rotation.x, rotation.y, rotation.z, rotation.w) == (0.0, 0.0, 0.0, 1.0)


def test_occupancy_grid_is_row_major():
    message = rclpy_type("nav_msgs/msg/OccupancyGrid")()
    occupancy = np.array([[0, 100, -1], [-1, 37, 0]], np.int8)
    geometry = Geometry(resolution=0.125, origin=(-1.0, 2.0), shape=(2, 3))
    encode.fill_occupancy_grid(message, occupancy, geometry, 12_000_000_034, "map")
    check_info(message, (12, 34), columns=3, rows=2)
    assert message.data.tolist() == [0, 100, -1, -1, 37, 0]


def test_occupancy_grid_needs_an_array_that_goes_with_its_geometry():
    message = rclpy_type("nav_msgs/msg/OccupancyGrid")()
    geometry = Geometry(resolution=0.125, origin=(-1.0, 2.0), shape=(2, 3))
    for wrong in (np.zeros((3, 2), np.int8), np.zeros((2, 3), np.int16)):
        with pytest.raises(ValueError, match="does not go with"):
            encode.fill_occupancy_grid(message, wrong, geometry, 0, "map")


def test_occupancy_grid_of_a_view_that_is_not_contiguous():
    message = rclpy_type("nav_msgs/msg/OccupancyGrid")()
    whole = np.arange(12, dtype=np.int8).reshape(3, 4)
    geometry = Geometry(resolution=0.125, origin=(0.0, 0.0), shape=(2, 2))
    encode.fill_occupancy_grid(message, whole[1:, 2:], geometry, 0, "map")
    assert message.data.tolist() == [6, 7, 10, 11]


def test_height_grid_is_row_major():
    message = rclpy_type("heightmap25d_msgs/msg/HeightGrid")()
    height = [[-32700, 0, 7], [32700, -1, 12]]
    probability = [[65535, 0, 32768], [52428, 13107, 1]]
    encode.fill_height_grid(message, a_map(probability, height=height), 12_000_000_034, "map")
    check_info(message, (12, 34), columns=3, rows=2)
    assert message.height.tolist() == [-32700, 0, 7, 32700, -1, 12]
    assert message.probability.tolist() == [255, 0, 128, 204, 51, 1]
    assert message.height_resolution == pytest.approx(0.01)
    assert message.probability_threshold == 0.5


@given(st.floats(0.01, 0.99), st.data())
def test_height_grid_keeps_cells_known_and_observed(threshold, data):
    boundary = stored_probability(threshold)
    near = st.integers(max(boundary - 300, 0), min(boundary + 300, 65535))
    stored = data.draw(
        st.lists(st.one_of(near, st.integers(0, 65535), st.integers(0, 300)), min_size=1)
    )
    height_map = a_map([stored], threshold)
    message = rclpy_type("heightmap25d_msgs/msg/HeightGrid")()
    encode.fill_height_grid(message, height_map, 0, "map")
    probability = np.array(message.probability) / 255.0
    known = probability >= np.float32(message.probability_threshold)
    np.testing.assert_array_equal(known, np.array(stored) >= boundary)
    np.testing.assert_array_equal(probability > 0.0, np.array(stored) > 0)
    np.testing.assert_allclose(probability, np.array(stored) / 65535.0, atol=1.5 / 255.0)
    assert message.probability_threshold == pytest.approx(threshold, abs=1.01 / 255.0)


def test_height_points_are_the_tops_of_known_cells():
    message = rclpy_type("sensor_msgs/msg/PointCloud2")()
    height_map = a_map([[65535, 10], [0, 39321]], height=[[150, 1], [2, -325]])
    point_field = rclpy_type("sensor_msgs/msg/PointField")
    encode.fill_height_points(message, point_field, height_map, 12_000_000_034, "map")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 34)
    assert message.header.frame_id == "map"
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 2, 16, 32)
    assert message.is_dense
    assert not message.is_bigendian
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ("x", 0, point_field.FLOAT32, 1),
        ("y", 4, point_field.FLOAT32, 1),
        ("z", 8, point_field.FLOAT32, 1),
        ("intensity", 12, point_field.FLOAT32, 1),
    ]
    points = np.frombuffer(message.data, "<f4").reshape(-1, 4)
    expected = [(-0.9375, 2.0625, 1.5, 1.0), (-0.8125, 2.1875, -3.25, 0.6)]
    np.testing.assert_allclose(points, expected, atol=1e-6)


def test_grid_map_is_stored_as_its_readers_look_it_up():
    """grid_map: cell (r, c) is r cells along -x and c along -y from the corner of largest x, y."""
    info = SimpleNamespace(pose=rclpy_type("geometry_msgs/msg/Pose")())
    message = SimpleNamespace(header=rclpy_type("std_msgs/msg/Header")(), info=info, data=[])
    height_map = a_map([[65535, 10, 65535], [0, 39321, 65535]], height=[[150, 1, 7], [2, -325, 9]])
    multi_array, dimension = (
        rclpy_type(f"std_msgs/msg/{name}") for name in ("Float32MultiArray", "MultiArrayDimension")
    )
    encode.fill_grid_map(message, multi_array, dimension, height_map, 12_000_000_034, "map")
    assert (message.header.stamp.sec, message.header.frame_id) == (12, "map")
    assert message.layers == ["elevation", "probability"]
    cell, known = info.resolution, {}
    for layer, data in zip(message.layers, message.data, strict=True):
        outer, inner = data.layout.dim
        assert (outer.label, inner.label) == ("column_index", "row_index")
        assert (outer.size, outer.stride, inner.size, inner.stride) == (2, 6, 3, 3)
        for c, r in np.ndindex(outer.size, inner.size):
            x = info.pose.position.x + info.length_x / 2 - (r + 0.5) * cell
            y = info.pose.position.y + info.length_y / 2 - (c + 0.5) * cell
            known[layer, round(x, 4), round(y, 4)] = data.data[c * inner.stride + r]
    points = rclpy_type("sensor_msgs/msg/PointCloud2")()
    point_field = rclpy_type("sensor_msgs/msg/PointField")
    encode.fill_height_points(points, point_field, height_map, 0, "map")
    tops = np.frombuffer(points.data, "<f4").reshape(-1, 4).round(4).tolist()
    assert len(tops) == 4
    for x, y, z, probability in tops:
        x, y = round(x, 4), round(y, 4)  # noqa: PLW2901 - as float32 has them
        assert known["elevation", x, y] == pytest.approx(z)
        assert known["probability", x, y] == pytest.approx(probability, abs=1e-4)
    heights = [value for (layer, *_), value in known.items() if layer == "elevation"]
    assert np.isfinite(heights).sum() == 4


def test_height_points_of_a_map_without_known_cells():
    message = rclpy_type("sensor_msgs/msg/PointCloud2")()
    point_field = rclpy_type("sensor_msgs/msg/PointField")
    encode.fill_height_points(message, point_field, a_map([[0, 5]]), 0, "map")
    assert (message.width, message.row_step, len(message.data)) == (0, 0, 0)


def test_what_a_bag_gives_back_is_what_was_written():
    message = laser_scan(3, [1.0, INF, 2.5])
    raw = STORE.serialize_cdr(message, message.__msgtype__)
    back = decode.scan(STORE.deserialize_cdr(raw, message.__msgtype__))
    assert back.ranges.tolist() == [1.0, INF, 2.5]


def odd(value, place):
    T = np.eye(4)
    T[place] = value
    return T


@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize("place", [(0, 3), (2, 3), (0, 0), (1, 2)])
def test_nothing_that_is_not_finite_becomes_a_message(value, place):
    T, sure = odd(value, place), np.eye(3)
    message = rclpy_type("geometry_msgs/msg/PoseWithCovarianceStamped")()
    stamped = rclpy_type("geometry_msgs/msg/TransformStamped")()
    path = rclpy_type("nav_msgs/msg/Path")()
    poses = rclpy_type("geometry_msgs/msg/PoseArray")()
    of_path = rclpy_type("geometry_msgs/msg/PoseStamped")
    for fill in (
        lambda: encode.fill_pose(message, T, sure, np.ones(3), 0, "map"),
        lambda: encode.fill_pose(message, np.eye(4), np.full((3, 3), value), np.ones(3), 0, "map"),
        lambda: encode.fill_pose(message, np.eye(4), sure, [1.0, value, 1.0], 0, "map"),
        lambda: encode.fill_transform(stamped, T, 0, "map", "odom"),
        lambda: encode.fill_path(path, of_path, np.array([np.eye(4), T]), 0, "map"),
        lambda: encode.fill_poses(poses, None, np.array([T]), 0, "map"),
        lambda: encode.fill_twist(rclpy_type("geometry_msgs/msg/Twist")(), 0.1, value),
        lambda: encode.fill_plan_status(None, Plan(status=Status.NONE, reason="", length=value)),
    ):
        with pytest.raises(ValueError, match="is not finite, and not published"):
            fill()
    assert message == type(message)()
    assert path.poses == poses.poses == []


def with_covariance(matrix):
    message = rosbags_type("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=header(0, "map"), pose=odometry(0).pose
    )
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = matrix
    message.pose.covariance[:] = whole.reshape(-1)
    return message


LIMITS = 3.0, 3.0, 0.8


@given(
    arrays.arrays(np.float64, (3, 3), elements=st.floats(-1.0, 1.0)),
    st.tuples(*[st.sampled_from([0.0, 1e-12, 0.1, 1.0, 99999.0, 1e16, 1e150])] * 3),
)
def test_covariances_are_bounded_and_keep_their_directions(root, scale):
    matrix = np.outer(scale, scale) * (root @ root.T)
    if not np.isfinite(matrix).all():
        return
    read = decode.planar_covariance(with_covariance(matrix), LIMITS)
    assert np.isfinite(read).all()
    assert np.linalg.eigvalsh(read)[0] > -1e-6
    np.testing.assert_allclose(
        np.sqrt(np.diag(read)), np.minimum(np.sqrt(np.diag(matrix)), LIMITS), rtol=1e-6
    )
    if (np.sqrt(np.diag(matrix)) < LIMITS).all():
        deviation = np.sqrt(np.diag(matrix))
        assert (np.abs(read - matrix) <= 1e-9 * np.outer(deviation, deviation) + 1e-200).all()


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, -1.0, 1.0]), np.diag([NAN, 1.0, 1.0]), np.diag([1.0, 1.0, INF]),
        [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[1e16, 2e16, 0.0], [2e16, 1e16, 0.0], [0.0, 0.0, 1.0]],
        [[1e-300, 1e300, 0.0], [1e300, 1e-300, 0.0], [0.0, 0.0, 1.0]],
        [[1e-300, 1e300, 0.0], [-1e300, 1e-300, 0.0], [0.0, 0.0, 1.0]],
    ],
)  # fmt: skip
def test_what_is_no_covariance_is_refused(matrix):
    with pytest.raises(InputError, match=r"pose\.covariance: .* is not a covariance"):
        decode.planar_covariance(with_covariance(matrix), LIMITS)


@pytest.mark.parametrize("name", ["x" * 101, "a\nb", "a\x1b[2J", "\ud800"])
def test_names_of_frames_are_short_and_printable(name):
    for decoded, message in (
        (decode.scan, laser_scan(0, [1.0], frame_id=name)),
        (decode.odometry, odometry(0, frame_id=name)),
        (decode.odometry, odometry(0, child_frame_id=name)),
        (decode.transforms, tf_message((0, name, "b", (0, 0, 0), (0, 0, 0, 1))).transforms),
        (decode.transforms, tf_message((0, "a", name, (0, 0, 0), (0, 0, 0, 1))).transforms),
    ):
        with pytest.raises(InputError, match="is not the name of a frame") as refusal:
            decoded(message)
        assert len(str(refusal.value)) < 600


def test_commands_and_paths_of_others_are_finite_and_not_endless():
    def command(speed, turn):
        return SimpleNamespace(linear=SimpleNamespace(x=speed), angular=SimpleNamespace(z=turn))

    def path(*places):
        level = SimpleNamespace(x=0.0, y=0.0, z=1.0, w=0.0)  # to the west
        positions = (SimpleNamespace(x=x, y=y, z=0.0) for x, y in places)
        poses = [SimpleNamespace(position=p, orientation=level) for p in positions]
        return SimpleNamespace(
            header=header(0, "map"), poses=[SimpleNamespace(pose=pose) for pose in poses]
        )

    def decoded(message):
        return decode.path_in(message, "map")

    assert decode.twist(command(1, -0.5)) == (1.0, -0.5)
    assert decoded(path()).shape == (0, 3)
    there = [[0.0, 1.0, np.pi], [2.0, 3.0, np.pi]]
    np.testing.assert_allclose(decoded(path((0.0, 1.0), (2.0, 3.0))), there)
    with pytest.raises(InputError, match="is 'map', not 'odom'"):
        decode.path_in(path((0.0, 1.0)), "odom")
    for bad in (NAN, INF, -INF):
        for check, message in (
            (decode.twist, command(bad, 0.0)), (decode.twist, command(0.0, bad)),
            (decoded, path((0.0, bad))), (decoded, path((0.0, 0.0), (bad, 0.0))),
        ):  # fmt: skip
            with pytest.raises(InputError):
                check(message)
    for far in (2e5, 1e9, 1e300):
        with pytest.raises(InputError, match="poses"):
            decoded(path((0.0, 0.0), (far, 0.0)))


DECK = UpperSurfaces.of(
    [(1, 2), (0, 0), (1, 2)], [500, 241, 240], [470, 210, 240], [65535, 60000, 33000]
)


def upper_message(type_of, **changes):
    message = type_of("heightmap25d_msgs/msg/UpperSurfaces")()
    shown = HeightMap.from_metres(np.zeros((2, 3)), origin=(5.0, -1.0))
    encode.fill_upper_surfaces(message, replace(shown, upper=DECK), 12 * 10**9, "map")
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_upper_surfaces_come_back():
    geometry, upper = decode.upper_surfaces(upper_message(rclpy_type), "map")
    assert geometry == Geometry(resolution=0.125, origin=(5.0, -1.0), shape=(2, 3))
    for name in ("cell", "top", "bottom"):
        np.testing.assert_array_equal(getattr(upper, name), getattr(DECK, name))
    np.testing.assert_allclose(upper.probability, DECK.probability, atol=65535 / 255)
    assert (upper.probability >= 65535 / 2).all()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"cell": [0, 1]}, "top: 3 values for 2 surfaces"),
        ({"cell": [0, 1, 6]}, "cell: 6 is not one of 3 x 2 cells"),
        ({"bottom": [0, 0, 1000]}, "bottom: is above the top"),
        ({"height_resolution": 0.1}, "height_resolution"),
    ],
)
def test_upper_surfaces_that_are_none(changes, reason):
    with pytest.raises(InputError, match=reason):
        decode.upper_surfaces(upper_message(rclpy_type, **changes))


def test_points_are_of_all_surfaces():
    message, field = rclpy_type("sensor_msgs/msg/PointCloud2")(), rclpy_type(
        "sensor_msgs/msg/PointField"
    )  # fmt: skip
    shown = replace(HeightMap.from_metres([[0.0, 0.0, np.nan], [0.0, 0.0, 0.0]]), upper=DECK)
    encode.fill_height_points(message, field, shown, 0, "map")
    points = np.frombuffer(message.data, "<f4").reshape(-1, 4)
    assert sorted(points[:, 2].round(2).tolist()) == pytest.approx([0.0] * 5 + [2.4, 2.41, 5.0])
