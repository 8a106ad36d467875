# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""QoS profiles of the nodes' topics."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from heightmap25d_ros.errors import InputError

QUEUE = QoSProfile(depth=10)
"""Of goals, corrections and the like: reliable."""

POSES = QoSProfile(depth=100)
"""Of odometry, poses and transforms: deep enough for those that come while a map is converted."""

SCANS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""As qos_profile_sensor_data, but deep enough for the scans that come while a map is converted."""

CLOUDS = QoSProfile(depth=10)
"""Of point clouds: megabytes each, of which best effort would lose parts; see `best_effort`."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of maps and plans: reliable, and a late subscriber gets the newest one."""

UPDATES = QoSProfile(depth=100)
"""Of changes of maps, each of which counts: reliable, and only for who listens."""

STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of /tf_static."""

_OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


@contextmanager
def overridable(profile: QoSProfile | int) -> Iterator[tuple[QoSProfile, dict[str, Any]]]:
    """A profile, and the options with which parameters ``qos_overrides.TOPIC...`` change it.

    Raises
    ------
    InputError
        If such a parameter has a value that is no policy.
    """
    own = QoSProfile(depth=profile) if isinstance(profile, int) else copy.copy(profile)
    try:
        yield own, {"qos_overriding_options": QoSOverridingOptions(_OVERRIDABLE)}
    except RuntimeError as error:
        if "QoS override" not in str(error):
            raise
        raise InputError(str(error)) from None


def best_effort(profile: QoSProfile) -> QoSProfile:
    """The same profile, which best-effort publishers match as well."""
    result = copy.copy(profile)
    result.reliability = ReliabilityPolicy.BEST_EFFORT
    return result


def is_best_effort_needed(subscribed: QoSProfile, offered: list[QoSProfile]) -> bool:
    """Whether a reliable subscription, not to latched topics, does not hear some publisher."""
    if subscribed.reliability != ReliabilityPolicy.RELIABLE:
        return False
    if subscribed.durability != DurabilityPolicy.VOLATILE:
        return False
    return any(profile.reliability == ReliabilityPolicy.BEST_EFFORT for profile in offered)
