# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Running nodes that are killed while they save, sent through transitions, and kept busy."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bag_writer import laser_scan, odometry, rclpy_type
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_client import PATIENCE, Client, start
from repository import BAGS
from tally import Tally, random_of

from heightmap25d_msgs.srv import SaveMap
from heightmap25d_ros.io import map_directory

SAVE_FOREVER = """
import sys
from pathlib import Path
from types import SimpleNamespace
import numpy as np
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.grid.height_map import Geometry, HeightMap

side = 200
geometry = Geometry(resolution=0.125, origin=(0.0, 0.0), shape=(side, side))
for count in range(10**9):
    value = count % 2
    height_map = HeightMap(
        geometry=geometry,
        height=np.full((side, side), value, np.int16),
        probability=np.full((side, side), 65535, np.uint16),
        probability_threshold=0.5,
    )
    occupancy = np.full((side, side), 100 * value, np.int8)
    obstacle_map = SimpleNamespace(geometry=geometry, occupancy=occupancy)
    map_directory.save(Path(sys.argv[1]), height_map, obstacle_map, "map")
    if count == 0:
        print("saved", flush=True)
"""

START_NS = 1_700_000_000 * 10**9
MOUNT = ("-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]")
LARGEST_GROWTH = 30.0
"""MB by which a node may grow from the second quarter of a soak to the end."""


def attack_saves(seed: int, count: int, directory: Path) -> Tally:
    """A process that saves maps for ever is killed: the map of one save is there, all of it."""
    tally = Tally("kills of a process that saves")
    target = directory / "room"
    for number in range(count):
        with tally.case(number):
            _killed_while_saving(target, random_of(seed, number).uniform(0.0, 0.1))
            loaded = map_directory.load(target, 0.5).height_map
            value = int(loaded.height[0, 0])
            if not (loaded.height == value).all():
                raise AssertionError("heights of two saves")
            pixels = set((target / "map.pgm").read_bytes()[-loaded.height.size :])
            if pixels != {254 - 254 * value}:
                raise AssertionError("a picture of another save")
            others = [path.name for path in directory.iterdir() if path != target]
            if len(others) > 1 or not all(name.startswith(".room.") for name in others):
                raise AssertionError(f"{others} is left over")
    return tally


def _killed_while_saving(target: Path, seconds: float) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SAVE_FOREVER, str(target)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    with process.stdout:
        process.stdout.readline()
        time.sleep(seconds)
        process.kill()
        if process.wait() != -signal.SIGKILL:
            raise AssertionError(f"ended by itself with {process.returncode}")


@contextmanager
def running(node: str, *arguments: str, namespace: str) -> Iterator[subprocess.Popen[str]]:
    """A node's process, which is killed at the end if it still runs."""
    process = start(
        f"nodes.{node}", "--ros-args", *arguments, "-r", f"__ns:={namespace}",
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def attack_node_saves(seed: int, count: int, directory: Path) -> Tally:
    """The mapping node is killed while it saves: the map of before or a new one is there."""
    tally = Tally("kills of the mapping node during a save")
    arguments = (*MOUNT, "-p", f"mapping.map_directory:={directory}")
    for number in range(count):
        namespace = f"/killed_{number}"  # DDS takes a killed node for a living one for a while
        client = Client(namespace)
        with tally.case(number), running("mapping", *arguments, namespace=namespace) as process:
            _drive(client, 0)
            if not client.call("mapping/save_map", SaveMap, name="yard").success:
                raise AssertionError("not saved")
            request = client.node.create_client(SaveMap, "mapping/save_map")
            request.wait_for_service(timeout_sec=60.0)
            request.call_async(SaveMap.Request(name="yard"))
            client.spin(random_of(seed, number).uniform(0.0, 0.02))
            process.kill()
            process.wait()
            if not map_directory.load(directory / "yard", 0.5).height_map.known.any():
                raise AssertionError("an empty map")
        client.close()
    return tally


def _drive(client: Client, milliseconds: int) -> None:
    """A pose before and after a scan."""
    for kind, at in (("odom", 0), ("odom", 20), ("scan", 10)):
        stamp = START_NS + (milliseconds + at) * 10**6
        if kind == "odom":
            client.publish(kind, odometry(stamp, type_of=rclpy_type))
        else:
            client.publish(kind, laser_scan(stamp, (2.0, 2.0), type_of=rclpy_type))


def attack_lifecycle(seed: int, count: int) -> Tally:
    """Random transitions while messages come, allowed and not: the node answers and lives."""
    tally = Tally("lifecycle transitions of the mapping node, while messages come")
    client, random = Client("/turned"), random_of(seed, 0)
    with running("mapping", *MOUNT, namespace="/turned") as process:
        for number in range(count):
            with tally.case(number):
                if number % 10 == 0:
                    _to_active(client)
                    _drive(client, 100 * number)
                transition = int(random.choice([1, 2, 3, 3, 4, 4, 99]))  # 99 does not exist
                client.call(
                    "mapping/change_state", ChangeState, transition=Transition(id=transition)
                )
                if process.poll() is not None:
                    raise AssertionError(f"the node ended with {process.returncode}")
        with tally.case(count):
            _to_active(client)
    client.close()
    return tally


def _to_active(client: Client) -> None:
    steps = {State.PRIMARY_STATE_UNCONFIGURED: Transition.TRANSITION_CONFIGURE,
             State.PRIMARY_STATE_INACTIVE: Transition.TRANSITION_ACTIVATE}  # fmt: skip
    for _ in range(3):
        state = client.call("mapping/get_state", GetState).current_state.id
        if state == State.PRIMARY_STATE_ACTIVE:
            return
        step = Transition(id=steps[state])
        client.call("mapping/change_state", ChangeState, transition=step)
    raise AssertionError("does not become active")


def soak(seconds: float, rate: float, directory: Path) -> Tally:
    """All nodes with a bag that loops, faster than it was recorded; the map is saved all along.

    No node may end, fail in a callback, or grow by more than `LARGEST_GROWTH`.
    """
    tally = Tally(f"soak of all nodes at {rate:g} times the rate of bags/room_1")
    client = Client("/soak")
    reports: list[DiagnosticArray] = []
    client.node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 10)
    scans = ("-p", "intake.scan_topics:=[scan, scan_down]", "-p", "mapping.autosave:=''")
    with ExitStack() as stack, tally.case(0):
        nodes = {
            node: stack.enter_context(running(node, *options, namespace="/soak"))
            for node, options in (
                ("mapping", (*scans, "-p", f"mapping.map_directory:={directory}")),
                ("localization", (*scans, "-r", "long_term_grid:=height_grid")), ("planning", ()),
            )
        }  # fmt: skip
        topics = [f"{t}:=/soak{t}" for t in ("/scan", "/scan_down", "/odom")]
        replay = start(
            "nodes.replay", str(BAGS / "room_1"), "--loop", "--rate", str(rate),
            "--topics", "/scan", "/scan_down", "/odom", "/tf_static", "--wait", str(PATIENCE),
            *(word for topic in topics for word in ("--remap", topic)),
        )  # fmt: skip
        stack.callback(replay.wait)
        stack.callback(replay.kill)
        client.publish("goal_pose", _goal())
        saves, sizes = _Saves(client), {node: [] for node in nodes}
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            client.spin(min(5.0, seconds / 20))
            saves.go_on()
            for node, process in nodes.items():
                if process.poll() is not None:
                    raise AssertionError(f"{node} ended with {process.returncode}")
                sizes[node].append(_resident(process.pid))
        if not saves.answered:
            raise AssertionError("no map was saved")
        for node, megabytes in sizes.items():
            grown = max(megabytes[-3:]) - max(megabytes[: len(megabytes) // 2])
            tally.outcomes[f"MB more of {node} in the second half"] = round(grown)
            if grown > LARGEST_GROWTH:
                raise AssertionError(f"{node} has grown by {grown:.0f} MB")
        statuses = [status for report in reports for status in report.status]
        failed = {f"{s.name}: {s.message}" for s in statuses if "callbacks failed" in s.message}
        if failed:
            raise AssertionError(f"callbacks failed: {max(failed, key=len)}")
        merged = [int(v.value) for s in statuses for v in s.values if v.key == "scans merged"]
        tally.outcomes["scans merged"] = max(merged)
        tally.outcomes["maps saved"] = saves.answered
        tally.outcomes["seconds"] = round(seconds)
    client.close()
    return tally


class _Saves:
    """Has the map saved again and again by one client; on a busy machine an answer may get lost."""

    def __init__(self, client: Client) -> None:
        self._client = client.node.create_client(SaveMap, "mapping/save_map")
        self._future, self._asked_at = None, 0.0
        self.answered = 0

    def go_on(self) -> None:
        """Ask for the next save when the last one is answered, or has not been for a minute."""
        is_answered = self._future is not None and self._future.done()
        self.answered += is_answered
        if is_answered or time.monotonic() > self._asked_at + 60.0:
            self._asked_at = time.monotonic()
            self._future = self._client.call_async(SaveMap.Request(name="soak"))


def _goal() -> PoseStamped:
    goal = PoseStamped()
    goal.header.frame_id = "map"
    goal.pose.position.x, goal.pose.orientation.w = 2.0, 1.0
    return goal


def _resident(pid: int) -> float:
    """Memory of a process [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
