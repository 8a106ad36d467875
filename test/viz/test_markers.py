# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What viewers are shown: exact small maps, and what rclpy reads of our own serialization."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker

from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.search import cost_to_go
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import block_mesh, marker_cdr, markers
from heightmap25d_ros.viz.field_arrows import field_arrows

NAN = np.nan


def a_map(centimetres, resolution=0.5):
    height = np.array(centimetres, float)
    known = np.isfinite(height)
    return HeightMap(
        geometry=Geometry(resolution=resolution, origin=(10.0, -1.0), shape=height.shape),
        height=np.where(known, height, 0).astype(np.int16),
        probability=np.where(known, 60000, 0).astype(np.uint16),
        probability_threshold=0.5,
    )


def test_all_faces_of_a_pillar_look_outwards():
    metres = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    geometry = Geometry(resolution=1.0, origin=(0.0, 0.0), shape=(3, 3))
    found = block_mesh.all_faces(geometry, metres)
    assert len(found.corners) == 9 + 4  # a top each, and the pillar's sides
    tall = np.ptp(found.corners[:, :, 2], axis=1) > 0.0
    sides = found.corners[tall]
    assert len(sides) == 4
    middles = sides.mean(axis=1)
    np.testing.assert_allclose(middles[:, 2], 1.0)
    away = middles[:, :2] - 1.5
    assert {tuple(np.round(a, 3)) for a in away} == {(0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)}  # fmt: skip  # noqa: E501
    # The area vector of a polygon whose corners go round against the clock points to the viewer.
    for corners, outward in zip(sides, away, strict=True):
        area = sum(np.cross(corners[i], corners[(i + 1) % 4]) for i in range(4)) / 2
        np.testing.assert_allclose(area[:2], outward * 2 * 2.0, atol=1e-12)
    for top in found.corners[~tall]:
        area = sum(np.cross(top[i], top[(i + 1) % 4]) for i in range(4)) / 2
        np.testing.assert_allclose(area, (0.0, 0.0, 1.0), atol=1e-12)


def test_blocks_are_coloured_by_height():
    corners, colours = markers.blocks(a_map([[0.0, 0.0, 200.0]]))
    level = np.ptp(corners[:, :, 2], axis=1) == 0.0
    low, high = (colours[level & np.isclose(corners[:, 0, 2], z)] for z in (0.0, 2.0))
    assert len(low) == 2
    assert len(high) == 1
    assert np.abs(low.mean(axis=0) - high[0]).max() > 0.2
    assert (colours >= 0.0).all()
    assert (colours <= 1.0).all()


def test_frontier_is_what_is_free_beside_the_unknown():
    heights = np.zeros((7, 8))
    heights[:, 5:] = NAN
    heights[3, 3:5] = 100.0  # a wall up to the unknown is no frontier
    shown = a_map(heights)
    known = markers.frontier(
        shown, to_obstacle_map(shown, TraversabilityParams(robot_radius=0.0))
    ).known
    expected = np.zeros((7, 8), bool)
    expected[[0, -1], :5] = expected[:, 0] = True  # the map's own border
    expected[[0, 1, 2, 4, 5, 6], 4] = True
    np.testing.assert_array_equal(known, expected)


def test_arrows_head_for_the_goal():
    shown = a_map(np.zeros((40, 60)), resolution=0.25)
    graph = transition_graph(shown, TraversabilityParams(), PlannerParams())
    goal = (20, 30)
    arrows = field_arrows(graph, cost_to_go(graph.incoming, goal))
    assert 100 < len(arrows) < 20 * 30
    assert len(np.unique(arrows[:, :2, 3], axis=0)) == len(arrows)
    away = shown.geometry.cell_center(goal) - arrows[:, :2, 3]
    far = np.hypot(*away.T)
    assert far.min() > 0.0  # none at the goal itself
    cosine = (arrows[:, :2, 0] * away).sum(axis=1) / far
    assert cosine.min() >= math.cos(math.radians(45.0)) - 1e-9  # one of eight directions


@pytest.mark.parametrize("frame", ["m", "map", "maps", "odom_1", "robot_12/map", "räume"])
def test_rclpy_reads_the_triangles(frame):
    marker = Marker(ns="blocks", type=Marker.TRIANGLE_LIST, id=7)
    marker.header.frame_id, marker.pose.orientation.w = frame, 0.5
    rng = np.random.default_rng(1)
    corners, colours = rng.uniform(-9.0, 9.0, (3, 4, 3)), rng.uniform(0.0, 1.0, (3, 3))
    data = marker_cdr.with_faces(marker, serialize_message(marker), corners, colours)
    read = deserialize_message(data, Marker)
    points = np.array([(p.x, p.y, p.z) for p in read.points]).reshape(3, 2, 3, 3)
    for face, (first, second) in zip(corners, points, strict=True):
        np.testing.assert_array_equal(first, face[[0, 1, 2]])
        np.testing.assert_array_equal(second, face[[0, 2, 3]])
    seen = np.array([(c.r, c.g, c.b, c.a) for c in read.colors])
    np.testing.assert_allclose(seen[::2, :3], colours, atol=1e-7)
    np.testing.assert_array_equal(seen[::2], seen[1::2])
    assert (seen[:, 3] == 1.0).all()
    read.points, read.colors = [], []
    assert read == marker


def test_what_is_above_is_a_slab():
    deck = UpperSurfaces.of([(0, 1)], top=[240], bottom=[210])
    floor = HeightMap.from_metres([[0.0, 0.0, 0.0]])
    without, _ = markers.blocks(floor)
    corners, colours = markers.blocks(replace(floor, upper=deck))
    slab = corners[len(without) :]
    assert len(corners) == len(colours) == len(without) + 6
    assert slab.reshape(-1, 3).min(axis=0) == pytest.approx((0.125, 0.0, 2.1))
    assert slab.reshape(-1, 3).max(axis=0) == pytest.approx((0.25, 0.125, 2.4))
    # Seen from outside, the corners are in counter-clockwise order.
    middle = slab.reshape(-1, 3).mean(axis=0)
    normals = np.cross(slab[:, 1] - slab[:, 0], slab[:, 2] - slab[:, 1])
    assert (((slab.mean(axis=1) - middle) * normals).sum(axis=1) > 0.0).all()
