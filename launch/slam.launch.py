# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros slam.launch.py params_file:=my_robot.yaml [map:=maps/hall]

`localization` holds the scans against what has been mapped so far and publishes map -> odom;
`mapping` follows its correction. With a saved map both go on from it, wherever the robot is on it.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from heightmap25d_ros.commands import bringup

ARGUMENTS = {
    "params_file": str(bringup.default_params_file()),
    "map": "",
    "namespace": "",
    "use_sim_time": "false",
}


def nodes(context):
    """The nodes, and what they know of a saved map; when one ends by itself, so does the other."""
    argument = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    params_file = bringup.existing_file("params_file", argument["params_file"])
    is_simulated = bringup.is_true("use_sim_time", argument["use_sim_time"])
    own = {
        "localization": {"localization.own_map": True},
        "mapping": {"mapping.needs_localization": True},
    }
    return [
        Node(
            package=bringup.PACKAGE,
            executable=name,
            namespace=argument["namespace"],
            parameters=[
                params_file,
                own[name]
                | {"use_sim_time": is_simulated}
                | bringup.map_parameters(name, argument["map"]),
            ],
            remappings=bringup.REMAPPINGS,
            output="screen",
            on_exit=Shutdown(reason=f"{name} has ended"),
        )
        for name in own
    ]


def generate_launch_description():
    """Arguments and nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=bringup.ARGUMENTS[name])
        for name, default in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
