# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which submaps a map follows, and how far."""

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.pipelines.submap_poses import SubmapPoses
from heightmap25d_ros.simulation import messages

FRAME, BEGUN_NS = "map", messages.START_NS


def planar(x, z=0.0, yaw=0.0):
    return se3.from_xyz_rpy([x, 0.0, z, 0.0, 0.0, yaw])


def told(submaps, *poses, begun_ns=BEGUN_NS):
    return submaps.take(messages.path(begun_ns, FRAME, np.array(poses)), FRAME)


def test_small_steps_add_up_to_one_that_is_followed():
    """Cells move by whole ones: 4 cm five times are 20 cm, not nothing."""
    submaps = SubmapPoses(0.1)
    assert told(submaps, planar(0.0), planar(4.0)) is None
    for step in range(1, 5):
        assert told(submaps, planar(0.0), planar(4.0 + 0.04 * step)) is None
    motions = told(submaps, planar(0.0), planar(4.2001))
    np.testing.assert_allclose(motions[:2], [np.eye(4)] * 2)
    np.testing.assert_allclose(motions[2], planar(0.2001), atol=1e-12)
    assert told(submaps, planar(0.0), planar(4.2001)) is None


def test_turns_and_lifts_are_followed_as_well():
    for pose in (planar(4.0, yaw=0.03), planar(4.0, z=0.06)):
        submaps = SubmapPoses(0.1)
        told(submaps, planar(0.0), planar(4.0))
        motions = told(submaps, planar(0.0), pose)
        np.testing.assert_allclose(motions[2] @ planar(4.0), pose, atol=1e-12)


def test_a_submap_that_has_just_begun_has_not_moved():
    submaps = SubmapPoses(0.1)
    told(submaps, planar(0.0))
    assert told(submaps, planar(0.0), planar(4.0)) is None
    assert submaps.newest == 2
    motions = told(submaps, planar(1.0), planar(5.0), planar(9.0))
    assert len(motions) == 3  # what is not from any submap, and the two that had begun
    np.testing.assert_allclose(motions[1:], [planar(1.0)] * 2, atol=1e-12)


def test_of_a_new_map_nothing_has_moved():
    submaps = SubmapPoses(0.1)
    told(submaps, planar(0.0), planar(4.0))
    assert told(submaps, planar(2.0), begun_ns=BEGUN_NS + 10**9) is None
    assert submaps.newest == 1
