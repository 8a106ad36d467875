# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: the same core on a recorded bag, deterministic and without a ROS graph.

This module imports hardly anything, and a command only where it is named. So ``--help`` comes at
once, and Ctrl-C ends the process at once while a command is imported, which takes seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import sys
from collections.abc import Collection, Iterator
from importlib import import_module
from types import FrameType
from typing import Any

import argcomplete

from heightmap25d_ros.commands import SUMMARIES
from heightmap25d_ros.errors import InputError, NegativeResultError
from heightmap25d_ros.version import VERSION

EXIT_UNUSABLE = 2
EXIT_INTERRUPTED = 130
_MODULES = {"import": "import_map"}  # the word is Python's
REPLAY = "heightmap25d_ros.executables", "replay"


def main(arguments: list[str] | None = None) -> int:
    """Run a command; the exit status of the process."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["replay"]:  # the node's own command line
        os.execv(sys.executable, [sys.executable, "-m", REPLAY[0], REPLAY[1], *arguments[1:]])
    while_starting = signal.signal(signal.SIGINT, _exit)
    parser = _parser(os.environ.get("COMP_LINE", "").split() or arguments)
    signal.signal(signal.SIGINT, while_starting)
    argcomplete.autocomplete(parser)  # ends the process where a shell asks for completions
    options = parser.parse_args(_with_negative_coordinates(arguments))
    try:
        figures = options.command(options)
        status = 0
    except NegativeResultError as result:
        figures, status = result.figures, result.exit_status
    except InputError as error:
        print(f"heightmap25d: {error}", file=sys.stderr)
        return EXIT_UNUSABLE
    except OSError as error:
        print(f"heightmap25d: {error.filename or 'output'}: {error.strerror}", file=sys.stderr)
        return EXIT_UNUSABLE
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    try:
        print(json.dumps(figures, indent=2) if options.json else "\n".join(_lines(figures)))
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return status


def _exit(signal_number: int, frame: FrameType | None) -> None:
    os._exit(EXIT_INTERRUPTED)


def _with_negative_coordinates(arguments: list[str]) -> list[str]:
    """Arguments in which ``--goal -4,0`` is ``--goal=-4,0``: argparse takes -4,0 for an option.

    It does not where a space comes first, which numbers may have.
    """
    joined: list[str] = []
    for argument in arguments:
        is_coordinates = re.fullmatch(r"-[\d.][^ ]*,[^ ]*", argument)
        if is_coordinates and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={argument}"
        else:
            joined.append(f" {argument}" if is_coordinates else argument)
    return joined


def _parser(words: Collection[str] = tuple(SUMMARIES)) -> argparse.ArgumentParser:
    """The parser of a command line; only commands that are named there are imported."""
    parser = argparse.ArgumentParser(
        prog="heightmap25d",
        description="2 1/2-D height maps from recorded laser bags.",
        epilog="Example: heightmap25d map bags/ramp -o out/ramp && "
        "heightmap25d render out/ramp -o out/pictures",
    )
    parser.add_argument("--version", action="version", version=f"heightmap25d {VERSION}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    commands.add_parser("replay", help="a bag on its topics, and /clock (needs ROS)")
    for name, summary in SUMMARIES.items():
        if name in words:
            import_module(f"heightmap25d_ros.commands.{_MODULES.get(name, name)}").add_to(commands)
        else:
            commands.add_parser(name, help=summary)
    return parser


def _lines(figures: dict[str, Any], indent: str = "") -> Iterator[str]:
    """The figures as aligned lines of text."""
    width = max((len(name) for name in figures), default=0)
    for name, value in figures.items():
        if isinstance(value, dict):
            yield f"{indent}{name}" if value else f"{indent}{name:{width}}  none"
            yield from _lines(value, indent + "  ")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list) else value
            yield f"{indent}{name:{width}}  {text}"
