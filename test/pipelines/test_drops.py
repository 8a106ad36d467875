# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import re
from types import SimpleNamespace

from bag_writer import laser_scan, odometry, tf_message
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.planning import Planning


def test_a_malformed_message_is_counted_with_the_numbers_that_are_wrong():
    dropped = Drops()
    scan = laser_scan(0, [1.0] * 361, angle_min=0.0, angle_max=3.0, angle_increment=0.01)
    assert dropped.decoded("scan", decode.scan, scan) is None
    assert dropped == {"scan: bad ranges": 1}
    example = dropped.examples["scan: bad ranges"]
    assert "361" in example
    assert "3 rad by 0.01 rad" in example
    assert str(dropped) == f"scan: bad ranges (1, the last one: {example})"
    assert dropped.decoded("scan", decode.scan, laser_scan(0, [1.0, 2.0])) is not None
    assert dropped.total() == 1


def test_text_of_strangers_fills_neither_memory_nor_log():
    dropped = Drops()
    for number in range(1000):
        dropped.record("odometry: of another frame", f"{number} " + "x" * 10_000)
        bad = odometry(0, (float("nan"), 0.0, 0.0))
        dropped.decoded("odometry", decode.odometry, bad)
    assert len(dropped) == 2
    assert len(str(dropped)) < 600


def test_nothing_is_no_entry():
    dropped = Drops()
    dropped.record("return: beyond grid.extent", count=0)
    assert dropped == {}
    assert not dropped


def test_reasons_are_a_closed_set_whatever_an_error_says():
    dropped = Drops()

    def refuse(text):
        raise InputError(text)

    for number in range(100):
        dropped.decoded("map", refuse, f"{number} GiB: are too much")
        dropped.decoded("map", refuse, f"transforms[{number}]: is no place")
        dropped.decoded("map", refuse, f"a sentence of frame {number}")
    assert dropped == {"map: bad content": 200, "map: bad transforms": 100}


names = st.text(max_size=200)
numbers = st.sampled_from([0.0, 1.0, -1.0, 1e9, float("nan"), float("inf"), 1e30])
stamps = st.integers(0, 2**31 - 1).map(lambda seconds: seconds * 10**9)


@draws(60)
@given(st.lists(st.tuples(names, names, numbers, numbers, stamps), min_size=5, max_size=30))
def test_strangers_do_not_choose_the_reasons(strangers):
    """Of messages of every kind with any names and numbers: few reasons, and short."""
    mapping, localizer, planning = Mapping(Params()), Localizer(), Planning(Params())
    for frame, child, x, w, stamp in strangers:
        pose = odometry(stamp, (x, 0.0, 0.0), (0.0, 0.0, 0.0, w), frame, child)
        transforms = tf_message((stamp, frame, child, (x, 0.0, 0.0), (0.0, 0.0, 0.0, w)))
        stamped = SimpleNamespace(header=pose.header, pose=pose.pose)
        for pipeline in (mapping, localizer):
            pipeline.take_scan("scan", laser_scan(stamp, [x, w], frame))
        for pipeline in (mapping, localizer, planning):
            pipeline.take_odometry(pose)
            pipeline.take_transforms(transforms, is_static=False)
        mapping.take_correction(stamped)
        localizer.take_initial_pose(stamped)
        plan = planning.take_goal(SimpleNamespace(header=pose.header, pose=pose.pose.pose))
        assert len(plan.reason) < 1000
    for pipeline in (mapping, localizer, planning):
        assert all(re.fullmatch(r"[a-z0-9_.:, -]{1,70}", reason) for reason in pipeline.dropped)
        assert len(pipeline.dropped) < 25
        assert all(len(text) <= 200 for text in pipeline.dropped.examples.values())
        assert len(pipeline.dropped.notices) < 3
