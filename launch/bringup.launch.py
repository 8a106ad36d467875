# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros bringup.launch.py params_file:=my_robot.yaml: the nodes."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from heightmap25d_ros.commands import bringup

DEFAULTS = {"params_file": str(bringup.default_params_file()), "use_sim_time": "false"}
AUTOSTART = "false: a lifecycle manager configures and activates the nodes"


def start(context):
    """The nodes that are asked for; when one ends by itself, so do the others."""
    names = [*bringup.ARGUMENTS, "autostart"]
    argument = {name: LaunchConfiguration(name).perform(context) for name in names}
    params_file = bringup.existing_file("params_file", argument["params_file"])
    switches = {
        name: bringup.is_true(name, argument[name]) for name in ("use_sim_time", "autostart")
    }
    return [
        Node(
            package=bringup.PACKAGE,
            executable=name,
            namespace=argument["namespace"],
            parameters=[
                params_file,
                switches | bringup.map_parameters(name, argument["map"]),
            ],
            remappings=bringup.REMAPPINGS,
            output="screen",
            on_exit=Shutdown(reason=f"{name} has ended"),
        )
        for name in argument["nodes"].split() or bringup.default_nodes(argument["map"])
    ]


def generate_launch_description():
    """Arguments and nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=DEFAULTS.get(name, ""), description=meaning)
        for name, meaning in bringup.ARGUMENTS.items()
    ]
    autostart = DeclareLaunchArgument("autostart", default_value="true", description=AUTOSTART)
    return LaunchDescription([*declared, autostart, OpaqueFunction(function=start)])
