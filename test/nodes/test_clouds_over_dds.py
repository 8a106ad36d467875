# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapping node with a lidar of 128 rings, over DDS: megabytes a message."""

import numpy as np
from bag_writer import odometry, point_cloud, rclpy_type
from node_client import Client, mapping_node
from rclpy.qos import qos_profile_sensor_data

MS = 10**6
BEGIN = 1_700_000_000 * 10**9
POINT = np.dtype(
    {
        "names": ["x", "y", "z", "t", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<u4", "<u2"],
        "itemsize": 32,
    }
)
COUNT = 3


def floor_around():
    """A floor 0.8 m below a lidar of 128 rings; (128, 1024) points."""
    azimuth = np.arange(1024) * (2 * np.pi / 1024)
    reach = 0.8 / np.tan(np.radians(np.linspace(50.0, 5.0, 128)))
    points = np.zeros((128, 1024), POINT)
    points["x"], points["y"] = reach[:, None] * np.cos(azimuth), reach[:, None] * np.sin(azimuth)
    points["z"] = -0.8
    points["t"] = np.arange(1024) * 97_000
    points["ring"] = np.arange(128)[:, None]
    return points


def test_clouds_reach_the_map_and_bad_ones_the_log(tmp_path):
    client = Client("/lidar")
    client.subscribe("height_grid", rclpy_type("heightmap25d_msgs/msg/HeightGrid"))
    arguments = (
        "-p", "intake.cloud_topics:=[points]",
        "-p", "sensor.points.mount:=[0.0, 0.0, 0.8, 0.0, 0.0, 0.0]",
        "-p", "sensor.points.max_range:=6.0",
        "-p", "sensor.scam.max_range:=6.0",
    )  # fmt: skip
    with mapping_node(tmp_path, *arguments, namespace="/lidar") as process:
        for index in range(COUNT):
            points = point_cloud(BEGIN + index * 100 * MS, floor_around(), type_of=rclpy_type)
            client.publish("points", points)
        bad = point_cloud(BEGIN, floor_around()[["y", "z"]], type_of=rclpy_type)
        client.publish("points", bad, qos_profile_sensor_data)
        for milliseconds in range(0, 100 * (COUNT + 1), 20):
            pose = odometry(BEGIN + milliseconds * MS, (0, 0, 0), type_of=rclpy_type)
            client.publish("odom", pose)
        client.wait(lambda: "height_grid" in client.newest)
        client.wait(lambda: client.newest["height_grid"].header.stamp.nanosec == 200 * MS)
        client.spin(6.0)  # within which the node reports
    client.close()
    grid = client.newest["height_grid"]
    known = np.array(grid.probability) > 0
    assert 0.8 < known.sum() * 0.125**2 / (np.pi * 6.0**2) < 1.05
    assert "parameter sensor.scam.max_range: no topic is scam, only points" in process.log
    assert set(np.array(grid.height)[known].tolist()) == {0}
    assert "points: neighbours in rings (ring); time of each point: t, nanoseconds" in process.log
    assert "cloud: bad fields (1, the last one: fields: no x, only y, z)" in process.log
