# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulator, the three nodes and path_follower over DDS: the robot goes where it is sent."""

import json
import subprocess
import sys

import numpy as np
from PIL import Image
from repository import ROOT

from heightmap25d_ros.evaluation.truth import read_ground

TRUTH = ROOT / "bags" / "ramp_1" / "truth" / "surface.npz"


def test_robot_finds_its_way_over_a_ramp_and_back_on_drifting_odometry(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "studies" / "closed_loop.py", "-o", tmp_path, "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["arrived"] is True
    assert found["status of the last plan"] == "found"
    assert found["plans"] >= 2
    # No detour worth the name; nothing that the robot does not climb.
    straight = found["straight distances to the goals [m]"]
    assert 43.0 < straight <= found["path length [m]"] + 0.6 < 1.2 * straight
    assert found["largest true step under the robot [m]"] < 0.1
    assert found["steepest true slope under the robot [deg]"] < 10.0
    # The landing is at ground zero, the yard as deep as the world has it.
    ground = read_ground(TRUTH)
    yard = ground.height[tuple(ground.geometry.cell_at((24.5, -0.6)))]
    np.testing.assert_allclose(found["lowest and highest [m]"], (yard, 0.0), atol=0.05)
    # It stands within 0.3 m of where it takes the goal to be. On the way back it looks where the
    # long-term map was never made, so that its pose is off by decimetres there.
    _, _, end = found["error of the pose: RMSE, largest, at the end [m]"]
    assert end < 1.0
    assert found["distance to the goal at the end [m]"] < 0.3 + end + 0.05
    assert (tmp_path / "map" / "map.pgm").exists()
    with Image.open(tmp_path / "run.gif") as animation:
        assert animation.n_frames > 20
    assert (tmp_path / "run.gif").stat().st_size < 1_000_000
