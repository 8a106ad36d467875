# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The self-check after a node's activation, and its reports on /diagnostics."""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSCompatibility, qos_check_compatible
from rclpy.subscription import Subscription

from heightmap25d_ros.io.message_bytes import READERS
from heightmap25d_ros.nodes.guard import Guard
from heightmap25d_ros.nodes.interface import Input as Interface
from heightmap25d_ros.nodes.qos import best_effort, is_best_effort_needed
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import LOST, Flatness
from heightmap25d_ros.pipelines.self_check import (
    Finding,
    Input,
    Observed,
    Watch,
    findings,
    recent,
    with_watch,
)

PERIOD = 1.0
"""Between two messages on /diagnostics [s]."""

SETTLED = 5.0
"""How long after its activation a node is given to hear everybody [s]."""

_SCANS = "LaserScan", "PointCloud2", "CompressedPointCloud2", "CustomMsg"  # the last one Livox's
_PAGE = os.sysconf("SC_PAGE_SIZE")


class Reporting(Protocol):
    """What `Diagnostics` needs to know of a node, besides what all nodes have."""

    @property
    def is_configured(self) -> bool:
        """Whether there is anything to report."""

    @property
    def state_label(self) -> str:
        """State of the lifecycle."""

    @property
    def dropped(self) -> Drops:
        """What was not used."""

    @property
    def guard(self) -> Guard:
        """Which callbacks failed."""

    def figures(self) -> dict[str, Any]:
        """Further values of the report."""

    def trouble(self) -> str:
        """What stops the node from doing its work, or nothing."""


@dataclass(slots=True)
class _Counted:
    """A subscription, and how many messages came since the activation."""

    subscription: Subscription
    is_needed: bool
    is_latched: bool
    take: Callable[[Any], None]
    is_resubscribed: bool = False
    received: int = 0
    received_before: int = 0


class Diagnostics:
    """Subscribes for a node, and reports what comes and what does not.

    Parameters
    ----------
    node : rclpy.node.Node, and Reporting

    Attributes
    ----------
    flatness : Flatness
        Of the poses since the activation.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._reporting: Reporting = node
        self._wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._counted_at = time.monotonic()
        self._clock_ns = (0, 0)
        self.deactivate()
        node.create_timer(PERIOD, self._publish, clock=self._wall_clock)

    def subscribe(self, entry: Interface) -> None:
        """Subscribe to an input of the node, and count what comes.

        What comes many times a second is taken as bytes, see `message_bytes`.
        """
        read = READERS.get(_type_name(entry.kind))

        def take(message: Any) -> None:
            counted.received += 1
            if read is not None:
                message = self._reporting.dropped.decoded(entry.kind.__name__, read, message)
                if message is None:
                    return
            entry.callback(message)

        subscription = self._node.create_subscription(
            entry.kind, entry.topic, take, entry.profile, raw=read is not None
        )
        is_latched = entry.profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        counted = _Counted(subscription, entry.is_needed, is_latched, take)
        self._inputs.append(counted)
        self._hear_best_effort(counted)

    def _hear_best_effort(self, counted: _Counted) -> None:
        """Subscribe anew where a publisher offers best effort only: nothing is lost but for that.

        A reliable subscription loses no message of a reliable publisher, and hears no other one.
        """
        heard = counted.subscription
        publishers = self._node.get_publishers_info_by_topic(heard.topic_name)
        offered = [publisher.qos_profile for publisher in publishers]
        if counted.is_resubscribed or not is_best_effort_needed(heard.qos_profile, offered):
            return
        counted.is_resubscribed = True
        # Overrides are in its profile already, and would make it reliable again.
        counted.subscription = self._node.create_subscription(
            heard.msg_type,
            heard.topic_name,
            counted.take,
            best_effort(heard.qos_profile),
            qos_overriding_options=None,
            raw=heard.raw,
        )
        self._node.destroy_subscription(heard)

    def activate(self) -> None:
        """Everything is subscribed; check after a while what comes."""
        self._settling = self._node.create_timer(
            SETTLED, self._log_first_findings, clock=self._wall_clock
        )

    def deactivate(self) -> None:
        """Nothing is subscribed any more."""
        self._inputs: list[_Counted] = []
        self.flatness = Flatness()
        self._is_settled = False
        self._trouble = ""
        self._watch = Watch()
        self._seen: deque[Observed] = deque(maxlen=round(SETTLED / PERIOD) + 1)

    def _log_first_findings(self) -> None:
        self._settling.cancel()
        self._is_settled = True
        found = findings(self._observed())
        self._watch.update(found)
        if found:
            self._warn(found)
        else:
            self._node.get_logger().info("self-check: nothing is missing")

    def _log_changes(self, found: list[Finding]) -> None:
        """Log each problem when it begins, and when it is over."""
        begun, over = self._watch.update(found)
        if begun:
            self._warn(begun)
        for finding in over:
            told = " ".join(filter(None, [finding.problem.value, finding.topic]))
            self._node.get_logger().info(f"self-check: over: {told}")

    def _log_trouble(self, trouble: str) -> None:
        """Log what stops the node when it begins, and when it is over."""
        if trouble and not self._trouble:
            self._node.get_logger().error(trouble)
        elif self._trouble and not trouble:
            self._node.get_logger().info(f"over: {self._trouble}")
        self._trouble = trouble

    def _warn(self, found: list[Finding]) -> None:
        told = "; ".join(map(str, found))
        self._node.get_logger().warning(f"self-check: {told} (see docs/troubleshooting.md)")

    def _check(self) -> list[Finding]:
        """What is missing in the last seconds; nothing before the node has heard everybody."""
        if not self._inputs:
            return []
        now = self._observed()
        before = self._seen[0] if self._seen else None
        self._seen.append(now)
        if not self._is_settled:
            return []
        return findings(now if before is None else recent(now, before))

    def _observed(self) -> Observed:
        is_simulated = self._node.get_parameter("use_sim_time").value
        dropped = self._reporting.dropped
        observed = Observed(
            inputs=tuple(map(self._input, self._inputs)),
            scans=sum(
                h.received for h in self._inputs if h.subscription.msg_type.__name__ in _SCANS
            ),
            dropped=Counter(dropped),
            clock_ns=self._clock_ns if is_simulated else None,
            flat_poses=self.flatness.poses,
        )
        watch = getattr(self._node, "watch", None)
        return observed if watch is None else with_watch(observed, watch, dropped)

    def _input(self, counted: _Counted) -> Input:
        subscription = counted.subscription
        publishers = self._node.get_publishers_info_by_topic(subscription.topic_name)
        faults = (_incompatible(publisher, subscription) for publisher in publishers)
        return Input(
            topic=subscription.topic_name,
            publishers=len(publishers),
            incompatible=tuple(filter(None, faults)),
            received=counted.received,
            is_needed=counted.is_needed,
            is_latched=counted.is_latched,
        )

    def _publish(self) -> None:
        for counted in self._inputs:
            self._hear_best_effort(counted)
        now = self._node.get_clock().now()
        self._clock_ns = self._clock_ns[1], now.nanoseconds
        present = self._check()
        if self._is_settled:
            self._log_changes(present)
        found = [str(finding) for finding in present]
        state, level = self._reporting.state_label, DiagnosticStatus.OK
        trouble = self._reporting.trouble() if self._reporting.is_configured else ""
        self._log_trouble(trouble)
        failures, newest = self._reporting.guard.failures.total(), self._reporting.guard.newest
        if failures:
            trouble = "; ".join(filter(None, [trouble, f"{failures} callbacks failed: {newest}"]))
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
        if self._reporting.is_configured:
            values |= self._reporting.figures()
            values |= self._dropped()
            watch = getattr(self._node, "watch", None)
            if watch is not None:
                values["scans that did not come, by their stamps"] = watch.counts[LOST]
        values["memory of the process [MB]"] = round(_resident_bytes() / 1e6, 1)
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = now.to_msg()
        self._publisher.publish(array)

    def _dropped(self) -> dict[str, str]:
        dropped = self._reporting.dropped
        return {
            f"dropped: {reason}": f"{count} {dropped.examples.get(reason, '')}".strip()
            for reason, count in dropped.items()
        }

    def _rates(self) -> dict[str, float]:
        """Messages a second on each topic since the last time [Hz]."""
        now = time.monotonic()
        seconds, self._counted_at = now - self._counted_at, now
        rates = {}
        for counted in self._inputs:
            count, counted.received_before = (
                counted.received - counted.received_before,
                counted.received,
            )
            rates[f"{counted.subscription.topic_name} [Hz]"] = round(count / seconds, 1)
        return rates


def _incompatible(publisher: Any, subscription: Subscription) -> str:
    """Why a publisher cannot reach a subscription; empty where it can."""
    wanted = _type_name(subscription.msg_type)
    name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
    if publisher.topic_type != wanted:
        return f"{name} publishes {publisher.topic_type}, not {wanted}"
    compatibility, reason = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
    if compatibility != QoSCompatibility.ERROR:
        return ""
    return f"{name}: {reason.removeprefix('ERROR: ').rstrip('; ')}"


def _type_name(kind: Any) -> str:
    """Of a class of messages, as sensor_msgs/msg/LaserScan."""
    return f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE
