# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapping node in its own process, over DDS."""

import array
import math
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from bag_writer import laser_scan, odometry, rclpy_type
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.srv import GetMap
from node_client import MAPS, PATIENCE, Client, mapping_node, replay, start
from PIL import Image
from repository import BAGS, ROOT
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from scipy import ndimage
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.srv import LoadMap, SaveMap
from heightmap25d_ros import cli
from heightmap25d_ros.grid.height_map import SUSPECTED, HeightMap
from heightmap25d_ros.io import decode, layers_file, map_directory
from heightmap25d_ros.localization.layers import NAMES
from heightmap25d_ros.nodes import map_transform
from heightmap25d_ros.nodes.mapping import MappingNode

RAMP = BAGS / "ramp"
CONFIG = ROOT / "config" / "heightmap25d.yaml"
SECONDS = 6.0
MOUNT = ("-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]")
MS = 10**6


@pytest.fixture(scope="module")
def short_bag(tmp_path_factory):
    """The first seconds of the ramp."""
    path = tmp_path_factory.mktemp("bags") / "short"
    with Reader(RAMP) as reader, Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as out:
        stop = reader.start_time + round(SECONDS * 1e9)
        copies = {
            connection.id: out.add_connection(
                connection.topic,
                connection.msgtype,
                msgdef=connection.msgdef.data,
                rihs01=connection.digest,
                offered_qos_profiles=connection.ext.offered_qos_profiles,
            )
            for connection in reader.connections
        }
        for connection, stamp, data in reader.messages(stop=stop):
            out.write(copies[connection.id], stamp, data)
    return path


@pytest.fixture(scope="module")
def by_command_line(short_bag, tmp_path_factory):
    directory = tmp_path_factory.mktemp("maps") / "by_command_line"
    assert cli.main(["map", str(short_bag), "-o", str(directory), "--json"]) == 0
    return directory


@pytest.fixture(scope="module")
def replayed(short_bag, tmp_path_factory):
    """What the node published and saved for the short bag: messages, directory, services."""
    directory = tmp_path_factory.mktemp("node")
    client = Client()
    for topic, kind in MAPS.items():
        client.subscribe(topic, kind)
    topics = "--params-file", str(CONFIG), "-p", "intake.scan_topics:=[scan, scan_down]"
    with mapping_node(directory, *topics) as process:
        client.wait_for_node()
        played = replay(short_bag, "--rate", "2.0")
        client.wait(lambda: played.poll() is not None, 2 * PATIENCE)
        assert played.returncode == 0
        saved = client.call("mapping/save_map", SaveMap, name="maps/short")
        client.spin(1.5)
        client.messages = dict(client.newest)
        client.got = client.call("mapping/get_map", GetMap).map
        client.saved, client.directory = saved, directory
        yield client
    client.close()
    assert "dropped" not in process.log


def cells(message):
    return np.array(message.data, np.int8).reshape(message.info.height, message.info.width)


def test_the_saved_map_is_the_command_lines_byte_for_byte(replayed, by_command_line):
    assert replayed.saved.success, replayed.saved.message
    saved = Path(replayed.saved.path)
    assert saved == replayed.directory / "maps" / "short"
    for name in ("height_grid.npz", "map.pgm", "map.yaml"):
        assert (saved / name).read_bytes() == (by_command_line / name).read_bytes(), name


def test_the_map_topic_is_the_saved_picture(replayed, by_command_line):
    pixels = np.asarray(Image.open(by_command_line / "map.pgm"))[::-1]
    expected = np.select([pixels == 0, pixels == 254], [100, 0], -1)
    for message in (replayed.messages["map"], replayed.got):
        np.testing.assert_array_equal(cells(message), expected)
        assert message.header.frame_id == "map"
        assert message.info.origin.orientation.w == 1.0
        assert message.info.resolution == np.float32(0.125)
    assert {100, 0, -1} == set(np.unique(expected))


def test_the_topics_agree_with_one_another(replayed):
    grid, occupancy = replayed.messages["height_grid"], replayed.messages["map"]
    cost, points = replayed.messages["cost_map"], replayed.messages["height_points"]
    for message in (grid, occupancy, cost, points):
        assert message.header == occupancy.header
    assert occupancy.info == cost.info
    for field in ("resolution", "width", "height", "origin"):
        assert getattr(grid.info, field) == getattr(occupancy.info, field)
    known = np.array(grid.probability) >= grid.probability_threshold * 255
    is_told = known | (np.array(grid.height) == SUSPECTED)
    # What may be a drop-off is closed before it is known.
    upper, layers = (replayed.messages[name] for name in ("upper_surfaces", "localization_layers"))
    # The map shows the level of the robot: what is of another one is unknown in it.
    decks = np.zeros_like(known)
    decks[np.array(upper.cell)] = True
    beside_decks = ndimage.binary_dilation(decks.reshape(-1, grid.info.width), iterations=8).ravel()
    for data in (np.array(occupancy.data), np.array(cost.data)):
        assert not (known & ~beside_decks & (data < 0)).any()
        # On ground of one level these are walls of which the foot and the top alone were seen.
        assert (known & (data < 0)).sum() <= 0.003 * known.sum()
        assert not ((data >= 0) & ~is_told).any()
    assert (np.array(cost.data)[np.array(occupancy.data) == 100] == 100).all()
    cloud = np.frombuffer(points.data.tobytes(), np.float32).reshape(-1, 4)
    assert upper.header == layers.header == grid.header
    assert upper.info == layers.info == occupancy.info
    tops = np.concatenate([np.array(grid.height)[known], np.array(upper.top)])
    assert points.width == len(cloud) == len(tops)
    np.testing.assert_allclose(np.sort(cloud[:, 2]), np.sort(tops * 0.01), atol=1e-5)


def test_the_heights_are_the_saved_ones_and_the_stamp_is_the_newest_scans(replayed, short_bag):
    grid = replayed.messages["height_grid"]
    loaded = map_directory.load(Path(replayed.saved.path), 0.5).height_map
    is_told = loaded.known | loaded.suspected  # another height counts for nothing
    published = np.array(grid.height).reshape(loaded.height.shape)
    np.testing.assert_array_equal(published[is_told], loaded.height[is_told])
    layers = layers_file.load(Path(replayed.saved.path), loaded)
    told = decode.localization_layers(replayed.messages["localization_layers"], "map")
    for name in NAMES:
        np.testing.assert_array_equal(getattr(told, name), getattr(layers, name))
    with Reader(short_bag) as reader:
        scans = [c for c in reader.connections if c.topic.startswith("/scan")]
        newest = max(
            int.from_bytes(data[4:8], "little") * 10**9 + int.from_bytes(data[8:12], "little")
            for _, _, data in reader.messages(scans)
        )
    stamp = grid.header.stamp.sec * 10**9 + grid.header.stamp.nanosec
    assert newest - 60 * MS <= stamp <= newest


def test_who_subscribes_late_gets_the_map(replayed):
    late = Client(name="late")
    late.subscribe("map", MAPS["map"])
    late.wait(lambda: "map" in late.newest, 10.0)
    assert late.newest["map"].data == replayed.messages["map"].data
    late.close()


@pytest.mark.parametrize("name", ["../outside", "/tmp/absolute", "", "."])
def test_no_map_is_saved_outside_of_the_directory(replayed, name):
    answer = replayed.call("mapping/save_map", SaveMap, name=name)
    assert not answer.success
    assert "does not name a map" in answer.message


def test_a_damaged_map_is_refused_and_the_running_one_stays(replayed):
    damaged = replayed.directory / "damaged"
    damaged.mkdir()
    (damaged / "height_grid.npz").write_bytes(b"PK\x03\x04 not really")
    for name in ("damaged", "missing", "../short"):
        answer = replayed.call("mapping/load_map", LoadMap, name=name)
        assert not answer.success
        assert answer.message
    assert replayed.call("mapping/get_map", GetMap).map.data == replayed.got.data


def test_a_map_is_cleared_and_loaded_again(replayed):
    assert replayed.call("mapping/clear_map", Trigger).success
    assert set(replayed.call("mapping/get_map", GetMap).map.data) == {-1}
    assert replayed.call("mapping/load_map", LoadMap, name="maps/short").success
    assert replayed.call("mapping/get_map", GetMap).map.data == replayed.got.data


def test_no_message_ends_the_node_and_good_ones_still_count(tmp_path):
    client = Client("/abused")
    client.subscribe("map", MAPS["map"])
    start_ns = 1_700_000_000 * 10**9

    def pose(milliseconds, x=0.0, **changes):
        message = odometry(start_ns + milliseconds * MS, (x, 0.0, 0.0), type_of=rclpy_type)
        for name, value in changes.items():
            setattr(message, name, value)
        return message

    def scan(milliseconds, ranges=(2.0, 2.0, 2.0), **changes):
        return laser_scan(start_ns + milliseconds * MS, ranges, type_of=rclpy_type, **changes)

    bad_pose = pose(30)
    bad_pose.pose.pose.position.x = math.nan
    bad_quaternion = pose(31)
    bad_quaternion.pose.pose.orientation.w = 0.0
    no_ranges = scan(32)
    no_ranges.ranges = array.array("f")
    correction = PoseWithCovarianceStamped()  # in no frame, with a zero quaternion
    with mapping_node(tmp_path, *MOUNT, namespace="/abused") as process:
        for message in (bad_pose, bad_quaternion, pose(33, child_frame_id="elsewhere")):
            client.publish("odom", message)
        for message in (no_ranges, scan(34, angle_increment=math.nan), scan(35, (math.nan,) * 3)):
            client.publish("scan", message)
        client.publish("pose_correction", correction)
        client.publish("odom", pose(40))
        client.publish("odom", pose(60))
        client.publish("scan", scan(50))
        client.wait(lambda: "map" in client.newest)
        client.publish("odom", pose(-10_000))  # a bag that loops
        client.publish("odom", pose(-9_980))
        client.publish("scan", scan(-9_990, (3.0, 3.0, 3.0)))
        known = np.count_nonzero(np.array(client.newest["map"].data) >= 0)
        client.wait(lambda: np.count_nonzero(np.array(client.newest["map"].data) >= 0) > known)
        client.spin(5.5)  # until the node has told what it dropped
        assert process.poll() is None
    client.close()
    for reason in ("odometry: bad pose.pose", "scan: bad ranges", "scan: bad angle_increment",
                   "correction: bad header.frame_id", "clock jumped back"):  # fmt: skip
        assert reason in process.log


def test_a_correction_moves_later_scans_into_the_map(tmp_path):
    client = Client("/corrected")
    client.subscribe("height_grid", MAPS["height_grid"])
    start_ns = 1_700_000_000 * 10**9
    correction = PoseWithCovarianceStamped()
    correction.header.frame_id = "map"
    correction.pose.pose.position.x = 10.0
    correction.pose.pose.orientation.w = 1.0
    with mapping_node(tmp_path, *MOUNT, namespace="/corrected"):
        client.publish("pose_correction", correction)
        for milliseconds in (0, 20):
            client.publish(
                "odom", odometry(start_ns + milliseconds * MS, (0, 0, 0), type_of=rclpy_type)
            )
        client.publish("scan", laser_scan(start_ns + 10 * MS, [2.0], type_of=rclpy_type))
        client.wait(lambda: "height_grid" in client.newest)
    client.close()
    grid = client.newest["height_grid"]
    (index,) = np.flatnonzero(np.array(grid.probability))
    iy, ix = divmod(int(index), grid.info.width)
    x = grid.info.origin.position.x + (ix + 0.5) * 0.125
    y = grid.info.origin.position.y + (iy + 0.5) * 0.125
    beam = 10.0 + 2.0 * math.cos(-0.5), 2.0 * math.sin(-0.5)  # of a scan that begins at -0.5 rad
    assert (x, y) == pytest.approx(beam, abs=0.0626)
    assert grid.height[index] == 50


@pytest.mark.parametrize("is_left", [False, True])
def test_map_to_odom_is_told_unless_it_is_left_to_localization(tmp_path, is_left):
    """Also before localization is there, which takes its time to start."""
    client = Client("/told")
    told = []
    client.node.create_subscription(TFMessage, "tf", told.append, 10)
    times = iter(range(0, 10**6, 20))
    until = math.inf

    def has_driven_on():
        client.publish("odom", odometry(next(times) * MS, type_of=rclpy_type))
        return bool(told) or time.monotonic() > until

    left = "-p", f"mapping.needs_localization:={str(is_left).lower()}"
    with mapping_node(tmp_path, *MOUNT, *left, "-r", "/tf:=tf", namespace="/told"):
        client.wait_for_node()
        if is_left:
            until = time.monotonic() + 2.0 * map_transform.SILENCE
        client.wait(has_driven_on)
    client.close()
    frames = {(t.header.frame_id, t.child_frame_id) for m in told for t in m.transforms}
    assert frames == (set() if is_left else {("map", "odom")})


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_with_status_0(tmp_path, kind):
    client = Client("/ended")
    with mapping_node(tmp_path, namespace="/ended") as process:
        client.wait_for_node()
        client.spin(0.5)
        process.send_signal(kind)
        process.wait(timeout=PATIENCE)
    client.close()


@pytest.mark.parametrize(
    ("parameter", "complaint"),
    [
        ("sensor.max_rnage:=3.0", "did you mean sensor.max_range?"),
        ("grid.resolution:=-1.0", "grid.resolution: -1 is not within 0.01 .. 10"),
        ("mapper.update_rule:=literal", "'literal' is not one of candidate, paper"),
        ("traversability.max_step:=high", "'high' is not a float"),
        ("intake.scan_topics:=['a b']", "topic name must not contain"),
        ("intake.mounts:=[]", "a parameter is an empty list"),
    ],
)
def test_a_wrong_parameter_ends_the_node_with_one_line(parameter, complaint):
    process = start("nodes.mapping", "--ros-args", "-p", parameter, stderr=subprocess.PIPE)
    _, log = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert complaint in log.splitlines()[-1]


def test_nothing_is_converted_or_published_without_a_listener_or_a_change(monkeypatch):
    """In this process, to count what the node asks of the core."""
    context = rclpy.Context()
    rclpy.init(context=context, args=["mapping", "--ros-args", "-r", "__ns:=/idle", *MOUNT])
    monkeypatch.setattr("rclpy.node.get_default_context", lambda: context)
    node = MappingNode()
    node.begin()
    conversions = []
    converted = node._mapping.obstacles
    monkeypatch.setattr(
        node._mapping, "obstacles", lambda area: conversions.append(1) or converted(area)
    )
    start_ns = 1_700_000_000 * 10**9
    for milliseconds in (0, 20):
        pose = odometry(start_ns + milliseconds * MS, (0.0, 0.0, 0.0))
        node._on_odometry(pose)
    node._on_scan("scan", laser_scan(start_ns + 10 * MS))
    node._publish()
    assert conversions == []  # nobody listens

    topics = []
    monkeypatch.setattr(node, "publish", lambda topic, _: topics.append(topic))
    monkeypatch.setattr(node, "count_listeners", lambda _: 1)
    node._publish()
    node._publish()
    # Each once, since the map did not change in between, which height_grid tells.
    assert sorted(topics) == sorted([*MAPS, "/idle/height_grid_updates"])
    assert conversions == [1]
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_far_from_zero_points_are_told_in_a_frame_nearby(tmp_path):
    client = Client("/far")
    client.subscribe("height_grid", MAPS["height_grid"])
    client.subscribe("height_points", MAPS["height_points"])
    client.subscribe("/tf_static", TFMessage)
    start_ns = 1_700_000_000 * 10**9
    place = 500_000.0, 4_500_000.0, 2500.25
    with mapping_node(tmp_path, *MOUNT, namespace="/far"):
        for milliseconds in (0, 20):
            client.publish(
                "odom", odometry(start_ns + milliseconds * MS, place, type_of=rclpy_type)
            )
        client.publish("scan", laser_scan(start_ns + 10 * MS, [2.0625], type_of=rclpy_type))
        client.wait(lambda: len(client.newest) == 3)
    client.close()
    grid, points = client.newest["height_grid"], client.newest["height_points"]
    assert grid.info.origin.position.z == 2500.0
    assert (grid.header.frame_id, points.header.frame_id) == ("map", "map_anchor")
    (transform,) = client.newest["/tf_static"].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "map_anchor")
    offset = transform.transform.translation
    assert (offset.x, offset.y, offset.z) == (500_000.0, 4_500_000.0, 2500.0)
    ((x, y, z, _),) = np.frombuffer(points.data.tobytes(), np.float32).reshape(-1, 4)
    (index,) = np.flatnonzero(np.array(grid.probability))
    iy, ix = divmod(int(index), grid.info.width)
    assert x + offset.x == grid.info.origin.position.x + (ix + 0.5) * 0.125
    assert y + offset.y == grid.info.origin.position.y + (iy + 0.5) * 0.125
    assert z == pytest.approx(0.01 * grid.height[index], abs=1e-6)


def test_no_name_and_no_map_file_ends_the_node(tmp_path):
    """Names that no directory can have, and a frame of what is no character."""
    client = Client("/names")
    names = ["x" * 300 + "/", "x" * 300, "a/" * 1900 + "b", "a\nb", "\x1b[2J", "..", "", "ä" * 101]
    map_directory.save(tmp_path / "foreign", HeightMap.from_metres(np.zeros((4, 4))))
    path = tmp_path / "foreign" / "height_grid.npz"
    with np.load(path) as archive:
        fields = dict(archive) | {"frame_id": np.array([0x7FFFFFFF], np.uint32).view("U1")[0:1]}
    fields["frame_id"] = fields["frame_id"].reshape(())
    np.savez(path, **fields)
    with mapping_node(tmp_path, *MOUNT, namespace="/names") as process:
        for name in names:
            for service, kind in (("save_map", SaveMap), ("load_map", LoadMap)):
                answer = client.call(f"mapping/{service}", kind, name=name)
                assert not answer.success
                assert answer.message.startswith("map name ")
        answer = client.call("mapping/load_map", LoadMap, name="foreign")
        assert "frame_id: is damaged" in answer.message
        assert process.poll() is None
    client.close()
    assert "Traceback" not in process.log
