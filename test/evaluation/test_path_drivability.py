# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.path_drivability import Drivability, evaluate_path
from heightmap25d_ros.evaluation.truth import TrueGround, read_ground
from heightmap25d_ros.grid.height_map import Geometry

CELL = 0.05
SIZE = 0.78, 0.64
SHAPE = 80, 100  # 4 m x 5 m
IY, IX = np.indices(SHAPE)
X, Y = (IX + 0.5) * CELL, (IY + 0.5) * CELL


def ground(height, clearance=None, origin=(0.0, 0.0)):
    geometry = Geometry(resolution=CELL, origin=origin, shape=SHAPE)
    clearance = np.full(SHAPE, np.inf) if clearance is None else clearance
    return TrueGround(geometry=geometry, height=np.asarray(height, float), clearance=clearance)


def driven(height, *poses, clearance=None):
    return evaluate_path(ground(height, clearance), np.array(poses, float), *SIZE)


ALONG_X = (1.0, 2.0, 0.0), (4.0, 2.0, 0.0)


def test_level_ground():
    worst = driven(np.full(SHAPE, 7.5), *ALONG_X)
    assert worst.largest_step_m == 0.0
    assert worst.steepest_slope_rad == pytest.approx(0.0, abs=1e-9)
    assert worst.lowest_ceiling_m == np.inf


@pytest.mark.parametrize("height", [0.3, -0.3])
def test_a_step_across_the_way(height):
    worst = driven(np.where(X > 2.5, height, 0.0), *ALONG_X)
    assert worst.largest_step_m == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("reach", "step"),
    # The rectangle ends 0.32 m beside the way: the last cells under it have their middle at
    # 0.275 m, the next ones at 0.325 m.
    [(0.25, 0.5), (0.30, 0.0), (0.40, 0.0)],
)
def test_a_kerb_along_the_way_counts_where_it_is_under_the_rectangle(reach, step):
    aside = Y - 2.0
    assert driven(np.where(aside > reach, 0.5, 0.0), *ALONG_X).largest_step_m == step
    assert driven(np.where(aside < -reach, 0.5, 0.0), *ALONG_X).largest_step_m == step


def test_the_rectangle_is_long_where_it_looks():
    kerb = np.where(Y > 2.35, 0.5, 0.0)
    along, across = (2.5, 2.0, 0.0), (2.5, 2.0, math.pi / 2)
    assert driven(kerb, along).largest_step_m == 0.0
    assert driven(kerb, across).largest_step_m == 0.5
    # Turned by 45 degrees a corner reaches out by half the diagonal, 0.504 m.
    kerb = np.where(Y > 2.45, 0.5, 0.0)
    assert driven(kerb, across).largest_step_m == 0.0
    assert driven(kerb, (2.5, 2.0, math.atan2(0.78, 0.64))).largest_step_m == 0.5


def test_what_lies_between_far_poses_is_met():
    wall = np.where(np.abs(X - 2.525) < 0.02, 1.0, 0.0)
    assert wall.any()
    assert driven(wall, *ALONG_X).largest_step_m == 1.0
    assert driven(wall, ALONG_X[0]).largest_step_m == 0.0
    beyond = np.where(np.abs(X - 4.625) < 0.02, 1.0, 0.0)
    assert driven(beyond, *ALONG_X).largest_step_m == 0.0


def test_the_last_pose_has_its_own_heading():
    kerb = np.where((Y > 2.35) & (X > 3.7), 0.5, 0.0)
    start, end = ALONG_X
    assert driven(kerb, start, end).largest_step_m == 0.0
    assert driven(kerb, start, (*end[:2], math.pi / 2)).largest_step_m == 0.5


@pytest.mark.parametrize(("gx", "gy"), [(0.2, 0.0), (0.0, -0.5), (0.3, 0.4)])
@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_a_plane(gx, gy, heading):
    worst = driven(gx * X + gy * Y, (1.0, 2.0, heading), (4.0, 2.0, heading))
    assert worst.steepest_slope_rad == pytest.approx(math.atan(math.hypot(gx, gy)), abs=1e-9)
    assert worst.largest_step_m == pytest.approx((abs(gx) + abs(gy)) * CELL)  # across


def test_the_steepest_part_counts():
    ramp = np.interp(X, [2.0, 3.5], [0.0, 0.6])
    assert driven(ramp, *ALONG_X).steepest_slope_rad == pytest.approx(math.atan(0.4), abs=1e-9)
    assert driven(ramp, ALONG_X[0]).steepest_slope_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "pose", [(0.3, 2.0, 0.0), (4.8, 2.0, 0.0), (2.0, 0.2, 0.0), (-9.0, 2.0, 0)]
)
def test_beyond_the_true_surface(pose):
    worst = driven(np.zeros(SHAPE), pose)
    assert worst.largest_step_m == worst.steepest_slope_rad == np.inf
    assert driven(np.zeros(SHAPE), (2.0, 2.0, 0.0), pose).largest_step_m == np.inf


def test_a_hole_under_the_rectangle_and_beside_it():
    hole = np.zeros(SHAPE)
    hole[40, 60] = np.nan
    assert driven(hole, *ALONG_X).largest_step_m == np.inf
    assert driven(hole, (1.0, 1.0, 0.0), (4.0, 1.0, 0.0)).largest_step_m == 0.0


def test_the_lowest_ceiling_over_the_way():
    clearance = np.where(np.abs(X - 3.0) < 0.1, 1.25, np.inf)
    clearance[IY < 5] = 0.3
    worst = driven(np.zeros(SHAPE), *ALONG_X, clearance=clearance)
    assert worst.lowest_ceiling_m == 1.25
    assert driven(np.zeros(SHAPE), ALONG_X[0], clearance=clearance).lowest_ceiling_m == np.inf


def test_a_surface_that_does_not_begin_at_zero():
    moved = ground(np.where(X > 2.5, 0.3, 0.0), origin=(-20.0, 30.0))
    path = np.array(ALONG_X) + (-20.0, 30.0, 0.0)
    assert evaluate_path(moved, path, *SIZE).largest_step_m == pytest.approx(0.3)


def test_figures_by_name():
    worst = Drivability(largest_step_m=0.12345, steepest_slope_rad=np.inf, lowest_ceiling_m=2.0)
    assert worst.as_dict() == {
        "largest_step_m": 0.123, "steepest_slope_rad": None, "lowest_ceiling_m": 2.0,
    }  # fmt: skip


def test_grounds_are_read_and_others_refused(tmp_path):
    path = tmp_path / "surface.npz"
    fields = {"resolution": 0.05, "origin": [1.0, 2.0], "top": np.full((3, 4), 2.0)}
    np.savez(path, **fields)
    top = read_ground(path)
    assert top.geometry == Geometry(resolution=0.05, origin=(1.0, 2.0), shape=(3, 4))
    assert (top.height == 2.0).all()
    assert (top.clearance == np.inf).all()
    np.savez(path, **fields, ground=np.zeros((3, 4)), clearance=np.ones((3, 4)))
    below = read_ground(path)
    assert (below.height == 0.0).all()
    assert (below.clearance == 1.0).all()
    np.savez(path, top=np.zeros((3, 4)))
    for name in ("surface.npz", "missing.npz"):
        with pytest.raises(InputError, match=name):
            read_ground(tmp_path / name)
