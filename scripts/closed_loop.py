# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated robot maps a ramp and is then sent back over it: a closed loop over DDS.

Usage: python scripts/closed_loop.py [-o DIRECTORY] [--rate R] [--json]

`simulator`, `mapping`, `planning` and `driver` run as processes of their own. The first way, down
into the yard, is given by hand, as a path on `plan`: nothing is known yet, and planning with its
defaults leads over known ground only. Then a goal is set on the landing above: from here on the
robot plans by itself, on the map that goes on growing.

The directory (default: out/closed_loop) gets run.gif, driven.tum (the true poses), the map and
summary.json. The exit status is 0 if the robot arrived.
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
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_msgs.msg import HeightGrid, PlanStatus
from heightmap25d_msgs.srv import SaveMap
from heightmap25d_ros import drivability, map_io, messages, se3
from heightmap25d_ros.grid import HeightMap
from heightmap25d_ros.params import PlannerParams, PlanningParams
from heightmap25d_ros.simulation import outgoing, recording

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = ROOT / "install" / "heightmap25d_ros" / "lib" / "heightmap25d_ros"
WORLD, SEED = "ramp", 1
TRUTH = ROOT / "bags" / f"{WORLD}_{SEED}" / "truth" / "surface.npz"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE = 60.0  # [s] for a node to start, and for a service to answer
LONGEST = 120.0  # [s], simulated: a drive that takes longer is given up
STANDS = 0.01  # [m/s]

GOAL = (3.0, 0.0, np.pi)  # [m], [rad], map: the landing

NODES = {
    "mapping": ("-p", "intake.scan_topics:=[scan, scan_down]"),
    "planning": (),
    "driver": (),
    "simulator": ("-p", f"simulator.world:={WORLD}", "-p", f"simulator.seed:={SEED}",
                  "-p", "simulator.true_odometry:=true"),
}  # fmt: skip


@dataclass
class Run:
    """What was heard; times in seconds since the simulator's start."""

    driven: list[tuple[int, se3.Matrix]] = field(default_factory=list)
    speed: float = 0.0
    known: se3.Matrix | None = None  # the pose of base_link as the robot knows it
    plans: list[tuple[float, NDArray[np.float64]]] = field(default_factory=list)
    maps: list[tuple[float, HeightMap]] = field(default_factory=list)
    status: PlanStatus | None = None
    goal_at: float = np.inf

    @property
    def seconds(self) -> float:
        return since_start(self.driven[-1][0]) if self.driven else 0.0

    @property
    def has_arrived(self) -> bool:
        return self.seconds > self.goal_at and self.stands_at(GOAL)

    def stands_at(self, place: Sequence[float]) -> bool:
        return (
            self.known is not None
            and distance(self.known, place) < PlanningParams().goal_reached
            and self.speed < STANDS
        )

    def take_truth(self, message: Odometry) -> None:
        truth = messages.odometry(message)
        self.driven.append((truth.stamp_ns, truth.T))
        self.speed = abs(message.twist.twist.linear.x)

    def take_odometry(self, message: Odometry) -> None:
        self.known = messages.odometry(message).T

    def take_plan(self, message: PathMessage) -> None:
        places = [(p.pose.position.x, p.pose.position.y) for p in message.poses]
        self.plans.append((self.seconds, np.array(places).reshape(-1, 2)))

    def take_map(self, message: HeightGrid) -> None:
        stamp = messages.stamp_ns(message.header)
        self.maps.append((since_start(stamp), messages.height_map(message)))

    def take_status(self, message: PlanStatus) -> None:
        self.status = message


def main() -> int:
    options = parser().parse_args()
    # Nobody else's robot shall hear this, nor be heard.
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    options.output.mkdir(parents=True, exist_ok=True)
    run = Run()
    drive(run, options.output, options.rate)
    map_io.write_tum(options.output / "driven.tum", run.driven)
    figures = summary(run)
    (options.output / "summary.json").write_text(json.dumps(figures, indent=2) + "\n")
    closed_loop_picture.animate(options.output / "run.gif", run, GOAL)
    if options.json:
        print(json.dumps(figures))
    else:
        width = max(map(len, figures))
        print("\n".join(f"{name:{width}}  {value}" for name, value in figures.items()))
        print(f"\nsee {options.output}/run.gif")
    return 0 if run.has_arrived else 1


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        description="A simulated robot maps a ramp, plans and drives back over it."
    )
    made.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "closed_loop")
    made.add_argument("--rate", type=float, default=4.0, help="times real time (default: 4)")
    made.add_argument("--json", action="store_true", help="print the figures as JSON")
    return made


def drive(run: Run, directory: Path, rate: float) -> None:
    """Start the nodes, set the goal, listen until the robot has arrived or given up."""
    more = {
        "mapping": ("-p", f"mapping.map_directory:={directory}"),
        "simulator": ("-p", f"simulator.rate:={rate}"),
    }
    processes = []
    rclpy.init()
    node = rclpy.create_node("closed_loop")
    subscribe(node, run)
    ways = node.create_publisher(PathMessage, "plan", LATCHED)
    goals = node.create_publisher(PoseStamped, "goal_pose", LATCHED)
    way = recording.world_of(WORLD, SEED).way
    longest = LONGEST / rate + PATIENCE
    try:
        for name, arguments in NODES.items():
            if name == "simulator":  # last, since its time does not wait for the others
                wait(node, lambda: is_up(node))
            command = [EXECUTABLES / name, "--ros-args", *arguments, *more.get(name, ())]
            processes.append(subprocess.Popen(command))
        wait(node, lambda: run.maps and run.known is not None)
        ways.publish(PathMessage(poses=[stamped((x, y, 0.0)) for x, y in way]))
        wait(node, lambda: run.stands_at(way[-1]) or run.seconds > LONGEST, longest)
        run.goal_at = run.seconds
        goals.publish(stamped(GOAL))
        wait(node, lambda: run.has_arrived or run.seconds > LONGEST, longest)
        save_map(node)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(timeout=PATIENCE)
        node.destroy_node()
        rclpy.try_shutdown()


def subscribe(node: Node, run: Run) -> None:
    for kind, topic, take, quality in (
        (Odometry, "ground_truth", run.take_truth, 50),
        (Odometry, "odom", run.take_odometry, 50),
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


def summary(run: Run) -> dict[str, float | int | str | None]:
    stamps = np.array([since_start(stamp) for stamp, _ in run.driven])
    poses = np.array([T for _, T in run.driven])
    is_planned = stamps >= run.goal_at
    mapped, planned = poses[~is_planned], poses[is_planned]
    rectangle = PlannerParams().robot_length, PlannerParams().robot_width
    ground = drivability.read_ground(TRUTH)
    met = drivability.evaluate_path(ground, se3.to_xyz_rpy(planned)[:, [0, 1, 5]], *rectangle)
    return {
        "arrived": run.has_arrived,
        "status of the last plan": run.status.reason or "NONE" if run.status else "no plan",
        "driven by hand, mapping [m]": round(length(mapped), 2),
        "time from goal to arrival [s]": round(run.seconds - run.goal_at, 1),
        "path length [m]": round(length(planned), 2),
        "straight distance to the goal [m]": round(distance(planned[0], GOAL), 2),
        "climb [m]": round(float(planned[-1, 2, 3] - planned[0, 2, 3]), 2),
        "distance to the goal at the end [m]": round(distance(poses[-1], GOAL), 3),
        "plans": sum(len(way) > 0 and at >= run.goal_at for at, way in run.plans),
        "largest true step under the robot [m]": round(met.largest_step, 3),
        "steepest true slope under the robot [deg]": round(np.degrees(met.steepest_slope), 1),
        "known cells": int(run.maps[-1][1].known.sum()),
    }


def length(poses: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())


def distance(T: se3.Matrix, place: Sequence[float]) -> float:
    return float(np.linalg.norm(T[:2, 3] - place[:2]))


def since_start(stamp_ns: int) -> float:
    return (stamp_ns - outgoing.START_NS) * 1e-9


if __name__ == "__main__":
    sys.exit(main())
