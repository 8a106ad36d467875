# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot is sent from one level to the other and back, on drifting odometry.

The long-term map is of another drive through the same world, with true poses. The robot knows where
it starts, and from there on what its wheels, its inclinometer and its lasers tell: localization,
planning and path following run in one process, by simulated time. Its goals are on the upper level,
below that place on the lower one, and where it started. A JSON line a seed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from level_drives import print_table

from heightmap25d_ros import se3
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.path_following import PathFollowing
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.simulation import messages, recording
from heightmap25d_ros.simulation.simulation import Simulation
from heightmap25d_ros.terrain.slices import SurfaceStack

SCAN_RATE, STEP = 12.5, 0.02  # [Hz], [s]
PATIENCE = 180.0  # [s], simulated, for a goal
REACHED = 0.25  # [m]
TOPICS = ("/scan", "/scan_down")
PLACES = {"overpass": (13.8, 0.0), "garage": (12.0, 5.3)}
"""[m], below a deck and on it."""


class Robot:
    """All that drives: each step takes the messages of the simulation, and gives velocities."""

    def __init__(self, simulation, height_map, layers, params) -> None:
        self.simulation = simulation
        self.localizer, self.planning = Localizer(params), Planning(params)
        self.following = PathFollowing(params)
        self.localizer.set_long_term(height_map, layers)
        self.localizer.begin_at([0.0, 0.0, 0.0, 0.0])
        self.planning.set_map(height_map)
        self.following.set_map(height_map)
        self.velocity, self.contacts, self.refusal = (0.0, 0.0), 0, ""
        self.true, self.errors, self.alone, self.faults = [], [], 0.0, set()
        self._was_blocked = False
        self._take(simulation.begin())

    def drive_to(self, goal):
        """Whether the robot comes to (x, y, z) [m]."""
        T = se3.from_xyz_rpy([*goal, 0.0, 0.0, 0.0])
        stamped = Odometry(stamp_ns=0, frame_id="map", child_frame_id="goal", T=T)
        self._follow(self.planning.set_goal(stamped))
        end = self.simulation.seconds + PATIENCE
        while self.simulation.seconds < end and not self.refusal:
            self._take(self.simulation.step(*self.velocity))
            is_blocked = self.simulation.robot.is_blocked
            self.contacts += is_blocked and not self._was_blocked
            self._was_blocked = is_blocked
            at = self.simulation.robot.T[:3, 3]
            if not self.following.has_path and np.linalg.norm(at - goal) < REACHED:
                return True
        return False

    def _take(self, events):
        for _, topic, message in events:
            if topic == "/odom":
                self._localize(message)
            elif topic == "/tf_static":
                self.localizer.take_transforms(message, is_static=True)
            elif topic in TOPICS:
                self.localizer.take_scan(topic, message)

    def _localize(self, odometry):
        self.localizer.take_odometry(odometry)
        pose, true = self.localizer.pose, self.simulation.robot.T
        correction = messages.correction(self.simulation.seconds, "map", pose.T_map_odom)
        self.planning.take_correction(correction)
        self.following.take_correction(correction)
        self._follow(self.planning.take_odometry(odometry))
        velocity = self.following.take_odometry(odometry)
        self.velocity = velocity.speed, velocity.turn_rate
        self.faults |= {self.following.fault} - {""}
        self.true.append(true[:3, 3])
        self.errors.append(pose.T_map_base[:3, 3] - true[:3, 3])
        wheels = se3.inverse(pose.T_map_odom) @ pose.T_map_base
        self.alone = float(np.linalg.norm((wheels - true)[:2, 3]))

    def _follow(self, plan):
        if plan is None:
            return
        self.refusal = "" if plan.found else plan.reason
        heading = np.arctan2(plan.poses[:, 1, 0], plan.poses[:, 0, 0])
        self.following.set_path(np.column_stack([plan.poses[:, :2, 3], heading]))


def drives(folder, seeds, params):
    """Drives to the upper level, below that place, and back to the start."""
    print_table(
        "world, seed", "goals reached", "driven", "highest", "contacts", "halted",
        "odometry alone: end", "RMSE", "largest", "z RMSE",
    )  # fmt: skip
    params = replace(params, intake=replace(params.intake, scan_topics=TOPICS))
    for world in PLACES:
        for seed in seeds:
            print(f"| `{world}`, {seed} | {run(world, seed, params, folder)}", flush=True)


def run(name, seed, params, bags):
    """The figures of a drive through the world of a seed."""
    bag = bags / f"{name}_{seed}_drive1"
    if not bag.exists():
        recording.simulate(name, seed, bag, drive=1)
    mapping = Mapping(params)
    with Bag(bag) as opened:
        for _ in replayed(opened, mapping, "/ground_truth", params.intake):
            pass
    mapping.flush()
    height_map = mapping.maps()[0]
    simulation = Simulation(
        recording.world_of(name, seed),
        [seed, 2],
        recording.noise_of(noise_free=False, true_odometry=False),
        recording.mounted_sensors(SCAN_RATE),
        step=STEP,
    )
    robot = Robot(simulation, height_map, mapping.layers(height_map.geometry), params)
    reached = [robot.drive_to(goal) for goal in goals_in(height_map, PLACES[name], params)]
    true, errors = np.array(robot.true), np.array(robot.errors)
    away = np.hypot(errors[:, 0], errors[:, 1])
    return (
        f"{sum(reached)} of {len(reached)}{robot.refusal and f' ({robot.refusal})'} | "
        f"{np.linalg.norm(np.diff(true, axis=0), axis=1).sum():.1f} m | {true[:, 2].max():.2f} m | "
        f"{robot.contacts} | {', '.join(sorted(robot.faults)) or '-'} | {robot.alone:.2f} m | "
        f"{np.sqrt(np.mean(away**2)):.3f} m | {away.max():.3f} m | "
        f"{np.sqrt(np.mean(errors[:, 2] ** 2)):.3f} m |"
    )


def goals_in(height_map, place, params):
    """On the deck at a place (x, y), below it, and at the start."""
    stack = SurfaceStack(height_map, params.levels, params.traversability)
    high = stack.surface_at(*place, 10.0)
    low = stack.surface_at(*place, None)
    return [(*place, stack.z_of(high)), (*place, stack.z_of(low)), (0.0, 0.0, 0.0)]
