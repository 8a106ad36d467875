# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which sources of messages have fallen silent."""

from __future__ import annotations

from collections.abc import Iterable

CHECKS = 4
"""Calls of `Silence.pass_time` in a timeout, at the least."""

ODOMETRY, LOCALIZATION = "odometry", "localization"
"""Sources besides the lasers, which go by their topics."""


class Silence:
    """How long nothing usable has come from each source: what is refused is no sign of life.

    Time is that of any clock. While it stands nobody is silent, where it jumps back nothing has
    passed, and of a long step only half a timeout counts: then the process itself was busy, and
    what came meanwhile still waits.

    Parameters
    ----------
    sources : iterable of str
    timeout : float [s]

    Examples
    --------
    >>> silence = Silence(["scan"], timeout=1.0)
    >>> for tenths in range(0, 14, 2):
    ...     silence.pass_time(tenths * 10**8)
    >>> silence.silent, silence.seconds("scan")
    (['scan'], 1.2)
    >>> silence.hear("scan")
    >>> silence.silent
    []
    """

    def __init__(self, sources: Iterable[str], timeout: float) -> None:
        self._timeout_ns = round(timeout * 1e9)
        self._silent_ns = dict.fromkeys(sources, 0)
        self._now_ns: int | None = None

    def hear(self, source: str) -> None:
        """Something usable has come."""
        self._silent_ns[source] = 0

    def pass_time(self, now_ns: int) -> None:
        """It is ``now_ns`` [ns]."""
        before, self._now_ns = self._now_ns, now_ns
        passed = 0 if before is None else min(max(now_ns - before, 0), self._timeout_ns // 2)
        for source in self._silent_ns:
            self._silent_ns[source] += passed

    @property
    def silent(self) -> list[str]:
        """The sources that have been silent for longer than the timeout."""
        return [source for source, ns in self._silent_ns.items() if ns > self._timeout_ns]

    def seconds(self, source: str) -> float:
        """How long a source has been silent [s]."""
        return self._silent_ns[source] / 1e9

    @property
    def told(self) -> str:
        """The silent sources in words; empty where there are none."""
        return ", ".join(f"nothing from {s} for {self.seconds(s):.1f} s" for s in self.silent)
