# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which scans leave the queue, when, in which order, with which poses; and why others do not.

The robot drives at 2 m/s along x and turns at 0.3 rad/s, so that its pose is known at any time.
"""

import math
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bag_writer import tf_message
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from repository import ROOT

from heightmap25d_ros import se3
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.io.decode import Odometry, Transform
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.params.sections import IntakeParams
from heightmap25d_ros.pipelines.scan_queue import ScanQueue

EPOCH = 1_700_000_000 * 10**9


def ns(seconds):
    return EPOCH + round(seconds * 1e9)


def drive(seconds):
    return (2.0 * seconds, 0.0, 0.0, 0.0, 0.0, 0.3 * seconds)


def pose(seconds, frame_id="odom", child_frame_id="base_link"):
    return Odometry(
        stamp_ns=ns(seconds),
        frame_id=frame_id,
        child_frame_id=child_frame_id,
        T=se3.from_xyz_rpy(drive(seconds)),
    )


def scan(seconds, beams=3, time_increment=0.0, frame_id="laser"):
    return Scan(
        stamp_ns=ns(seconds), frame_id=frame_id, angle_min=0.0, angle_increment=0.1,
        time_increment=time_increment, range_min=0.1, range_max=30.0,
        ranges=np.ones(beams, np.float32),
    )  # fmt: skip


def mount(seconds=0.0, frame="laser", xyz_rpy=(0.3, 0.0, 0.4, 0.0, 0.0, 0.0), parent="base_link"):
    return Transform(parent=parent, child=frame, stamp_ns=ns(seconds), T=se3.from_xyz_rpy(xyz_rpy))


def add_transforms(queue, transforms, is_static=False):
    message = tf_message(
        *((t.stamp_ns, t.parent, t.child, t.T[:3, 3], se3.to_quaternion(t.T)) for t in transforms)
    )
    return queue.take_transforms(message, is_static=is_static)


def intake_of(topics=("scan",), with_mounts=True, **params):
    mounts = (0.3, 0.0, 0.4, 0.0, 0.0, 0.0) * len(topics) if with_mounts else ()
    return ScanQueue(IntakeParams(scan_topics=topics, mounts=mounts, **params))


def stamps(readings):
    return [round((reading.scan.stamp_ns - EPOCH) / 1e9, 6) for reading in readings]


def xyz_rpy(T):
    return se3.to_xyz_rpy(T)


# The poses of a reading.


def test_each_beam_gets_the_pose_of_its_own_time():
    queue = intake_of()
    for seconds in (0.0, 0.1, 0.2, 0.3):
        assert queue.add_odometry(pose(seconds)) == []
    (reading,) = queue.add_scan("scan", scan(0.05, beams=5, time_increment=0.05))
    times = 0.05 + 0.05 * np.arange(5)
    np.testing.assert_allclose(xyz_rpy(reading.T_map_base), [drive(t) for t in times], atol=1e-9)
    np.testing.assert_allclose(xyz_rpy(reading.T_base_sensor), [(0.3, 0, 0.4, 0, 0, 0)])
    assert (reading.topic, stamps([reading])) == ("scan", [0.05])


def test_a_nodding_mount_is_taken_at_each_beams_own_time():
    queue = intake_of(with_mounts=False)
    for seconds in (0.0, 0.2, 0.4):
        queue.add_odometry(pose(seconds))
        add_transforms(queue, [mount(seconds, xyz_rpy=(0, 0, 1, 0, 0.5 * seconds, 0))])
    (reading,) = queue.add_scan("scan", scan(0.05, beams=4, time_increment=0.1))
    times = 0.05 + 0.1 * np.arange(4)
    expected = [(0, 0, 1, 0, 0.5 * t, 0) for t in times]
    np.testing.assert_allclose(xyz_rpy(reading.T_base_sensor), expected, atol=1e-9)
    np.testing.assert_allclose(xyz_rpy(reading.T_map_base), [drive(t) for t in times], atol=1e-9)


def test_beams_that_run_backwards_in_time():
    queue = intake_of()
    for seconds in (0.0, 0.5):
        queue.add_odometry(pose(seconds))
    (reading,) = queue.add_scan("scan", scan(0.4, beams=3, time_increment=-0.1))
    np.testing.assert_allclose(reading.T_map_base[:, 0, 3], (0.8, 0.6, 0.4), atol=1e-9)


def test_mounts_from_parameters_belong_to_their_topics():
    six = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    queue = ScanQueue(IntakeParams(scan_topics=("b", "a"), mounts=(*six, 7.0, 0, 0, 0, 0, 0)))
    queue.add_odometry(pose(0.0))
    queue.add_scan("a", scan(0.0))
    first, second = queue.add_scan("b", scan(0.0))
    assert (first.topic, second.topic) == ("a", "b")
    np.testing.assert_allclose(xyz_rpy(second.T_base_sensor), [six])
    np.testing.assert_allclose(xyz_rpy(first.T_base_sensor), [(7.0, 0, 0, 0, 0, 0)])


def test_a_correction_moves_later_scans_into_the_map():
    queue = intake_of()
    queue.add_odometry(pose(1.0))
    (before,) = queue.add_scan("scan", scan(1.0))
    queue.set_correction(se3.from_xyz_rpy((10.0, 20.0, 0.0, 0.0, 0.0, math.pi / 2)))
    queue.add_odometry(pose(1.5))
    (after,) = queue.add_scan("scan", scan(1.5))
    np.testing.assert_allclose(xyz_rpy(before.T_map_base), [drive(1.0)], atol=1e-12)
    # 3 m ahead in odom is 3 m to the left in the map.
    np.testing.assert_allclose(
        xyz_rpy(after.T_map_base), [(10.0, 23.0, 0, 0, 0, math.pi / 2 + 0.45)], atol=1e-9
    )


# When a scan is released.


def test_a_scan_waits_for_the_pose_after_its_last_beam():
    queue = intake_of()
    queue.add_odometry(pose(0.0))
    assert queue.add_scan("scan", scan(0.05, beams=3, time_increment=0.1)) == []
    assert queue.add_odometry(pose(0.1)) == []
    assert queue.add_odometry(pose(0.2)) == []
    assert stamps(queue.add_odometry(pose(0.3))) == [0.05]
    assert not queue.dropped


def test_a_pose_at_the_scans_own_stamp_needs_no_other():
    queue = intake_of()
    assert queue.add_scan("scan", scan(0.5)) == []
    assert stamps(queue.add_odometry(pose(0.5))) == [0.5]


def test_a_scan_waits_for_its_mount():
    queue = intake_of(with_mounts=False)
    queue.add_odometry(pose(0.0))
    queue.add_odometry(pose(0.2))
    assert queue.add_scan("scan", scan(0.1)) == []
    assert add_transforms(queue, [mount(frame="other")]) == []
    assert stamps(add_transforms(queue, [mount()], is_static=True)) == [0.1]


def test_scans_leave_in_the_order_of_their_stamps_and_topics():
    queue = intake_of(topics=("b", "a", "c"))
    queue.add_odometry(pose(0.0))
    for topic, seconds in (("c", 0.3), ("b", 0.1), ("b", 0.2), ("a", 0.2), ("a", 0.25)):
        assert queue.add_scan(topic, scan(seconds)) == []
    assert queue.add_scan("c", scan(0.15)) == []
    released = queue.add_odometry(pose(0.4))
    assert [(r.topic, *stamps([r])) for r in released] == [
        ("b", 0.1), ("c", 0.15), ("a", 0.2), ("b", 0.2),
    ]  # fmt: skip
    # The others may still have something for 0.25 and 0.3.
    assert [r.topic for r in queue.flush()] == ["a", "c"]
    assert not queue.dropped


def test_settling_releases_what_has_its_poses_and_keeps_what_has_not():
    queue = intake_of(topics=("left", "right"))
    for seconds in (0.0, 0.1, 0.2):
        queue.add_odometry(pose(seconds))
    assert queue.add_scan("left", scan(0.05)) == []  # the right laser may still have an older one
    assert queue.add_scan("left", scan(0.25)) == []
    assert stamps(queue.settle()) == [0.05]
    queue.add_odometry(pose(0.3))
    assert stamps(queue.settle()) == [0.25]
    assert queue.dropped.total() == 0


def test_a_laser_that_fell_silent_is_not_waited_for():
    queue = intake_of(topics=("a", "b"), wait_limit=1.0)
    released = []
    for step in range(31):
        seconds = 0.1 * step
        released += queue.add_odometry(pose(seconds))
        released += queue.add_scan("a", scan(seconds))
        if step == 0:
            released += queue.add_scan("b", scan(seconds))
    assert stamps(released) == [0.0, *np.round(0.1 * np.arange(0, 31), 6)]
    assert not queue.dropped


def test_a_laser_that_never_speaks_holds_the_others_up_only_at_first():
    queue = intake_of(topics=("a", "b"), wait_limit=0.5)
    latest = []
    for step in range(21):
        seconds = 0.1 * step
        queue.add_odometry(pose(seconds))
        latest.append(stamps(queue.add_scan("a", scan(seconds))))
    assert latest[:5] == [[]] * 5
    assert latest[-1] == [2.0]
    assert not queue.dropped


# What is dropped, and why.


def test_scans_before_the_first_pose():
    queue = intake_of()
    queue.add_odometry(pose(1.0))
    assert queue.add_scan("scan", scan(0.9)) == []
    assert queue.dropped == {"scan: before the odometry": 1}


def test_scans_whose_poses_do_not_come():
    queue = intake_of(wait_limit=0.5)
    queue.add_odometry(pose(0.0))
    for step in range(1, 11):
        assert queue.add_scan("scan", scan(0.1 * step)) == []
    assert queue.dropped == {"scan: after the odometry": 4}
    # The others are not lost yet.
    assert stamps(queue.add_odometry(pose(0.95)))[0] == 0.5
    assert queue.flush() == []
    assert queue.dropped == {"scan: after the odometry": 5}


def test_scans_without_any_odometry():
    queue = intake_of(wait_limit=0.5)
    for step in range(100):
        assert queue.add_scan("scan", scan(0.1 * step)) == []
    assert queue.dropped["scan: without the odometry"] >= 90


def test_scans_in_a_gap_of_the_odometry():
    queue = intake_of(odom_gap=0.5)
    queue.add_odometry(pose(0.0))
    queue.add_scan("scan", scan(0.3))
    assert queue.add_odometry(pose(0.6)) == []
    assert queue.dropped == {"scan: in a gap of the odometry": 1}
    # Beams at the very ends of the gap are sound.
    assert stamps(queue.add_scan("scan", scan(0.6))) == [0.6]


def test_scans_without_mount_are_dropped_until_it_comes():
    queue = intake_of(with_mounts=False, wait_limit=0.3)
    reason = "scan: without its mount"
    add_transforms(queue, [mount(frame="laser", parent="elsewhere")], is_static=True)
    for step in range(11):
        queue.add_odometry(pose(0.1 * step))
        assert queue.add_scan("scan", scan(0.1 * step)) == []
    # Once waited for in vain, a mount is not waited for again.
    assert queue.dropped == {reason: 11}
    add_transforms(queue, [mount(frame="laser")], is_static=True)
    queue.add_odometry(pose(1.1))
    assert stamps(queue.add_scan("scan", scan(1.1))) == [1.1]
    assert queue.dropped == {reason: 11}


def test_a_laser_without_mount_does_not_hold_another_one_up():
    queue = intake_of(topics=("a", "b"), with_mounts=False, wait_limit=0.3)
    add_transforms(queue, [mount(frame="laser")], is_static=True)
    released, latest = [], []
    for step in range(21):
        seconds = 0.1 * step
        released += queue.add_odometry(pose(seconds))
        released += queue.add_scan("b", scan(seconds, frame_id="unmounted"))
        latest = queue.add_scan("a", scan(seconds))
        released += latest
    assert stamps(released) == list(np.round(0.1 * np.arange(21), 6))
    assert stamps(latest) == [2.0]
    assert queue.dropped.keys() == {"scan: without its mount"}


def test_scans_before_a_moving_mount_and_in_a_gap_of_it():
    queue = intake_of(with_mounts=False, odom_gap=0.5)
    for step in range(11):
        queue.add_odometry(pose(0.1 * step))
    for seconds in (0.2, 0.9):
        add_transforms(queue, [mount(seconds)])
    for seconds in (0.1, 0.3):
        assert queue.add_scan("scan", scan(seconds)) == []
    assert queue.dropped == {
        "scan: before its mount": 1,
        "scan: in a gap of its mount": 1,
    }


def test_duplicates_and_stragglers_of_a_topic():
    queue = intake_of()
    for seconds in (0.0, 1.0, 2.0):
        queue.add_odometry(pose(seconds))
    assert stamps(queue.add_scan("scan", scan(1.0))) == [1.0]
    assert queue.add_scan("scan", scan(1.0)) == []
    assert queue.add_scan("scan", scan(0.8)) == []
    assert queue.add_scan("scan", scan(2.1)) == []
    assert queue.add_scan("scan", scan(2.1)) == []
    assert queue.dropped == {"scan: stamp seen before": 2, "scan: out of order": 1}
    assert stamps(queue.add_odometry(pose(2.2))) == [2.1]


def test_scans_that_overtook_each_other_on_the_way_are_put_in_order():
    queue = intake_of()
    queue.add_odometry(pose(0.0))
    for seconds in (0.3, 0.1, 0.2):
        queue.add_scan("scan", scan(seconds))
    assert stamps(queue.add_odometry(pose(0.4))) == [0.1, 0.2, 0.3]


def test_odometry_that_is_not_what_is_expected():
    queue = intake_of()
    queue.add_odometry(pose(0.0))
    queue.add_odometry(pose(0.1, frame_id="map"))
    queue.add_odometry(pose(0.2, child_frame_id="base_footprint"))
    queue.add_odometry(pose(0.0))
    queue.add_odometry(pose(0.4))
    queue.add_odometry(pose(0.3))
    assert queue.dropped == {
        "odometry: in another frame": 1,
        "odometry: of another frame": 1,
        "odometry: stamp seen before": 1,
        "odometry: out of order": 1,
    }
    assert queue.dropped.examples == {
        "odometry: in another frame": "in 'map', not in 'odom'",
        "odometry: of another frame": "of 'base_footprint', not of 'base_link'",
    }
    np.testing.assert_allclose(
        queue.add_scan("scan", scan(0.2))[0].T_map_base[0, 0, 3], 0.4, atol=1e-9
    )


def test_odometry_of_the_robot_in_itself():
    queue = intake_of()
    queue.add_odometry(pose(0.0, frame_id="base_link"))
    assert queue.dropped == {"odometry: of a frame in itself": 1}


def test_transforms_that_close_a_loop():
    queue = intake_of(with_mounts=False)
    add_transforms(queue, [mount()], is_static=True)
    add_transforms(queue, [mount(frame="base_link", parent="laser")])
    queue.add_odometry(pose(0.0))
    assert stamps(queue.add_scan("scan", scan(0.0))) == [0.0]
    assert queue.dropped == {"transforms: closes a loop": 1}
    assert "laser -> base_link" in queue.dropped.examples["transforms: closes a loop"]


def test_a_topic_that_is_none_of_the_lasers_is_misuse():
    with pytest.raises(ValueError, match="is not one of the topics"):
        intake_of().add_scan("elsewhere", scan(0.0))


# Clocks that jump.


def test_another_drive_joins_nothing_of_before_but_static_mounts():
    queue = intake_of(with_mounts=False)
    add_transforms(queue, [mount()], is_static=True)
    queue.add_odometry(pose(0.0))
    queue.add_scan("scan", scan(0.05))
    assert queue.flush() == []
    queue.begin_drive()
    assert queue.add_odometry(pose(0.0, frame_id="world")) == []
    (reading,) = queue.add_scan("scan", scan(0.0))
    assert stamps([reading]) == [0.0]
    assert reading.T_base_sensor[0, 0, 3] == 0.3
    assert queue.dropped == {"scan: after the odometry": 1}


def test_a_bag_that_loops():
    queue = intake_of(with_mounts=False)
    released = []
    for _ in range(3):
        for step in range(41):
            seconds = 0.1 * step
            add_transforms(queue, [mount(seconds, xyz_rpy=(0, 0, 1, 0, 0.5 * seconds, 0))])
            released += queue.add_odometry(pose(seconds))
            released += queue.add_scan("scan", scan(seconds))
    assert stamps(released) == 3 * list(np.round(0.1 * np.arange(41), 6))
    assert queue.dropped == {"poses: clock jumped back": 2}


def test_after_a_jump_back_nothing_of_before_is_used():
    queue = intake_of(with_mounts=False)
    for seconds in (10.0, 10.1, 10.2):
        queue.add_odometry(pose(seconds))
        add_transforms(queue, [mount(seconds)])
    queue.add_scan("scan", scan(10.25))
    # The new run's odometry comes before its transforms; what is still known of the mount is
    # of another run, even at the same stamp.
    assert queue.add_odometry(pose(5.0)) == []
    assert queue.dropped == {"poses: clock jumped back": 1, "scan: clock jumped back": 1}
    assert queue.add_scan("scan", scan(5.0)) == []
    moved = mount(5.0, xyz_rpy=(9.0, 0, 0, 0, 0, 0))
    (reading,) = add_transforms(queue, [moved])
    assert reading.T_base_sensor[0, 0, 3] == 9.0


def test_a_scan_of_the_next_loop_that_comes_before_its_odometry_is_not_mixed_up():
    queue = intake_of()
    for step in range(41):
        queue.add_odometry(pose(0.1 * step))
        queue.add_scan("scan", scan(0.1 * step))
    assert queue.add_scan("scan", scan(0.0)) == []
    assert queue.dropped == {"scan: out of order": 1}
    queue.add_odometry(pose(0.0))
    assert stamps(queue.add_scan("scan", scan(0.0))) == [0.0]


def test_after_a_jump_back_the_lasers_still_wait_for_one_another():
    queue = intake_of(topics=("a", "b"))
    for seconds in (10.0, 10.1):
        queue.add_odometry(pose(seconds))
        for topic in ("a", "b"):
            queue.add_scan(topic, scan(seconds))
    queue.add_odometry(pose(5.0))
    queue.add_odometry(pose(5.1))
    assert queue.add_scan("b", scan(5.05)) == []
    assert [r.topic for r in queue.add_scan("a", scan(5.02))] == ["a"]
    assert [r.topic for r in queue.add_scan("a", scan(5.06))] == ["b"]


def test_a_laser_whose_clock_was_ahead_comes_back():
    queue = intake_of(topics=("a", "b"))
    released = []
    for step in range(50):
        seconds = 0.1 * step
        released += queue.add_odometry(pose(seconds))
        released += queue.add_scan("a", scan(seconds + (3600.0 if step < 25 else 0.05)))
        released += queue.add_scan("b", scan(seconds + 0.05))
    released += queue.add_odometry(pose(5.0))
    topics = [reading.topic for reading in released]
    assert (topics.count("a"), topics.count("b")) == (25, 50)
    assert sum(queue.dropped.values()) == 25


def test_a_laser_whose_stamps_are_never_set_does_not_disturb_the_other():
    queue = intake_of(topics=("broken", "good"))
    released = []
    for step in range(50):
        seconds = 0.1 * step
        released += queue.add_odometry(pose(seconds))
        queue.add_scan("broken", scan(-1e9 + 1e-6 * step))
        released += queue.add_scan("good", scan(seconds))
    released += queue.flush()
    assert stamps(released) == list(np.round(0.1 * np.arange(50), 6))


def test_a_jump_forward_is_a_gap():
    queue = intake_of()
    queue.add_odometry(pose(0.0))
    queue.add_scan("scan", scan(0.1))
    queue.add_odometry(pose(5.0))
    assert queue.dropped == {"scan: in a gap of the odometry": 1}
    queue.add_scan("scan", scan(5.05))
    assert stamps(queue.add_odometry(pose(5.1))) == [5.05]


def test_the_queue_does_not_grow_without_end():
    queue = intake_of(topics=("future", "good"), wait_limit=0.5)
    for step in range(2000):
        queue.add_odometry(pose(0.1 * step))
        queue.add_scan("future", scan(0.1 * step + 3600.0))
        queue.add_scan("good", scan(0.1 * step))
    assert sum(queue.dropped.values()) >= 1990


# How the topics interleave on their way does not matter.


def recorded():
    """Two lasers, odometry with a gap, a nodding mount: (topic, stamp, content), by stamp."""
    events = []
    for step in range(300):
        seconds = 0.02 * step
        if not 2.0 < seconds < 3.5:
            events.append(("odom", seconds, pose(seconds)))
        nod = (0, 0, 1, 0, 0.5 * seconds, 0)
        events.append(("tf", seconds, mount(seconds, "nodding", nod)))
    for step in range(150):
        seconds = 0.04 * step + 0.001
        events.append(("b", seconds, scan(seconds, 5, 0.004, "nodding")))
    for step in range(90):
        seconds = 0.06 * step
        events.append(("a", seconds, scan(seconds, 5, 0.004, "laser")))
    return sorted(events, key=lambda event: event[1])


RECORDED = recorded()


@cache
def expected_run():
    return run(RECORDED)


def run(events):
    queue = intake_of(topics=("a", "b"), with_mounts=False)
    add_transforms(queue, [mount(frame="laser")], is_static=True)
    released = []
    for topic, _, content in events:
        if topic == "odom":
            released += queue.add_odometry(content)
        elif topic == "tf":
            released += add_transforms(queue, [content])
        else:
            released += queue.add_scan(topic, content)
    return released + queue.flush(), queue.dropped


@draws(10)
@given(
    st.dictionaries(
        st.sampled_from(["odom", "tf", "a", "b"]), st.floats(0.0, 0.3), min_size=4, max_size=4
    ),
    st.integers(0, 2**32 - 1),
)
def test_the_interleaving_of_the_topics_does_not_matter(delays, seed):
    random = np.random.default_rng(seed)
    arrival, latest = [], dict.fromkeys(delays, 0.0)
    for event in RECORDED:
        topic, seconds, _ = event
        latest[topic] = max(latest[topic], seconds + delays[topic] + 0.1 * random.random())
        arrival.append((latest[topic], event))
    arrival.sort(key=lambda pair: pair[0])
    expected, dropped = expected_run()
    got, got_dropped = run([event for _, event in arrival])
    assert len(expected) > 150
    assert [(r.topic, r.scan.stamp_ns) for r in got] == [
        (r.topic, r.scan.stamp_ns) for r in expected
    ]
    assert sum(got_dropped.values()) == sum(dropped.values()) == 240 - len(expected)
    for mine, other in zip(got, expected, strict=True):
        np.testing.assert_array_equal(mine.T_map_base, other.T_map_base)
        np.testing.assert_array_equal(mine.T_base_sensor, other.T_base_sensor)


# Real recordings.

SHARED = Path(os.environ.get("HEIGHTMAP25D_SHARED_BAGS", ROOT.parent / "shared" / "bags"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "scans"),
    [("kurt3d_sick_nodding", 678), ("fr079_2d", 4934), ("monoforce_tradr", 204)],
)
def test_every_scan_of_the_real_recordings_is_used(name, scans):
    if not (SHARED / name).is_dir():
        pytest.skip(f"the recording {name} is not on this machine")
    queue = ScanQueue(IntakeParams(scan_topics=("/scan",)))
    released = []
    with Bag(SHARED / name) as bag:
        topics = {"/scan", "/odom", "/tf", "/tf_static"} & bag.topics.keys()
        for event in bag.events(topics):
            if event.topic == "/scan":
                released += queue.add_scan(event.topic, decode.scan(event.message))
            elif event.topic == "/odom":
                released += queue.add_odometry(decode.odometry(event.message))
            else:
                is_static = event.topic == "/tf_static"
                released += queue.take_transforms(event.message, is_static=is_static)
    released += queue.flush()
    assert len(released) == scans
    assert not queue.dropped
