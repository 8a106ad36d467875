# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters themselves, in sections: default, unit, range and meaning, one line each.

One frozen section for each class of the package that has parameters. `files` generates
``config/heightmap25d.yaml`` and the table of docs/interface.md from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.spec import Section, Value, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class GridParams(Section):
    """The grid of cells."""

    resolution: float = parameter(0.125, "side of a cell", "m", low=0.01, high=10.0)
    extent: float = parameter(
        4096.0, "side of the square around the start that can be mapped", "m", low=8.0, high=32768.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorParams(Section):
    """Which ranges are used, and the sensor model.

    The four likelihoods are pairs, at range 0 and at ``max_range``. Every parameter may be set for
    one source alone, see module `sources`.
    """

    min_range: float = parameter(
        0.0, "returns at a shorter range (the robot's own body) are ignored", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    body_box: tuple[float, ...] = parameter(
        (), "x, y, z of two opposite corners of a box in base_link: returns in it are from the "
        "robot's own body, and are ignored; empty: none", "m", low=-100.0, high=100.0,
    )  # fmt: skip
    max_range: float = parameter(
        30.0, "returns at a longer range clear cells up to this range, and mark none", "m",
        low=0.5, high=200.0,
    )  # fmt: skip
    no_return: str = parameter(
        "rep117",
        "ranges that mean no return: rep117: +inf; and besides, zero: 0; range_max: range_max and "
        "more; out_of_range: range_max and more, range_min and less (Nav2's inf_is_valid)",
        choices=("rep117", "zero", "range_max", "out_of_range"),
    )
    clearing_range: float = parameter(
        10.0, "a beam without return clears cells up to this range", "m", low=0.0, high=200.0
    )
    min_height: float = parameter(
        -5.0, "returns below this height above base_link are not mapped", "m",
        low=-327.0, high=327.0,
    )  # fmt: skip
    max_height: float = parameter(
        1.5, "returns above this height above base_link (ceilings) are not mapped", "m",
        low=-327.0, high=327.0,
    )  # fmt: skip
    hit_given_object: tuple[float, ...] = parameter(
        (0.80, 0.60), "P(s|O): likelihood of a return from an occupied cell", low=0.01, high=0.99
    )
    hit_given_empty: tuple[float, ...] = parameter(
        (0.20, 0.40), "P(s|not O): likelihood of a return from an empty cell", low=0.01, high=0.99
    )
    miss_given_object: tuple[float, ...] = parameter(
        (0.30, 0.45), "P(miss|O): likelihood that a beam passes an occupied cell",
        low=0.01, high=0.99,
    )  # fmt: skip
    miss_given_empty: tuple[float, ...] = parameter(
        (0.70, 0.55), "P(miss|not O): likelihood that a beam passes an empty cell",
        low=0.01, high=0.99,
    )  # fmt: skip
    error_growth: str = parameter(
        "linear",
        "how the likelihoods go from range 0 to max_range: linear; quadratic: with the square of "
        "the range, as the error of a depth camera does",
        choices=("linear", "quadratic"),
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        for name in _LIKELIHOODS:
            if len(getattr(self, name)) != 2:
                raise InputError(
                    f"parameter sensor.{name}: needs two numbers, at 0 m and at max_range"
                )
        if len(self.body_box) not in (0, 6):
            raise InputError(
                f"parameter sensor.body_box: {len(self.body_box)} numbers; needs six, x, y, z of "
                "two corners, or none"
            )
        if self.min_height >= self.max_height:
            raise InputError("parameter sensor.min_height: must be below max_height")
        if any(o <= e for o, e in zip(self.hit_given_object, self.hit_given_empty, strict=True)):
            raise InputError("parameter sensor.hit_given_object: must exceed hit_given_empty")
        if any(o >= e for o, e in zip(self.miss_given_object, self.miss_given_empty, strict=True)):
            raise InputError("parameter sensor.miss_given_object: must be below miss_given_empty")


_LIKELIHOODS = ("hit_given_object", "hit_given_empty", "miss_given_object", "miss_given_empty")


@dataclass(frozen=True, slots=True, kw_only=True)
class MapperParams(Section):
    """The update of a cell from a reading."""

    update_rule: str = parameter(
        "candidate",
        "paper: the literal rule; candidate: a higher reading must be confirmed by a second one",
        choices=("candidate", "paper"),
    )
    height_tolerance: float = parameter(
        0.10, "T: a reading within this distance of the stored height confirms it", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    probability_threshold: float = parameter(
        0.50, "cells of a lower probability are unknown", low=0.01, high=0.99
    )
    probability_min: float = parameter(
        0.02, "lower limit of the probability of an observed cell", low=0.0, high=0.5
    )
    probability_max: float = parameter(
        0.98, "upper limit of the probability, below 1 so that every cell can change",
        low=0.5, high=1.0,
    )  # fmt: skip
    replace_belief: float = parameter(
        0.50, "least P(s|O) of a higher reading that replaces the stored height", low=0.0, high=1.0
    )
    candidate_belief: float = parameter(
        0.85, "candidate: probability at which it replaces the stored height", low=0.0, high=1.0
    )
    clearing_margin: float = parameter(
        0.05, "candidate: a beam clears only heights at least this far above it", "m",
        low=0.0, high=1.0,
    )  # fmt: skip
    clearing_fall: float = parameter(
        0.25,
        "candidate: a beam that falls or rises by less than this from end to end needs a smaller "
        "margin; a level one clears also the height at which it passes; 0: no such exception", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    clearing_width: float = parameter(
        0.5, "candidate: a beam clears only cells whose centre is in a strip of this width",
        "cells", low=0.0, high=3.0,
    )  # fmt: skip
    lone_return: float = parameter(
        0.15,
        "candidate: a return farther than this from those of its neighbouring beams is an "
        "outlier; 0: no outlier rejection", "m",
        low=0.0, high=100.0,
    )  # fmt: skip
    height_allowance: float = parameter(
        0.01,
        "candidate: subtracted from a reading in eq. (3), against the bias of a running maximum",
        "m", low=0.0, high=1.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if not self.probability_min < self.probability_threshold < self.probability_max:
            raise InputError(
                "parameter mapper.probability_threshold: must lie between probability_min and "
                "probability_max"
            )
        if self.candidate_belief > self.probability_max:
            raise InputError("parameter mapper.candidate_belief: must not exceed probability_max")


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelsParams(Section):
    """Several surfaces in a cell, one above the other: bridges, gates, decks."""

    max_surfaces: int = parameter(
        3, "surfaces that a cell may hold one above the other; 1: only the lowest, as in the paper",
        low=1, high=8,
    )  # fmt: skip
    clear_height: float = parameter(
        0.70, "clear height that the robot needs: a surface at least this far above another one is "
        "a level of its own, what is nearer stands on it", "m",
        low=0.11, high=100.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class TraversabilityParams(Section):
    """Limits of what the robot can drive over."""

    max_step: float = parameter(
        0.10, "largest height difference between neighbouring cells that the robot climbs", "m",
        low=0.01, high=10.0,
    )  # fmt: skip
    max_slope: float = parameter(
        0.44, "steepest slope of the ground under the footprint that the robot climbs", "rad",
        low=0.01, high=1.5,
    )  # fmt: skip
    max_roughness: float = parameter(
        0.05, "rms distance of the ground from its plane at which the cost is highest", "m",
        low=0.001, high=10.0,
    )  # fmt: skip
    drop_offs: str = parameter(
        "may",
        "unknown cells behind an edge that are closed as suspected drop-offs until they are seen: "
        "those whose ground must be too low to drive on, those too whose ground may be, or none",
        choices=("must", "may", "none"),
    )
    robot_radius: float = parameter(
        0.50, "radius of the disc that covers the robot", "m", low=0.0, high=5.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerParams(Section):
    """The cost of a path, in metres of flat open ground, and what it may cross."""

    climb_weight: float = parameter(
        2.0, "cost of one metre of ascent, besides its length", low=0.0, high=50.0
    )
    descent_weight: float = parameter(
        1.0, "cost of one metre of descent, besides its length", low=0.0, high=50.0
    )
    cross_slope_weight: float = parameter(
        3.0, "cost per metre across a slope, times its tangent, besides its length",
        low=0.0, high=50.0,
    )  # fmt: skip
    roughness_weight: float = parameter(
        1.0, "cost per metre on ground of traversability.max_roughness, besides its length",
        low=0.0, high=50.0,
    )  # fmt: skip
    clearance_weight: float = parameter(
        1.0, "cost per metre beside an obstacle, where the robot just fits, besides its length",
        low=0.0, high=50.0,
    )  # fmt: skip
    clearance: float = parameter(
        0.4, "distance beyond robot_radius from which on obstacles add no cost", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    unknown: str = parameter(
        "forbid", "whether paths over unknown cells are forbidden, or cost more",
        choices=("forbid", "cost"),
    )  # fmt: skip
    unknown_weight: float = parameter(
        2.0, "unknown: cost: cost per metre over unknown cells, besides its length",
        low=0.0, high=50.0,
    )  # fmt: skip
    unknown_margin: float = parameter(
        0.2, "unknown: forbid: distance that the robot's centre keeps from unknown cells", "m",
        low=0.0, high=5.0,
    )  # fmt: skip
    max_gap: float = parameter(
        0.25, "unknown gaps between known cells up to this width are filled with ground", "m",
        low=0.0, high=2.0,
    )  # fmt: skip
    goal_tolerance: float = parameter(
        0.0, "an unreachable goal is replaced by the nearest reachable cell within this distance",
        "m", low=0.0, high=10.0,
    )  # fmt: skip
    robot_length: float = parameter(0.78, "length of the footprint, along x", "m", low=0, high=10)
    robot_width: float = parameter(0.64, "width of the footprint, along y", "m", low=0, high=10)
    timeout: float = parameter(2.0, "planning fails after this time", "s", low=0.01, high=600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class IntakeParams(Section):
    """Which messages are used, and how long a scan waits for its poses."""

    scan_topics: tuple[str, ...] = parameter(
        ("scan",), "LaserScan topics, one per laser; none by default where cloud_topics are given",
    )  # fmt: skip
    mounts: tuple[float, ...] = parameter(
        (), "x, y, z, roll, pitch, yaw of each laser in base_link; empty: from /tf", "m, rad"
    )
    cloud_topics: tuple[str, ...] = parameter(
        (), "PointCloud2 topics, one per 3-D lidar or depth camera", entries=str
    )
    cloud_mounts: tuple[float, ...] = parameter(
        (), "x, y, z, roll, pitch, yaw of each of these in base_link; empty: from /tf", "m, rad"
    )
    base_frame: str = parameter("base_link", "frame of the robot")
    pose_source: str = parameter(
        "odometry",
        "type of the robot's poses on odom: Odometry, PoseStamped (pose) or "
        "PoseWithCovarianceStamped; tf: odom_frame to base_frame on /tf, without a topic",
        choices=("odometry", "tf", "pose", "pose_with_covariance"),
    )  # fmt: skip
    odom_frame: str = parameter("odom", "pose_source: tf: frame in which the robot's poses are")
    odom_gap: float = parameter(
        1.0, "no interpolation between poses that are farther apart than this", "s",
        low=0.001, high=60.0,
    )  # fmt: skip
    wait_limit: float = parameter(
        1.0, "a scan is dropped when its poses have not arrived after this time", "s",
        low=0.0, high=60.0,
    )  # fmt: skip
    timeout: float = parameter(
        1.0,
        "odometry, a laser or localization from which nothing usable comes for longer is silent: "
        "the pose is DEGRADED, the plan stale, or mapping pauses", "s",
        low=0.05, high=3600.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        for name, topics, mounts in (
            ("scan_topics", self.scan_topics, "mounts"),
            ("cloud_topics", self.cloud_topics, "cloud_mounts"),
        ):
            if not all(topics) or len(set(topics)) < len(topics):
                raise InputError(f"parameter intake.{name}: a topic is empty or named twice")
            given = len(getattr(self, mounts))
            if given and given != 6 * len(topics):
                raise InputError(
                    f"parameter intake.{mounts}: {given} numbers for {len(topics)} {name}; needs "
                    "six for each, or none"
                )
        both = set(self.scan_topics) & set(self.cloud_topics)
        if both:
            raise InputError(f"parameter intake.cloud_topics: {min(both)} is in scan_topics too")

    @property
    def source_topics(self) -> tuple[str, ...]:
        """The topics of all lasers, 3-D lidars and depth cameras."""
        return self.scan_topics + self.cloud_topics


@dataclass(frozen=True, slots=True, kw_only=True)
class CloudParams(Section):
    """How many of the returns of a point cloud are used; may be set for one source alone."""

    step: int = parameter(
        1, "every so many points of a ring or row are used, of a cloud without these of all",
        low=1, high=1000,
    )  # fmt: skip
    voxel_size: float = parameter(
        0.0, "one return of each cube of this side, in the frame of the sensor, is used; 0: all",
        "m", low=0.0, high=10.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryParams(Section):
    """Which motion between two poses of the odometry is plausible; anything faster is a jump."""

    max_speed: float = parameter(
        25.0, "highest plausible speed; the lower, the smaller the jumps that are noticed", "m/s",
        low=0.1, high=1e6,
    )  # fmt: skip
    max_climb_rate: float = parameter(
        5.0, "highest plausible change of z per second", "m/s", low=0.1, high=1e6
    )
    max_turn_rate: float = parameter(
        6.0, "highest plausible change of the yaw per second", "rad/s", low=0.1, high=1e6
    )
    max_tilt_rate: float = parameter(
        4.0, "highest plausible change of roll and pitch per second", "rad/s", low=0.1, high=1e6
    )
    position_tolerance: float = parameter(
        0.2, "added to what the limits allow: noise of positions and stamps", "m",
        low=0.001, high=100.0,
    )  # fmt: skip
    angle_tolerance: float = parameter(
        0.1, "added to what the limits allow: noise of angles and stamps", "rad",
        low=0.001, high=3.1416,
    )  # fmt: skip
    bridge_time: float = parameter(
        0.25,
        "a jump between two poses closer than this is bridged: the robot has not moved, the "
        "odometry started anew; after a longer time its pose is unknown", "s",
        low=0.0, high=60.0,
    )  # fmt: skip
    spike_time: float = parameter(
        0.3,
        "how long poses that leave the motion wait for it to go on where it was left, and are "
        "skipped then; 0: they do not wait", "s",
        low=0.0, high=0.9,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingParams(Section):
    """The mapping node."""

    map_frame: str = parameter("map", "frame_id of published messages")
    publish_rate: float = parameter(
        2.0, "highest rate at which maps are published", "Hz", low=0.05, high=50.0
    )
    start_radius: float = parameter(
        0.0,
        "a new map begins with flat ground of this radius around the robot, which no laser "
        "sees; readings replace it; 0: no such ground", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    publish_transform: bool = parameter(
        True, "whether map -> odom is published on /tf while nobody else publishes it"
    )
    needs_localization: bool = parameter(
        False,
        "nothing is mapped until localization has told how sure the pose is, and map -> odom is "
        "left to it",
    )
    max_cells: float = parameter(
        32e6,
        "a map whose bounding box has more cells is published and saved without what is far off "
        "and small",
        low=256, high=1e9,
    )  # fmt: skip
    slice: str = parameter(
        "robot",
        "level of map and cost_map, where surfaces lie one above the other: that on which the "
        "robot is, followed along the surface; the highest or the lowest one of each cell",
        choices=("robot", "top", "lowest"),
    )
    localization_layers: bool = parameter(
        True, "whether the map keeps mean heights and places of returns, which localization uses"
    )
    map_directory: str = parameter("maps", "directory of the maps of save_map and load_map")
    initial_map: str = parameter("", "name of the map that is loaded at the start; empty: none")
    autosave: str = parameter(
        "",
        "name under which an unsaved map is saved when the node shuts down; empty: it is not "
        "saved",
    )  # fmt: skip

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if not self.map_frame:
            raise InputError("parameter mapping.map_frame: is empty")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningParams(Section):
    """The planning node."""

    replan_gain: float = parameter(
        0.2, "a valid path is replaced by a new one that is cheaper by this share",
        low=0.0, high=1.0,
    )  # fmt: skip
    replan_angle: float = parameter(
        1.0, "the robot has left the path when it moves at a larger angle to the best direction",
        "rad", low=0.4, high=3.14,
    )  # fmt: skip
    goal_reached: float = parameter(
        0.3, "the goal is reached within this distance, and planning ends", "m", low=0.0, high=10.0
    )
    planner_ids: tuple[str, ...] = parameter(
        ("GridBased",), "names that Nav2's actions may call this planner by; no name is right, too"
    )
    speed_limit_ahead: float = parameter(
        0.0,
        "speed_limit of Nav2's controllers follows from the ground this far ahead along the path; "
        "0: none is published", "m",
        low=0.0, high=50.0,
    )  # fmt: skip
    gentle_slope: float = parameter(
        0.1, "the speed is not limited up to this slope, and to least_speed at max_slope", "rad",
        low=0.0, high=1.5,
    )  # fmt: skip
    gentle_roughness: float = parameter(
        0.02,
        "the speed is not limited up to this roughness, and to least_speed at max_roughness", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    least_speed: float = parameter(
        0.3, "share of its full speed at which the robot drives over the worst and unknown ground",
        low=0.05, high=1.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ShortTermParams(Section):
    """Short-term maps, by the distance travelled; a radian of turning counts as half a metre."""

    length: float = parameter(
        2.0, "distance travelled after which a map is replaced by the next one", "m",
        low=0.2, high=100.0,
    )  # fmt: skip
    maps: int = parameter(
        2, "number of maps that are kept at a time, of staggered age", low=1, high=10
    )
    mature_distance: float = parameter(
        0.4, "distance travelled after which a map is registered", "m", low=0.0, high=100.0
    )
    mature_time: float = parameter(
        5.0, "time after which a map is registered, for a robot that does not move", "s",
        low=0.0, high=600.0,
    )  # fmt: skip
    mature_cells: int = parameter(
        150, "least number of known cells of a map that is registered", low=10
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistrationParams(Section):
    """Registration of a short-term map against the long-term map."""

    method: str = parameter(
        "robust",
        "paper: the literal method; robust: clipped cost, z eliminated, sub-cell accuracy",
        choices=("robust", "paper"),
    )
    clip: float = parameter(0.3, "largest cost of a difference in height", "m", low=0.01, high=10.0)
    unknown: float = parameter(
        1.0, "cost of a point over an unknown cell, as a share of clip", low=0.0, high=1.0
    )
    edge_step: float = parameter(
        0.15,
        "cells that are this much higher than a neighbour are edges: only their position is "
        "compared", "m",
        low=0.01, high=10.0,
    )  # fmt: skip
    search_points: int = parameter(600, "number of points that the search uses", low=50)
    window_distance: float = parameter(
        3.0, "largest offset from the prior that is searched", "m", low=0.1, high=50.0
    )
    window_angle: float = parameter(
        0.8, "largest yaw offset from the prior that is searched", "rad", low=0.01, high=3.1416
    )
    z_range: float = parameter(1.0, "largest error of z, up and down", "m", low=0.05, high=50.0)
    min_overlap: float = parameter(
        0.5, "share of the points over known cells below which a registration is rejected",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_residual: float = parameter(
        0.06, "mean cost of a point above which a registration is rejected", "m", low=0.0, high=10.0
    )
    max_ratio: float = parameter(
        0.85,
        "ratio to the score of the second-best minimum above which a registration is rejected",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_search_ratio: float = parameter(
        0.7, "the same ratio for a search of the whole map", low=0.01, high=1.0
    )
    search_margin: float = parameter(
        0.015,
        "difference of two scores that noise makes: places of the whole map within it are the same",
        "m", low=0.0, high=1.0,
    )  # fmt: skip
    search_nodes: int = parameter(
        100_000_000, "number of nodes after which a search of the whole map ends in vain", low=1
    )
    search_memory: int = parameter(
        1000, "memory that a search of the whole map may take", "MB", low=1
    )
    max_deviation: float = parameter(
        4.0, "standard deviations from the prior beyond which a registration is rejected",
        low=0.5, high=100.0,
    )  # fmt: skip
    min_curvature: float = parameter(
        0.005,
        "increase of the score one cell away, per clip, below which a direction is not observed",
        low=0.0, high=1.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizationParams(Section):
    """Localization on the long-term map."""

    interval: float = parameter(
        0.25, "distance travelled from one registration to the next", "m", low=0.05, high=50.0
    )
    initial_position: float = parameter(
        0.3, "standard deviation of x and y at the start", "m", low=0.01, high=10.0
    )
    initial_yaw: float = parameter(
        0.1, "standard deviation of the yaw at the start", "rad", low=0.001, high=3.1416
    )
    position_drift: float = parameter(
        0.08, "standard deviation that a metre travelled adds to x and y", "m", low=0.0, high=1.0
    )
    yaw_drift: float = parameter(
        0.01, "standard deviation that a metre travelled adds to the yaw", "rad", low=0.0, high=1.0
    )
    confirmations: int = parameter(
        2, "accepted registrations in a row after which the state is TRACKING", low=1, high=100
    )
    degraded_refusals: int = parameter(
        3, "contradictions in a row after which the state is DEGRADED", low=1, high=1000
    )
    degraded_deviation: float = parameter(
        0.3, "standard deviation of the position above which the state is DEGRADED", "m",
        low=0.01, high=100.0,
    )  # fmt: skip
    lost_refusals: int = parameter(
        10, "contradictions in a row after which the state is LOST", low=1, high=1000
    )
    relocalize_when_lost: bool = parameter(
        True, "whether the whole map is searched when the state is LOST"
    )
    correction_speed: float = parameter(
        0.2, "highest speed at which the published transform follows a correction", "m/s",
        low=0.001, high=100.0,
    )  # fmt: skip
    correction_turn: float = parameter(
        0.2, "highest turn rate at which the published transform follows a correction", "rad/s",
        low=0.001, high=100.0,
    )  # fmt: skip
    transform_rate: float = parameter(
        20.0, "rate at which map -> odom is published on /tf", "Hz", low=1.0, high=200.0
    )
    transform_tolerance: float = parameter(
        0.1, "how far that transform is post-dated", "s", low=0.0, high=10.0
    )
    map_directory: str = parameter(
        "", "directory of the long-term map; empty: from the topic long_term_grid"
    )
    own_map: bool = parameter(
        False, "localization on the map made so far (SLAM), which goes on from that of "
        "map_directory, if there is one; closed loops move the pose at once"
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanFilterParams(Section):
    """The scan-level filter, where the long-term map has localization layers."""

    enabled: bool = parameter(
        True, "false: only short-term maps are registered, as without localization layers"
    )
    interval: float = parameter(
        0.08, "distance from one update to the next", "m", low=0.01, high=1.0
    )
    min_returns: int = parameter(60, "returns without which it does not update", low=10)
    max_returns: int = parameter(1200, "returns of an update at most", low=50)
    wall_noise: float = parameter(
        0.02, "standard deviation of a return from its wall", "m", low=0.001, high=1.0
    )
    ground_noise: float = parameter(
        0.025, "standard deviation of a return from the ground", "m", low=0.001, high=1.0
    )
    tilt_noise: float = parameter(
        0.0052, "standard deviation of roll and pitch of the odometry", "rad",
        low=0.0001, high=0.5,
    )  # fmt: skip
    returns_per_information: float = parameter(
        8.0, "returns that tell as much as one of which the errors are independent",
        low=1.0, high=1000.0,
    )  # fmt: skip
    noise_weight: float = parameter(
        2.0, "information that noise of the map explains is subtracted so many times",
        low=0.0, high=10.0,
    )  # fmt: skip
    noise_caution: float = parameter(
        3.0, "and what is left is divided by 1 plus so many times its share", low=0.0, high=100.0
    )
    slip: float = parameter(
        0.055, "standard deviation of the wheels' slip, per distance, at the start",
        low=0.0, high=1.0,
    )  # fmt: skip
    slip_length: float = parameter(
        3.0, "distance over which slip persists", "m", low=0.1, high=100.0
    )
    distance_scale: float = parameter(
        0.01, "standard deviation of a constant error of the distance, per distance",
        low=0.0, high=1.0,
    )  # fmt: skip
    turn_scale: float = parameter(
        0.03, "standard deviation of a constant error of turns, per turn", low=0.0, high=1.0
    )
    turn_noise: float = parameter(
        0.02, "standard deviation that a radian of turning adds to the yaw, at the start", "rad",
        low=0.0, high=1.0,
    )  # fmt: skip
    heading_bias: float = parameter(
        0.02, "standard deviation of a constant turn of the heading, per distance", "rad/m",
        low=0.0, high=1.0,
    )  # fmt: skip
    position_drift: float = parameter(
        0.015, "standard deviation that a metre adds to x and y besides these", "m",
        low=0.0, high=1.0,
    )  # fmt: skip
    yaw_drift: float = parameter(
        0.006, "standard deviation that a metre adds to the yaw besides these", "rad",
        low=0.0, high=1.0,
    )  # fmt: skip
    z_drift: float = parameter(
        0.01, "standard deviation that a metre adds to z besides these", "m", low=0.0, high=1.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamParams(Section):
    """Maps without known poses."""

    submap_length: float = parameter(
        4.0, "distance travelled along which a submap is rigid, at most", "m", low=0.5, high=100.0
    )
    active_distance: float = parameter(
        40.0, "distance back along the drive and its loops that scans are held against", "m",
        low=1.0, high=100000.0,
    )  # fmt: skip
    reach: float = parameter(
        16.0, "distance from the robot within which returns are held against the map", "m",
        low=2.0, high=200.0,
    )  # fmt: skip
    refresh_distance: float = parameter(
        0.4, "distance travelled after which what has been mapped since is used", "m",
        low=0.05, high=10.0,
    )  # fmt: skip
    close_loops: bool = parameter(True, "search older submaps for the robot, and join them")
    max_drift: float = parameter(
        15.0, "farthest that the robot is searched from where it is expected", "m",
        low=0.5, high=1000.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplorationParams(Section):
    """Frontier exploration: where to look next, and when to end."""

    boundary: tuple[float, ...] = parameter(
        (), "x, y of the corners of the polygon, in the map, that the robot does not leave; empty: "
        "none", "m", low=-1e8, high=1e8,
    )  # fmt: skip
    min_gain: float = parameter(
        2.0, "area that a place must be expected to show, to be worth the way; without such a "
        "place the exploration is done", "m^2", low=0.01, high=1000.0,
    )  # fmt: skip
    time_limit: float = parameter(
        0.0, "the exploration ends after this time; 0: no limit", "s", low=0.0, high=1e6
    )
    distance_limit: float = parameter(
        0.0, "the exploration ends after this distance; 0: no limit", "m", low=0.0, high=1e6
    )
    return_home: bool = parameter(False, "whether the robot returns to where it started")
    start_at_once: bool = parameter(
        False, "whether the exploration starts with the first map and pose, without being asked"
    )
    frontiers_only: bool = parameter(
        False, "whether frontiers are published and no goals: for planners of your own"
    )
    sight: float = parameter(
        5.0, "distance up to which the ground is expected to be seen", "m", low=0.5, high=50.0
    )
    blind_radius: float = parameter(
        1.4, "distance up to which no sensor sees the ground on a turn on the spot", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    sensor_height: float = parameter(
        0.6, "height of the sensor that sees the ground, above the ground", "m",
        low=0.05, high=10.0,
    )  # fmt: skip
    frontier_depth: float = parameter(
        1.5, "unknown cells farther behind a frontier do not count", "m", low=0.1, high=50.0
    )
    spacing: float = parameter(
        0.5, "distance between the places that are compared", "m", low=0.05, high=5.0
    )
    distance_weight: float = parameter(
        0.15, "share of its gain that a place loses per metre of the way to it", "1/m",
        low=0.0, high=10.0,
    )  # fmt: skip
    keep_gain: float = parameter(
        0.3, "a goal is given up when less than this share of its gain is left", low=0.0, high=1.0
    )
    looks: int = parameter(
        2, "a cell that was looked for so often without being seen is not wanted any more; looks "
        "from within 3 m count twice", low=1, high=100,
    )  # fmt: skip
    stuck_timeout: float = parameter(
        20.0, "a goal is given up when the robot has not moved towards it for this time", "s",
        low=1.0, high=3600.0,
    )  # fmt: skip
    lost_timeout: float = parameter(
        120.0, "the exploration ends when the pose has been unknown for this time", "s",
        low=1.0, high=36000.0,
    )  # fmt: skip
    max_deviation: float = parameter(
        0.5, "standard deviation of the position from which on the robot first returns to a place "
        "that is well known", "m", low=0.01, high=100.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class PathFollowerParams(Section):
    """The controller that follows the plan: regulated pure pursuit."""

    stamped: bool = parameter(False, "whether cmd_vel is a TwistStamped; false: a Twist")
    max_speed: float = parameter(1.0, "highest speed", "m/s", low=0.01, high=10.0)
    min_speed: float = parameter(
        0.1, "lowest speed while the robot drives", "m/s", low=0.001, high=10.0
    )
    max_acceleration: float = parameter(
        0.8, "of speeding up and braking", "m/s^2", low=0.01, high=20.0
    )
    max_turn_rate: float = parameter(1.2, "highest turn rate", "rad/s", low=0.01, high=10.0)
    turn_rate_on_spot: float = parameter(0.7, "turn rate on the spot", "rad/s", low=0.01, high=10.0)
    max_turn_acceleration: float = parameter(2.5, "of turning", "rad/s^2", low=0.01, high=50.0)
    min_lookahead: float = parameter(
        0.4, "least distance to the point that is driven to", "m", low=0.05, high=10.0
    )
    max_lookahead: float = parameter(
        0.8, "largest distance to the point that is driven to", "m", low=0.05, high=10.0
    )
    lookahead_time: float = parameter(
        0.8, "distance to the point that is driven to, per speed", "s", low=0.0, high=10.0
    )
    curve_radius: float = parameter(
        0.7, "in curves with a smaller radius the robot is slower, in proportion", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    slope_stop: float = parameter(
        0.9, "slope at which the speed would reach 0, in proportion", "rad", low=0.05, high=10.0
    )
    slow_distance: float = parameter(
        0.3, "the robot is slower where obstacles are nearer to its disc, in proportion", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    turn_on_spot: float = parameter(
        0.8, "for a larger angle to the path the robot turns on the spot", "rad",
        low=0.2, high=3.2,
    )  # fmt: skip
    goal_tolerance: float = parameter(
        0.1, "distance to the end of the path at which it is reached", "m", low=0.01, high=5.0
    )
    yaw_tolerance: float = parameter(
        0.1, "angle to the heading at the end at which it is reached", "rad", low=0.01, high=3.2
    )
    max_offset: float = parameter(
        0.6, "the robot stops when it is farther from the path", "m", low=0.05, high=10.0
    )
    check_length: float = parameter(
        1.0, "so much of the path ahead must be free on the newest map", "m", low=0.0, high=20.0
    )
    timeout: float = parameter(
        0.5, "the robot stops after so long without odometry", "s", low=0.05, high=10.0
    )
    map_timeout: float = parameter(
        5.0, "and after so long without a map, where maps came again and again", "s",
        low=0.1, high=600.0,
    )  # fmt: skip
    localization_timeout: float = parameter(
        3.0, "and after so long without the status of localization, where there was one", "s",
        low=0.1, high=600.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        for low, high in (("min_speed", "max_speed"), ("min_lookahead", "max_lookahead")):
            if getattr(self, low) > getattr(self, high):
                raise InputError(f"parameter path_follower.{low}: is more than {high}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorParams(Section):
    """The simulator node."""

    world: str = parameter(
        "room", "simulated world",
        choices=(
            "ramp", "room", "rough", "street", "arch", "garage", "moving", "plain_ramp",
            "plain_street", "corridor", "court", "pillars", "twin_rooms", "overpass",
        ),
    )  # fmt: skip
    seed: int = parameter(1, "seed of the world's details and of the noise, from 0 on")
    rate: float = parameter(
        1.0, "speed in multiples of real time, as far as the machine can keep up",
        low=0.01, high=100.0,
    )  # fmt: skip
    scan_rate: float = parameter(37.5, "scan rate of each laser", "Hz", low=0.1, high=75.0)
    nodding: bool = parameter(False, "whether the robot carries a third, nodding laser")
    lidar_rings: int = parameter(
        0, "rings of a 3-D lidar in place of the lasers, from 8 on; 0: none", low=0, high=128
    )
    depth_camera: bool = parameter(
        False, "whether the robot carries a depth camera in place of the lasers"
    )
    true_odometry: bool = parameter(False, "whether odometry is free of errors")


@dataclass(frozen=True, slots=True, kw_only=True)
class Params:
    """All sections, and the parameters that belong to none.

    Examples
    --------
    >>> Params().grid.resolution
    0.125
    >>> params = Params(grid=GridParams(resolution=0.25))

    By the names of a parameter file:

    >>> from heightmap25d_ros.params.by_name import with_values
    >>> params = with_values(Params(), {"grid.resolution": 0.25, "mapper.update_rule": "paper"})
    """

    autostart: bool = parameter(
        True, "whether the node configures and activates itself; false: left to a lifecycle manager"
    )
    grid: GridParams = field(default_factory=GridParams)
    sensor: SensorParams = field(default_factory=SensorParams)
    mapper: MapperParams = field(default_factory=MapperParams)
    levels: LevelsParams = field(default_factory=LevelsParams)
    traversability: TraversabilityParams = field(default_factory=TraversabilityParams)
    planner: PlannerParams = field(default_factory=PlannerParams)
    intake: IntakeParams = field(default_factory=IntakeParams)
    cloud: CloudParams = field(default_factory=CloudParams)
    odometry: OdometryParams = field(default_factory=OdometryParams)
    mapping: MappingParams = field(default_factory=MappingParams)
    planning: PlanningParams = field(default_factory=PlanningParams)
    short_term: ShortTermParams = field(default_factory=ShortTermParams)
    registration: RegistrationParams = field(default_factory=RegistrationParams)
    localization: LocalizationParams = field(default_factory=LocalizationParams)
    scan_filter: ScanFilterParams = field(default_factory=ScanFilterParams)
    slam: SlamParams = field(default_factory=SlamParams)
    exploration: ExplorationParams = field(default_factory=ExplorationParams)
    path_follower: PathFollowerParams = field(default_factory=PathFollowerParams)
    simulator: SimulatorParams = field(default_factory=SimulatorParams)
    sources: Mapping[str, Mapping[str, Value]] = field(default_factory=dict, hash=False)
    """Source -> parameters (``sensor.max_range``) that differ for it, see module `sources`."""
