# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded bag through a pipeline."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

from tqdm import tqdm

from heightmap25d_ros.io.bag import (
    LASER_SCAN,
    ODOMETRY,
    POSE,
    POSE_WITH_COVARIANCE,
    TF_MESSAGE,
    Bag,
    Event,
)
from heightmap25d_ros.io.message_bytes import READERS
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import IntakeParams, Params
from heightmap25d_ros.pipelines.robot_pose import TransformPoses

TRANSFORMS, STATIC_TRANSFORMS = "/tf", "/tf_static"

_POSE_TYPES = {
    "odometry": ODOMETRY,
    "pose": POSE,
    "pose_with_covariance": POSE_WITH_COVARIANCE,
    "tf": TF_MESSAGE,
}
"""Message types of ``intake.pose_source``."""

_Outcome = TypeVar("_Outcome")
_Outcome_co = TypeVar("_Outcome_co", covariant=True)


class Pipeline(Protocol[_Outcome_co]):
    """What takes the messages of a robot, as `Mapping` and `Localizer` do."""

    @property
    def scan_topics(self) -> tuple[str, ...]:
        """The topics that `take_scan` knows."""

    @property
    def cloud_topics(self) -> tuple[str, ...]:
        """The topics that `take_cloud` knows."""

    def take_scan(self, topic: str, message: Any) -> Sequence[_Outcome_co]:
        """Take a LaserScan."""

    def take_cloud(self, topic: str, message: Any) -> Sequence[_Outcome_co]:
        """Take a PointCloud2."""

    def take_odometry(self, message: Any) -> Sequence[_Outcome_co]:
        """Take an Odometry, a pose, or a decoded one."""

    def take_transforms(self, message: Any, *, is_static: bool) -> Sequence[_Outcome_co]:
        """Take a TFMessage."""

    def flush(self) -> Sequence[_Outcome_co]:
        """No more messages will come."""


def feed(
    pipeline: Pipeline[_Outcome], topic: str, message: Any, odom_topic: str = "/odom"
) -> Sequence[_Outcome]:
    """Hand a recorded message to a pipeline by its topic; what came of it.

    A topic that the pipeline does not know is left out: bags hold more than a pipeline takes.
    """
    if topic == odom_topic:
        return pipeline.take_odometry(message)
    if topic in (TRANSFORMS, STATIC_TRANSFORMS):
        return pipeline.take_transforms(message, is_static=topic == STATIC_TRANSFORMS)
    if topic in pipeline.scan_topics:
        return pipeline.take_scan(topic, message)
    if topic in pipeline.cloud_topics:
        return pipeline.take_cloud(topic, message)
    return ()


@dataclass(frozen=True, slots=True)
class Step(Generic[_Outcome]):
    """A message that was fed to a pipeline.

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


def with_sources(
    settings: Params,
    bags: Sequence[Bag],
    scan_topics: Sequence[str] = (),
    cloud_topics: Sequence[str] = (),
    *,
    is_named: bool = False,
) -> Params:
    """The parameters with lasers and 3-D lidars of these bags in them.

    The chosen ones, or those that the parameters name. Where they name none, all LaserScan topics
    of the bags, or, where there is no such topic, all topics of clouds.

    Parameters
    ----------
    settings : Params
    bags : sequence of Bag
    scan_topics, cloud_topics : sequence of str, optional
        The chosen ones.
    is_named : bool
        Whether the parameters name them, also where it is the default that they name.

    Raises
    ------
    InputError
        If a bag lacks one that was named, or has none at all.
    """
    intake = settings.intake
    is_named = is_named or intake != replace(
        intake,
        scan_topics=IntakeParams().scan_topics,
        mounts=(),
        cloud_topics=(),
        cloud_mounts=(),
    )
    if not (scan_topics or cloud_topics) and is_named:
        scan_topics = [f"/{topic.lstrip('/')}" for topic in intake.scan_topics]
        cloud_topics = [f"/{topic.lstrip('/')}" for topic in intake.cloud_topics]
    if scan_topics or cloud_topics:
        for bag in bags:
            for topic in scan_topics:
                bag.require(topic, LASER_SCAN)
            for topic in cloud_topics:
                bag.require(topic, bag.cloud_type(topic))
    else:
        scan_topics, cloud_topics = _all_sources(bags)
    values = {"intake.scan_topics": scan_topics, "intake.cloud_topics": cloud_topics}
    return with_values(settings, {name: list(topics) for name, topics in values.items()})


def _all_sources(bags: Sequence[Bag]) -> tuple[list[str], list[str]]:
    """The LaserScan topics of all bags, or else their topics of clouds; each bag has some."""
    lasers = [bag.topics_of(LASER_SCAN) for bag in bags]
    clouds = [bag.cloud_topics() for bag in bags]
    if not all(lasers) and all(clouds):
        return [], sorted(set().union(*clouds))
    return sorted({topic for bag in bags for topic in bag.scan_topics()}), []


def pose_topic(bag: Bag, chosen: str | None, intake: IntakeParams) -> tuple[str, str]:
    """The topic of the robot's poses, and the type of its messages.

    Parameters
    ----------
    bag : Bag
    chosen : str or None
        A topic of Odometry, PoseStamped, PoseWithCovarianceStamped or TFMessage; None: the one
        of ``intake.pose_source``.
    intake : IntakeParams

    Raises
    ------
    InputError
        If there is none, it is not clear which one is meant, or it is of another type.
    """
    if chosen is not None:
        found = next((kind for kind in _POSE_TYPES.values() if chosen in bag.topics_of(kind)), None)
        kind = found or ODOMETRY
    else:
        kind = _POSE_TYPES[intake.pose_source]
        chosen = TRANSFORMS if kind == TF_MESSAGE else bag.odometry_topic(kind)
    bag.require(chosen, kind)
    return chosen, kind


def replayed(
    bag: Bag,
    pipeline: Pipeline[_Outcome],
    odom_topic: str,
    intake: IntakeParams | None = None,
    stretch: tuple[int, int] | None = None,
) -> Iterator[Step[_Outcome]]:
    """Feed a bag to a pipeline: a step for each message, and one for the end.

    Static transforms hold for all times, so those of the whole bag are fed first.

    Parameters
    ----------
    bag : Bag
    pipeline : Pipeline
    odom_topic : str
        Of the robot's poses, see `pose_topic`.
    intake : IntakeParams, optional
        Whose frames are those of the poses on /tf.
    stretch : (int, int) [ns], optional
        From when to before when messages were recorded that are fed; all by default.
    """
    transforms = [topic for topic in (TRANSFORMS, STATIC_TRANSFORMS) if topic in bag.topics]
    types = {odom_topic: pose_topic(bag, odom_topic, intake or IntakeParams())[1]}
    poses = TransformPoses(intake or IntakeParams()) if types[odom_topic] == TF_MESSAGE else None
    types |= dict.fromkeys(pipeline.scan_topics, LASER_SCAN)
    types |= {topic: bag.cloud_type(topic) for topic in pipeline.cloud_topics}
    types |= dict.fromkeys(transforms, TF_MESSAGE)
    static = bag.events([STATIC_TRANSFORMS], types) if STATIC_TRANSFORMS in transforms else ()
    # The first one of a frame comes last: it holds until another one comes in its turn.
    for event in reversed(list(static)):
        _fed(pipeline, event, odom_topic, poses)
    sources = *pipeline.scan_topics, *pipeline.cloud_topics
    wanted = dict.fromkeys([*sources, odom_topic, *transforms])
    topics = [topic for topic in wanted if topic in bag.topics]
    first_ns, stop_ns = stretch or (bag.start_ns, bag.end_ns + 1)
    is_whole = first_ns <= bag.start_ns and stop_ns > bag.end_ns
    total = sum(bag.topics[topic].count for topic in topics) if is_whole else None
    with tqdm(
        total=total, unit=" messages", unit_scale=True, desc=bag.path.name, disable=None
    ) as progress:
        for event in bag.events(topics, types, first_ns, stop_ns, READERS):
            began = time.perf_counter()
            outcomes = _fed(pipeline, event, odom_topic, poses)
            yield Step(event.topic, 1e3 * (time.perf_counter() - began), outcomes)
            progress.update()
    began = time.perf_counter()
    outcomes = pipeline.flush()
    yield Step("", 1e3 * (time.perf_counter() - began), outcomes)


def _fed(
    pipeline: Pipeline[_Outcome], event: Event, odom_topic: str, poses: TransformPoses | None
) -> Sequence[_Outcome]:
    """`feed`, with the poses that the transforms hold where the robot's come from there."""
    if poses is None:
        return feed(pipeline, event.topic, event.message, odom_topic)
    is_static = event.topic == STATIC_TRANSFORMS
    if event.topic not in (odom_topic, TRANSFORMS, STATIC_TRANSFORMS):
        return feed(pipeline, event.topic, event.message, odom_topic)
    outcomes = list(pipeline.take_transforms(event.message, is_static=is_static))
    for pose in poses.take(event.message, is_static=is_static):
        outcomes += pipeline.take_odometry(pose)
    return outcomes
