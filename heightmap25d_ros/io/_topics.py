# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a bag says of its topics; a topic may have messages of several types."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos

LASER_SCAN = "sensor_msgs/msg/LaserScan"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
LIVOX_CLOUD = "livox_ros_driver2/msg/CustomMsg"
COMPRESSED_CLOUD = "point_cloud_interfaces/msg/CompressedPointCloud2"
CLOUD_TYPES = (POINT_CLOUD, LIVOX_CLOUD, COMPRESSED_CLOUD)
ODOMETRY = "nav_msgs/msg/Odometry"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"

_READ = (LASER_SCAN, *CLOUD_TYPES, ODOMETRY, TF_MESSAGE)


@dataclass(frozen=True, slots=True)
class Topic:
    """What a bag says of one of its topics.

    Attributes
    ----------
    message_type : str
        That its messages are read as: LaserScan, PointCloud2, Odometry or TFMessage where it has
        such messages, else that of the most messages.
    count : int
        Messages of this type.
    profiles : tuple of Qos
        Of its publishers; none where the bag says nothing of them.
    other_types : dict of message type to int
        Messages of other types on the same topic.
    """

    message_type: str
    count: int
    profiles: tuple[Qos, ...]
    other_types: Mapping[str, int] = field(default_factory=dict)

    @property
    def counts(self) -> dict[str, int]:
        """How many messages it has of each type."""
        return {self.message_type: self.count, **self.other_types}


def type_of(connection: Connection) -> str:
    """The type of a connection's messages; no type of ROS where they are not CDR."""
    extension = connection.ext
    if isinstance(extension, ConnectionExtRosbag2) and extension.serialization_format != "cdr":
        return f"{connection.msgtype} as {extension.serialization_format or 'unknown bytes'}"
    return connection.msgtype


def topic_of(connections: list[Connection]) -> Topic:
    """The topic of some connections, which is the same for all."""
    counts: Counter[str] = Counter()
    profiles: dict[int, list[Qos]] = {}
    for connection in connections:
        counts[type_of(connection)] += connection.msgcount
    read_as = max(counts, key=lambda name: (name in _READ and counts[name] > 0, counts[name]))
    for connection in connections:
        if isinstance(connection.ext, ConnectionExtRosbag2) and type_of(connection) == read_as:
            offered = connection.ext.offered_qos_profiles
            profiles.setdefault(id(connection.owner), []).extend(offered)
    # Each file of a split bag repeats them.
    of_a_file = max(profiles.values(), key=len, default=[])
    count = counts.pop(read_as)
    return Topic(read_as, count, tuple(of_a_file), dict(counts))
