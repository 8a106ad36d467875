# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last metres refined while the drive goes on, against drives of which the truth is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from bent_drives import drive, keyframe_of
from scipy import linalg

from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.live_refinement import LiveRefinement

PARAMS = Params().scan_filter
LENGTH = 10  # keyframes of a submap


def kept(keyframes):
    """A refinement that has kept keyframes, and their submaps."""
    refinement = LiveRefinement(PARAMS)
    for number, keyframe in enumerate(keyframes):
        refinement.keep(keyframe._replace(submap=number // LENGTH), float(number))
    submaps = [SimpleNamespace(T_map_submap=np.eye(4)) for _ in keyframes[::LENGTH]]
    return refinement, submaps


def refined(refinement, submaps, seconds=np.inf):
    """What moves, when it is done; the submaps are moved."""
    refinement.begin(submaps)
    moves = None
    while moves is None:
        moves = refinement.step(seconds)
    for number, motion in moves.motions.items():
        submaps[number].T_map_submap = motion @ submaps[number].T_map_submap
    return moves


def test_where_the_robot_is_and_the_submaps_are_moved_to_where_they_belong():
    true, keyframes, _ = drive(1)
    told = np.array([keyframe.T_odom_base for keyframe in keyframes])
    refinement, submaps = kept(keyframes)
    moves = refined(refinement, submaps)
    assert np.linalg.norm((told[-1] - true[-1])[:2, 3]) > 0.3
    np.testing.assert_allclose((moves.newest @ told[-1])[:2, 3], true[-1, :2, 3], atol=0.05)
    assert sorted(moves.motions) == [1, 2, 3]  # the first one holds the others
    for number, motion in moves.motions.items():
        middle = LENGTH * number + LENGTH // 2 - 1
        np.testing.assert_allclose((motion @ told[middle])[:2, 3], true[middle, :2, 3], atol=0.05)
    assert moves.heading_bias == pytest.approx(-0.02, abs=0.01)


def test_the_next_one_begins_where_this_one_ended():
    _, keyframes, _ = drive(2)
    refinement, submaps = kept(keyframes)
    refined(refinement, submaps)
    again = refined(refinement, submaps)
    moved = (again.newest @ keyframes[-1].T_odom_base - keyframes[-1].T_odom_base)[:3, 3]
    assert np.linalg.norm(moved) < 0.03


def test_slices_give_what_is_done_at_once():
    _, keyframes, _ = drive(3)
    at_once, in_slices = (refined(*kept(keyframes), seconds) for seconds in (np.inf, 0.0))
    np.testing.assert_array_equal(at_once.newest, in_slices.newest)


def test_submaps_stay_rigid_however_often_they_are_moved():
    """What a motion is off from a rigid one must not grow from one refinement to the next."""
    _, keyframes, _ = drive(4)
    refinement, submaps = kept(keyframes)
    for _ in range(50):
        refined(refinement, submaps)
    for submap in submaps:
        turn = submap.T_map_submap[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_what_was_kept_meanwhile_is_refined_the_next_time():
    _, keyframes, _ = drive(5)
    refinement, submaps = kept(keyframes[:30])
    refinement.begin(submaps)
    for number, keyframe in enumerate(keyframes[30:], 30):
        refinement.keep(keyframe._replace(submap=3), float(number))
    assert 3 not in refinement.step(np.inf).motions
    submaps.append(SimpleNamespace(T_map_submap=np.eye(4)))
    assert 3 in refined(refinement, submaps).motions


def test_a_few_keyframes_tell_nothing():
    _, keyframes, _ = drive(6)
    refinement, submaps = kept(keyframes[:5])
    refinement.begin(submaps)
    assert refinement.step(np.inf) is None


def test_a_refinement_that_was_cancelled_moves_nothing():
    _, keyframes, _ = drive(7)
    refinement, submaps = kept(keyframes)
    refinement.begin(submaps)
    refinement.cancel()
    assert refinement.step(np.inf) is None


def test_equations_without_a_solution_move_nothing_and_lose_nothing(monkeypatch):
    def fails(*_, **__):
        raise linalg.LinAlgError("not positive definite")

    _, keyframes, _ = drive(8)
    refinement, submaps = kept(keyframes)
    refinement.begin(submaps)
    with monkeypatch.context() as patch:
        patch.setattr(linalg, "cho_factor", fails)
        assert refinement.step(np.inf) is None
    assert refined(refinement, submaps).motions


def test_of_a_long_drive_a_bounded_number_is_kept_and_all_of_the_last_ones():
    refinement, _ = kept([keyframe_of(k, np.eye(4), np.zeros((1, 3))) for k in range(1000)])
    scans = [keyframe.scan for keyframe in refinement._keyframes]
    assert len(scans) == 200
    assert scans[-80:] == list(range(920, 1000))
    assert set(np.diff(scans[:-80])) == {2}
