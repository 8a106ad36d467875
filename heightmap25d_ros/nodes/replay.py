# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replay: the messages of a bag on their topics as they were recorded, and /clock.

The serialized bytes go out as they are in the bag. Static transforms hold for all times: those of
the whole bag go out first, latched.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import NoReturn

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_topic_name import validate_topic_name

from heightmap25d_ros.commands.stretch import add_stretch, not_negative, positive, stretch
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.nodes import runtime
from heightmap25d_ros.nodes.player import Player, message_class, profile_of

__all__ = ["Player", "main", "message_class", "profile_of"]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="replay",
        description="Publish the messages of a bag on their topics, and /clock.",
        epilog="Example: replay bags/ramp --rate 2 --start 5 --remap /scan:=/front/scan\n"
        "Nodes that listen need use_sim_time:=true to live in the bag's time.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("bag", type=Path, metavar="BAG", help="rosbag2 directory, or a .mcap, .db3 or .bag file")
    add("--rate", type=positive, default=1.0, metavar="R", help="times real time (default: 1)")
    add("--loop", action="store_true", help="from the beginning again, until Ctrl-C")
    add_stretch(parser)
    add("--remap", type=_rule, nargs="+", action="extend", default=[], metavar="/A:=/B",
        help="publish under other names; -r of --ros-args works as well")  # fmt: skip
    add("--topics", nargs="+", action="extend", metavar="/T",
        help="publish only these, by their names in the bag (default: all)")  # fmt: skip
    add("--wait", type=not_negative, default=5.0, metavar="N",
        help="seconds to wait at most for subscribers at first, of each of --topics or of any "
        "(default: 5)")  # fmt: skip
    return parser


def _split(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Our own arguments, and those from --ros-args on (up to a --)."""
    first, last = [*arguments, "--ros-args"].index("--ros-args"), len(arguments)
    if "--" in arguments[first:]:
        last = arguments.index("--", first)
    return arguments[:first] + arguments[last + 1 :], ["--ros-args", *arguments[first + 1 : last]]


def _rule(text: str) -> str:
    try:
        if text.count(":=") == 1 and all(map(validate_topic_name, text.split(":="))):
            return text
    except NameValidationException:
        pass
    raise argparse.ArgumentTypeError(f"{text} is not of the form /a:=/b")


def _topics(bag: Bag, wanted: list[str] | None) -> list[str]:
    for name in wanted or []:
        if name not in bag.topics:
            raise InputError(f"--topics {name}: {bag.path} has {', '.join(bag.topics)}")
    return [name for name in wanted or bag.topics if name != "/clock"]


def _run(node: Node, bag: Bag, options: argparse.Namespace) -> None:
    start_ns, stop_ns = stretch(bag, options)
    player = Player(node, bag, _topics(bag, options.topics))
    if player.skipped:
        print(f"replay: types not installed, skipped: {', '.join(player.skipped)}")
    if options.wait:
        print(f"replay: waiting up to {options.wait:g} s for subscribers", flush=True)
        unheard = player.wait_for_subscribers(options.wait, to_all=bool(options.topics))
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
    for topic, count in bag.damaged.items():
        print(f"replay: {topic}: {count} messages are damaged, skipped")
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
