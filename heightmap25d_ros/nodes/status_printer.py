# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Prints the state of the nodes of its namespace, as /diagnostics tell it, when it changes."""

from __future__ import annotations

import re
import sys

from diagnostic_msgs.msg import DiagnosticArray

from heightmap25d_ros.errors import printable
from heightmap25d_ros.nodes import runtime
from heightmap25d_ros.nodes.guard import GuardedCallbacks

_MOST_NODES = 100  # whose states are remembered


class StatusPrinterNode(GuardedCallbacks):
    """Part of ``heightmap25d bringup``."""

    NAME = "status_printer"
    PARAMETERS: tuple[str, ...] = ()

    def __init__(self) -> None:
        super().__init__(self.NAME)
        self._told: dict[str, str] = {}
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            told = re.sub(r"\d+", "", status.message)  # that a count went up is no news
            is_ours = status.hardware_id == self.get_namespace() and len(self._told) < _MOST_NODES
            if is_ours and self._told.get(status.name) != told:
                self._told[status.name] = told
                print(printable(f"{status.name}: {status.message}"), flush=True)


def main() -> int:
    """Run the node."""
    return runtime.run(StatusPrinterNode)


if __name__ == "__main__":
    sys.exit(main())
