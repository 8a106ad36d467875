# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The executables of ``ros2 run``, and ``python -m heightmap25d_ros.executables NAME``.

Importing ROS and loading kernels takes seconds. Until a node runs it has nothing to save, so that
Ctrl-C and SIGTERM end the process at once, with status 0; this module, which imports hardly
anything, sees to that from the start.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from types import FrameType

NODES = (
    "exploration", "localization", "mapping", "markers", "path_follower", "planning", "replay",
    "simulator",
)  # fmt: skip
"""The executables that are nodes; each is a module of `nodes` with a ``main``."""


def main(name: str | None = None) -> int:
    """Run a node by its name, by default the process's own; its exit status."""
    if name is None:
        name = os.path.basename(sys.argv[0])  # noqa: PTH119 - pathlib takes a while to import
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _exit)
    status: int = importlib.import_module(f"heightmap25d_ros.nodes.{name}").main()
    return status


def _exit(signal_number: int, frame: FrameType | None) -> None:
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main(sys.argv.pop(1)))
