# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes the messages of a bag when they are due, with the QoS they were recorded with."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterable
from typing import Any, NoReturn

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosReliability
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from heightmap25d_ros.io.bag import Bag

CLOCK_PERIOD_NS = 25_000_000
"""At most this much bag time [ns] lies between two messages on /clock."""

SETTLED = 2.0
"""Subscribers are all there when for so long [s] no other one came."""

ACKNOWLEDGED = 5.0
"""How long at the end to wait [s] until reliable subscribers have everything."""

_DEPTH, _LATCHED_DEPTH = 10, 100


def profile_of(topic: str, recorded: Iterable[Qos]) -> QoSProfile:
    """Quality of service to publish with: as recorded, of several publishers the stronger one.

    Recordings tell depths only sometimes. What was not recorded is reliable, so that every
    subscriber matches. /tf_static is reliable and transient local whatever was recorded: nobody
    subscribes to it otherwise.
    """
    offers = list(recorded)
    is_static = is_static_transforms(topic)
    is_latched = is_static or any(
        offer.durability is QosDurability.TRANSIENT_LOCAL for offer in offers
    )
    is_best_effort = (
        not is_static
        and bool(offers)
        and all(offer.reliability is QosReliability.BEST_EFFORT for offer in offers)
    )
    # One publisher stands for several latched ones, and late subscribers need them all.
    depth = sum(offer.depth for offer in offers if offer.history is QosHistory.KEEP_LAST)
    keeps_all = any(offer.history is QosHistory.KEEP_ALL for offer in offers)
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL if keeps_all else HistoryPolicy.KEEP_LAST,
        depth=depth or (_LATCHED_DEPTH if is_latched else _DEPTH),
        reliability=(
            ReliabilityPolicy.BEST_EFFORT if is_best_effort else ReliabilityPolicy.RELIABLE
        ),
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE),
    )


def is_static_transforms(topic: str) -> bool:
    """Whether a topic is /tf_static, of a namespace or of none."""
    return topic.rpartition("/")[2] == "tf_static"


class Player:
    """Publishes the messages of a bag when they are due.

    Parameters
    ----------
    node : Node
    bag : Bag
    topics : iterable of str
        Those to publish; one whose type is not installed is skipped and named in ``skipped``.
    """

    def __init__(self, node: Node, bag: Bag, topics: Iterable[str]) -> None:
        self.publishers: dict[str, Publisher] = {}
        self.skipped: list[str] = []
        self.count = 0
        self.late = 0.0
        self._bag = bag
        self._clock = node.create_publisher(Clock, "/clock", _DEPTH)
        for name in topics:
            topic = bag.topics[name]
            kind = message_class(topic.message_type)
            if kind is None:
                self.skipped.append(f"{name} ({', '.join(topic.counts)})")
                continue
            profile = profile_of(name, topic.profiles)
            if is_static_transforms(name):
                # Who subscribes late needs those of all publishers.
                profile.depth = max(profile.depth, topic.count)
            # In a namespace the bag's topics are the namespace's.
            place = name if node.get_namespace() == "/" else name.lstrip("/")
            self.publishers[name] = node.create_publisher(kind, place, profile)

    def wait_for_subscribers(self, seconds: float, *, to_all: bool) -> list[str]:
        """Wait until no more come, at most so long; the topics that nobody listens to.

        At least one must have come: to each of the topics, or to any.
        """
        counts: list[int] = []
        are_enough = all if to_all else any
        now = changed = time.monotonic()
        deadline = now + seconds
        while now < deadline and not (counts and are_enough(counts) and now - changed > SETTLED):
            latest = [p.get_subscription_count() for p in self.publishers.values()]
            if latest != counts:
                counts, changed = latest, now
            time.sleep(0.02)
            now = time.monotonic()
        return [name for name, p in self.publishers.items() if not p.get_subscription_count()]

    def play(self, start_ns: int, stop_ns: int, rate: float) -> None:
        """Publish a stretch of the bag [ns], and what was latched before it, at a rate."""
        timed = self._publish_latched(start_ns)
        began = time.monotonic()
        with _progress((stop_ns - start_ns) * 1e-9) as progress:

            def advance(stamp_ns: int) -> float:
                """Let the time of a stamp come; when that was due."""
                passed = (stamp_ns - start_ns) * 1e-9
                due = began + passed / rate
                time.sleep(max(0.0, due - time.monotonic()))
                self._publish_clock(stamp_ns)
                progress.update(passed - progress.n)
                return due

            clock_ns, due = start_ns, advance(start_ns)
            for event in self._bag.raw_events(timed, start_ns, stop_ns):
                while clock_ns < event.stamp_ns:
                    clock_ns = min(clock_ns + CLOCK_PERIOD_NS, event.stamp_ns)
                    due = advance(clock_ns)
                self._publish(event.topic, event.data)
                self.late = max(self.late, time.monotonic() - due)

    def wait_until_acknowledged(self) -> bool:
        """Wait until reliable subscribers have all messages; whether they do."""
        deadline = time.monotonic() + ACKNOWLEDGED
        waiting = list(self.publishers.values())
        while waiting and time.monotonic() < deadline:
            # In short steps: a signal is only seen between them.
            if waiting[-1].wait_for_all_acked(Duration(seconds=0.1)):
                waiting.pop()
        return not waiting

    def _publish_latched(self, start_ns: int) -> list[str]:
        """Publish what holds at the start of a stretch [ns]; the topics to publish in time.

        Static transforms of the whole bag hold from the start. Where a mount changes, its first
        one does, and the others follow when they were recorded.
        """
        static = [name for name in self.publishers if is_static_transforms(name)]
        transforms = list(self._bag.raw_events(static))
        is_changing = self._is_changing(static)
        for event in reversed(transforms) if is_changing else transforms:
            self._publish(event.topic, event.data)
        latched = [
            name
            for name, publisher in self.publishers.items()
            if publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
            and name not in static
        ]
        for event in self._bag.raw_events(latched, stop_ns=start_ns):
            self._publish(event.topic, event.data)
        return [name for name in self.publishers if is_changing or name not in static]

    def _is_changing(self, static: list[str]) -> bool:
        """Whether a frame of the static transforms comes with another pose or parent."""
        known: dict[tuple[str, str], tuple[str, Any]] = {}
        for event in self._bag.events(static):
            for stamped in event.message.transforms:
                pose = stamped.header.frame_id, stamped.transform
                if known.setdefault((event.topic, stamped.child_frame_id), pose) != pose:
                    return True
        return False

    def _publish_clock(self, stamp_ns: int) -> None:
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(stamp_ns, 10**9)
        self._clock.publish(clock)

    def _publish(self, topic: str, data: bytes) -> None:
        self.publishers[topic].publish(data)
        self.count += 1


def message_class(message_type: str) -> Any:
    """Class of a type like ``sensor_msgs/msg/LaserScan``, or None."""
    package, _, name = message_type.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ModuleNotFoundError:
        return None


def _progress(seconds: float) -> tqdm[NoReturn]:
    shape = "{desc} {percentage:3.0f}%|{bar}| {n:.1f} of {total:.1f} s"
    return tqdm(total=seconds, desc="replay", bar_format=shape, disable=None)
