# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros bringup.launch.py params_file:=my_robot.yaml: the nodes."""

from pathlib import Path

from ament_index_python import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PACKAGE = "heightmap25d_ros"
PARAMS = get_package_share_path(PACKAGE) / "config" / "atrvjr.yaml"
ARGUMENTS = [
    ("params_file", str(PARAMS), "ROS parameter file of all nodes"),
    ("map", "", "map directory to begin with (and to localize in); empty: none"),
    ("namespace", "", "of nodes and topics, /tf and /tf_static as well"),
    ("use_sim_time", "false", "true: time comes from /clock"),
    ("autostart", "true", "false: a lifecycle manager configures and activates"),
    ("nodes", "", "which nodes; empty: mapping planning, and localization where there is a map"),
]


def start(context):
    """The nodes that are asked for."""
    argument = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    values = {name: argument[name] == "true" for name in ("use_sim_time", "autostart")}
    names, maps = ["mapping", "planning"], {}
    if argument["map"]:
        names.append("localization")
        path = Path(argument["map"]).resolve()
        maps["mapping"] = {
            "mapping.map_directory": str(path.parent),
            "mapping.initial_map": path.name,
        }
        maps["localization"] = {"localization.map_directory": str(path)}
    return [
        Node(
            package=PACKAGE,
            executable=name,
            namespace=argument["namespace"],
            parameters=[argument["params_file"], values | maps.get(name, {})],
            remappings=[("/tf", "tf"), ("/tf_static", "tf_static")],
            output="screen",
        )
        for name in argument["nodes"].split() or names
    ]


def generate_launch_description():
    """Arguments and nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in ARGUMENTS
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])
