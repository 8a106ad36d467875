# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros simulation.launch.py world:=ramp: the loop is closed."""

from ament_index_python import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetRemap

from heightmap25d_ros.commands import bringup

PACKAGE = "heightmap25d_ros"


def generate_launch_description():
    """The bringup, with its arguments, around a simulated robot that is driven along the plan."""
    nodes = get_package_share_path(PACKAGE) / "launch" / "bringup.launch.py"
    return LaunchDescription(
        [
            DeclareLaunchArgument("world", default_value="room", description="where the robot is"),
            DeclareLaunchArgument("rate", default_value="1.0", description="times real time"),
            SetRemap("/clock", "clock"),  # in a namespace, each robot has a time of its own
            IncludeLaunchDescription(str(nodes), launch_arguments={"use_sim_time": "true"}.items()),
            Node(
                package=PACKAGE,
                executable="simulator",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    {
                        "simulator.world": LaunchConfiguration("world"),
                        "simulator.rate": LaunchConfiguration("rate"),
                    }
                ],
                remappings=bringup.REMAPPINGS,
                output="screen",
                on_exit=Shutdown(reason="the simulator has ended"),
            ),
            Node(
                package=PACKAGE,
                executable="path_follower",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file"), {"use_sim_time": True}],
                remappings=bringup.REMAPPINGS,
                output="screen",
            ),
        ]
    )
