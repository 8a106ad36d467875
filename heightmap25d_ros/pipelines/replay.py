# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the commands give a bag to what listens to it: their options and their loop."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from tqdm import tqdm

from heightmap25d_ros.io.bag import LASER_SCAN, ODOMETRY, TF_MESSAGE, Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params

_Outcome = TypeVar("_Outcome")
_Outcome_co = TypeVar("_Outcome_co", covariant=True)


class Listener(Protocol[_Outcome_co]):
    """What takes messages in, as `Mapping` and `Localizer` do."""

    @property
    def scan_topics(self) -> tuple[str, ...]:
        """The topics that `take_scan` knows."""

    def take_scan(self, topic: str, message: Any) -> Sequence[_Outcome_co]:
        """Take a LaserScan in."""

    def take_odometry(self, message: Any) -> Sequence[_Outcome_co]:
        """Take an Odometry in."""

    def take_transforms(self, message: Any, *, is_static: bool) -> Sequence[_Outcome_co]:
        """Take a TFMessage in."""

    def flush(self) -> Sequence[_Outcome_co]:
        """No more messages will come."""


@dataclass(frozen=True, slots=True)
class Step(Generic[_Outcome]):
    """A message that was given to a listener.

    Attributes
    ----------
    topic : str
        Empty for the end of the bag.
    milliseconds : float
        That it took.
    outcomes : sequence
        What came of it.
    """

    topic: str
    milliseconds: float
    outcomes: Sequence[_Outcome]


def with_scan_topics(settings: Params, bag: Bag, chosen: Sequence[str]) -> Params:
    """The parameters with the scan topics of this bag in them: the chosen ones, or all.

    Raises
    ------
    InputError
        If the bag lacks one of them.
    """
    named = [f"/{topic.lstrip('/')}" for topic in settings.intake.scan_topics]
    topics = chosen or (named if settings.intake.mounts else bag.scan_topics())
    for topic in topics:
        bag.require(topic, LASER_SCAN)
    return with_values(settings, {"intake.scan_topics": list(topics)})


def replayed(bag: Bag, listener: Listener[_Outcome], odom_topic: str) -> Iterator[Step[_Outcome]]:
    """Give a bag to a listener: a step for each message, and one for the end.

    Static transforms hold for all times, so those of the whole bag are given first.
    """
    transform_topics = [topic for topic in ("/tf", "/tf_static") if topic in bag.topics]
    types = dict.fromkeys(listener.scan_topics, LASER_SCAN) | {odom_topic: ODOMETRY}
    types |= dict.fromkeys(transform_topics, TF_MESSAGE)
    static = bag.events(["/tf_static"], types) if "/tf_static" in transform_topics else ()
    # The first one of a frame comes last: it holds until another one comes in its turn.
    for event in reversed(list(static)):
        listener.take_transforms(event.message, is_static=True)
    topics = [*listener.scan_topics, odom_topic, *transform_topics]
    total = sum(bag.topics[topic].count for topic in topics if topic in bag.topics)
    with tqdm(total=total, unit=" messages", unit_scale=True, desc=bag.path.name) as progress:
        for event in bag.events(topics, types):
            began = time.perf_counter()
            if event.topic == odom_topic:
                outcomes = listener.take_odometry(event.message)
            elif event.topic in transform_topics:
                is_static = event.topic == "/tf_static"
                outcomes = listener.take_transforms(event.message, is_static=is_static)
            else:
                outcomes = listener.take_scan(event.topic, event.message)
            yield Step(event.topic, 1e3 * (time.perf_counter() - began), outcomes)
            progress.update()
    began = time.perf_counter()
    outcomes = listener.flush()
    yield Step("", 1e3 * (time.perf_counter() - began), outcomes)


def reasons(dropped: Counter[str]) -> str:
    """Why messages were dropped, in one line."""
    counted = (f"{reason} ({count})" for reason, count in dropped.most_common())
    return "; ".join(counted) or "the bag has none"
