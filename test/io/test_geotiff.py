# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""GeoTIFF elevation models out and in, held against what rasterio itself reads and writes."""

import numpy as np
import pytest

from heightmap25d_ros.cli import main
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.terrain.traversability import to_obstacle_map

rasterio = pytest.importorskip("rasterio")
geotiff = pytest.importorskip("heightmap25d_ros.io.geotiff")

METRES = 518.0 + np.array([[0.0, 0.25, np.nan], [1.5, -2.0, 0.1]])
ORIGIN = (412_000.25, 5_318_000.5)


@pytest.fixture
def directory(tmp_path):
    height_map = HeightMap.from_metres(METRES, resolution=0.5, origin=ORIGIN, ground_zero=518.0)
    map_directory.save(tmp_path / "map", height_map, to_obstacle_map(height_map), "map")
    return tmp_path / "map"


def dem(path, values, **changes):
    """A raster as others write it: the first row is the northern one."""
    values = np.asarray(values, np.float32)
    profile = {
        "driver": "GTiff", "height": values.shape[0], "width": values.shape[1], "count": 1,
        "dtype": "float32", "transform": rasterio.Affine(2.0, 0.0, 100.0, 0.0, -2.0, 50.0),
    } | changes  # fmt: skip
    with rasterio.open(path, "w", **profile) as file:
        file.write(values.astype(profile["dtype"]), 1)
    return path


def test_a_map_is_written_where_it_is_and_comes_back(directory, tmp_path):
    original = map_directory.load(directory, 0.5).height_map
    file = tmp_path / "map.tif"
    assert main(["export", str(directory), "-o", str(file), "--crs", "EPSG:32632"]) == 0
    with rasterio.open(file) as raster:
        assert raster.crs.to_epsg() == 32632
        assert raster.nodata == -9999.0
        assert tuple(raster.bounds) == (ORIGIN[0], ORIGIN[1], ORIGIN[0] + 1.5, ORIGIN[1] + 1.0)
        iy, ix = original.geometry.cell_at((ORIGIN[0] + 0.6, ORIGIN[1] + 0.2))
        (sample,) = raster.sample([(ORIGIN[0] + 0.6, ORIGIN[1] + 0.2)])
        assert sample[0] == pytest.approx(original.metres[iy, ix], abs=1e-4)
    again = tmp_path / "again"
    assert main(["import", str(file), "-o", str(again)]) == 0
    loaded = map_directory.load(again, 0.5).height_map
    assert loaded.geometry.origin == pytest.approx(original.geometry.origin)
    np.testing.assert_allclose(loaded.metres, original.metres, atol=1e-6)
    np.testing.assert_array_equal(loaded.probability, original.probability)


@pytest.mark.parametrize("dtype", ["float32", "int16"])
def test_a_model_of_others_is_read_from_north_to_south(tmp_path, dtype):
    values = [[1201.0, 1202.0], [1203.0, -32768.0]]
    found = geotiff.read(dem(tmp_path / "dem.tif", values, dtype=dtype, nodata=-32768.0))
    assert (found.geometry.origin, found.geometry.resolution) == ((100.0, 46.0), 2.0)
    np.testing.assert_array_equal(found.metres, [[1203.0, np.nan], [1201.0, 1202.0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"crs": "EPSG:4326"}, "EPSG:4326 counts in degrees, not in metres"),
        ({"crs": "EPSG:2263"}, "counts in US survey foot, not in metres"),
        ({"transform": (2.0, 0.5, 100.0, 0.5, -2.0, 50.0)}, "is turned, or mirrored"),
        ({"transform": (2.0, 0.0, 100.0, 0.0, 2.0, 50.0)}, "is turned, or mirrored"),
        ({"transform": (2.0, 0.0, 100.0, 0.0, -3.0, 50.0)}, "pixels of 2 x 3 m are not square"),
        ({"nodata": 7.0}, "no pixel of band 1 holds a height"),
        ({"dtype": "int16", "values": [[0, 2000]]}, "heights of 0 to 2000 m; a map holds 654 m"),
    ],
)
def test_what_is_no_model_of_metres_is_refused_by_name(tmp_path, changes, message):
    changes = dict(changes)
    values = changes.pop("values", [[7.0, 7.0]])
    if "transform" in changes:
        changes["transform"] = rasterio.Affine(*changes["transform"])
    with pytest.raises(InputError, match=message):
        geotiff.read(dem(tmp_path / "dem.tif", values, **changes))


def test_wrong_files_and_reference_systems(directory, tmp_path, capsys):
    (tmp_path / "text.tif").write_text("no raster")
    assert main(["import", str(tmp_path / "text.tif"), "-o", str(tmp_path / "out")]) == 2
    assert "text.tif: " in capsys.readouterr().err
    for crs in ("EPSG:1", "EPSG:4326"):
        assert main(["export", str(directory), "-o", str(tmp_path / "x.tif"), "--crs", crs]) == 2
        assert "crs: EPSG" in capsys.readouterr().err
