# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded bag through the real nodes: `replay` and `mapping`, each a process of its own.

The map that `mapping` made is saved by its service, drawn, held against the truth, and
compared with what `heightmap25d map` makes of the same bag. All of it goes to out/demo/.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_msgs.srv import SaveMap
from heightmap25d_ros.io import map_directory

ROOT = Path(__file__).parent.parent
BAG = ROOT / "bags" / "ramp"
OUT = ROOT / "out" / "demo"
EXECUTABLES = ROOT / "install" / "heightmap25d_ros" / "lib" / "heightmap25d_ros"
RATE = 2.0
PATIENCE = 60.0  # [s] for a node to start, and for a service to answer


def main() -> int:
    began = time.perf_counter()
    # Nobody else's robot shall hear this, nor be heard.
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    OUT.mkdir(parents=True, exist_ok=True)

    mapping = start("mapping", "--ros-args", "-p", "intake.scan_topics:=[scan, scan_down]",
                    "-p", f"mapping.map_directory:={OUT}")  # fmt: skip
    rclpy.init()
    node = rclpy.create_node("demo")
    grids: list[OccupancyGrid] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(OccupancyGrid, "map", grids.append, latched)
    service = node.create_client(SaveMap, "mapping/save_map")
    try:
        if not service.wait_for_service(timeout_sec=PATIENCE):
            raise SystemExit("demo: the mapping node did not come up")
        replay = start("replay", str(BAG), "--rate", str(RATE))
        while replay.poll() is None:
            rclpy.spin_once(node, timeout_sec=0.1)
        request = service.call_async(SaveMap.Request(name="map"))
        rclpy.spin_until_future_complete(node, request, timeout_sec=PATIENCE)
        answer = request.result()
        if answer is None or not answer.success:
            raise SystemExit(f"demo: map not saved: {answer and answer.message}")
    finally:
        mapping.send_signal(signal.SIGINT)
        mapping.wait(timeout=PATIENCE)
        node.destroy_node()
        rclpy.try_shutdown()

    print(f"\n`map` came {len(grids)} times; the last one has "
          f"{grids[-1].info.width} x {grids[-1].info.height} cells.")  # fmt: skip
    say("The same bag through the command line:")
    command("map", str(BAG), "-o", str(OUT / "map_by_command_line"))
    same = map_directory.digest(OUT / "map") == map_directory.digest(OUT / "map_by_command_line")
    print(f"Node and command line made {'the same map' if same else 'DIFFERENT maps'}.")
    say("The node's map against the truth:")
    command("evaluate", str(OUT / "map"), "--truth", str(BAG / "truth" / "surface.npz"))
    (OUT / "map" / "trajectory.tum").write_bytes(
        (OUT / "map_by_command_line" / "trajectory.tum").read_bytes()
    )
    say("Pictures:")
    command("render", str(OUT / "map"), "-o", str(OUT))
    print(f"\nDone in {time.perf_counter() - began:.0f} s; see {OUT.relative_to(ROOT)}/")
    return 0 if same else 1


def start(executable: str, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen([EXECUTABLES / executable, *arguments])


def command(*arguments: str) -> None:
    subprocess.run([EXECUTABLES / "heightmap25d", *arguments], check=True)


def say(text: str) -> None:
    print(f"\n{text}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
