# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ros2 launch heightmap25d_ros nav2.launch.py map:=maps/yard: Nav2 over our map and planner."""

from ament_index_python import get_package_share_path
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetParameter, SetRemap

from heightmap25d_ros.commands import bringup

SHARE = get_package_share_path("heightmap25d_ros")
SERVERS = {
    "controller_server": ("nav2_controller", [("cmd_vel", "cmd_vel_nav")]),
    "behavior_server": ("nav2_behaviors", [("cmd_vel", "cmd_vel_nav")]),
    "velocity_smoother": (
        "nav2_velocity_smoother", [("cmd_vel", "cmd_vel_nav"), ("cmd_vel_smoothed", "cmd_vel")],
    ),
    "bt_navigator": ("nav2_bt_navigator", []),
    "lifecycle_manager": ("nav2_lifecycle_manager", []),
}  # fmt: skip


def servers(context):
    """Nav2's nodes; the lifecycle manager starts them after ours."""
    ours = bringup.default_nodes(LaunchConfiguration("map").perform(context))
    managed = {"node_names": [*ours, *list(SERVERS)[:-1]]}
    file = LaunchConfiguration("params_file").perform(context)
    return [
        Node(
            package=package,
            executable=name,
            parameters=[file, managed if name == "lifecycle_manager" else {}],
            remappings=remappings,
            output="screen",
        )
        for name, (package, remappings) in SERVERS.items()
    ]


def generate_launch_description():
    """Our nodes, which leave goal_pose to bt_navigator, and Nav2's."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=bringup.ARGUMENTS[name])
        for name, value in (("params_file", str(SHARE / "config" / "nav2.yaml")), ("map", ""))
    ]
    clock = DeclareLaunchArgument("use_sim_time", default_value="false")
    ours = IncludeLaunchDescription(
        str(SHARE / "launch" / "bringup.launch.py"), launch_arguments={"autostart": "false"}.items()
    )
    remapped = GroupAction([SetRemap("goal_pose", "planning/goal_pose"), ours], forwarding=True)
    time = SetParameter("use_sim_time", LaunchConfiguration("use_sim_time"))
    return LaunchDescription([*declared, clock, time, remapped, OpaqueFunction(function=servers)])
