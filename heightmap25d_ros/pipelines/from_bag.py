# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded bag to a map or to a trajectory, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import pose_topic, replayed, with_sources


def map_bag(
    path: Path | str,
    params: Params | None = None,
    *,
    odom_topic: str | None = None,
    scan_topics: Sequence[str] = (),
    cloud_topics: Sequence[str] = (),
) -> HeightMap:
    """Map a bag, as ``heightmap25d map`` does.

    Parameters
    ----------
    path : Path or str
        Its directory, or a single .db3 or .mcap file.
    params : Params, optional
    odom_topic : str, optional
        Of the 3-D poses, see `pose_topic`; by default of ``intake.pose_source``, ``/odom`` or the
        only one.
    scan_topics : sequence of str, optional
        The lasers.
    cloud_topics : sequence of str, optional
        The 3-D lidars and depth cameras. By default all LaserScan topics are used, or all
        PointCloud2 topics of a bag that has no lasers.

    Raises
    ------
    InputError
        If the bag or a topic is missing or damaged, or no scan could be mapped.

    Examples
    --------
    >>> height_map = map_bag("bags/ramp")
    >>> iy, ix = height_map.geometry.cell_at((21.5, -2.0))  # a pallet in the yard
    >>> int(height_map.height[iy, ix])  # [cm] above the start of the drive
    -136
    """
    with Bag(path) as bag:
        settings, odom_topic = _checked(bag, params, odom_topic, (scan_topics, cloud_topics))
        mapping = Mapping(settings)
        steps = replayed(bag, mapping, odom_topic, settings.intake)
        count = sum(len(step.outcomes) for step in steps)
    if not count:
        raise InputError(f"{path}: no scan could be mapped; {mapping.dropped}")
    return mapping.maps()[0]


def localize_bag(
    path: Path | str,
    long_term: HeightMap,
    params: Params | None = None,
    *,
    initial: ArrayLike | None = None,
    odom_topic: str | None = None,
    scan_topics: Sequence[str] = (),
    cloud_topics: Sequence[str] = (),
) -> list[tuple[int, se3.Matrix]]:
    """Localize the drive of a bag in a map, as ``heightmap25d localize`` does.

    Parameters
    ----------
    path : Path or str
        Its directory, or a single .db3 or .mcap file.
    long_term : HeightMap
    params : Params, optional
    initial : (4,) float, optional
        x, y, z [m], yaw [rad] of the robot in the map at the first odometry; by default ``odom``
        and the map are the same.
    odom_topic : str, optional
        Of the 3-D poses, see `pose_topic`; by default of ``intake.pose_source``, ``/odom`` or the
        only one.
    scan_topics : sequence of str, optional
        The lasers.
    cloud_topics : sequence of str, optional
        The 3-D lidars and depth cameras. By default all LaserScan topics are used, or all
        PointCloud2 topics of a bag that has no lasers.

    Returns
    -------
    list of (int, (4, 4) float64)
        Stamp [ns] and pose of the robot in the map at each odometry.

    Raises
    ------
    InputError
        If the bag or a topic is missing or damaged, or nothing could be registered.
    ValueError
        If ``initial`` is not four finite numbers.

    Examples
    --------
    >>> long_term = map_bag("bags/room_1", odom_topic="/ground_truth")  # doctest: +SKIP
    >>> trajectory = localize_bag("bags/room_1", long_term)  # doctest: +SKIP
    """
    with Bag(path) as bag:
        settings, odom_topic = _checked(bag, params, odom_topic, (scan_topics, cloud_topics))
        localizer = Localizer(settings)
        localizer.set_long_term(long_term)
        if initial is not None:
            localizer.begin_at(initial)
        trajectory: list[tuple[int, se3.Matrix]] = []
        attempts = 0
        for step in replayed(bag, localizer, odom_topic, settings.intake):
            attempts += len(step.outcomes)
            pose = localizer.pose
            if step.topic == odom_topic and pose is not None:
                trajectory.append((pose.stamp_ns, pose.T_map_base))
    if not attempts:
        raise InputError(f"{path}: nothing to register; {localizer.dropped}")
    return trajectory


def _checked(
    bag: Bag,
    params: Params | None,
    odom_topic: str | None,
    sources: tuple[Sequence[str], Sequence[str]],
) -> tuple[Params, str]:
    """The parameters with the lasers and lidars of this bag in them, and its topic of poses."""
    settings = with_sources(params or Params(), [bag], *sources)
    return settings, pose_topic(bag, odom_topic, settings.intake)[0]
