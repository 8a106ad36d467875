# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mounts that are off, in worlds whose ranges are exact: a floor, and a room of four walls."""

import numpy as np
import pytest
from repository import BAGS

from heightmap25d_ros import se3
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.mount_watch import MountWatch
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pipelines.self_check import Problem

ANGLES = np.radians(np.arange(-90.0, 90.5, 0.5))
FAN = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(len(ANGLES))], axis=1)
DOWN = [0.28, 0.0, 0.6, 0.0, float(np.radians(28.0)), 0.0]
LEVEL = [0.3, 0.0, 0.4, 0.0, 0.0, 0.0]
AXES = {"roll": 3, "pitch": 4, "yaw": 5}


def on_a_circle(travelled):
    turned = travelled / 2.0
    return se3.from_xyz_rpy([2 * np.sin(turned), 2 - 2 * np.cos(turned), 0.0, 0.0, 0.0, turned])


def straight_on(travelled):
    return se3.from_xyz_rpy([travelled - 9.0, 0.3, 0.0, 0.0, 0.0, 0.0])


ROOMS = {on_a_circle: np.array([7.0, 5.0]), straight_on: np.array([10.5, 5.0])}
"""Half of the sides [m], around the middle of the circle."""


def ranges(T_map_laser, path):
    """(N,) to the floor or a wall."""
    origin, directions = T_map_laser[:3, 3] - (0.0, 2.0, 0.0), FAN @ T_map_laser[:3, :3].T
    with np.errstate(divide="ignore"):
        walls = (np.sign(directions[:, :2]) * ROOMS[path] - origin[:2]) / directions[:, :2]
        floor = np.where(directions[:, 2] < 0.0, -origin[2] / directions[:, 2], np.inf)
    return np.minimum(floor, walls.min(axis=1))


def fault(mount, path, **off):
    """What is told of a laser that is assumed to be mounted otherwise by some angles [degrees]."""
    watch, rng, assumed = MountWatch(), np.random.default_rng(3), list(mount)
    for axis, degrees in off.items():
        assumed[AXES[axis]] += np.radians(degrees)
    for travelled in np.arange(0.0, 18.0, 0.11):
        T, T_base_laser = path(travelled), se3.from_xyz_rpy(mount)
        noisy = ranges(T @ T_base_laser, path) + rng.normal(0.0, 0.01, len(ANGLES))
        scan = Scan(
            angle_min=ANGLES[0], angle_increment=np.radians(0.5), range_max=30.0, ranges=noisy
        )
        watch.observe("scan", scan, T[None], se3.from_xyz_rpy(assumed)[None])
    return watch.fault()


@pytest.mark.parametrize("path", [on_a_circle, straight_on])
@pytest.mark.parametrize("mount", [DOWN, LEVEL])
def test_right_mounts_are_not_told(mount, path):
    assert fault(mount, path) == ""


@pytest.mark.parametrize("degrees", [-2.0, 2.0])
@pytest.mark.parametrize(
    ("axis", "mount", "path"),
    [
        ("pitch", DOWN, straight_on), ("pitch", DOWN, on_a_circle), ("roll", DOWN, on_a_circle),
        ("yaw", LEVEL, straight_on), ("yaw", LEVEL, on_a_circle),
    ],
)  # fmt: skip
def test_the_axis_and_the_angle_are_told(axis, mount, path, degrees):
    told = fault(mount, path, **{axis: degrees})
    assert told.startswith(f"scan: {axis} seems ")
    assert told.endswith(" large" if degrees > 0 else " small")
    # About the axes of base_link: the roll of a laser that is pitched down by 28 degrees is less.
    assert float(told.split(" ")[3]) == pytest.approx(2.0, abs=0.35)
    assert "," not in told


@pytest.mark.parametrize("axis", ["pitch", "roll"])
def test_nothing_is_told_of_what_nobody_can_know(axis):
    """A level laser meets no floor; it meets none in its own plane either."""
    assert fault(LEVEL, on_a_circle, **{axis: 2.0}) == ""


def test_a_jump_of_the_odometry_is_no_fault():
    """Poses go on elsewhere: what was seen before is not compared with what comes."""

    def path(travelled):
        jump = [3.0, 1.0, 0.3, 0.0, 0.0, 0.5] if travelled > 7.0 else [0.0] * 6
        return se3.from_xyz_rpy(jump) @ straight_on(travelled)

    watch = MountWatch()
    for travelled in np.arange(0.0, 18.0, 0.11):
        seen = ranges(straight_on(travelled) @ se3.from_xyz_rpy(DOWN), straight_on)
        scan = Scan(
            angle_min=ANGLES[0], angle_increment=np.radians(0.5), range_max=30.0, ranges=seen
        )
        watch.observe("scan", scan, path(travelled)[None], se3.from_xyz_rpy(DOWN)[None])
    assert watch.fault() == ""


def test_odometry_that_has_drifted_is_no_fault():
    """The robot saw the ground of its way back on its way there, before its odometry drifted."""
    watch, rng = MountWatch(), np.random.default_rng(3)
    for travelled in np.arange(0.0, 18.0, 0.11):
        x, yaw = (travelled, 0.0) if travelled < 9.0 else (18.0 - travelled, np.pi + 0.02)
        y = 0.3 + 0.02 * max(travelled - 9.0, 0.0)
        T = se3.from_xyz_rpy([x - 4.5, y, 0.0, 0.0, 0.0, yaw])
        noisy = ranges(T @ se3.from_xyz_rpy(DOWN), straight_on) + rng.normal(0.0, 0.01, len(FAN))
        scan = Scan(
            angle_min=ANGLES[0], angle_increment=np.radians(0.5), range_max=30.0, ranges=noisy
        )
        T[2, 3] += 0.01 * travelled
        watch.observe("scan", scan, T[None], se3.from_xyz_rpy(DOWN)[None])
    assert watch.fault() == ""


@pytest.mark.parametrize(("pitch", "told"), [(28.0, False), (30.0, True)])
def test_the_self_check_names_the_laser(pitch, told):
    """Of a bag whose laser is pitched down by 28 degrees."""
    mounts = [*LEVEL, *DOWN[:4], float(np.radians(pitch)), 0.0]
    params = with_values(
        Params(), {"intake.scan_topics": ["/scan", "/scan_down"], "intake.mounts": mounts}
    )
    with Bag(BAGS / "ramp") as bag:
        mapping = Mapping(params)
        stretch = bag.start_ns, bag.start_ns + 6 * 10**9
        for _ in replayed(bag, mapping, "/odom", params.intake, stretch):
            pass
    found = [str(f) for f in mapping.problems() if f.problem is Problem.MOUNT]
    assert len(found) == told
    for finding in found:
        assert finding.startswith("a mount is off: /scan_down: pitch seems ")
        assert finding.endswith(" degrees too large")
