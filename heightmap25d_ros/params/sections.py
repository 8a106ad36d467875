# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every tunable number, once: default, unit, range and meaning.

One frozen section per module; the module takes its own section, the nodes declare ROS
parameters from it (``section.name``), and `parameter_file` writes ``config/heightmap25d.yaml``
and the table of docs/interface.md from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.spec import Section, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class GridParams(Section):
    """The lattice of cells."""

    resolution: float = parameter(0.125, "side of a cell", "m", low=0.01, high=10.0)
    extent: float = parameter(
        4096.0, "side of the square around the start that can be mapped", "m", low=8.0, high=32768.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorParams(Section):
    """From ranges to beams, and how far a beam is believed.

    The four likelihoods are pairs, at range 0 and at ``max_range``, linear in between.
    """

    min_range: float = parameter(
        0.0, "returns nearer than this (the robot's own body) are ignored", "m", low=0.0, high=10.0
    )
    max_range: float = parameter(
        30.0, "returns from farther away clear, but do not hit", "m", low=0.5, high=200.0
    )
    clearing_range: float = parameter(
        10.0, "how far a beam without return clears", "m", low=0.0, high=200.0
    )
    min_height: float = parameter(
        -5.0, "returns lower than this above base_link are not mapped", "m", low=-327.0, high=327.0
    )
    max_height: float = parameter(
        1.5, "returns higher than this above base_link (ceilings) are not mapped", "m",
        low=-327.0, high=327.0,
    )  # fmt: skip
    hit_given_object: tuple[float, ...] = parameter(
        (0.80, 0.60), "P(s|O): a return where there is an object", low=0.01, high=0.99
    )
    hit_given_empty: tuple[float, ...] = parameter(
        (0.20, 0.40), "P(s|not O): a return where there is none", low=0.01, high=0.99
    )
    miss_given_object: tuple[float, ...] = parameter(
        (0.30, 0.45), "P(miss|O): a beam passes where there is an object", low=0.01, high=0.99
    )
    miss_given_empty: tuple[float, ...] = parameter(
        (0.70, 0.55), "P(miss|not O): a beam passes where there is none", low=0.01, high=0.99
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        for name in _LIKELIHOODS:
            if len(getattr(self, name)) != 2:
                raise InputError(
                    f"parameter sensor.{name}: needs two numbers, at 0 m and at max_range"
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
    """The update of a cell."""

    update_rule: str = parameter(
        "candidate",
        "paper: literal; candidate: a higher reading waits beside the stored one for a second",
        choices=("candidate", "paper"),
    )
    height_tolerance: float = parameter(
        0.10, "T: readings this close to the stored height confirm it", "m", low=0.0, high=10.0
    )
    probability_threshold: float = parameter(
        0.50, "cells believed less than this are unknown", low=0.01, high=0.99
    )
    probability_min: float = parameter(
        0.02, "no observed cell is believed less than this", low=0.0, high=0.5
    )
    probability_max: float = parameter(
        0.98, "no cell is believed more than this, so that every cell can change", low=0.5, high=1.0
    )
    replace_belief: float = parameter(
        0.50, "P(s|O) that a higher reading needs to replace the stored one", low=0.0, high=1.0
    )
    candidate_belief: float = parameter(
        0.85, "candidate: belief at which it takes the stored height's place", low=0.0, high=1.0
    )
    clearing_margin: float = parameter(
        0.05, "candidate: a beam contradicts heights only this far above itself", "m",
        low=0.0, high=1.0,
    )  # fmt: skip
    clearing_width: float = parameter(
        0.5, "candidate: a beam contradicts a cell whose centre is in a strip this wide", "cells",
        low=0.0, high=3.0,
    )  # fmt: skip
    lone_return: float = parameter(
        0.15, "candidate: returns this far from what the beams beside see are ignored; 0: none",
        "m", low=0.0, high=100.0,
    )  # fmt: skip
    height_allowance: float = parameter(
        0.01, "candidate: eq. (3) raises a height to this far below the reading", "m",
        low=0.0, high=1.0,
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
class TraversabilityParams(Section):
    """What the robot can drive over."""

    max_step: float = parameter(
        0.10, "height difference of neighbouring cells that the robot climbs", "m",
        low=0.01, high=10.0,
    )  # fmt: skip
    max_slope: float = parameter(
        0.44, "slope of the ground under the footprint that the robot climbs", "rad",
        low=0.01, high=1.5,
    )  # fmt: skip
    max_roughness: float = parameter(
        0.05, "rms distance of the ground from its plane at which the cost is full", "m",
        low=0.001, high=10.0,
    )  # fmt: skip
    robot_radius: float = parameter(
        0.50, "radius of the disc that covers the robot", "m", low=0.0, high=5.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerParams(Section):
    """What a way costs, in metres of flat open ground, and what it may cross."""

    climb_weight: float = parameter(
        2.0, "metres on the flat that one metre up is worth besides its length", low=0.0, high=50.0
    )
    descent_weight: float = parameter(
        1.0, "metres on the flat that one metre down is worth besides its length",
        low=0.0, high=50.0,
    )  # fmt: skip
    cross_slope_weight: float = parameter(
        3.0, "of one metre on the flat, added per metre along a slope, times its tangent",
        low=0.0, high=50.0,
    )  # fmt: skip
    roughness_weight: float = parameter(
        1.0, "added per metre on ground of traversability.max_roughness", low=0.0, high=50.0
    )
    clearance_weight: float = parameter(
        1.0, "added per metre beside an obstacle, where the robot just fits", low=0.0, high=50.0
    )
    clearance: float = parameter(
        0.4, "distance beyond robot_radius at which obstacles cost nothing", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    unknown: str = parameter(
        "forbid", "whether ways over unknown cells are forbidden, or cost more",
        choices=("forbid", "cost"),
    )  # fmt: skip
    unknown_weight: float = parameter(
        2.0, "unknown: cost: added per metre over unknown cells", low=0.0, high=50.0
    )
    unknown_margin: float = parameter(
        0.2, "unknown: forbid: the robot's middle keeps this far from unknown cells", "m",
        low=0.0, high=5.0,
    )  # fmt: skip
    max_gap: float = parameter(
        0.25, "unknown gaps between known cells, up to this wide, are taken for ground", "m",
        low=0.0, high=2.0,
    )  # fmt: skip
    goal_tolerance: float = parameter(
        0.0, "a goal that cannot be reached is replaced by the nearest place within this", "m",
        low=0.0, high=10.0,
    )  # fmt: skip
    robot_length: float = parameter(0.78, "of the robot's rectangle, along x", "m", low=0, high=10)
    robot_width: float = parameter(0.64, "of the robot's rectangle, along y", "m", low=0, high=10)
    timeout: float = parameter(2.0, "a plan is given up after this", "s", low=0.01, high=600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class IntakeParams(Section):
    """Which messages are taken, and how long a scan waits for its poses."""

    scan_topics: tuple[str, ...] = parameter(("scan",), "LaserScan topics, one per laser")
    mounts: tuple[float, ...] = parameter(
        (), "x, y, z, roll, pitch, yaw of each laser in base_link; empty: from /tf", "m, rad"
    )
    base_frame: str = parameter("base_link", "the robot's frame")
    odom_gap: float = parameter(
        1.0, "poses farther apart than this are not interpolated", "s", low=0.001, high=60.0
    )
    wait_limit: float = parameter(
        1.0, "a scan is dropped when its poses have not come by then", "s", low=0.0, high=60.0
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if not all(self.scan_topics) or len(set(self.scan_topics)) < len(self.scan_topics):
            raise InputError("parameter intake.scan_topics: a topic is empty or named twice")
        if self.mounts and len(self.mounts) != 6 * len(self.scan_topics):
            raise InputError(
                f"parameter intake.mounts: {len(self.mounts)} numbers for "
                f"{len(self.scan_topics)} lasers; needs six for each, or none"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingParams(Section):
    """The mapping node."""

    map_frame: str = parameter("map", "frame_id of what is published")
    publish_rate: float = parameter(
        2.0, "most often that maps are published", "Hz", low=0.05, high=50.0
    )
    start_radius: float = parameter(
        0.0,
        "an empty map begins with flat ground this far around the robot, where no laser sees it; "
        "what is seen replaces it; 0: with nothing", "m", low=0.0, high=10.0,
    )  # fmt: skip
    max_cells: float = parameter(
        32e6, "a map whose bounding box has more cells is not published or saved", low=256, high=1e9
    )
    localization_layers: bool = parameter(
        True, "whether the map keeps mean heights and places of returns, which localization uses"
    )
    map_directory: str = parameter("maps", "where save_map and load_map keep their maps")
    initial_map: str = parameter("", "name of the map to begin with; empty: none")
    autosave: str = parameter(
        "", "name under which a map that is not saved is saved when the node ends; empty: it is not"
    )

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if not self.map_frame:
            raise InputError("parameter mapping.map_frame: is empty")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningParams(Section):
    """The planning node."""

    replan_gain: float = parameter(
        0.2, "a path that is still open is replaced by one that is cheaper by this share",
        low=0.0, high=1.0,
    )  # fmt: skip
    replan_angle: float = parameter(
        1.0, "the robot has left the path when it moves this far off the best direction", "rad",
        low=0.4, high=3.14,
    )  # fmt: skip
    goal_reached: float = parameter(
        0.3, "a goal this near is reached, and not planned to any more", "m", low=0.0, high=10.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ShortTermParams(Section):
    """Short-term maps; way counts turning as well, a radian as half a metre."""

    length: float = parameter(
        2.0, "way after which a map is given up for the next one", "m", low=0.2, high=100.0
    )
    maps: int = parameter(2, "how many there are at once, of staggered age", low=1, high=10)
    mature_way: float = parameter(0.4, "way after which a map is used", "m", low=0.0, high=100.0)
    mature_time: float = parameter(
        5.0, "or time: for a robot that stands", "s", low=0.0, high=600.0
    )
    mature_cells: int = parameter(150, "known cells without which it is not used", low=10)


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistrationParams(Section):
    """A short-term map against the long-term map."""

    method: str = parameter(
        "robust", "paper: literal; robust: clipped, z eliminated, below the size of a cell",
        choices=("robust", "paper"),
    )  # fmt: skip
    clip: float = parameter(
        0.3, "the most that a difference in height costs", "m", low=0.01, high=10.0
    )
    unknown: float = parameter(
        1.0, "part of clip that a point over an unknown cell costs", low=0.0, high=1.0
    )
    edge_step: float = parameter(
        0.15, "cells so much above a neighbour are edges: only their place is compared", "m",
        low=0.01, high=10.0,
    )  # fmt: skip
    search_points: int = parameter(600, "points that are used for the search", low=50)
    window_distance: float = parameter(
        3.0, "the search goes at most so far from the prior", "m", low=0.1, high=50.0
    )
    window_angle: float = parameter(0.8, "and turns at most so far", "rad", low=0.01, high=3.1416)
    z_range: float = parameter(
        1.0, "errors of z that are looked for, up and down", "m", low=0.05, high=50.0
    )
    min_overlap: float = parameter(
        0.5, "share of the points over known cells below which it is refused", low=0.0, high=1.0
    )
    max_residual: float = parameter(
        0.06, "mean cost of a point above which it is refused", "m", low=0.0, high=10.0
    )
    max_ratio: float = parameter(
        0.85, "score over that of the second-best basin above which it is refused",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_search_ratio: float = parameter(
        0.7, "the same for a search of the whole map", low=0.0, high=1.0
    )
    max_deviation: float = parameter(
        4.0, "standard deviations from the prior beyond which it is refused", low=0.5, high=100.0
    )
    min_curvature: float = parameter(
        0.005, "rise of the score one cell away, per clip, below which a direction is not observed",
        low=0.0, high=1.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizationParams(Section):
    """The pose over the long-term map."""

    interval: float = parameter(
        0.25, "way from one registration to the next", "m", low=0.05, high=50.0
    )
    initial_position: float = parameter(
        0.3, "standard deviation of x and y at the start", "m", low=0.01, high=10.0
    )
    initial_yaw: float = parameter(
        0.1, "standard deviation of the yaw at the start", "rad", low=0.001, high=3.1416
    )
    position_drift: float = parameter(
        0.08, "standard deviation that a metre of way adds to x and y", "m", low=0.0, high=1.0
    )
    yaw_drift: float = parameter(
        0.01, "standard deviation that a metre of way adds to the yaw", "rad", low=0.0, high=1.0
    )
    max_odom_step: float = parameter(
        0.5, "odometry that moves farther between two messages has jumped, the robot has not", "m",
        low=0.01, high=100.0,
    )  # fmt: skip
    confirmations: int = parameter(
        2, "registrations in a row that make the state TRACKING", low=1, high=100
    )
    degraded_refusals: int = parameter(
        3, "contradictions in a row after which the state is DEGRADED", low=1, high=1000
    )
    degraded_deviation: float = parameter(
        0.3, "or standard deviation of the position", "m", low=0.01, high=100.0
    )
    lost_refusals: int = parameter(
        10, "contradictions in a row after which the state is LOST", low=1, high=1000
    )
    relocalize_when_lost: bool = parameter(
        True, "whether the whole map is searched when the state is LOST"
    )
    correction_speed: float = parameter(
        0.2, "the published pose is corrected at most so fast", "m/s", low=0.001, high=100.0
    )
    correction_turn: float = parameter(
        0.2, "and turned at most so fast", "rad/s", low=0.001, high=100.0
    )
    transform_rate: float = parameter(
        20.0, "how often map -> odom is published on /tf", "Hz", low=1.0, high=200.0
    )
    transform_tolerance: float = parameter(
        0.1, "how far that transform is dated ahead", "s", low=0.0, high=10.0
    )
    map_directory: str = parameter(
        "", "directory of the long-term map; empty: from the topic long_term_grid"
    )


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
class SimulatorParams(Section):
    """The simulator node."""

    world: str = parameter(
        "room", "where the robot is",
        choices=("ramp", "room", "rough", "street", "arch", "garage", "moving"),
    )  # fmt: skip
    seed: int = parameter(1, "of the world's details and of the noise, from 0 on")
    rate: float = parameter(1.0, "times real time, where the machine can", low=0.01, high=100.0)
    scan_rate: float = parameter(37.5, "scans of each laser", "Hz", low=0.1, high=75.0)
    nodding: bool = parameter(False, "whether there is a third laser, which nods")
    true_odometry: bool = parameter(False, "whether odom is without errors")


@dataclass(frozen=True, slots=True, kw_only=True)
class Params:
    """All sections together, and what belongs to none."""

    autostart: bool = parameter(
        True, "whether the node configures and activates itself; false: a lifecycle manager does"
    )
    grid: GridParams = field(default_factory=GridParams)
    sensor: SensorParams = field(default_factory=SensorParams)
    mapper: MapperParams = field(default_factory=MapperParams)
    traversability: TraversabilityParams = field(default_factory=TraversabilityParams)
    planner: PlannerParams = field(default_factory=PlannerParams)
    intake: IntakeParams = field(default_factory=IntakeParams)
    mapping: MappingParams = field(default_factory=MappingParams)
    planning: PlanningParams = field(default_factory=PlanningParams)
    short_term: ShortTermParams = field(default_factory=ShortTermParams)
    registration: RegistrationParams = field(default_factory=RegistrationParams)
    localization: LocalizationParams = field(default_factory=LocalizationParams)
    scan_filter: ScanFilterParams = field(default_factory=ScanFilterParams)
    simulator: SimulatorParams = field(default_factory=SimulatorParams)
