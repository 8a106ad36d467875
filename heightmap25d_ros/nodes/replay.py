# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replay: the messages of a bag on their topics as they were recorded, and /clock.

The serialized bytes go out as they are in the bag; nothing is decoded.
"""

from __future__ import annotations

import argparse
import importlib
import math
import signal
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_topic_name import validate_topic_name
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosReliability
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.nodes import runtime

CLOCK_PERIOD_NS = 25_000_000
"""At most this much bag time [ns] lies between two messages on /clock."""

SETTLED = 1.0
"""Subscribers are all there when for so long [s] no other one came."""

ACKNOWLEDGED = 5.0
"""How long at the end to wait [s] until reliable subscribers have everything."""

_DEPTH, _LATCHED_DEPTH = 10, 100


def profile_of(topic: str, recorded: Iterable[Qos]) -> QoSProfile:
    """Quality of service to publish with: as recorded, of several publishers the stronger one.

    Recordings tell depths only sometimes. What was not recorded is reliable, so that every
    subscriber matches, and transient local for /tf_static.
    """
    offers = list(recorded)
    is_latched = any(offer.durability is QosDurability.TRANSIENT_LOCAL for offer in offers)
    is_latched |= not offers and topic == "/tf_static"
    is_best_effort = bool(offers) and all(
        offer.reliability is QosReliability.BEST_EFFORT for offer in offers
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
                self.skipped.append(f"{name} ({topic.message_type})")
                continue
            profile = profile_of(name, topic.profiles)
            self.publishers[name] = node.create_publisher(kind, name, profile)

    def wait_for_subscribers(self, seconds: float) -> list[str]:
        """Wait until no more come, at most so long; the topics that nobody listens to."""
        counts: list[int] = []
        now = changed = time.monotonic()
        deadline = now + seconds
        while now < deadline and not (any(counts) and now - changed > SETTLED):
            latest = [p.get_subscription_count() for p in self.publishers.values()]
            if latest != counts:
                counts, changed = latest, now
            time.sleep(0.02)
            now = time.monotonic()
        return [name for name, p in self.publishers.items() if not p.get_subscription_count()]

    def play(self, start_ns: int, stop_ns: int, rate: float) -> None:
        """Publish a stretch of the bag [ns], and what was latched before it, at a rate."""
        latched = [
            name
            for name, publisher in self.publishers.items()
            if publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
        ]
        for event in self._bag.raw_events(latched, stop_ns=start_ns):
            self._publish(event.topic, event.data)
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
            for event in self._bag.raw_events(self.publishers, start_ns, stop_ns):
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="replay",
        description="Publish the messages of a rosbag2 on their topics, and /clock.",
        epilog="Example: replay bags/ramp --rate 2 --start 5 --remap /scan:=/front/scan\n"
        "Nodes that listen need use_sim_time:=true to live in the bag's time.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("bag", type=Path, metavar="BAG", help="rosbag2 directory, or one of its files")
    add("--rate", type=_positive, default=1.0, metavar="R", help="times real time (default: 1)")
    add("--loop", action="store_true", help="from the beginning again, until Ctrl-C")
    add("--start", type=_not_negative, default=0.0, metavar="S",
        help="seconds of the bag to leave out at its beginning")  # fmt: skip
    add("--duration", type=_positive, default=math.inf, metavar="D",
        help="seconds of the bag to publish (default: all)")  # fmt: skip
    add("--remap", type=_rule, nargs="+", action="extend", default=[], metavar="/A:=/B",
        help="publish under other names; -r of --ros-args works as well")  # fmt: skip
    add("--topics", nargs="+", action="extend", metavar="/T",
        help="publish only these, by their names in the bag (default: all)")  # fmt: skip
    add("--wait", type=_not_negative, default=5.0, metavar="N",
        help="seconds to wait at most for subscribers at first (default: 5)")  # fmt: skip
    return parser


def _split(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Our own arguments, and those from --ros-args on (up to a --)."""
    first, last = [*arguments, "--ros-args"].index("--ros-args"), len(arguments)
    if "--" in arguments[first:]:
        last = arguments.index("--", first)
    return arguments[:first] + arguments[last + 1 :], ["--ros-args", *arguments[first + 1 : last]]


def _positive(text: str) -> float:
    number = _not_negative(text)
    if not number:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return number


def _not_negative(text: str) -> float:
    number = float(text)
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a number from 0 on")
    return number


def _rule(text: str) -> str:
    try:
        if text.count(":=") == 1 and all(map(validate_topic_name, text.split(":="))):
            return text
    except NameValidationException:
        pass
    raise argparse.ArgumentTypeError(f"{text} is not of the form /a:=/b")


def _stretch(bag: Bag, options: argparse.Namespace) -> tuple[int, int]:
    """From when to before when to publish [ns]."""
    if options.start > bag.duration:
        raise InputError(f"--start {options.start:g}: {bag.path} lasts {bag.duration:.1f} s")
    start_ns = bag.start_ns + round(options.start * 1e9)
    stop_ns = bag.end_ns + 1
    if options.duration < bag.duration:
        stop_ns = min(stop_ns, start_ns + round(options.duration * 1e9))
    return start_ns, stop_ns


def _topics(bag: Bag, wanted: list[str] | None) -> list[str]:
    for name in wanted or []:
        if name not in bag.topics:
            raise InputError(f"--topics {name}: {bag.path} has {', '.join(bag.topics)}")
    return [name for name in wanted or bag.topics if name != "/clock"]


def _run(node: Node, bag: Bag, options: argparse.Namespace) -> None:
    start_ns, stop_ns = _stretch(bag, options)
    player = Player(node, bag, _topics(bag, options.topics))
    if player.skipped:
        print(f"replay: types not installed, skipped: {', '.join(player.skipped)}")
    if options.wait:
        print(f"replay: waiting up to {options.wait:g} s for subscribers", flush=True)
        unheard = player.wait_for_subscribers(options.wait)
        if unheard:
            print(f"replay: nobody listens to {', '.join(unheard)}", flush=True)
    began = time.monotonic()
    try:
        player.play(start_ns, stop_ns, options.rate)
        while options.loop:
            player.play(start_ns, stop_ns, options.rate)
    finally:
        seconds, late = time.monotonic() - began, 1e3 * player.late
        print(f"replay: {player.count} messages in {seconds:.1f} s, at most {late:.1f} ms late")
    if not player.wait_until_acknowledged():
        print("replay: a subscriber did not acknowledge everything")


def _stop(signal_number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def main(arguments: list[str] | None = None) -> int:
    """Replay a bag; the exit status of the process."""
    arguments = sys.argv[1:] if arguments is None else arguments
    own_arguments, ros_arguments = _split(arguments)
    options = _parser().parse_args(own_arguments)
    ros_arguments += [word for rule in options.remap for word in ("-r", rule)]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    try:
        # Signals are ours: rclpy's handlers would let a sleep go on to its end.
        runtime.start_ros(ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
        with Bag(options.bag) as bag:
            _run(rclpy.create_node("replay"), bag, options)
    except InputError as error:
        print(f"replay: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    finally:
        runtime.ignore_signals()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
