# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros exploration.launch.py world:=ramp: a robot maps what it finds.

With use_sim:=false for a robot of one's own: no simulator then, and time from the machine.
"""

from ament_index_python import get_package_share_path
from launch import LaunchDescription, actions
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetRemap

from heightmap25d_ros.commands import bringup


def parameters_of(context):
    """Of each node of this file, by the launch arguments."""
    values = {n: LaunchConfiguration(n).perform(context) for n in bringup.EXPLORATION_ARGUMENTS}
    return bringup.exploration_parameters(values)


def check(context):
    """Refuse wrong arguments before a node is started that would be left running."""
    parameters_of(context)


def own_nodes(context):
    """Exploration, and what drives and simulates the robot."""
    return [
        Node(
            package=bringup.PACKAGE,
            executable=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), parameters],
            remappings=bringup.REMAPPINGS,
            output="screen",
            on_exit=actions.Shutdown(reason=f"{name} has ended"),
        )
        for name, parameters in parameters_of(context).items()
    ]


def generate_launch_description():
    """The bringup of mapping and planning, with its arguments, and the nodes of this file."""
    nodes = get_package_share_path(bringup.PACKAGE) / "launch" / "bringup.launch.py"
    declared = [
        actions.DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in bringup.EXPLORATION_ARGUMENTS.items()
    ]
    return LaunchDescription(
        [
            *declared,
            actions.OpaqueFunction(function=check),
            SetRemap("/clock", "clock"),  # in a namespace, each robot has a time of its own
            actions.SetLaunchConfiguration("use_sim_time", LaunchConfiguration("use_sim")),
            actions.IncludeLaunchDescription(str(nodes)),
            actions.OpaqueFunction(function=own_nodes),
        ]
    )
