# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot finds its way over a ramp and back on drifting odometry: a loop over DDS.

Usage: python studies/closed_loop.py [-o DIRECTORY] [--seed N] [--rate R] [--no-animation] [--json]

First a drive (of seed 1: bags/ramp_1) is mapped with its true poses: the long-term map. Then
`simulator`, `mapping`, `localization`, `planning` and `path_follower` run as processes of their
own, with config/atrvjr.yaml. The robot knows where it starts and from there on what its wheels, its
inclinometer and its lasers tell. It is sent down into the yard and, when it has arrived, back up to
the landing; all the while it goes on mapping, and plans on that map.

The directory (default: out/closed_loop) gets run.gif, driven.tum (the true poses), known.tum (those
that the robot took for true), the map at the end and summary.json. Another seed is another ramp
and yard, whose drive is simulated first. The exit status is 0 if the robot arrived at both goals.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import closed_loop_picture
import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_msgs.msg import HeightGrid, PlanStatus
from heightmap25d_msgs.srv import SaveMap
from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.evaluation.path_drivability import evaluate_path
from heightmap25d_ros.evaluation.truth import read_ground
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode, trajectory
from heightmap25d_ros.params.sections import PlannerParams, PlanningParams
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import messages, recording

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = ROOT / "install" / "heightmap25d_ros" / "lib" / "heightmap25d_ros"
PARAMS = ROOT / "config" / "atrvjr.yaml"
WORLD = "ramp"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE = 180.0  # [s] for a node to start, and for a service to answer
LONGEST = 120.0  # [s], simulated: a drive that takes longer is given up
STANDS = 0.01  # [m/s]
AGAIN = 1.0  # [s] from one time that a goal is sent to the next

LANDING = 3.0, 0.0, np.pi  # [m], [rad], map
NODES = ("mapping", "localization", "planning", "path_follower", "simulator")


@dataclass
class Run:
    """What was heard; times in seconds since the simulator's start."""

    goals: Sequence[Sequence[float]]
    driven: list[tuple[int, se3.Matrix]] = field(default_factory=list)
    known: list[tuple[int, se3.Matrix]] = field(default_factory=list)  # what the robot thought
    covariances: list[NDArray[np.float64]] = field(default_factory=list)  # of x and y
    odometry: list[tuple[int, se3.Matrix]] = field(default_factory=list)
    speed: float = 0.0
    plans: list[tuple[float, NDArray[np.float64]]] = field(default_factory=list)
    maps: list[tuple[float, HeightMap]] = field(default_factory=list)
    status: PlanStatus | None = None
    sent_at: list[float] = field(default_factory=list)
    arrived_at: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        return since_start(self.driven[-1][0]) if self.driven else 0.0

    @property
    def has_arrived(self) -> bool:
        return len(self.arrived_at) == len(self.goals)

    def stands_at(self, place: Sequence[float]) -> bool:
        return (
            bool(self.known)
            and distance(self.known[-1][1], place) < PlanningParams().goal_reached
            and self.speed < STANDS
        )

    def take_truth(self, message: Odometry) -> None:
        truth = decode.odometry(message)
        self.driven.append((truth.stamp_ns, truth.T))
        self.speed = abs(message.twist.twist.linear.x)

    def take_odometry(self, message: Odometry) -> None:
        odometry = decode.odometry(message)
        self.odometry.append((odometry.stamp_ns, odometry.T))

    def take_pose(self, message: PoseWithCovarianceStamped) -> None:
        pose = decode.pose(message.pose.pose, "pose")
        self.known.append((decode.stamp_ns(message.header), pose))
        self.covariances.append(np.reshape(message.pose.covariance, (6, 6))[:2, :2])

    def take_plan(self, message: PathMessage) -> None:
        places = [(p.pose.position.x, p.pose.position.y) for p in message.poses]
        self.plans.append((self.seconds, np.array(places).reshape(-1, 2)))

    def take_map(self, message: HeightGrid) -> None:
        stamp = decode.stamp_ns(message.header)
        self.maps.append((since_start(stamp), decode.height_map(message)))

    def take_status(self, message: PlanStatus) -> None:
        self.status = message


def main() -> int:
    options = parser().parse_args()
    # Nobody else's robot shall hear this, nor be heard.
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    options.output.mkdir(parents=True, exist_ok=True)
    world = recording.world_of(WORLD, options.seed)
    run = Run(goals=((*world.way[-1], 0.0), LANDING))  # in the yard, and back
    bag = recorded(options.output, options.seed)
    drive(run, options, bag)
    trajectory.write_tum(options.output / "driven.tum", run.driven)
    trajectory.write_tum(options.output / "known.tum", run.known)
    figures = summary(run, bag)
    (options.output / "summary.json").write_text(json.dumps(figures, indent=2) + "\n")
    if options.animation:
        closed_loop_picture.animate(options.output / "run.gif", run, run.goals)
    if options.json:
        print(json.dumps(figures))
    else:
        width = max(map(len, figures))
        print("\n".join(f"{name:{width}}  {value}" for name, value in figures.items()))
        print(f"\nsee {options.output}")
    return 0 if run.has_arrived else 1


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        description="A simulated robot finds its way over a ramp and back on drifting odometry."
    )
    made.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "closed_loop")
    made.add_argument("--seed", type=int, default=1, help="of the world (default: 1)")
    made.add_argument("--no-animation", dest="animation", action="store_false")
    made.add_argument("--rate", type=float, default=1.0, help="times real time (default: 1)")
    made.add_argument("--json", action="store_true", help="print the figures as JSON")
    return made


def recorded(directory: Path, seed: int) -> Path:
    """A drive through the world: one of the project's bags, or one that is simulated."""
    bag = ROOT / "bags" / f"{WORLD}_{seed}"
    if not bag.exists():
        bag = directory / bag.name
    if not bag.exists():
        recording.simulate(WORLD, seed, bag)
    return bag


def drive(run: Run, options: argparse.Namespace, bag: Path) -> None:
    """Map, start the nodes, set the goals, listen until the robot has arrived or given up."""
    directory, rate = options.output, options.rate
    long_term = directory / "long_term"
    make_map(bag, long_term)
    arguments = {
        "mapping": [f"mapping.map_directory:={directory}", "mapping.initial_map:=long_term"],
        "localization": [f"localization.map_directory:={long_term}"],
        "simulator": [f"simulator.{name}:={value}" for name, value in
                      (("world", WORLD), ("seed", options.seed), ("rate", rate))],
    }  # fmt: skip
    processes = []
    rclpy.init()
    node = rclpy.create_node("closed_loop")
    subscribe(node, run)
    goals = node.create_publisher(PoseStamped, "goal_pose", LATCHED)
    try:
        for name in NODES:
            if name == "simulator":  # last, since its time does not wait for the others
                wait(node, lambda: is_up(node))
            command = [EXECUTABLES / name, "--ros-args", "--params-file", PARAMS]
            for argument in arguments.get(name, []):
                command += ["-p", argument]
            processes.append(subprocess.Popen(command))
        wait(node, lambda: run.maps and run.known)
        for goal in run.goals:
            run.sent_at.append(run.seconds)
            send(node, run, goals, goal, LONGEST / rate + PATIENCE)
            if not run.stands_at(goal):
                break
            run.arrived_at.append(run.seconds)
        save_map(node)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(timeout=PATIENCE)
        node.destroy_node()
        rclpy.try_shutdown()


def make_map(bag: Path, directory: Path) -> None:
    command = ["heightmap25d", "map", bag, "-o", directory, "--odom-topic", "/ground_truth",
               "--params", PARAMS]  # fmt: skip
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def send(node: Node, run: Run, goals: Publisher, goal: Sequence[float], seconds: float) -> None:
    """Send a goal until there is a path to it, and wait until the robot has arrived or given up.

    Planning refuses a goal while it has not heard the robot.
    """
    count, end = len(run.plans), run.seconds + LONGEST

    def publish() -> None:
        if not any(len(way) for _, way in run.plans[count:]):
            goals.publish(stamped(goal))

    publish()
    timer = node.create_timer(AGAIN, publish)
    wait(node, lambda: run.stands_at(goal) or run.seconds > end, seconds)
    node.destroy_timer(timer)


def subscribe(node: Node, run: Run) -> None:
    for kind, topic, take, quality in (
        (Odometry, "ground_truth", run.take_truth, 50),
        (Odometry, "odom", run.take_odometry, 50),
        (PoseWithCovarianceStamped, "pose", run.take_pose, 50),
        (PathMessage, "plan", run.take_plan, LATCHED),
        (HeightGrid, "height_grid", run.take_map, LATCHED),
        (PlanStatus, "planning/status", run.take_status, LATCHED),
    ):
        node.create_subscription(kind, topic, take, quality)


def is_up(node: Node) -> bool:
    """Whether all that take odometry, this process among them, have subscribed."""
    return node.count_subscribers("odom") >= len(NODES) and node.count_subscribers("scan") > 0


def stamped(place: Sequence[float]) -> PoseStamped:
    """A PoseStamped of x, y, yaw in the map."""
    message = PoseStamped()
    message.header.frame_id = "map"
    position, rotation = message.pose.position, message.pose.orientation
    position.x, position.y = float(place[0]), float(place[1])
    rotation.z, rotation.w = np.sin(place[2] / 2), np.cos(place[2] / 2)
    return message


def save_map(node: Node) -> None:
    service = node.create_client(SaveMap, "mapping/save_map")
    request = service.call_async(SaveMap.Request(name="map"))
    rclpy.spin_until_future_complete(node, request, timeout_sec=PATIENCE)
    answer = request.result()
    if answer is None or not answer.success:
        raise SystemExit(f"closed_loop: map not saved: {answer and answer.message}")


def wait(node: Node, is_done, seconds: float = PATIENCE) -> None:
    end = time.monotonic() + seconds
    while not is_done():
        if time.monotonic() > end:
            raise SystemExit("closed_loop: waited in vain")
        rclpy.spin_once(node, timeout_sec=0.1)


def summary(run: Run, bag: Path) -> dict[str, float | int | str | None]:
    stamps = np.array([since_start(stamp) for stamp, _ in run.driven])
    poses = np.array([T for _, T in run.driven])
    legs = [poses[(stamps >= begin) & (stamps <= end)]
            for begin, end in zip(run.sent_at, run.arrived_at, strict=False)]  # fmt: skip
    rectangle = PlannerParams().robot_length, PlannerParams().robot_width
    ground = read_ground(bag / "truth" / "surface.npz")
    met = evaluate_path(ground, se3.to_xyz_rpy(poses)[:, [0, 1, 5]], *rectangle)
    known, wheels = (error_of(told, run.driven) for told in (run.known, run.odometry))
    return {
        "arrived": run.has_arrived,
        "status of the last plan": (run.status.reason or "found") if run.status else "no plan",
        "goals reached": len(run.arrived_at),
        "time from the first goal to the last arrival [s]": round(
            (run.arrived_at or [run.seconds])[-1] - run.sent_at[0], 1
        ),
        "path length [m]": round(length(poses), 2),
        "straight distances to the goals [m]": round(
            sum(distance(leg[0], goal) for leg, goal in zip(legs, run.goals, strict=False)), 2
        ),
        "lowest and highest [m]": [round(float(z), 2) for z in
                                   (poses[:, 2, 3].min(), poses[:, 2, 3].max())],
        "distance to the goal at the end [m]": round(distance(poses[-1], run.goals[-1]), 3),
        "plans": sum(len(way) > 0 for _, way in run.plans),
        "error of the pose: RMSE, largest, at the end [m]": rounded(known),
        "poses over 3 sigma and 0.15 m": overconfident(run),
        "error of the odometry alone [m]": rounded(wheels),
        "largest true step under the robot [m]": round(met.largest_step_m, 3),
        "steepest true slope under the robot [deg]": round(np.degrees(met.steepest_slope_rad), 1),
        "known_cells": int(run.maps[-1][1].known.sum()),
    }  # fmt: skip


def overconfident(run: Run) -> int:
    """How many poses are off by more than 0.15 m and by more than three of their deviations."""
    stamps, known = unzipped(run.known)
    driven = unzipped(run.driven)
    is_heard = (stamps >= driven[0][0]) & (stamps <= driven[0][-1])
    true = interpolate(*driven, stamps[is_heard])
    error = (known[is_heard] - true)[:, :2, 3]
    precision = np.linalg.inv(np.array(run.covariances)[is_heard])
    squared = np.einsum("ni,nij,nj->n", error, precision, error)
    return int(((squared > 9.0) & (np.linalg.norm(error, axis=1) > 0.15)).sum())


def error_of(told: list[tuple[int, se3.Matrix]], driven: list[tuple[int, se3.Matrix]]):
    """`TrajectoryError` of what was told while the truth was heard."""
    heard = [pose for pose in told if driven[0][0] <= pose[0] <= driven[-1][0]]
    return trajectory_error.evaluate_trajectory(*unzipped(heard), *unzipped(driven))


def unzipped(poses: list[tuple[int, se3.Matrix]]) -> tuple[NDArray[np.int64], se3.Matrix]:
    return np.array([stamp for stamp, _ in poses]), np.array([T for _, T in poses])


def rounded(error) -> list[float]:
    return [round(value, 3) for value in
            (error.planar_rmse_m, error.planar_max_m, error.final_position_m)]  # fmt: skip


def length(poses: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())


def distance(T: se3.Matrix, place: Sequence[float]) -> float:
    return float(np.linalg.norm(T[:2, 3] - place[:2]))


def since_start(stamp_ns: int) -> float:
    return (stamp_ns - messages.START_NS) * 1e-9


if __name__ == "__main__":
    sys.exit(main())
