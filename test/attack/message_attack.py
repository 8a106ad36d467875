# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mutated messages between sound ones, to the pipelines of all nodes in one process."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from mutated_messages import default, learn_messages, mutated
from nav_msgs.msg import Path as PathMessage
from repository import BAGS
from tally import Tally, random_of

from heightmap25d_msgs.msg import HeightGrid, LocalizationStatus, PlanStatus
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import encode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.localization.tracker import Attempt
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.planning.plan import Plan

SCANS, CLOUDS = ("/scan", "/scan_down"), "/points"
PARAMS = with_values(
    Params(),
    {"intake.scan_topics": list(SCANS), "intake.cloud_topics": [CLOUDS], "grid.extent": 200.0},
)
SECONDS = 3.0
"""Of the drive whose messages are mutated."""

OTHERS = {
    "pose_correction": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "initialpose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "goal_pose": "geometry_msgs/msg/PoseStamped",
    "localization/status": "heightmap25d_msgs/msg/LocalizationStatus",
    "height_grid": "heightmap25d_msgs/msg/HeightGrid",
    "height_grid_updates": "heightmap25d_msgs/msg/HeightGrid",
    "upper_surfaces": "heightmap25d_msgs/msg/UpperSurfaces",
    CLOUDS: "sensor_msgs/msg/PointCloud2",
}
"""Topics that no recorded drive has, and their types."""

COPIES = 6.0
"""Mutated copies of each message of the drive, on average."""

OTHER_SHARES = {
    "pose_correction": 0.5, "localization/status": 0.5, "goal_pose": 0.1, "initialpose": 0.03,
    "height_grid": 0.03, "height_grid_updates": 0.03, "upper_surfaces": 0.03, CLOUDS: 0.2,
}  # fmt: skip
"""How often a mutated message of another topic follows one of the drive; some take long to use."""


@cache
def drive() -> list[tuple[str, int, Any]]:
    """Topic, stamp [ns] and message of the first seconds of a recorded drive."""
    with Bag(BAGS / "ramp") as bag:
        until = bag.start_ns + round(SECONDS * 1e9)
        events = bag.events([*SCANS, "/odom", "/tf", "/tf_static"], stop_ns=until)
        return [(event.topic, event.stamp_ns, event.message) for event in events]


@cache
def sound_map() -> Any:
    """The HeightGrid of the drive, as rosbags' message."""
    learn_messages()
    mapping = Mapping(PARAMS)
    for topic, _, message in drive():
        _feed_mapping(mapping, topic, message)
    mapping.flush()
    message = default("heightmap25d_msgs/msg/HeightGrid")
    encode.fill_height_grid(message, mapping.maps()[0], 0, "map")
    for name, kind in (("height", np.int16), ("probability", np.uint8)):
        setattr(message, name, np.asarray(getattr(message, name), kind))
    return message


def sound(topic: str, stamp_ns: int) -> Any:
    """A message of `OTHERS` that says that all is well."""
    if topic in ("height_grid", "height_grid_updates"):
        return sound_map()
    learn_messages()
    message = default(OTHERS[topic])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    message.header.frame_id = "map"
    if topic == CLOUDS:
        _fill_cloud(message)
    elif topic == "goal_pose":
        message.pose.orientation.w, message.pose.position.x = 1.0, 5.0
    elif hasattr(message, "pose"):
        message.pose.pose.orientation.w = 1.0
    return message


def _fill_cloud(message: Any) -> None:
    """A few points around the robot, in the frame of a laser, with rings and times."""
    layout = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("ring", "u2"), ("t", "u4")]
    points = np.zeros(64, layout)
    points["x"], points["y"] = np.indices((8, 8)).reshape(2, -1)
    points["ring"] = np.arange(64) % 8
    message.header.frame_id = "laser"
    message.height, message.width = 1, len(points)
    message.point_step, message.row_step = points.itemsize, points.nbytes
    kinds = {"f4": 7, "u2": 4, "u4": 6}
    field = type(default("sensor_msgs/msg/PointField"))
    message.fields = [
        field(name=name, offset=points.dtype.fields[name][1], datatype=kinds[kind], count=1)
        for name, kind in layout
    ]
    message.data = points.view(np.uint8)


def attack_messages(seed: int, messages: int) -> Tally:
    """Drive after drive, with mutated messages in it; what comes out is made messages.

    After each drive a sound one must be mapped as ever.
    """
    tally = Tally("mutated messages to the pipelines of all nodes")
    drives = 0
    while tally.outcomes["fed"] < messages:
        tally.outcomes["fed"] += _attack_drive(tally, random_of(seed, drives), drives)
        drives += 1
    tally.outcomes["sound drives mapped afterwards"] = drives - len(tally.failures)
    del tally.outcomes["used"]
    return tally


def _attack_drive(tally: Tally, random: np.random.Generator, number: int) -> int:
    """How many messages were fed that were mutated."""
    stack = Stack()
    fed = 0
    with tally.case(number):
        for topic, message, is_mutated in _messages(random):
            fed += is_mutated
            stack.feed(topic, message)
        stack.check_maps()
        stack.require_mapping()
    return fed


def _messages(random: np.random.Generator) -> Iterator[tuple[str, Any, bool]]:
    """The drive, between whose messages mutated copies come, and mutated ones of other topics."""
    for topic, stamp, message in drive():
        for _ in range(random.poisson(COPIES)):
            yield topic, mutated(random, message), True
        if random.random() < 0.9:
            yield topic, message, False
        for other, share in OTHER_SHARES.items():
            if random.random() < share:
                yield other, mutated(random, sound(other, stamp)), True


class Stack:
    """The pipelines of all nodes, joined as the topics join the nodes."""

    def __init__(self) -> None:
        self.mapping = Mapping(PARAMS)
        self.localizer = Localizer(PARAMS)
        self.planning = Planning(PARAMS)
        for topic in ("height_grid", "goal_pose"):
            self.feed(topic, sound(topic, 0))

    def feed(self, topic: str, message: Any) -> None:
        """Give a message to who subscribes to its topic, and make messages of what comes of it."""
        _feed_mapping(self.mapping, topic, message)
        for attempt in _feed_localizer(self.localizer, topic, message):
            encode.fill_localization_status(LocalizationStatus(), attempt)
        plan = _feed_planning(self.planning, topic, message)
        if plan is not None:
            encode.fill_path(PathMessage(), PoseStamped, plan.poses, 0, "map")
            encode.fill_plan_status(PlanStatus(), plan)
        pose = self.localizer.pose
        if pose is not None:
            for T in (pose.T_map_odom, pose.T_map_base):
                message = PoseWithCovarianceStamped()
                encode.fill_pose(message, T, pose.covariance, pose.vertical, pose.stamp_ns, "map")

    def check_maps(self) -> None:
        """The map can be published, or is refused with a reason."""
        try:
            height_map, _ = self.mapping.maps()
        except InputError:
            return
        encode.fill_height_grid(HeightGrid(), height_map, self.mapping.stamp_ns, "map")

    def require_mapping(self) -> None:
        """A sound drive, later, is mapped once the map is cleared: nothing holds it up."""
        later = 10**9 * (drive()[-1][1] // 10**9 - drive()[0][1] // 10**9 + 10)
        self.feed("localization/status", sound("localization/status", drive()[-1][1] + later))
        self.mapping.clear()
        before = self.mapping.merged["scans"]
        for topic, _, message in drive():
            self.feed(topic, _later(message, later))
        self.mapping.settle()
        merged = self.mapping.merged["scans"] - before
        scans = sum(topic in SCANS for topic, _, _ in drive())
        if merged < 0.5 * scans:
            raise AssertionError(f"{merged} of {scans} scans were mapped; {self.mapping.dropped}")


def _later(message: Any, later_ns: int) -> Any:
    """A copy of a message with later stamps."""
    message = copy.deepcopy(message)
    for stamped in getattr(message, "transforms", [message]):
        stamped.header.stamp.sec += later_ns // 10**9
    return message


def _feed_mapping(mapping: Mapping, topic: str, message: Any) -> None:
    if topic == "pose_correction":
        mapping.take_correction(message)
    elif topic == "localization/status":
        mapping.take_localization_status(message)
    elif topic == "/odom":
        mapping.take_odometry(message)
    elif topic in SCANS:
        mapping.take_scan(topic, message)
    elif topic == CLOUDS:
        mapping.take_cloud(topic, message)
    elif topic in ("/tf", "/tf_static"):
        mapping.take_transforms(message, is_static=topic == "/tf_static")


def _feed_localizer(localizer: Localizer, topic: str, message: Any) -> list[Attempt]:
    if topic == "initialpose":
        localizer.take_initial_pose(message)
    elif topic == "height_grid":
        localizer.take_long_term(message)
    elif topic == "/odom":
        return localizer.take_odometry(message)
    elif topic in SCANS:
        return localizer.take_scan(topic, message)
    elif topic == CLOUDS:
        return localizer.take_cloud(topic, message)
    elif topic in ("/tf", "/tf_static"):
        return localizer.take_transforms(message, is_static=topic == "/tf_static")
    return []


def _feed_planning(planning: Planning, topic: str, message: Any) -> Plan | None:
    takes = {
        "goal_pose": planning.take_goal,
        "height_grid": planning.take_map,
        "height_grid_updates": planning.take_map_update,
        "upper_surfaces": planning.take_upper_surfaces,
        "/odom": planning.take_odometry,
        "pose_correction": planning.take_correction,
    }
    if topic in takes:
        return takes[topic](message)
    if topic in ("/tf", "/tf_static"):
        return planning.take_transforms(message, is_static=topic == "/tf_static")
    return None
