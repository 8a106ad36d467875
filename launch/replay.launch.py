# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros replay.launch.py bag:=bags/ramp_1: a bag through the nodes."""

from ament_index_python import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetRemap

from heightmap25d_ros.commands import bringup

PACKAGE = "heightmap25d_ros"


def after_replay(event, context):
    """A bag that cannot be played ends the nodes; after its end they go on, with their map."""
    return Shutdown(reason="the bag cannot be played") if event.returncode else None


def generate_launch_description():
    """The bringup, with its arguments, in the time of the bag."""
    nodes = get_package_share_path(PACKAGE) / "launch" / "bringup.launch.py"
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="rosbag2 directory, or one of its files"),
            DeclareLaunchArgument("rate", default_value="1.0", description="times real time"),
            SetRemap("/clock", "clock"),  # in a namespace, each robot has a time of its own
            IncludeLaunchDescription(str(nodes), launch_arguments={"use_sim_time": "true"}.items()),
            Node(
                package=PACKAGE,
                executable="replay",
                namespace=LaunchConfiguration("namespace"),
                remappings=bringup.REMAPPINGS,
                arguments=[
                    LaunchConfiguration("bag"),
                    "--rate",
                    LaunchConfiguration("rate"),
                    "--wait",
                    "60",
                ],
                output="screen",
                on_exit=after_replay,
            ),
        ]
    )
