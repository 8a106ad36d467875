# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures show what is in the map, where it is, and the same bytes every time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.viz import map_figures, palette
from heightmap25d_ros.viz.walls import walls_without_ground

ROWS, COLUMNS = 30, 60
GEOMETRY = Geometry(resolution=0.1, origin=(-2.0, 1.0), shape=(ROWS, COLUMNS))
TRAJECTORY = np.array([[-1.5, 1.5, 0.0], [0.0, 2.5, 0.0], [3.5, 3.5, 0.0]])


def height_map(known: bool = True) -> HeightMap:
    """Flat but for a block at small x and large y."""
    height = np.zeros((ROWS, COLUMNS), np.int16)
    height[20:25, 5:10] = 100
    probability = np.full((ROWS, COLUMNS), 65535 if known else 0, np.uint16)
    probability[5:15, 30:50] = 0
    return HeightMap(
        geometry=GEOMETRY, height=height, probability=probability, probability_threshold=0.5
    )


def obstacle_map() -> SimpleNamespace:
    occupancy = np.zeros((ROWS, COLUMNS), np.int8)
    occupancy[5:15, 30:50] = -1
    occupancy[20:25, 5:10] = 100
    cost = np.maximum(occupancy, 0)
    return SimpleNamespace(geometry=GEOMETRY, occupancy=occupancy, cost=cost)


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def center_of(mask: np.ndarray) -> np.ndarray:
    """Mean (x, y) of a mask, as shares of the picture's width and height, y up."""
    row, column = np.argwhere(mask).mean(axis=0) / mask.shape
    return np.array([column, 1.0 - row])


def test_obstacle_map_has_three_colours_in_their_places(tmp_path: Path) -> None:
    path = tmp_path / "obstacles.png"
    map_figures.obstacle_map(path, obstacle_map())
    image = pixels(path)
    inside = image[image.shape[0] // 6 : -image.shape[0] // 6]  # without the legend
    is_obstacle = (np.abs(inside - palette.rgb(palette.OCCUPIED)) < 8).all(axis=-1)
    is_unknown = (inside < 8).all(axis=-1)
    # 25 cells of one, 200 of the other, and a frame and labels that are black, too.
    assert is_unknown.sum() / is_obstacle.sum() == pytest.approx(8.0, rel=0.1)
    obstacle, unknown = center_of(is_obstacle), center_of(is_unknown)
    assert obstacle[0] < 0.3 < unknown[0]
    assert unknown[1] < 0.5 < obstacle[1]


def test_height_map_shows_the_block_and_the_unknown(tmp_path: Path) -> None:
    path = tmp_path / "heights.png"
    map_figures.height_map(path, height_map())
    image = pixels(path)
    frame = image[: image.shape[0] * 5 // 6, : image.shape[1] * 8 // 10]
    is_unknown = (frame < 8).all(axis=-1)
    assert is_unknown.sum() > 0.05 * is_unknown.size
    lowest, highest = (palette.HEIGHTS(value)[:3] for value in (0.0, 1.0))
    is_low, is_high = (
        (np.abs(frame - 255 * np.array(colour)) < 4).all(axis=-1) for colour in (lowest, highest)
    )
    # Without the block's edge (16 cells) and its foot (24), which are shaded.
    assert is_low.sum() / is_high.sum() == pytest.approx((1800 - 225 - 24) / 9, rel=0.25)
    assert center_of(is_high)[0] < 0.4 < center_of(is_unknown)[0]


@pytest.mark.slow
@pytest.mark.parametrize("draw", [map_figures.height_map, map_figures.blocks])
def test_trajectory_is_drawn_and_bytes_are_the_same(tmp_path: Path, draw) -> None:
    for name in ("first.png", "second.png"):
        draw(tmp_path / name, height_map(), TRAJECTORY)
    draw(tmp_path / "without.png", height_map())
    first = (tmp_path / "first.png").read_bytes()
    assert first == (tmp_path / "second.png").read_bytes()
    colour = np.array(palette.rgb(palette.DRIVEN))
    with_line, without = (
        (np.abs(pixels(tmp_path / name) - colour) < 12).all(axis=-1).sum()
        for name in ("first.png", "without.png")
    )
    assert with_line > 300
    assert without == 0


def test_blocks_show_tops_and_sides(tmp_path: Path) -> None:
    path = tmp_path / "blocks.png"
    map_figures.blocks(path, height_map())
    image = pixels(path)
    assert min(image.shape[:2]) > 400
    top = 255 * np.array(palette.HEIGHTS(1.0)[:3])
    for shade in (1.0, 0.72, 0.55):  # of the block's top and its two sides
        assert (np.abs(image - shade * top) < 5).all(axis=-1).sum() > 100


def test_big_map_is_drawn_with_larger_cells(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(map_figures, "MAX_BLOCKS", 100)
    map_figures.blocks(tmp_path / "blocks.png", height_map(), TRAJECTORY)
    assert pixels(tmp_path / "blocks.png").size


def test_map_without_known_cells_is_drawn(tmp_path: Path) -> None:
    nothing = height_map(known=False)
    map_figures.height_map(tmp_path / "heights.png", nothing)
    map_figures.blocks(tmp_path / "blocks.png", nothing)
    unknown = np.full((ROWS, COLUMNS), -1, np.int8)
    shown = SimpleNamespace(geometry=GEOMETRY, occupancy=unknown, cost=unknown)
    map_figures.obstacle_map(tmp_path / "obstacles.png", shown)
    assert len(list(tmp_path.iterdir())) == 3


def test_walls_without_ground_are_told_from_ground() -> None:
    metres = np.zeros((12, 20))
    metres[:, 10:] = np.nan
    metres[2, 11:15] = 1.5  # the top of a wall, its foot hidden
    metres[6, 11:13] = 0.05  # a bit of ground
    metres[9:, 15:] = 1.5  # a platform
    shown = HeightMap.from_metres(metres)
    walls = walls_without_ground(shown, np.zeros(metres.shape, bool))
    expected = np.zeros(metres.shape, bool)
    expected[2, 11:15] = True
    np.testing.assert_array_equal(walls, expected)


def test_legend_of_the_obstacle_map_names_walls_where_heights_are_given(
    tmp_path: Path, monkeypatch
) -> None:
    named: list[list[str]] = []
    draw = palette.legend_above
    monkeypatch.setattr(
        palette, "legend_above",
        lambda axes, entries: named.append([e.get_label() for e in entries]) or draw(axes, entries),
    )  # fmt: skip
    path = tmp_path / "obstacles.png"
    map_figures.obstacle_map(path, obstacle_map(), TRAJECTORY, height_map())
    map_figures.obstacle_map(path, obstacle_map())
    assert named == [
        ["free", "occupied", "wall or ledge without known ground", "unknown", "driven path"],
        ["free", "occupied", "unknown"],
    ]
