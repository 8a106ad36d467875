# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far a robot drives to explore a world, against a tour that knows the world beforehand.

Usage: python studies/measure_exploration.py [-o DIRECTORY] [--worlds W ...] [--seeds N ...]
       [--nearest | --drift]

Each run is that of `heightmap25d explore`, with true poses, and ends by itself. Covered is the
share of the true ground where the robot's middle may be, connected with the start, that is known
in the map: on all levels, where there are several. Besides these the tour is computed: places
chosen greedily from the true heights, until what a full turn shows from them covers the same share,
ordered by 2-opt; it ends at its last place.

--nearest runs the nearest frontier as well, by the rule of explore_lite (m-explore-ros2) with its
defaults, over the same mapper, planner and controller.

--drift runs it on drifting odometry, with localization in the map under construction
(``localization.own_map``): errors of the pose, and for how long it was confidently wrong.

F1 is of the blocked transitions of the map, after alignment with the truth where odometry drifts:
of each level, where there are two.

The directory (default: out/exploration) gets a JSON line for each run, and a picture of each.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import full_knowledge_tour
import numpy as np
from nearest_frontier import NearestFrontier

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.level_error import evaluate_levels
from heightmap25d_ros.evaluation.map_error import evaluate_map
from heightmap25d_ros.evaluation.path_drivability import evaluate_path
from heightmap25d_ros.evaluation.trajectory_error import (
    alignment,
    confidently_wrong,
    planar_errors,
)
from heightmap25d_ros.evaluation.truth import LevelTruth, TrueGround, Truth
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Geometry
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params import files
from heightmap25d_ros.pipelines.exploration_task import Task
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording, truth
from heightmap25d_ros.simulation.explored import SimulatedExploration
from heightmap25d_ros.simulation.simulation import Simulation
from heightmap25d_ros.terrain.slices import SurfaceStack
from heightmap25d_ros.viz import exploration_figures

ROOT = Path(__file__).resolve().parent.parent
CONFIG = ROOT / "config" / "atrvjr.yaml"
WORLDS, SEEDS = ("room", "ramp", "rough", "street"), (11, 12, 13)
SHARES = (0.9, 0.95)
SCAN_RATE, STEP = 12.5, 0.02  # [Hz], [s]
LONGEST = 3600.0  # [s], simulated
SAME_LEVEL = 0.35  # [m]
TOLERANCE = 2.0  # [m] of the planner, for goals of explore_lite, which lie in the unknown


class Run:
    """One exploration, and how much of the true ground was known along it."""

    def __init__(
        self, name, seed, params, explorer=None, distance_limit=0.0, *, has_drift=False
    ) -> None:
        self.world = recording.world_of(name, seed)
        (x0, x1), (y0, y1) = self.world.area
        task = replace(
            Task.of(params),
            boundary=Boundary.of([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]),
            distance_limit=distance_limit,
        )
        simulation = Simulation(
            self.world,
            seed,
            recording.noise_of(noise_free=False, true_odometry=not has_drift),
            recording.mounted_sensors(SCAN_RATE),
            step=STEP,
        )
        self.simulation = simulation
        self.params, self.task = params, task
        self.localizer = None
        if has_drift:
            self.localizer = Localizer(own_map_params(params.intake.scan_topics))
        self.explored = SimulatedExploration(simulation, params, task, explorer, self.localizer)
        self.height, self.reachable, _ = full_knowledge_tour.reachable_ground(self.world)
        self.geometry = Geometry(
            resolution=truth.RESOLUTION, origin=(x0, y0), shape=self.reachable.shape[1:]
        )
        self.cells = np.argwhere(self.reachable)
        self.centers = self.geometry.cell_center(self.cells[:, 1:])

    def known(self, height_map):
        """(N,): which of the reachable cells are known."""
        there = height_map.geometry.cell_at(self.centers)
        inside = height_map.geometry.contains(there)
        at, result = tuple(there[inside].T), np.zeros(len(there), bool)
        if not self.world.has_decks:
            result[inside] = height_map.known[at]
            return result
        stack = SurfaceStack(height_map, self.params.levels)
        tops = HEIGHT_RESOLUTION * stack.top[(slice(None), *at)]
        z = self.height[tuple(self.cells[inside].T)] - height_map.geometry.ground_zero
        result[inside] = (np.abs(tops - z) < SAME_LEVEL).any(axis=0)
        return result

    def covered(self, height_map):
        """Share of the reachable ground that is known."""
        return float(self.known(height_map).mean())

    def figures(self):
        """Run to the end."""
        began = time.process_time()
        self.explored.run(LONGEST)
        record, exploration = self.explored.record, self.explored.exploration
        curve = [(shot.distance, self.covered(shot.height_map)) for shot in record.snapshots]
        poses = np.array([T for _, T in record.trajectory])
        inside = self.task.boundary.mask(self.geometry)
        cells = self.geometry.cell_at(poses[:, :2, 3])
        found = {
            "end": exploration.end.name,
            "way_m": round(exploration.distance, 1),
            "time_s": round(self.simulation.seconds, 1),
            "covered": round(curve[-1][1], 4),
            "reachable_m2": round(len(self.cells) * truth.RESOLUTION**2, 1),
            "contacts": record.contacts,
            "is_inside": bool(inside[tuple(cells.T)].all()),
            "largest_step_m": round(self.largest_step(poses[::5]), 3),
            "given_up": len(exploration.given_up),
            "cpu_s": round(time.process_time() - began, 1),
        }
        if record.decision_s:
            found["decision_p95_ms"] = round(1e3 * float(np.percentile(record.decision_s, 95)), 1)
        found |= self.drift() if record.told else self.blocked_f1(np.eye(4))
        if self.world.has_decks:
            known = self.known(record.snapshots[-1].height_map)
            found["covered_by_level"] = [
                round(float(known[self.cells[:, 0] == level].mean()), 4)
                for level in range(len(self.height))
            ]
        for share in SHARES:
            reached = [way for way, covered in curve if covered >= share]
            found[f"way_to_{share:g}_m"] = round(reached[0], 1) if reached else None
        return found

    def largest_step(self, poses):
        """Under the robot's rectangle [m]; where a pose is on two levels, on the better one."""
        planner = self.params.planner
        cells = self.geometry.cell_at(poses[:, :2, 3])
        off = np.abs(self.height[(slice(None), *cells.T)] - poses[:, 2, 3])
        places = se3.to_xyz_rpy(poses)[:, [0, 1, 5]]
        steps = np.full(off.shape, np.inf)
        for level, height in enumerate(self.height):
            clearance = np.full(height.shape, np.inf)
            ground = TrueGround(geometry=self.geometry, height=height, clearance=clearance)
            for n in np.flatnonzero(off[level] < SAME_LEVEL):
                met = evaluate_path(
                    ground, places[n : n + 1], planner.robot_length, planner.robot_width
                )
                steps[level, n] = met.largest_step_m
        return float(steps.min(axis=0).max())

    def drift(self):
        """Errors of the told poses, and of the map against the true heights.

        Aligned is what is left after the shift and the yaw that bring the poses nearest to the
        true ones: the frame of a robot's own map begins as its first scans were seen. The map is
        aligned by where its submaps are in the end, since these have moved after poses were told.
        Confidently wrong is of poses as they are told, not aligned: their covariances are seen from
        where the robot started.
        """
        record = self.explored.record
        stamps = np.array([pose.stamp_ns for pose, _ in record.told])
        told = np.array([pose.T_map_base for pose, _ in record.told])
        true = interpolate(*map(np.array, zip(*record.trajectory, strict=True)), stamps)
        T_world_map = alignment(told, true)
        away = planar_errors(told, true)[:, 0]
        left = planar_errors(T_world_map @ told, true)[:, 0]
        return {
            "pose_end_m": round(away[-1], 3),
            "aligned_rmse_m": round(float(np.sqrt(np.mean(left**2))), 3),
            "aligned_largest_m": round(left.max(), 3),
            "aligned_end_m": round(left[-1], 3),
            "confidently_wrong_s": self.confidently_wrong(told, true),
            "turned_deg": round(float(np.degrees(se3.yaw(T_world_map))), 2),
            **self.blocked_f1(
                alignment(self.localizer.submap_poses(), np.array(record.submap_starts))
            ),
        }

    def blocked_f1(self, T_world_map):
        """Of the map's blocked transitions, of each level by itself where there are two."""
        height_map, _ = self.explored.mapping.maps()
        geometry, terrain = height_map.geometry, self.params.traversability
        if not self.world.has_decks:
            top = truth.tops_at(self.world, geometry, T_world_map)
            known = Truth(geometry=geometry, top=top, seen=top)
            found = evaluate_map(height_map, terrain, known)
            return {"blocked_f1": round(found.blocked_transitions.f1 or 0.0, 4)}
        tops = truth.levels_at(self.world, geometry, T_world_map)
        nothing = np.full(tops.shape, np.nan)
        known = LevelTruth(geometry=geometry, top=tops, seen=tops, clearance=nothing)
        found = evaluate_levels(height_map, self.params.levels, terrain, known)
        return {
            "blocked_f1_by_level": [
                round(level.blocked_transitions.f1 or 0.0, 4)
                for level in (found.lower, found.upper)
            ]
        }

    def confidently_wrong(self, told, true):
        """For how long [s] the pose was confidently wrong, while TRACKING."""
        covariances = np.array([pose.covariance[:2, :2] for pose, _ in self.explored.record.told])
        is_sure = [state is State.TRACKING for _, state in self.explored.record.told]
        is_wrong = is_sure & confidently_wrong(told, true, covariances)
        return round(float(is_wrong.mean()) * self.simulation.seconds, 1)

    def draw(self, path):
        record = self.explored.record
        driven = np.array([T[:2, 3] for _, T in record.trajectory])
        given_up = self.explored.exploration.given_up
        corners = self.task.boundary.corners
        exploration_figures.draw(path, record.snapshots, driven, corners, given_up, self.params)


def own_map_params(scan_topics):
    """Those of the node `localization`, which are not those of `mapping`."""
    params = files.read_yaml(CONFIG, "localization")
    return replace(
        params,
        intake=replace(params.intake, scan_topics=scan_topics),
        localization=replace(params.localization, own_map=True),
    )


def main() -> None:
    options = parser().parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    params = files.read_yaml(CONFIG, "mapping")
    topics = tuple(f"/{topic}" for topic in params.intake.scan_topics)
    params = replace(params, intake=replace(params.intake, scan_topics=topics))
    lines = options.output / "runs.jsonl"
    for name in options.worlds:
        for seed in options.seeds:
            run = Run(name, seed, params, has_drift=options.drift)
            method = "drift" if options.drift else "gain"
            found = {"world": name, "seed": seed, "method": method, **run.figures()}
            run.draw(options.output / f"{name}_{seed}.png")
            for share in (0.95, min(found["covered"], 0.99)):
                length, count = full_knowledge_tour.tour_length(run.world, share)
                key = "tour_to_0.95" if share == 0.95 else "tour_to_end"
                found |= {f"{key}_m": round(length, 1), f"{key}_places": count}
            report(found, lines)
            if options.nearest:
                nearest = replace(params, planner=replace(params.planner, goal_tolerance=TOLERANCE))
                limit = 4.0 * found["way_m"]
                run = Run(name, seed, nearest, NearestFrontier(nearest), limit)
                found = {"world": name, "seed": seed, "method": "nearest", **run.figures()}
                report(found, lines)


def report(found, path):
    with path.open("a") as lines:
        lines.write(json.dumps(found) + "\n")
    print(json.dumps(found), flush=True)


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(description="How far a robot drives to explore a world.")
    made.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "exploration")
    made.add_argument("--worlds", nargs="+", default=WORLDS)
    made.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    made.add_argument("--nearest", action="store_true", help="run the nearest frontier as well")
    made.add_argument(
        "--drift", action="store_true", help="odometry drifts: localization in the map that is made"
    )
    return made


if __name__ == "__main__":
    main()
