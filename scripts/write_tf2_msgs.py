# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write an ament_cmake package tf2_msgs with TFMessage, for a machine whose ROS has none.

Usage: python write_tf2_msgs.py DIRECTORY
"""

import sys
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

PACKAGE_XML = """\
<?xml version="1.0"?>
<package format="3">
  <name>tf2_msgs</name>
  <version>0.36.0</version>
  <description>TFMessage, the type of /tf and /tf_static.</description>
  <maintainer email="heightmap25d@example.org">heightmap25d_ros authors</maintainer>
  <license>BSD</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <build_depend>rosidl_default_generators</build_depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""

CMAKE_LISTS = """\
cmake_minimum_required(VERSION 3.16)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


def main() -> None:
    """Write the three files of the package below the directory of the command line."""
    typestore = get_typestore(Stores.ROS2_JAZZY)
    definition, _ = typestore.generate_msgdef("tf2_msgs/msg/TFMessage", ros_version=2)
    # The full text goes on with the definitions of the types used, each after a ruler.
    fields = definition.partition("\n" + "=" * 80)[0]

    root = Path(sys.argv[1])
    (root / "msg").mkdir(parents=True, exist_ok=True)
    (root / "package.xml").write_text(PACKAGE_XML)
    (root / "CMakeLists.txt").write_text(CMAKE_LISTS)
    (root / "msg" / "TFMessage.msg").write_text(fields.strip() + "\n")


main()
