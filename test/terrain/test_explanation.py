# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why cells are what they are: exact small maps, and random ones against the obstacle map."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from properties import draws

from heightmap25d_ros.cli import main
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.params.sections import TraversabilityParams
from heightmap25d_ros.terrain.explanation import Rule, Waiting, explain
from heightmap25d_ros.terrain.traversability import INFLATED, OCCUPIED, to_obstacle_map

SMALL = TraversabilityParams(robot_radius=0.25)
WALL = HeightMap.from_metres([[0.0] * 6 + [0.6] * 3] * 5)


def at(height_map, cell, **arguments):
    return explain(height_map, height_map.geometry.cell_center(cell), SMALL, **arguments)


def test_a_wall_the_ground_beside_it_and_the_ground_beyond():
    wall, beside, beyond = (at(WALL, (2, ix)) for ix in (6, 5, 1))
    assert (wall.rule, wall.value, wall.limit) == (Rule.STEP, pytest.approx(0.6), 0.1)
    assert wall.because_of == pytest.approx((0.6875, 0.3125))
    assert wall.sentence == (
        "(0.81, 0.31): occupied, 0.60 m above its neighbour to the west at (0.69, 0.31), max_step "
        "is 0.10 m; height 0.60 m, probability 1.00"
    )
    assert (beside.rule, beside.cost, beside.occupancy) == (Rule.INFLATION, INFLATED, 0)
    assert beside.value == pytest.approx(0.125)
    assert beside.because_of == pytest.approx(wall.position)
    assert "that cell is occupied, 0.60 m above its neighbour" in beside.sentence
    assert (beyond.rule, beyond.cost) == (Rule.LEVEL, 0)
    assert beyond.sentence == "(0.19, 0.31): free, on level ground; height 0.00 m, probability 1.00"


def test_a_slope_is_told_in_degrees():
    rise = 0.125 * math.tan(math.radians(30.0))
    steep = HeightMap.from_metres(np.tile(rise * np.arange(12), (12, 1)))
    found = at(steep, (6, 6))
    assert found.rule is Rule.SLOPE
    assert math.degrees(found.value) == pytest.approx(30.0, abs=0.5)
    assert found.occupancy == OCCUPIED
    gentle = HeightMap.from_metres(np.tile(rise / 2 * np.arange(12), (12, 1)))
    found = at(gentle, (6, 6))
    assert found.rule is Rule.SLOPE
    assert found.sentence.startswith("(0.81, 0.81): free, cost ")
    assert "by the slope of 1" in found.sentence


def test_unknown_cells_and_places_outside():
    metres = np.zeros((3, 4))
    metres[1, 1] = np.nan
    height_map = HeightMap.from_metres(metres)
    never = at(height_map, (1, 1))
    assert (never.rule, never.occupancy, never.probability) == (Rule.UNOBSERVED, -1, 0.0)
    height_map.probability[1, 2] = 20_000
    doubted = at(height_map, (1, 2), waiting=Waiting(height=0.4, probability=0.7))
    assert doubted.rule is Rule.DOUBTED
    assert doubted.value == pytest.approx(20_000 / 65535)
    assert doubted.sentence.endswith("a reading of 0.40 m waits, with probability 0.70")
    outside = explain(height_map, (-3.01, 0.0))
    assert (outside.rule, outside.sentence) == (
        Rule.OUTSIDE, "(-3.06, 0.06): unknown, outside of the map"
    )  # fmt: skip


@draws(40)
@given(
    arrays(
        np.float64, (9, 11),
        elements=st.sampled_from([0.0, 0.02, 0.05, 0.09, 0.11, 0.3, -0.4, np.nan]),
    )
)  # fmt: skip
def test_explanations_agree_with_the_obstacle_map(metres):
    """The numbers that they name are those of the heights, and exceed the limits that they name."""
    height_map = HeightMap.from_metres(metres)
    expected = to_obstacle_map(height_map, SMALL)
    for cell in np.ndindex(metres.shape):
        found = at(height_map, cell)
        assert found.occupancy == expected.occupancy[cell]
        assert found.cost == expected.cost[cell]
        assert f"{found.height:.2f}" == f"{metres[cell]:.2f}"
        if found.occupancy == OCCUPIED:
            assert found.value > found.limit
        if found.occupancy == OCCUPIED and found.rule is Rule.STEP:
            other = tuple(height_map.geometry.cell_at(found.because_of))
            assert found.value == pytest.approx(metres[cell] - metres[other])
            assert max(abs(np.subtract(cell, other))) == 1
        if found.rule is Rule.INFLATION:
            other = tuple(height_map.geometry.cell_at(found.because_of))
            assert expected.occupancy[other] == OCCUPIED
            assert found.value <= found.limit


def test_the_command_line(tmp_path, capsys):
    map_directory.save(tmp_path / "map", WALL, to_obstacle_map(WALL), "map")
    assert main(["explain", str(tmp_path / "map"), "0.8,0.3", "-4.01,0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "occupied, 0.60 m above its neighbour to the west" in lines[0]
    assert lines[1].endswith("(-4.06, 0.06): unknown, outside of the map")
    assert main(["explain", str(tmp_path / "map"), "0.8,0.3", "--json"]) == 0
    (cell,) = json.loads(capsys.readouterr().out)["cells"]
    assert (cell["rule"], cell["value"], cell["limit"]) == ("step", 0.6, 0.1)
    with pytest.raises(SystemExit):
        main(["explain", str(tmp_path / "map"), "here"])
    assert "here is not x,y" in capsys.readouterr().err
    assert main(["explain", str(tmp_path), "0,0"]) == 2
