# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of single sources: a laser and a depth camera have other ranges and other errors.

``sensor.SOURCE.NAME`` and ``cloud.SOURCE.NAME`` take the place of ``sensor.NAME`` and
``cloud.NAME`` for one topic of ``intake``, and ``sensor.SOURCE.mount`` that of its mount there.
SOURCE is the topic, with ``_`` for each ``/`` inside, see `source_name`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeVar

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.sections import CloudParams, Params, SensorParams
from heightmap25d_ros.params.spec import Section, parameter, specs

_Kind = TypeVar("_Kind", bound=Section)


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceParams(SensorParams):
    """Section ``sensor`` of one source."""

    mount: tuple[float, ...] = parameter(
        (), "x, y, z, roll, pitch, yaw of the source in base_link; empty: as intake.mounts, "
        "intake.cloud_mounts or /tf have it", "m, rad",
    )  # fmt: skip
    message_type: str = parameter(
        "sensor_msgs/msg/PointCloud2", "of a topic of clouds, for nodes; bags tell it themselves",
        choices=(
            "sensor_msgs/msg/PointCloud2", "livox_ros_driver2/msg/CustomMsg",
            "point_cloud_interfaces/msg/CompressedPointCloud2",
        ),
    )  # fmt: skip

    def __post_init__(self) -> None:
        SensorParams.__post_init__(self)
        if len(self.mount) not in (0, 6):
            raise InputError(f"parameter sensor.mount: {len(self.mount)} numbers; needs six")


SECTIONS: dict[str, type[Section]] = {"sensor": SourceParams, "cloud": CloudParams}
"""Of which every parameter may be set for one source."""


def source_name(topic: str) -> str:
    """The name of a source in parameters.

    Examples
    --------
    >>> source_name("/camera/depth/points")
    'camera_depth_points'
    """
    return topic.strip("/").replace("/", "_")


def sensor_of(params: Params, topic: str) -> SensorParams:
    """Section ``sensor`` of the source with a topic."""
    source = source_name(topic)
    return (
        _of(params, source, "sensor", SourceParams) if source in params.sources else params.sensor
    )


def cloud_of(params: Params, topic: str) -> CloudParams:
    """Section ``cloud`` of the source with a topic."""
    source = source_name(topic)
    return _of(params, source, "cloud", CloudParams) if source in params.sources else params.cloud


def mounts(params: Params) -> dict[str, tuple[float, ...]]:
    """Topic -> x, y, z, roll, pitch, yaw [m, rad], where that is set for one source."""
    found = {topic: sensor_of(params, topic) for topic in params.intake.source_topics}
    return {t: s.mount for t, s in found.items() if isinstance(s, SourceParams) and s.mount}


def message_type(params: Params, topic: str) -> str:
    """The type of the messages of a topic of clouds."""
    sensor = sensor_of(params, topic)
    return (sensor if isinstance(sensor, SourceParams) else SourceParams()).message_type


def max_range(params: Params) -> float:
    """Largest range [m] up to which a source marks cells."""
    topics = params.intake.source_topics
    return max([params.sensor.max_range, *(sensor_of(params, t).max_range for t in topics)])


def without_topic(params: Params) -> list[str]:
    """A sentence for each source for which something is set, but that no topic is."""
    names = [source_name(topic) for topic in params.intake.source_topics]
    return [
        f"parameter {next(iter(values)).replace('.', f'.{source}.')}: no topic is {source}, only "
        + ", ".join(names)
        for source, values in params.sources.items()
        if source not in names
    ]


def check(params: Params) -> None:
    """Check what is set for single sources.

    Raises
    ------
    InputError
        If a value is out of its range, or does not go with the others of its source.
    """
    for source in params.sources:
        for section, kind in SECTIONS.items():
            _of(params, source, section, kind)


def _of(params: Params, source: str, section: str, kind: type[_Kind]) -> _Kind:
    values = {name: value for name, _, value in specs(getattr(params, section))}
    for name, value in params.sources[source].items():
        its_section, _, key = name.partition(".")
        if its_section == section:
            values[key] = value
    try:
        return kind(**values)
    except InputError as error:
        told = re.sub(r"^parameter \w+\.", f"parameter {section}.{source}.", str(error))
        raise InputError(told) from None
