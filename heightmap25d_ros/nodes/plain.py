# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes without a life cycle: the simulator."""

from __future__ import annotations

from heightmap25d_ros.nodes.diagnostics import Diagnostics
from heightmap25d_ros.nodes.guard import GuardedCallbacks


class PlainNode(GuardedCallbacks):
    """A node that is active from its start to its end, and reports its state on /diagnostics.

    A subclass has its NAME.

    Attributes
    ----------
    is_configured : bool
        False: there are no figures to report.
    state_label : str
    """

    NAME = ""

    def __init__(self) -> None:
        super().__init__(self.NAME, automatically_declare_parameters_from_overrides=True)
        self.is_configured = False
        self.state_label = "active"
        self._diagnostics = Diagnostics(self)
