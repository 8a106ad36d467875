# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Upright edges of what a laser sees, against a plan of which all corners are known."""

import numpy as np
import pytest

from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.slam.edges import add_edges, edges_of
from heightmap25d_ros.slam.patches import STATES, NormalEquations, Returns

CORNERS = np.array([(2.0, 0.5), (3.0, -0.4)])  # of a crate's face before a wall at x = 6


def scan(laser=(0.0, 0.0), pitch=0.0):
    """A level laser's beams, half a degree apart, in a plan (N, 3)."""
    angle = np.deg2rad(np.arange(-60.0, 60.5, 0.5))
    aimed = np.column_stack([np.cos(angle), np.sin(angle)])
    side = CORNERS[1] - CORNERS[0]
    begin = CORNERS[0] - laser
    turn = aimed[:, 0] * side[1] - aimed[:, 1] * side[0]
    along = (aimed[:, 1] * begin[0] - aimed[:, 0] * begin[1]) / turn
    to_face = (begin[0] * side[1] - begin[1] * side[0]) / turn
    to_wall = (6.0 - laser[0]) / aimed[:, 0]
    ranges = np.where((along > 0.0) & (along < 1.0), to_face, to_wall)
    ends = np.column_stack([laser + ranges[:, None] * aimed, np.full(len(angle), 0.4)])
    ends[:, 2] -= pitch * ranges
    origins = np.broadcast_to([*laser, 0.4], ends.shape).copy()
    no = np.zeros(len(angle), np.bool_)
    return Beams(origins=origins, ends=ends, is_hit=~no, is_lone=no)


@pytest.mark.parametrize("x", [0.0, 0.7, 1.2])
def test_the_ends_of_a_face_are_found_within_a_beam_of_it(x):
    found = edges_of(scan((x, 0.0)))
    away = np.linalg.norm(found[:, None, :2] - CORNERS, axis=2)
    half = np.deg2rad(0.25) * np.linalg.norm(CORNERS - (x, 0.0), axis=1)
    assert len(found) == 2  # none of the wall, which beams at the sides graze
    # Half a beam aside; along the beam what the face recedes by meanwhile, which is 1.6 times more.
    assert (away.min(axis=0) < half * np.hypot(1.0, 3.2)).all()


def test_rims_of_what_a_pitched_laser_sees_are_no_upright_edges():
    assert len(edges_of(scan(pitch=0.3))) == 0


def test_edges_tell_how_far_the_robot_came():
    """Of four poses the third one is thought to be 4 cm too far: the others draw it back."""
    positions = np.column_stack([np.arange(4) * 0.2, np.zeros((4, 2))])
    seen = [edges_of(scan(position[:2])) - (*position[:2], 0.0) for position in positions]
    pose_of = np.repeat(np.arange(4), [4 * len(part) for part in seen])
    places = np.concatenate([np.tile(part, (4, 1)) for part in seen])
    positions[2, 0] += 0.04
    size = STATES * 5
    equations = NormalEquations.zero(size)
    no = np.zeros(len(places), np.bool_)
    returns = Returns(places, np.zeros_like(places), pose_of, no)
    assert add_edges(returns, positions, 1.0, 0.1, equations) == 4  # two corners, sorted twice
    third = 2 * STATES
    back = -equations.gradient[third] / equations.matrix[third, third]
    assert back == pytest.approx(-0.04, abs=0.006)
    wide = NormalEquations.zero(size)
    assert add_edges(returns, positions, 1.0, 1.0, wide) == 0  # they might be other ones
