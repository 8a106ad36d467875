# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags as they are found: not closed, damaged, split, of ROS 1, several types on a topic."""

import shutil
import sqlite3
from contextlib import closing

import mcap_writer as mcap
import numpy as np
import pytest
import yaml
from bag_writer import STORE, laser_scan, odometry, rosbags_type, tf_message, write_bag
from rosbags.interfaces import QosDurability
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.bag import LASER_SCAN, ODOMETRY, Bag

START = 1_700_000_000 * 10**9
STEP = 10_000_000


def scan(index):
    return ("/scan", START + index * STEP, laser_scan(START + index * STEP, [1.0, float(index)]))


def text(index, topic="/scan"):
    return (topic, START + index * STEP, rosbags_type("std_msgs/msg/String")(data=str(index)))


def numbers(bag, topic="/scan"):
    """Which of the scans are in a bag, in order."""
    return [int(event.message.ranges[1]) for event in bag.events([topic])]


def refusal(path):
    with pytest.raises(InputError) as caught:
        Bag(path)
    line = str(caught.value)
    assert str(path) in line
    assert "\n" not in line
    return line


# Several types on a topic.


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_the_messages_of_the_right_type_are_read_and_the_others_counted(tmp_path, storage):
    events = [text(index) for index in range(9)] + [scan(index) for index in range(4)]
    with Bag(write_bag(tmp_path / "bag", events, storage=storage)) as bag:
        topic = bag.topics["/scan"]
        assert (topic.message_type, topic.count) == (LASER_SCAN, 4)
        assert topic.other_types == {"std_msgs/msg/String": 9}
        assert bag.scan_topics() == ["/scan"]
        bag.require("/scan", LASER_SCAN)
        assert numbers(bag) == [0, 1, 2, 3]
        assert len(list(bag.raw_events(["/scan"]))) == 4
        assert bag.other_types == {"/scan (std_msgs/msg/String)": 9}
        (warning,) = bag.warnings
    assert "/scan: 9 messages of type std_msgs/msg/String are not read" in warning


def test_a_topic_is_read_as_what_it_is_asked_for(tmp_path):
    poses = [("/scan", START + index, odometry(START)) for index in range(3)]
    with Bag(write_bag(tmp_path / "bag", [*poses, scan(0), scan(1)])) as bag:
        assert bag.scan_topics() == ["/scan"]
        assert bag.odometry_topic() == "/scan"
        for message_type, count in ((LASER_SCAN, 2), (ODOMETRY, 3)):
            events = list(bag.events(["/scan"], {"/scan": message_type}))
            assert [event.message_type for event in events] == count * [message_type]
        assert list(bag.events(["/scan"], {"/scan": "std_msgs/msg/String"})) == []
        with pytest.raises(InputError, match=r"/scan is a .* and a .*, not a std_msgs"):
            bag.require("/scan", "std_msgs/msg/String")


def test_of_other_types_the_most_frequent_is_read(tmp_path):
    number = rosbags_type("std_msgs/msg/Int32")(data=1)
    events = [("/x", START, number), text(0, "/x"), text(1, "/x")]
    with Bag(write_bag(tmp_path / "bag", events)) as bag:
        assert bag.topics["/x"].message_type == "std_msgs/msg/String"
        assert len(list(bag.events(["/x"]))) == 2
        assert bag.other_types == {"/x (std_msgs/msg/Int32)": 1}


# Journals of sqlite.


def unclosed(path, journal, statements):
    """A copy of a bag's database as it is on disk before a transaction's end, and its journal."""
    (file,) = path.glob("*.db3")
    work = path / "work.db3"
    shutil.copy(file, work)
    with closing(sqlite3.connect(work)) as database:
        for statement in statements:
            database.execute(statement)
        shutil.copy(work, file)
        shutil.copy(path / f"work.db3{journal}", path / f"{file.name}{journal}")
    for name in ("work.db3", "work.db3-wal", "work.db3-shm", "work.db3-journal"):
        (path / name).unlink(missing_ok=True)
    return file


IN_LOG = (
    "PRAGMA journal_mode = WAL",
    "PRAGMA wal_autocheckpoint = 0",
    "INSERT INTO messages (topic_id, timestamp, data)"
    f" SELECT topic_id, timestamp + {10 * STEP}, data FROM messages",
    "COMMIT",
)


@pytest.mark.parametrize("is_directory", [True, False])
def test_a_write_ahead_log_is_read(tmp_path, is_directory):
    path = write_bag(tmp_path / "bag", [scan(index) for index in range(10)])
    file = unclosed(path, "-wal", IN_LOG)
    before = {each.name: each.read_bytes() for each in path.iterdir()}
    with Bag(path if is_directory else file) as bag:
        assert numbers(bag) == 2 * list(range(10))
        assert bag.end_ns == START + 19 * STEP
        expected = ["holds 20 messages, metadata.yaml counts 10: bag.db3 20 of 10, /scan 20 of 10"]
        assert [line.partition("bag: ")[2] for line in bag.warnings] == expected * is_directory
    assert {each.name: each.read_bytes() for each in path.iterdir()} == before


def test_a_write_ahead_log_that_is_damaged_is_told(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(index) for index in range(10)])
    file = unclosed(path, "-wal", IN_LOG)
    (path / "bag.db3-wal").write_bytes(b"no log" * 100)
    with Bag(file) as bag:
        assert numbers(bag) == list(range(10))
        assert "bag.db3-wal" in bag.warnings[0]


def test_a_transaction_that_was_not_ended_is_rolled_back(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(index) for index in range(400)])
    sound = next(path.glob("*.db3")).read_bytes()
    file = unclosed(
        path, "-journal", ["PRAGMA cache_size = 2", "UPDATE messages SET data = zeroblob(200)"]
    )
    assert file.read_bytes() != sound
    with Bag(path) as bag:
        assert numbers(bag) == list(range(400))
        assert not bag.warnings


def test_a_log_that_cannot_be_merged_is_refused_by_name(tmp_path, monkeypatch):
    file = unclosed(write_bag(tmp_path / "bag", [scan(0)]), "-wal", IN_LOG)

    def no_space(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", no_space)
    line = refusal(file)
    assert "bag.db3-wal" in line
    assert "No space left" in line
    assert "wal_checkpoint" in line


def test_counts_are_held_against_metadata(tmp_path):
    path = write_bag(tmp_path / "bag", [*map(scan, range(10)), ("/odom", START, odometry(START))])
    with closing(sqlite3.connect(path / "bag.db3")) as database, database:
        database.execute("DELETE FROM messages WHERE id > 7")
    with Bag(path) as bag:
        assert len(numbers(bag)) == 7
        (warning,) = bag.warnings
    assert warning == (
        f"{path}: holds 7 messages, metadata.yaml counts 11: bag.db3 7 of 11, /odom 0 of 1, "
        "/scan 7 of 10"
    )


def test_a_warning_is_logged_once(tmp_path, caplog):
    with Bag(write_bag(tmp_path / "bag", [scan(0), text(0)])) as bag:
        for _ in range(2):
            numbers(bag)
    assert caplog.messages == bag.warnings
    assert len(bag.warnings) == 1


# Damaged databases.


def test_a_database_that_is_cut_off(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(index) for index in range(400)])
    (file,) = path.glob("*.db3")
    size = file.stat().st_size
    file.write_bytes(file.read_bytes()[: size // 2])
    with Bag(file) as bag:
        found = numbers(bag)
        assert found == list(range(len(found)))
        assert 50 < len(found) < 200
        (warning,) = bag.warnings
    assert warning.startswith(f"{file}: unfinished or damaged (its last {size - size // 2} bytes")
    assert f"{len(found)} messages are read" in warning
    assert "ros2 bag reindex" in warning


def test_a_damaged_page_costs_only_its_own_messages(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(index) for index in range(400)])
    (file,) = path.glob("*.db3")
    data = bytearray(file.read_bytes())
    pages = [
        n
        for n in range(4096, len(data), 4096)
        if data[n] == 0x0D and b"laser" in data[n : n + 4096]
    ]
    page = pages[len(pages) // 2]
    data[page : page + 4096] = bytes(4096)
    file.write_bytes(data)
    with Bag(path) as bag:
        found = numbers(bag)
        assert found == sorted(found)
        assert (found[0], found[-1]) == (0, 399)
        assert 340 < len(found) < 400
        assert f"{len(found)} messages are read" in " ".join(bag.warnings)
        assert f"/scan {len(found)} of 400" in " ".join(bag.warnings)


# mcap files that were not closed, or are damaged.


def unfinished(path, *parts):
    path.write_bytes(mcap.header() + mcap.channel(1, "/scan", LASER_SCAN) + b"".join(parts))
    return path


def record_of(index):
    _, stamp, message = scan(index)
    return mcap.message(1, stamp, message)


def chunk_of(indices, compression=""):
    stamps = [START + index * STEP for index in indices]
    return mcap.chunk(b"".join(map(record_of, indices)), stamps, compression)


@pytest.mark.parametrize("compression", ["", "lz4"])
def test_an_mcap_without_footer_is_read_from_its_start(tmp_path, compression):
    parts = [chunk_of([0, 2, 1], compression), record_of(3), chunk_of([4, 5], compression)]
    file = unfinished(tmp_path / "x.mcap", *parts)
    with Bag(file) as bag:
        assert numbers(bag) == [0, 1, 2, 3, 4, 5]
        assert [e.stamp_ns for e in bag.raw_events(["/scan"], START + STEP, START + 3 * STEP)] == [
            START + STEP, START + 2 * STEP,
        ]  # fmt: skip
        assert (bag.start_ns, bag.end_ns) == (START, START + 5 * STEP)
        (warning,) = bag.warnings
    assert warning == (
        f"{file}: unfinished or damaged (no footer); 6 messages are read; "
        "`mcap recover` repairs what can be repaired"
    )


@pytest.mark.parametrize("compression", ["", "lz4"])
def test_of_a_chunk_that_is_cut_off_the_whole_messages_are_read(tmp_path, compression):
    last = chunk_of(range(10, 400), compression)
    file = unfinished(tmp_path / "x.mcap", chunk_of(range(10)), last[: len(last) * 2 // 3])
    with Bag(file) as bag:
        found = numbers(bag)
        assert found == list(range(len(found)))
        assert len(found) >= 10 if compression else len(found) > 250
        assert "cut off" in bag.warnings[0]


def test_a_damaged_chunk_costs_only_its_own_messages(tmp_path):
    parts = [chunk_of([0, 1]), bytearray(chunk_of([2, 3])), chunk_of([4, 5]), mcap.end()]
    parts[1][-5] ^= 0xFF
    with Bag(unfinished(tmp_path / "x.mcap", *parts)) as bag:
        assert numbers(bag) == [0, 1, 4, 5]
        assert "checksum" in bag.warnings[0]


def test_a_chunk_that_turns_out_damaged_when_it_is_read(tmp_path):
    """The index is sound: what rosbags has given before the damage is not given twice."""
    scans = [
        (topic, stamp, laser_scan(stamp, np.random.default_rng(index).random(3000)))
        for index in range(300)
        for topic, stamp, _ in [scan(index)]
    ]
    path = write_bag(
        tmp_path / "bag", scans, storage=StoragePlugin.MCAP, compression=CompressionMode.STORAGE
    )
    (file,) = path.glob("*.mcap")
    data = bytearray(file.read_bytes())
    name = b"\x04\x00\x00\x00zstd"
    second = data.index(name, data.index(name) + 1) + len(name) + 8
    data[second : second + 4] = b"none"
    file.write_bytes(data)
    with Bag(path) as bag:
        for _ in range(2):
            stamps = [event.stamp_ns for event in bag.events(["/scan"])]
            assert 0 < len(stamps) < 300
            assert stamps == sorted(set(stamps))
            assert (stamps[0], stamps[-1]) == (START, START + 299 * STEP)
        (warning,) = bag.warnings
    assert f"{file}: unfinished or damaged (a damaged chunk" in warning
    assert f"{len(stamps)} messages are read" in warning


def test_an_mcap_without_chunks_need_not_be_in_order(tmp_path):
    file = unfinished(tmp_path / "x.mcap", *map(record_of, (0, 1, 3, 2, 4)), mcap.end())
    with Bag(file) as bag:
        assert numbers(bag) == [0, 1, 2, 3, 4]
        assert not bag.warnings


def test_an_mcap_without_a_message_is_refused_with_a_cure(tmp_path):
    line = refusal(unfinished(tmp_path / "x.mcap"))
    assert "no message can be read (no footer)" in line
    assert "`mcap recover`" in line
    (tmp_path / "y.mcap").write_bytes(b"")
    assert "`mcap recover`" in refusal(tmp_path / "y.mcap")


def test_messages_that_are_not_cdr_are_of_another_type(tmp_path):
    file = tmp_path / "x.mcap"
    channels = mcap.channel(1, "/scan", LASER_SCAN) + mcap.channel(2, "/scan", LASER_SCAN, "json")
    other = mcap.message(2, START, laser_scan(START))
    file.write_bytes(mcap.header() + channels + record_of(0) + other + mcap.end())
    with Bag(file) as bag:
        assert numbers(bag) == [0]
        assert bag.other_types == {f"/scan ({LASER_SCAN} as json)": 1}


# Which files are the bag.


def split(tmp_path, storage):
    """A bag of three files, whose names are not in order of time."""
    path = tmp_path / "split"
    path.mkdir()
    suffix = {StoragePlugin.SQLITE3: ".db3", StoragePlugin.MCAP: ".mcap"}[storage]
    for name, first in (("b", 0), ("c", 10), ("a", 20)):
        part = write_bag(tmp_path / name, map(scan, range(first, first + 10)), storage=storage)
        shutil.move(part / f"{name}{suffix}", path)
    return path, suffix


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_the_files_of_a_directory_without_metadata_are_one_bag(tmp_path, storage):
    path, _ = split(tmp_path, storage)
    with Bag(path) as bag:
        assert numbers(bag) == list(range(30))
        assert bag.topics["/scan"].count == 30
        (warning,) = bag.warnings
    assert warning == (
        f"{path}: no metadata.yaml; all its files are read; `ros2 bag reindex` writes "
        "metadata.yaml anew"
    )


def test_files_that_overlap_in_time_are_merged(tmp_path):
    path = tmp_path / "bag"
    path.mkdir()
    for name, first in (("even", 0), ("odd", 1)):
        part = write_bag(tmp_path / name, map(scan, range(first, 10, 2)))
        shutil.move(part / f"{name}.db3", path)
    with Bag(path) as bag:
        assert numbers(bag) == list(range(10))


def test_one_unreadable_file_does_not_cost_the_others(tmp_path):
    path, suffix = split(tmp_path, StoragePlugin.MCAP)
    (path / f"c{suffix}").write_bytes(b"damaged")
    with Bag(path) as bag:
        assert numbers(bag) == [*range(10), *range(20, 30)]
        assert str(path / "c.mcap") in bag.warnings[-1]


def test_a_directory_of_both_formats_is_not_clear(tmp_path):
    path, _ = split(tmp_path, StoragePlugin.MCAP)
    shutil.move(write_bag(tmp_path / "d", [scan(0)]) / "d.db3", path)
    assert ".mcap and .db3" in refusal(path)


def edited(path, **changes):
    metadata = path / "metadata.yaml"
    document = yaml.safe_load(metadata.read_text())
    document["rosbag2_bagfile_information"].update(changes)
    metadata.write_text(yaml.safe_dump(document))
    return path


@pytest.mark.parametrize(
    "changes", [{"storage_identifier": ""}, {"version": 12}, {"storage_identifier": "my_plugin"}]
)
def test_what_metadata_says_of_the_storage_does_not_matter(tmp_path, changes):
    with Bag(edited(write_bag(tmp_path / "bag", [scan(0)]), **changes)) as bag:
        assert numbers(bag) == [0]
        assert not bag.warnings


def test_a_compression_that_is_not_known_is_refused(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(0)])
    edited(path, compression_mode="FILE", compression_format="lz4")
    assert "compression_format 'lz4'" in refusal(path)


def test_files_that_metadata_lacks_or_lists_in_vain(tmp_path):
    """A recorder that crashed after a split leaves a part that is not listed."""
    path, _ = split(tmp_path, StoragePlugin.MCAP)
    for old, new in (("b", "r_0"), ("c", "r_1"), ("a", "other")):
        (path / f"{old}.mcap").rename(path / f"{new}.mcap")
    shutil.copy(tmp_path / "b" / "metadata.yaml", path)
    edited(path, relative_file_paths=["r_0.mcap"])
    with Bag(path) as bag:
        assert numbers(bag) == list(range(20))
        text = "\n".join(bag.warnings)
    assert f"{path / 'r_1.mcap'}: not in metadata.yaml, and read as well" in text
    assert f"{path / 'other.mcap'}: not in metadata.yaml, and not read" in text
    edited(path, relative_file_paths=["r_0.mcap", "r_7.mcap"])
    with Bag(path) as bag:
        assert f"{path / 'r_7.mcap'}: does not exist" in "\n".join(bag.warnings)


def test_a_bag_whose_file_was_renamed(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(0)])
    (path / "bag.db3").rename(path / "drive.db3")
    with Bag(path) as bag:
        assert numbers(bag) == [0]
        assert "metadata.yaml names bag.db3, but drive.db3 is read" in bag.warnings[0]


def test_topics_without_messages_are_known_from_metadata(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(0)], storage=StoragePlugin.MCAP)
    document = yaml.safe_load((path / "metadata.yaml").read_text())
    (topic,) = document["rosbag2_bagfile_information"]["topics_with_message_count"]
    silent = topic["topic_metadata"] | {"name": "/odom", "type": ODOMETRY}
    edited(
        path,
        topics_with_message_count=[topic, {"message_count": 0, "topic_metadata": silent}],
    )
    with Bag(path) as bag:
        assert bag.topics["/odom"].count == 0
        assert not bag.warnings
        with pytest.raises(InputError, match=r"/odom \(nav_msgs/msg/Odometry\) holds no messages"):
            bag.odometry_topic()
        bag.require("/odom", ODOMETRY)
        assert bag.warnings == [f"{path}: /odom ({ODOMETRY}) holds no messages"]


def test_a_type_without_definition_is_named_with_its_topic(tmp_path):
    path = write_bag(tmp_path / "bag", [scan(0)])
    with closing(sqlite3.connect(path / "bag.db3")) as database, database:
        database.execute("UPDATE topics SET type = 'own_msgs/msg/Thing'")
    with Bag(path / "bag.db3") as bag:
        with pytest.raises(InputError) as caught:
            list(bag.events(["/scan"]))
        assert len(list(bag.raw_events(["/scan"]))) == 1
    assert str(caught.value) == (
        f"{path / 'bag.db3'}: /scan: type own_msgs/msg/Thing is not known, nor defined in the bag"
    )


def test_a_type_that_is_defined_in_idl(tmp_path):
    definition = (
        "================\nIDL: own_msgs/msg/Thing\n"
        "module own_msgs { module msg { struct Thing { int32 number; }; }; };"
    )
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection(
            "/thing", "own_msgs/msg/Thing", msgdef=definition, rihs01="RIHS01_0"
        )
        writer.write(connection, START, b"\x00\x01\x00\x00\x05\x00\x00\x00")
    with closing(sqlite3.connect(tmp_path / "bag" / "bag.db3")) as database, database:
        database.execute("UPDATE message_definitions SET encoding = 'ros2idl'")
    with Bag(tmp_path / "bag") as bag:
        (event,) = bag.events(["/thing"])
    assert event.message.number == 5


# ROS 1.


ROS1 = get_typestore(Stores.ROS1_NOETIC)


def ros1(message):
    """The same message with ROS 1's header."""
    own = ROS1.types[message.__msgtype__]
    fields = dict(vars(message))
    if "header" in fields:
        stamp = ROS1.types["builtin_interfaces/msg/Time"](**vars(message.header.stamp))
        fields["header"] = ROS1.types["std_msgs/msg/Header"](
            seq=7, stamp=stamp, frame_id=message.header.frame_id
        )
    return own(**fields)


def write_ros1_bag(path):
    definition, _ = ROS1.generate_msgdef("geometry_msgs/msg/TransformStamped")
    definitions = (
        "geometry_msgs/TransformStamped[] transforms\n"
        f"{'=' * 80}\nMSG: geometry_msgs/TransformStamped\n{definition}"
    )
    with Rosbag1Writer(path) as writer:
        scans = writer.add_connection("/scan", LASER_SCAN, typestore=ROS1)
        poses = writer.add_connection("/odom", ODOMETRY, typestore=ROS1)
        marks = writer.add_connection("/mark", "visualization_msgs/msg/Marker", typestore=ROS1)
        frames = writer.add_connection(
            "/tf_static", "tf/msg/tfMessage", msgdef=definitions, md5sum="0" * 32, latching=1
        )
        mount = tf_message((START, "base_link", "laser", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)))
        store = get_typestore(Stores.ROS2_JAZZY)
        writer.write(frames, START, store.cdr_to_ros1(
            store.serialize_cdr(mount, mount.__msgtype__), mount.__msgtype__))  # fmt: skip
        for index in range(5):
            stamp = START + index * STEP
            for connection, message in ((scans, scan(index)[2]), (poses, odometry(stamp))):
                data = ROS1.serialize_ros1(ros1(message), message.__msgtype__)
                writer.write(connection, stamp, data)
        writer.write(marks, START, bytes(100))
    return path


def test_a_ros_1_bag_is_read_as_one_of_ros_2(tmp_path):
    with Bag(write_ros1_bag(tmp_path / "drive.bag")) as bag:
        assert bag.scan_topics() == ["/scan"]
        assert bag.odometry_topic() == "/odom"
        assert numbers(bag) == list(range(5))
        (mount,) = bag.events(["/tf_static"])
        assert mount.message_type == "tf2_msgs/msg/TFMessage"
        (transform,) = mount.message.transforms
        assert (transform.child_frame_id, transform.transform.translation.y) == ("laser", 2.0)
        (profile,) = bag.topics["/tf_static"].profiles
        assert profile.durability is QosDurability.TRANSIENT_LOCAL
        assert (bag.start_ns, bag.end_ns) == (START, START + 4 * STEP)
        raw = next(bag.raw_events(["/odom"]))
        assert bytes(raw.data) == bytes(STORE.serialize_cdr(odometry(START), ODOMETRY))
        # ROS 2 has given it further fields.
        assert bag.topics["/mark"].message_type == "visualization_msgs/msg/Marker of ROS 1"
        with pytest.raises(InputError, match="/mark"):
            list(bag.events(["/mark"]))
        assert not bag.warnings


def test_a_ros_1_bag_that_was_not_closed(tmp_path):
    path = write_ros1_bag(tmp_path / "drive.bag")
    path.write_bytes(path.read_bytes()[:-500])
    assert "`rosbag reindex`" in refusal(path)
