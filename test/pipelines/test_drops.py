# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
from bag_writer import laser_scan, odometry

from heightmap25d_ros.io import decode
from heightmap25d_ros.pipelines.drops import Drops


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
