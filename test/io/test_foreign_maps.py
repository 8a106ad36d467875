# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""map.yaml of others in, PLY and PCD out."""

import json
import math
import sys

import numpy as np
import pytest
from PIL import Image

from heightmap25d_ros.cli import main
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory, occupancy_map, point_files
from heightmap25d_ros.terrain.traversability import to_obstacle_map

KEYS = {
    "image": "map.pgm", "mode": "trinary", "resolution": 0.5, "origin": [1.0, -2.0, 0.0],
    "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196,
}  # fmt: skip


def write(folder, pixels, colours=None, **changes):
    """A map.yaml, and its picture, of which the first row is the top."""
    values = KEYS | changes
    Image.fromarray(np.asarray(pixels, np.uint8), colours).save(folder / values["image"])
    path = folder / "map.yaml"
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not None}))
    return path


# By hand, from the description of the modes in nav2_map_server.
@pytest.mark.parametrize(
    ("changes", "pixels", "expected"),
    [
        ({}, [0, 254, 205, 88, 90, 206], [100, 0, -1, 100, -1, 0]),
        ({"mode": None}, [0, 254, 205], [100, 0, -1]),
        ({"negate": 1}, [0, 254, 205, 100], [0, 100, 100, -1]),
        ({"mode": "scale"}, [0, 254, 147, 205], [100, 0, 50, 0]),
        ({"mode": "raw"}, [0, 50, 100, 101, 255], [0, 50, 100, -1, -1]),
    ],
)
def test_pixels_are_read_as_nav2_reads_them(tmp_path, changes, pixels, expected):
    found = occupancy_map.read(write(tmp_path, [pixels], **changes))
    assert found.occupancy.tolist() == [expected]
    assert (found.resolution, found.origin) == (0.5, (1.0, -2.0, 0.0))


def test_what_is_transparent_is_unknown_in_scale(tmp_path):
    pixels = [[(0, 0, 0, 255), (0, 0, 0, 100), (255, 255, 255, 255)]]
    path = write(tmp_path, pixels, "RGBA", image="map.png", mode="scale")
    assert occupancy_map.read(path).occupancy.tolist() == [[100, -1, 0]]


def test_our_own_map_comes_back_as_walls_and_ground(tmp_path, capsys):
    metres = np.zeros((12, 20))
    metres[:, 10] = 0.8
    metres[0, :3] = np.nan
    original = HeightMap.from_metres(metres, origin=(-3.0, 2.0))
    map_directory.save(tmp_path / "map", original, to_obstacle_map(original), "map")
    command = ["import", str(tmp_path / "map" / "map.yaml"), "-o", str(tmp_path / "back")]
    assert main([*command, "--wall-height", "0.8", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["occupied_cells"] == 12
    back = map_directory.load(tmp_path / "back").height_map
    assert back.geometry == original.geometry
    np.testing.assert_array_equal(back.metres, original.metres)
    assert main([*command, "--wall-height", "400"]) == 2
    assert "wall height: 400 m is not one of a wall" in capsys.readouterr().err


def test_graded_cells_are_believed_as_much_as_they_say(tmp_path):
    path = write(tmp_path, [[0, 20, 50, 80, 100, 200]], mode="raw")
    height_map = occupancy_map.to_height_map(occupancy_map.read(path), 1.0)
    assert height_map.height.tolist() == [[0, 0, 100, 100, 100, 0]]
    believed = height_map.probability[0] / 65535
    np.testing.assert_allclose(believed, [1.0, 0.8, 0.5, 0.8, 1.0, 0.0], atol=1e-4)


def test_a_quarter_turn_is_exact(tmp_path):
    pixels = np.random.default_rng(2).choice([0, 254, 205], (5, 8))
    level = occupancy_map.read(write(tmp_path, pixels, origin=[0.0, 0.0, 0.0]))
    turned = occupancy_map.read(write(tmp_path, pixels, origin=[0.0, 0.0, math.pi / 2]))
    straight = occupancy_map.to_height_map(level, 1.0)
    height_map = occupancy_map.to_height_map(turned, 1.0)
    np.testing.assert_array_equal(height_map.metres, np.rot90(straight.metres, -1))
    assert height_map.geometry.origin == pytest.approx((-2.5, 0.0))


def test_a_turned_map_has_its_walls_and_ground_where_they_were(tmp_path):
    pixels = np.full((40, 60), 254)
    pixels[8, 5:50] = pixels[10:35, 20] = 0
    pixels[30:, 45:] = 205
    yaw, x, y = 0.6, 10.0, -20.0
    source = occupancy_map.read(write(tmp_path, pixels, origin=[x, y, yaw]))
    height_map = occupancy_map.to_height_map(source, 1.0)
    rng = np.random.default_rng(1)
    places = rng.uniform((0.5, 0.5), (29.5, 19.5), (4000, 2))
    column, row = np.floor(places / 0.5).astype(int).T
    expected = source.occupancy[row, column]
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    cells = tuple(height_map.geometry.cell_at(places @ turn.T + (x, y)).T)
    found = height_map.metres[cells]
    on_wall = expected == 100
    assert on_wall.sum() > 80
    assert (found[on_wall] == 1.0).mean() > 0.9  # but for corners that no place in a cell meets
    free = found[expected == 0]
    assert (free == 0.0).mean() > 0.9  # the others lie beside walls
    assert np.isnan(found[expected < 0]).mean() > 0.8


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mode": "colour"}, "mode: 'colour' is not one of trinary, scale, raw"),
        ({"resolution": None}, "resolution is missing"),
        ({"resolution": "wide"}, "resolution: 'wide' is not a number"),
        ({"resolution": 0.0}, "resolution: 0 m is not within"),
        ({"origin": [1.0, 2.0]}, "origin: is not x, y, yaw"),
        ({"origin": 3}, "origin: is not x, y, yaw"),
        ({"origin": [1.0, 2.0, math.inf]}, "origin: .* is not a number"),
        ({"free_thresh": 0.9}, "free_thresh: 0.9 is not below occupied_thresh 0.65"),
    ],
)
def test_what_is_no_map_is_refused_by_key(tmp_path, changes, told):
    path = write(tmp_path, [[0, 254]], **changes)
    with pytest.raises(InputError, match=told):
        occupancy_map.to_height_map(occupancy_map.read(path), 1.0)


def test_a_picture_that_is_not_there_or_none(tmp_path):
    path = write(tmp_path, [[0, 254]])
    (tmp_path / "map.pgm").write_bytes(b"P5\n9999 9999\n255\nxx")
    with pytest.raises(InputError, match=r"map\.pgm: "):
        occupancy_map.read(path)
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(InputError, match=r"map\.pgm: "):
        occupancy_map.read(path)


def read_back(path):
    """Points of a PLY or PCD file, by its own header."""
    content = path.read_bytes()
    end = b"end_header\n" if path.suffix == ".ply" else b"DATA binary\n"
    header, _, body = content.partition(end)
    lines = header.decode().splitlines()
    if path.suffix == ".ply":
        kinds = {"double": "<f8", "float": "<f4"}
        listed = [line.split() for line in lines if line.startswith("property")]
        dtype = [(name, kinds[kind]) for _, kind, name in listed]
        count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    else:
        values = {line.split()[0]: line.split()[1:] for line in lines[1:]}
        dtype = [(n, f"<f{s}") for n, s in zip(values["FIELDS"], values["SIZE"], strict=True)]
        count = int(values["POINTS"][0])
    return np.frombuffer(body, dtype, count)


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_points_of_all_known_cells(tmp_path, suffix, capsys):
    """Far from zero, where single precision would lose them."""
    metres = np.array([[0.0, np.nan], [0.25, -1.5]]) + 2500.0
    height_map = HeightMap.from_metres(
        metres, origin=(500_000.0, 4_500_000.0), ground_zero=2500.0, resolution=0.25
    )
    map_directory.save(tmp_path / "map", height_map, to_obstacle_map(height_map), "map")
    file = tmp_path / f"points{suffix}"
    assert main(["export", str(tmp_path / "map"), "-o", str(file)]) == 0
    found = read_back(file)
    assert found["x"].tolist() == [500_000.125, 500_000.125, 500_000.375]
    assert found["y"].tolist() == [4_500_000.125, 4_500_000.375, 4_500_000.375]
    np.testing.assert_allclose(found["z"], [2500.0, 2500.25, 2498.5], atol=1e-9)
    assert (found["intensity"] == 1.0).all()
    assert main(["export", str(tmp_path / "map"), "-o", str(tmp_path / "points.obj")]) == 2
    assert "points.obj: ends in none of .ply, .pcd, .tif" in capsys.readouterr().err
    assert point_files.SUFFIXES == (".ply", ".pcd")


def test_without_rasterio_it_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    monkeypatch.delitem(sys.modules, "heightmap25d_ros.io.geotiff", raising=False)
    assert main(["import", str(tmp_path / "dem.tif"), "-o", str(tmp_path / "map")]) == 2
    assert capsys.readouterr().err == (
        "heightmap25d: GeoTIFF needs rasterio: pip install -r requirements/geotiff.txt\n"
    )
