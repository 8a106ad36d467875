# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive in UTM coordinates at 2500 m: what comes of it is what comes of the drive near zero."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_writer import rclpy_type
from localization_bags import drive, events_of
from repository import BAGS

from heightmap25d_ros import cli
from heightmap25d_ros.evaluation.map_error import evaluate_map
from heightmap25d_ros.evaluation.truth import read_truth
from heightmap25d_ros.io import decode, encode, map_directory
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.planning.plan import Pose2D

pytestmark = pytest.mark.slow  # whole drives

OFFSET = np.array([500_000.0, 4_500_000.0, 2500.0])
SCANS = ["/scan", "/scan_down"]
# One surface a cell: the format of a file with several is another one.
PARAMS = with_values(Params(), {"intake.scan_topics": SCANS, "levels.max_surfaces": 1})


def translated(event, offset):
    """An event of a bag with its pose moved."""
    if event.topic not in ("/odom", "/ground_truth"):
        return event
    message = deepcopy(event.message)
    place = message.pose.pose.position
    place.x, place.y, place.z = (float(c) for c in np.array([place.x, place.y, place.z]) + offset)
    return event._replace(message=message)


def mapped(bag: str, odometry: str, offset) -> Mapping:
    mapping = Mapping(PARAMS)
    for event in events_of(BAGS / bag, 15.0):
        moved = translated(event, offset)
        topics = {"/odom": "", "/ground_truth": "", odometry: "/odom"}
        topic = topics.get(event.topic, event.topic)
        if topic:
            feed(mapping, topic, moved.message)
    mapping.flush()
    return mapping


@pytest.fixture(scope="module")
def near_and_far() -> Iterator[tuple[Mapping, Mapping]]:
    return mapped("ramp", "/odom", np.zeros(3)), mapped("ramp", "/odom", OFFSET)


def test_cells_are_the_same(near_and_far):
    (near, obstacles), (far, far_obstacles) = (mapping.maps() for mapping in near_and_far)
    assert near.known.sum() > 2000
    # At 4500 km a double has steps of a nanometre, and some beams run exactly along cell borders.
    assert (near.probability != far.probability).sum() <= 4
    assert (near.known != far.known).sum() <= 2
    assert (obstacles.cost != far_obstacles.cost).sum() <= 2
    np.testing.assert_array_equal(near.height, far.height)
    assert np.subtract(far.geometry.origin, near.geometry.origin).tolist() == [*OFFSET[:2]]
    assert (near.geometry.ground_zero, far.geometry.ground_zero) == (0.0, 2500.0)


def test_files_and_messages_keep_the_centimetres(near_and_far, tmp_path: Path):
    (near, near_obstacles), (far, obstacles) = (mapping.maps() for mapping in near_and_far)
    map_directory.save(tmp_path / "far", far, obstacles, "map")
    loaded = map_directory.load(tmp_path / "far", 0.5).height_map
    both = near.known & far.known
    np.testing.assert_allclose(loaded.metres[both], near.metres[both] + 2500.0, atol=1e-9)
    assert loaded.geometry == far.geometry
    with np.load(tmp_path / "far" / "height_grid.npz") as archive:
        assert (archive["format_version"], archive["z_offset"]) == (2, 2500.0)
    map_directory.save(tmp_path / "near", near, near_obstacles, "map")
    with np.load(tmp_path / "near" / "height_grid.npz") as archive:
        assert archive["format_version"] == 1
        assert "z_offset" not in archive

    grid = rclpy_type("heightmap25d_msgs/msg/HeightGrid")()
    encode.fill_height_grid(grid, far, 0, "map")
    assert grid.info.origin.position.z == 2500.0
    decoded = decode.height_map(grid)
    assert decoded.geometry == far.geometry
    np.testing.assert_array_equal(decoded.metres, far.metres)
    occupancy = rclpy_type("nav_msgs/msg/OccupancyGrid")()
    encode.fill_occupancy_grid(occupancy, obstacles.occupancy, far.geometry, 0, "map")
    origin = occupancy.info.origin.position
    assert (origin.x, origin.y, origin.z) == (*far.geometry.origin, 2500.0)


def test_a_loaded_map_goes_on(near_and_far, tmp_path: Path):
    far, obstacles = near_and_far[1].maps()
    map_directory.save(tmp_path / "far", far, obstacles, "map")
    goes_on = Mapping(PARAMS)
    goes_on.clear(map_directory.load(tmp_path / "far", 0.5).height_map)
    again, _ = goes_on.maps()
    np.testing.assert_array_equal(again.metres, far.metres)
    assert goes_on.grid.geometry.ground_zero == 2500.0


def moved_map(height_map):
    """The same cells far from zero."""
    x, y = np.add(height_map.geometry.origin, OFFSET[:2]).tolist()
    geometry = replace(height_map.geometry, origin=(x, y), ground_zero=OFFSET[2])
    return replace(height_map, geometry=geometry)


def test_a_path_is_the_same(near_and_far):
    near, _ = near_and_far[0].maps()
    paths = []
    for height_map, offset in ((near, np.zeros(3)), (moved_map(near), OFFSET)):
        planning = Planning(PARAMS)
        planning.set_map(height_map)
        start, goal = (Pose2D(x=x + offset[0], y=offset[1], yaw=0.0) for x in (2.0, 9.0))
        plan = planning.plan_between(start, goal)
        assert plan.found, plan.reason
        paths.append((plan.poses, plan.length, plan.climb))
    moved = paths[0][0].copy()
    moved[:, :3, 3] += OFFSET
    np.testing.assert_allclose(moved, paths[1][0], atol=1e-5)
    assert paths[0][1:] == pytest.approx(paths[1][1:], abs=1e-4)


def test_pictures_are_drawn_and_figures_told(near_and_far, tmp_path: Path, capsys):
    map_directory.save(tmp_path / "far", *near_and_far[1].maps(), "map")
    assert cli.main(["render", str(tmp_path / "far"), "-o", str(tmp_path / "pictures")]) == 0
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 3
    capsys.readouterr()
    assert cli.main(["info", str(tmp_path / "far")]) == 0
    assert "2500.0" in capsys.readouterr().out


def test_the_map_is_evaluated_where_the_truth_is(near_and_far, tmp_path: Path):
    truth = dict(np.load(BAGS / "ramp" / "truth" / "surface.npz"))
    near, _ = near_and_far[0].maps()
    figures = []
    for height_map, offset in ((near, np.zeros(3)), (moved_map(near), OFFSET)):
        moved = {**truth, "origin": truth["origin"] + offset[:2]}
        for name in ("top", "seen"):
            moved[name] = truth[name].astype(np.float64) + offset[2]
        np.savez(tmp_path / "surface.npz", **moved)
        error = evaluate_map(
            height_map, PARAMS.traversability, read_truth(tmp_path / "surface.npz")
        )
        figures.append((error.blocked_transitions.f1, error.error_of_seen.bias_m))
    assert figures[1] == pytest.approx(figures[0], abs=1e-6)


def test_localization_holds_the_pose_as_near_zero():
    errors = []
    for offset in (np.zeros(3), OFFSET):
        long_term, _ = mapped("room_1", "/ground_truth", offset).maps()
        events = [translated(event, offset) for event in events_of(BAGS / "room_1", 15.0)]
        found = drive(events, long_term)
        assert sum(attempt.registration.is_accepted for attempt in found.attempts) > 10
        errors.append(found.errors(events))
    # Registration compares scores: the last bit may choose the next of its steps, of which the last
    # two are a 16th and a 32nd of a cell of 0.125 m.
    np.testing.assert_allclose(errors[0][:, :2], errors[1][:, :2], atol=0.125 / 16)
    np.testing.assert_allclose(errors[0][:, 2], errors[1][:, 2], atol=0.1)
