# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d bringup`` and the launch files: several nodes, and several robots, at once."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from diagnostic_msgs.msg import DiagnosticArray
from node_client import MAPS, PATIENCE, Client
from repository import ROOT

LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))
MS = 10**6
START_NS = 1_700_000_000 * 10**9


def started(*arguments):
    return subprocess.Popen(arguments, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def bringup(*arguments):
    command = "import sys; from heightmap25d_ros.cli import main; sys.exit(main())"
    return started(sys.executable, "-c", command, "bringup", *arguments)


@contextmanager
def robot(tmp_path, name):
    """A bringup with a mount for its laser, in a namespace; Ctrl-C ends it."""
    params = tmp_path / f"{name}.yaml"
    values = {"intake": {"mounts": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]}}
    values["mapping"] = {"map_directory": str(tmp_path), "autosave": name}
    params.write_text(json.dumps({"/**": {"ros__parameters": values}}))
    process = bringup("--params", str(params), "--namespace", name, "--json")
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.log, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, process.log


def test_two_robots_at_once_do_not_see_one_another(tmp_path):
    client, active = Client(), set()

    def note(message):
        active.update(s.name for s in message.status if s.message.startswith("active"))

    client.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
    for name in ("first", "second"):
        client.subscribe(f"/{name}/map", MAPS["map"])
    with robot(tmp_path, "first") as first, robot(tmp_path, "second") as second:
        times = iter(range(0, 10**6, 20))

        def is_mapped():
            """Drive on until a scan has arrived: what is sent before the discovery is lost."""
            at = START_NS + next(times) * MS
            client.publish("/first/odom", odometry(at, type_of=rclpy_type))
            scan = laser_scan(at - 10 * MS, [2.0] * 11, type_of=rclpy_type)
            client.publish("/first/scan", scan)
            return "/first/map" in client.newest

        client.wait(is_mapped)
        client.wait(lambda: len(active) == 4)
        client.spin(2.5)  # all tell it once more, whoever else listens
        assert "/second/map" not in client.newest
    client.close()
    assert (tmp_path / "first" / "map.yaml").exists()
    assert not (tmp_path / "second").exists()
    for name, process in (("first", first), ("second", second)):
        lines = process.log.splitlines()
        for node in ("mapping", "planning"):
            assert f"/{name}/{node}: active" in lines
        assert sum(line.startswith(f"/{name}/mapping: ") for line in lines) < 4
        figures = json.loads("\n".join(lines[lines.index("{") :]))
        assert figures == dict.fromkeys(("mapping", "planning", "status_printer"), "ended with 0")


def test_a_node_that_ends_by_itself_ends_the_others(tmp_path):
    missing = "--map", str(tmp_path / "missing"), "--namespace", "gone"
    process = bringup(*missing, "--nodes", "mapping", "planning", "--json")
    log, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert '"mapping": "ended with 2"' in log
    # Both begin at the same time: planning may be up by then or not.
    assert '"planning": "ended with 0"' in log or '"planning": "stopped while it started"' in log
    assert "missing" in log


def test_wrong_parameters_are_told_before_anything_starts(tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("/**: {ros__parameters: {gird: {resolution: 0.1}}}")
    process = bringup("--params", str(wrong))
    log, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert log.count("\n") == 1
    assert "wrong.yaml" in log


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_files_are_short(path):
    assert len(path.read_text().splitlines()) < 60


@pytest.mark.skipif(shutil.which("ros2") is None, reason="ros2 is not installed")
def test_ros2_launch_starts_and_ends_the_nodes(tmp_path):
    arguments = ("namespace:=launched", "world:=ramp")
    process = started("ros2", "launch", "heightmap25d_ros", "simulation.launch.py", *arguments)
    client = Client()
    client.subscribe("/launched/map", MAPS["map"])
    client.wait(lambda: "/launched/map" in client.newest)
    client.close()
    process.send_signal(signal.SIGINT)
    log, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert log.count("process has finished cleanly") == 4


@pytest.mark.skipif(shutil.which("ros2") is None, reason="ros2 is not installed")
@pytest.mark.parametrize(
    ("file", "argument", "complaint"),
    [
        ("bringup", "map:=/nowhere/yard", "/nowhere/yard"),
        ("bringup", "params_file:=/nowhere.yaml", "params_file:=/nowhere.yaml: is not a file"),
        ("bringup", "use_sim_time:=maybe", "use_sim_time:=maybe: is neither true nor false"),
        ("slam", "map:=/nowhere/yard", "/nowhere/yard"),
        ("slam", "params_file:=/nowhere.yaml", "params_file:=/nowhere.yaml: is not a file"),
        ("slam", "use_sim_time:=maybe", "use_sim_time:=maybe: is neither true nor false"),
        ("exploration", "params_file:=/nowhere.yaml", "/nowhere.yaml: is not a file"),
        ("simulation", "params_file:=/nowhere.yaml", "/nowhere.yaml: is not a file"),
        ("replay", "bag:=/nowhere", "/nowhere: does not exist"),
    ],
)
def test_ros2_launch_ends_by_itself_where_a_node_cannot_start(file, argument, complaint):
    """With one of launch's own endings: it may be 0 where all nodes could be ended."""
    process = started("ros2", "launch", str(ROOT / "launch" / f"{file}.launch.py"), argument)
    log, _ = process.communicate(timeout=PATIENCE)
    assert complaint in log
