# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds in the messages of drivers and of transports: what PointCloud2 gives, they give too."""

import zlib

import numpy as np
import pytest
from bag_writer import STORE, header, odometry, point_cloud, write_bag
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import get_types_from_msg

import heightmap25d_ros as hm
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import point_cloud as reader
from heightmap25d_ros.io._compression import zstd
from heightmap25d_ros.nodes.cloud_source import cloud_inputs
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params

BEGIN = 1_700_000_000 * 10**9
MS = 10**6
LIVOX, COMPRESSED = (
    "livox_ros_driver2/msg/CustomMsg", "point_cloud_interfaces/msg/CompressedPointCloud2",
)  # fmt: skip
for name, definition in {
    "livox_ros_driver2/msg/CustomPoint": "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
    "uint8 reflectivity\nuint8 tag\nuint8 line",
    LIVOX: "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\n"
    "uint8[3] rsvd\nCustomPoint[] points",
    COMPRESSED: "std_msgs/Header header\nuint32 height\nuint32 width\n"
    "sensor_msgs/PointField[] fields\nbool is_bigendian\nuint32 point_step\nuint32 row_step\n"
    "uint8[] compressed_data\nbool is_dense\nstring format",
}.items():
    if name not in STORE.fielddefs:
        STORE.register(get_types_from_msg(definition, name))
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4"), ("line", "u1")])


def floor(index):
    """Points of a floor 1 m below the sensor, in four lines."""
    x, y = np.meshgrid(np.arange(1.0, 4.0, 0.06), np.arange(-2.0, 2.0, 0.06))
    points = np.zeros(x.size, POINT)
    points["x"], points["y"], points["z"] = x.ravel(), y.ravel(), -1.0
    points["t"] = np.arange(x.size) * 20_000
    points["line"] = np.arange(x.size) % 4
    return points


def plain(index):
    return point_cloud(BEGIN + 100 * index * MS, floor(index))


def livox(index):
    stamp = BEGIN + 100 * index * MS
    kind = STORE.types["livox_ros_driver2/msg/CustomPoint"]
    points = [kind(t, x, y, z, 10, 0, line) for x, y, z, t, line in floor(index).tolist()]
    return STORE.types[LIVOX](
        header(stamp, "lidar"), stamp, len(points), 0, np.zeros(3, np.uint8), points
    )


def compressed(index, kind="zlib"):
    cloud = plain(index)
    pack = {"zlib": zlib.compress, "zstd": zstd.compress, "draco": bytes}[kind]
    return STORE.types[COMPRESSED](
        cloud.header, cloud.height, cloud.width, cloud.fields, cloud.is_bigendian,
        cloud.point_step, cloud.row_step, np.frombuffer(pack(cloud.data.tobytes()), np.uint8),
        cloud.is_dense, kind,
    )  # fmt: skip


@pytest.mark.parametrize(
    "message", [livox(1), compressed(1), compressed(1, "zstd")], ids=["livox", "zlib", "zstd"]
)
def test_each_gives_the_cloud_of_pointcloud2(message):
    expected, found = reader.cloud(plain(1)), reader.cloud(message)
    assert (found.stamp_ns, found.frame_id) == (expected.stamp_ns, expected.frame_id)
    for array in ("points", "offsets_ns", "lines"):
        np.testing.assert_array_equal(getattr(found, array), getattr(expected, array))
    assert found.has_gaps


@pytest.mark.parametrize("made", [livox, compressed])
def test_a_bag_of_them_maps_as_one_of_pointcloud2(tmp_path, made):
    """The bag alone defines their types."""
    maps = []
    for kind in (plain, made):
        events = [("/odom", BEGIN + i * 20 * MS, odometry(BEGIN + i * 20 * MS)) for i in range(30)]
        events += [("/points", BEGIN + (100 * i + 90) * MS, kind(i)) for i in range(1, 4)]
        bag = write_bag(
            tmp_path / kind.__name__, sorted(events, key=lambda e: e[1]), storage=StoragePlugin.MCAP
        )
        values = {"sensor.points.mount": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]}
        maps.append(hm.map_bag(bag, params=with_values(Params(), values)))
    np.testing.assert_array_equal(maps[0].height, maps[1].height)
    np.testing.assert_array_equal(maps[0].probability, maps[1].probability)
    assert maps[0].known.sum() > 400


def changed(message, **changes):
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("message", "told"),
    [
        (changed(livox(0), points=[]), "point_num: 3350, with 0 points"),
        (compressed(0, "draco"), "format: 'draco' is not read, only zlib and zstd"),
        (changed(compressed(0), format="zstd"), "compressed_data: zstd: "),
        (
            changed(compressed(0), compressed_data=np.arange(3, dtype=np.uint8)),
            "compressed_data: zlib: ",
        ),
        (changed(compressed(0), height=2), "data: 56950 bytes, 3350 x 2 points need"),
        (changed(compressed(0), height=10**6), "row_step: 56950 x 1000000 bytes are no cloud"),
    ],
)
def test_what_cannot_be_read_is_named(message, told):
    with pytest.raises(InputError, match=told):
        reader.cloud(message)


def test_a_node_subscribes_to_the_type_that_is_named():
    values = {"intake.cloud_topics": ["points", "/mid360/points"]}
    (both, _) = cloud_inputs(with_values(Params(), values), print)
    assert both.kind.__name__ == "PointCloud2"
    values["sensor.mid360_points.message_type"] = LIVOX
    told = "sensor.mid360_points.message_type: package livox_ros_driver2 is not installed"
    with pytest.raises(InputError, match=told):
        cloud_inputs(with_values(Params(), values), print)
