# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of every storage and compression, and bags that are damaged."""

import shutil
import sqlite3

import pytest
from bag_writer import STORE, laser_scan, odometry, qos, tf_message, write_bag
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.bag import Bag

START = 1_700_000_000 * 10**9
STEP = 10_000_000


def small_drive():
    """20 scans, 40 poses, one static transform; written out of order."""
    events = [("/tf_static", START, tf_message((START, "base_link", "laser", (1.0, 0.0, 0.0),
                                                (0.0, 0.0, 0.0, 1.0))))]  # fmt: skip
    for index in range(20):
        stamp = START + 2 * index * STEP + 1
        events.append(("/scan", stamp, laser_scan(stamp, [1.0, 2.0, float(index)])))
    for index in range(40):
        stamp = START + index * STEP
        events.append(("/odom", stamp, odometry(stamp, (float(index), 0.0, 0.0))))
    return events


@pytest.fixture(scope="module")
def sound_bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bags") / "sound", small_drive())


STORAGES = [
    pytest.param(storage, compression, id=f"{storage.name}-{compression.name}".lower())
    for storage, compression in [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ]
]


@pytest.mark.parametrize(("storage", "compression"), STORAGES)
def test_every_storage_gives_back_what_was_written(tmp_path, storage, compression):
    events = small_drive()
    path = write_bag(tmp_path / "bag", events, storage=storage, compression=compression)
    with Bag(path) as bag:
        assert list(bag.topics) == ["/odom", "/scan", "/tf_static"]
        assert {name: topic.count for name, topic in bag.topics.items()} == {
            "/odom": 40, "/scan": 20, "/tf_static": 1,
        }  # fmt: skip
        assert bag.topics["/scan"].message_type == "sensor_msgs/msg/LaserScan"
        assert (bag.start_ns, bag.end_ns) == (START, START + 39 * STEP)
        assert bag.duration == pytest.approx(0.39)
        got = list(bag.events(bag.topics))
        assert [event.stamp_ns for event in got] == sorted(stamp for _, stamp, _ in events)
        for name in bag.topics:
            mine = [event.message for event in got if event.topic == name]
            for message, (_, _, written) in zip(
                mine, [event for event in events if event[0] == name], strict=True
            ):
                kind = written.__msgtype__
                assert STORE.serialize_cdr(message, kind) == STORE.serialize_cdr(written, kind)
        assert not bag.damaged


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_file_of_a_bag_is_a_bag(tmp_path, storage):
    path = write_bag(tmp_path / "bag", small_drive(), storage=storage)
    (file,) = (file for file in path.iterdir() if file.suffix in (".db3", ".mcap"))
    with Bag(file) as bag:
        assert len(list(bag.events(["/scan"]))) == 20
        assert bag.topics["/odom"].count == 40
        assert (bag.start_ns, bag.end_ns) == (START, START + 39 * STEP)


def test_only_the_topics_that_are_asked_for_are_read(sound_bag):
    with Bag(sound_bag) as bag:
        assert {event.topic for event in bag.events(["/odom", "/tf_static"])} == {
            "/odom", "/tf_static",
        }  # fmt: skip
        assert list(bag.events([])) == []


def test_raw_events_of_a_stretch_of_time(sound_bag):
    events = small_drive()
    with Bag(sound_bag) as bag:
        start, stop = START + 5 * STEP, START + 8 * STEP
        got = list(bag.raw_events(["/odom", "/scan"], start, stop))
    expected = sorted(
        (stamp, topic, bytes(STORE.serialize_cdr(message, message.__msgtype__)))
        for topic, stamp, message in events
        if topic != "/tf_static" and start <= stamp < stop
    )
    assert [(stamp, topic, bytes(data)) for topic, stamp, data in got] == expected


def test_recorded_profiles_are_told(tmp_path):
    profile = qos(depth=7, is_reliable=False, is_transient_local=True)
    path = write_bag(tmp_path / "bag", small_drive(), profiles={"/scan": profile})
    with Bag(path) as bag:
        (told,) = bag.topics["/scan"].profiles
        assert bag.topics["/odom"].profiles == ()
    assert (told.depth, told.reliability) == (7, QosReliability.BEST_EFFORT)
    assert told.durability is QosDurability.TRANSIENT_LOCAL


def test_a_type_of_the_bags_own(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("int32 number\nNested[] parts", "own_msgs/msg/Thing"))
    store.register(get_types_from_msg("string name", "own_msgs/msg/Nested"))
    thing = store.types["own_msgs/msg/Thing"]
    nested = store.types["own_msgs/msg/Nested"]
    message = thing(number=5, parts=[nested(name="a"), nested(name="b")])
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/thing", thing.__msgtype__, typestore=store)
        writer.write(connection, START, store.serialize_cdr(message, thing.__msgtype__))
    with Bag(tmp_path / "bag") as bag:
        (event,) = bag.events(["/thing"])
    assert event.message.number == 5
    assert [part.name for part in event.message.parts] == ["a", "b"]


# Which topics are meant.


def bag_of(tmp_path, *topics):
    events = [
        (name, START, odometry(START) if "odom" in name or "pose" in name else laser_scan(START))
        for name in topics
    ]
    return Bag(write_bag(tmp_path / "bag", events))


def test_all_scan_topics_are_found(tmp_path):
    with bag_of(tmp_path, "/scan_b", "/odom", "/front/scan") as bag:
        assert bag.scan_topics() == ["/front/scan", "/scan_b"]


@pytest.mark.parametrize(
    ("topics", "chosen"),
    [
        (["/a/odom", "/laser_pose", "/odom"], "/odom"),
        (["/laser_pose"], "/laser_pose"),
        (["/robot/odom", "/laser_pose"], "/robot/odom"),
    ],
)
def test_the_odometry_is_found(tmp_path, topics, chosen):
    with bag_of(tmp_path, *topics) as bag:
        assert bag.odometry_topic() == chosen


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        (["/a/odom", "/b/odom"], "one of /a/odom, /b/odom"),
        (["/scan"], "no topic of type nav_msgs/msg/Odometry"),
    ],
)
def test_odometry_that_is_not_clear_is_asked_for(tmp_path, topics, message):
    with bag_of(tmp_path, *topics) as bag, pytest.raises(InputError, match=message):
        bag.odometry_topic()


def test_a_bag_without_scans(tmp_path):
    with bag_of(tmp_path, "/odom") as bag, pytest.raises(InputError, match="LaserScan"):
        bag.scan_topics()


def test_a_topic_that_is_not_there(sound_bag):
    with Bag(sound_bag) as bag, pytest.raises(InputError, match=r"/scam.*/odom, /scan"):
        list(bag.events(["/scam"]))


# Damage.


def error_of(path, topics=("/scan", "/odom")):
    """The one line that tells what is wrong; it names the path."""
    with pytest.raises(InputError) as caught, Bag(path) as bag:
        list(bag.events(topics))
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def warnings_of(path, count, topics=("/scan", "/odom")):
    """The warnings of a bag of which so many messages can be read, each a line."""
    with Bag(path) as bag:
        stamps = [event.stamp_ns for event in bag.events(topics)]
        assert (len(stamps), sorted(stamps)) == (count, stamps)
        assert not any("\n" in line for line in bag.warnings)
        return bag.warnings


def test_what_does_not_exist(tmp_path):
    assert "does not exist" in error_of(tmp_path / "nothing")


def test_a_directory_that_is_no_bag(tmp_path):
    assert "metadata.yaml" in error_of(tmp_path)


def test_a_file_of_another_kind(tmp_path):
    file = tmp_path / "notes.txt"
    file.write_text("hello")
    error_of(file)


def test_a_bag_without_messages(tmp_path):
    with Writer(tmp_path / "bag", version=9) as writer:
        writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=STORE)
    assert "no messages" in error_of(tmp_path / "bag")


def test_a_bag_whose_file_is_missing(sound_bag, tmp_path):
    shutil.copytree(sound_bag, tmp_path / "bag")
    next((tmp_path / "bag").glob("*.db3")).unlink()
    error_of(tmp_path / "bag")


@pytest.mark.parametrize("text", ["", "a: [", "rosbag2_bagfile_information: 3", "\x00"])
def test_a_bag_with_bad_metadata_is_read_without(sound_bag, tmp_path, text):
    shutil.copytree(sound_bag, tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    (warning,) = warnings_of(tmp_path / "bag", 60)
    assert str(tmp_path / "bag" / "metadata.yaml") in warning
    assert "`ros2 bag reindex`" in warning


@pytest.mark.parametrize(("storage", "compression"), STORAGES)
@pytest.mark.parametrize("part", [0.0, 0.05, 0.5, 0.95])
def test_a_truncated_bag_is_read_as_far_as_it_goes(tmp_path, storage, compression, part):
    path = write_bag(tmp_path / "bag", small_drive(), storage=storage, compression=compression)
    (file,) = (file for file in path.iterdir() if file.name != "metadata.yaml")
    data = file.read_bytes()
    file.write_bytes(data[: int(part * len(data))])
    try:
        with Bag(path) as bag:
            stamps = [event.stamp_ns for event in bag.events(["/scan", "/odom"])]
            assert stamps == sorted(stamps)
            assert 0 < len(stamps) <= 60
            assert str(file) in bag.warnings[0]
            if len(stamps) < 60:
                assert f"holds {len(stamps) + 1} messages, metadata.yaml counts 61" in " ".join(
                    bag.warnings
                ) or "/tf_static 0 of 1" in " ".join(bag.warnings)
    except InputError as error:
        message = str(error)
        assert str(file) in message
        assert "\n" not in message
        assert part < 0.9 or compression is CompressionMode.FILE


def test_a_damaged_message_in_the_middle_is_skipped_and_counted(tmp_path):
    events = small_drive()
    sound = bytes(STORE.serialize_cdr(events[5][2], "sensor_msgs/msg/LaserScan"))
    for index, data in ((5, sound[:40]), (7, b""), (9, b"\xff" * 60), (11, sound + bytes(8))):
        topic, stamp, _ = events[index]
        events[index] = topic, stamp, ("sensor_msgs/msg/LaserScan", data)
    with Bag(write_bag(tmp_path / "bag", events)) as bag:
        got = [event.message.ranges[2] for event in bag.events(["/scan"])]
        assert got == [float(index) for index in range(20) if index not in (4, 6, 8, 10)]
        assert bag.damaged == {"/scan": 4}


def test_a_type_that_nobody_knows(tmp_path):
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection(
            "/scan", "un_known/msg/Type", msgdef="=" * 80 + "\nIDL: x\n", rihs01="RIHS01_0"
        )
        writer.write(connection, START, b"\x00\x01\x00\x00")
    assert "un_known/msg/Type" in error_of(tmp_path / "bag", topics=["/scan"])


@pytest.mark.parametrize(
    ("change", "left"),
    [
        ("data = 'DROP TABLE messages'", 20 - 3),
        ("data = 12", 20 - 3),
        ("timestamp = 'noon'", 20 - 3),
        ("topic_id = 'scan'", 20 - 3),
    ],
)
def test_a_database_that_holds_text_where_numbers_and_bytes_are(tmp_path, change, left):
    path = write_bag(tmp_path / "bag", [e for e in small_drive() if e[0] == "/scan"])
    with sqlite3.connect(path / "bag.db3") as database:
        database.execute(f"UPDATE messages SET {change} WHERE id IN (2, 5, 9)")
    database.close()
    with Bag(path) as bag:
        assert len(list(bag.events(["/scan"]))) == left
        assert bag.warnings
