# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that have the robot's poses from /tf alone, or as PoseStamped, over DDS.

The robot stands at x = 10 m, and one beam returns after 2 m, at -0.5 rad, 0.5 m above the ground.
All poses lie exactly in the plane, as those of planar odometry.
"""

import math
import re
from contextlib import ExitStack

import numpy as np
import pytest
from bag_writer import header, laser_scan, rclpy_type, tf_message
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from node_client import MAPS, Client, node_process

START = 1_700_000_000 * 10**9
PERIOD = 50_000_000  # [ns]
MOUNT = ("-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]")
NODES = ("mapping", "localization", "planning")


def pose_at(stamp):
    """The robot's pose as each source has it: the topic, and the message."""
    place = (10.0, 0.0, 0.0)
    pose = PoseStamped(header=header(stamp, "odom", rclpy_type))
    pose.pose.position.x, pose.pose.orientation.w = place[0], 1.0
    transform = (stamp, "odom", "base_link", place, (0.0, 0.0, 0.0, 1.0))
    return {"pose": ("odom", pose), "tf": ("tf", tf_message(transform, type_of=rclpy_type))}


@pytest.fixture(scope="module", params=["tf", "pose"])
def driven(request):
    """What the nodes published, and what they logged, of poses of one source."""
    source = request.param
    namespace = f"/by_{source}"
    client = Client(namespace)
    client.subscribe("height_grid", MAPS["height_grid"])
    client.node.create_subscription(
        PoseWithCovarianceStamped, "pose", lambda m: client.newest.update(pose=m), 100
    )
    reports = {}
    client.node.create_subscription(
        DiagnosticArray, "/diagnostics",
        lambda m: reports.update({status.name: status.message for status in m.status}), 100,
    )  # fmt: skip
    arguments = (*MOUNT, "-p", f"intake.pose_source:={source}", "-r", "/tf:=tf")

    def is_told():
        names = [f"{namespace}/{name}" for name in NODES]
        return all("the odometry is flat" in reports.get(name, "") for name in names)

    with ExitStack() as stack:
        processes = [
            stack.enter_context(node_process(name, *arguments, namespace=namespace))
            for name in NODES
        ]
        stamp = START
        while not (is_told() and {"height_grid", "pose"} <= client.newest.keys()):
            assert stamp < START + 1000 * PERIOD, (reports, client.newest.keys())
            stamp += PERIOD
            client.publish(*pose_at(stamp)[source])
            scan = laser_scan(stamp - PERIOD // 2, [2.0], type_of=rclpy_type)
            client.publish("scan", scan)
            client.spin(0.05)
    client.close()
    return client.newest, reports, [process.log for process in processes]


def test_the_map_is_where_the_poses_are(driven):
    grid = driven[0]["height_grid"]
    known = np.flatnonzero(np.array(grid.probability) >= 128)
    (index,) = [i for i in known if grid.height[i] == 50]
    iy, ix = divmod(int(index), grid.info.width)
    origin = grid.info.origin.position
    place = origin.x + (ix + 0.5) * 0.125, origin.y + (iy + 0.5) * 0.125
    beam = 10.0 + 2.0 * math.cos(-0.5), 2.0 * math.sin(-0.5)
    assert place == pytest.approx(beam, abs=0.0626)


def test_localization_publishes_the_pose(driven):
    pose = driven[0]["pose"]
    assert pose.header.frame_id == "map"
    assert pose.pose.pose.position.x == pytest.approx(10.0, abs=1e-6)


def test_each_node_says_that_the_poses_are_flat(driven):
    for log in driven[2]:
        (line,) = re.findall("self-check: .*the odometry is flat: .*", log)
        assert re.search(r"z, roll and pitch were exactly 0 in all of \d+ messages", line)
