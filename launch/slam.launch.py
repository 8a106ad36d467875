# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros slam.launch.py params_file:=my_robot.yaml [map:=maps/hall]

`localization` holds the scans against what has been mapped so far and publishes map -> odom;
`mapping` follows its correction. With a saved map both go on from it, wherever the robot is on it.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from heightmap25d_ros.commands import bringup


def node(name, parameters):
    """One of the nodes; when it ends by itself, so does the other one."""
    return Node(
        package=bringup.PACKAGE,
        executable=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params_file"), parameters],
        remappings=bringup.REMAPPINGS,
        output="screen",
        on_exit=Shutdown(reason=f"{name} has ended"),
    )


def nodes(context):
    """The nodes, and what they know of a saved map."""
    time = {"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}
    localization, mapping = {"localization.own_map": True}, {"mapping.needs_localization": True}
    saved = LaunchConfiguration("map").perform(context)
    if saved:
        path = Path(saved).resolve()
        localization["localization.map_directory"] = str(path)
        mapping |= {"mapping.map_directory": str(path.parent), "mapping.initial_map": path.name}
    return [node("localization", time | localization), node("mapping", time | mapping)]


def generate_launch_description():
    """Arguments and nodes."""
    return LaunchDescription([
        DeclareLaunchArgument(
            "params_file", default_value=str(bringup.default_params_file()),
            description="parameters of the nodes",
        ),
        DeclareLaunchArgument("namespace", default_value="", description="of the nodes"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="/clock counts"),
        DeclareLaunchArgument(
            "map", default_value="", description="directory of a saved map to go on from"
        ),
        OpaqueFunction(function=nodes),
    ])  # fmt: skip
