# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node tells of itself: the self-check after its activation, and /diagnostics."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from sensor_msgs.msg import LaserScan

from heightmap25d_ros.nodes.self_check import Finding, Flatness, Input, Observed, findings

if TYPE_CHECKING:
    from heightmap25d_ros.nodes.lifecycle import ManagedNode

PERIOD = 1.0
"""Between two messages on /diagnostics [s]."""

SETTLED = 5.0
"""How long after its activation a node is given to hear everybody [s]."""

_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(slots=True)
class _Heard:
    """A subscription, and how much came on it since the activation."""

    subscription: Subscription
    is_needed: bool
    received: int = 0
    received_before: int = 0


class Diagnostics:
    """Subscribes for a node, and tells what comes and what does not.

    Parameters
    ----------
    node : ManagedNode
        Asked for its ``figures`` and for what it ``dropped`` while it is configured.
    """

    def __init__(self, node: ManagedNode) -> None:
        self._node = node
        self._wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._counted_at = time.monotonic()
        self._clock_ns = (0, 0)
        self.deactivate()
        node.create_timer(PERIOD, self._publish, clock=self._wall_clock)

    def subscribe(
        self,
        kind: Any,
        topic: str,
        callback: Callable[[Any], Any],
        profile: QoSProfile | int,
        *,
        is_needed: bool,
    ) -> None:
        """Subscribe, and count what comes."""

        def hear(message: Any) -> None:
            heard.received += 1
            callback(message)

        def hear_odometry(message: Any) -> None:
            self._flatness.see(message)
            hear(message)

        hearing = hear_odometry if kind is Odometry else hear
        subscription = self._node.create_subscription(kind, topic, hearing, profile)
        heard = _Heard(subscription, is_needed)
        self._inputs.append(heard)

    def activate(self) -> None:
        """Everything is subscribed; look around in a while."""
        self._settling = self._node.create_timer(SETTLED, self._tell, clock=self._wall_clock)

    def deactivate(self) -> None:
        """Nothing is subscribed any more."""
        self._inputs: list[_Heard] = []
        self._flatness = Flatness()
        self._is_settled = False

    def _tell(self) -> None:
        self._settling.cancel()
        self._is_settled = True
        found = "; ".join(map(str, self._findings()))
        if found:
            self._node.get_logger().warning(f"self-check: {found} (see docs/troubleshooting.md)")
        else:
            self._node.get_logger().info("self-check: nothing is missing")

    def _findings(self) -> list[Finding]:
        if not self._is_settled:
            return []
        is_simulated = self._node.get_parameter("use_sim_time").value
        return findings(
            Observed(
                inputs=tuple(map(self._input, self._inputs)),
                scans=sum(h.received for h in self._inputs if h.subscription.msg_type is LaserScan),
                dropped=self._node.dropped,
                clock_ns=self._clock_ns if is_simulated else None,
                flat_poses=self._flatness.poses,
            )
        )

    def _input(self, heard: _Heard) -> Input:
        subscription = heard.subscription
        publishers = self._node.get_publishers_info_by_topic(subscription.topic_name)
        faults = (_incompatible(publisher, subscription) for publisher in publishers)
        return Input(
            topic=subscription.topic_name,
            publishers=len(publishers),
            incompatible=tuple(filter(None, faults)),
            received=heard.received,
            is_needed=heard.is_needed,
        )

    def _publish(self) -> None:
        now = self._node.get_clock().now()
        self._clock_ns = self._clock_ns[1], now.nanoseconds
        found = [str(finding) for finding in self._findings()]
        state, level = self._node.state_label, DiagnosticStatus.OK
        trouble = self._node.trouble() if self._node.is_configured else ""
        if trouble:
            level = DiagnosticStatus.ERROR
            found.insert(0, trouble)
        elif found:
            level = DiagnosticStatus.WARN
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message="; ".join([state, *found]),
            hardware_id=self._node.get_namespace(),
        )
        values: dict[str, Any] = {"state": state, **self._rates()}
        if self._node.is_configured:
            values |= self._node.figures()
            values |= {f"dropped: {reason}": n for reason, n in self._node.dropped.items()}
        values["memory of the process [MB]"] = round(_resident_bytes() / 1e6, 1)
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = now.to_msg()
        self._publisher.publish(array)

    def _rates(self) -> dict[str, float]:
        """Messages a second on each topic since the last time [Hz]."""
        now = time.monotonic()
        seconds, self._counted_at = now - self._counted_at, now
        rates = {}
        for heard in self._inputs:
            count, heard.received_before = heard.received - heard.received_before, heard.received
            rates[f"{heard.subscription.topic_name} [Hz]"] = round(count / seconds, 1)
        return rates


def _incompatible(publisher: Any, subscription: Subscription) -> str:
    """Why a publisher cannot reach a subscription; empty where it can."""
    module = subscription.msg_type.__module__.partition(".")[0]
    wanted = f"{module}/msg/{subscription.msg_type.__name__}"
    name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
    if publisher.topic_type != wanted:
        return f"{name} publishes {publisher.topic_type}, not {wanted}"
    compatibility, reason = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
    if compatibility != QoSCompatibility.ERROR:
        return ""
    return f"{name}: {reason.removeprefix('ERROR: ').rstrip('; ')}"


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE
