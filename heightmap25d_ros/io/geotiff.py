# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Height maps as GeoTIFF elevation models, out and in, for GIS software; needs rasterio.

Band 1 is the height [m], float32, band 2 the probability; what is unknown is `NODATA`. As usual
there the first row is the northern one, that of the largest y.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Geometry,
    HeightMap,
    require_plausible,
)
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io._untrusted import as_input_error

try:
    import rasterio
except ImportError:
    raise InputError("GeoTIFF needs rasterio: pip install -r requirements/geotiff.txt") from None

NODATA = -9999.0
"""In place of the height and the probability of an unknown cell."""

MOST_CELLS = 2**28
"""Of a raster; a larger one is refused."""

PROBABILITY = "probability"
"""Name of the band that holds it; without one every height is certain."""

_SQUARE = 1e-6  # relative difference of the sides of a pixel, and its slant, that are none


def write(path: Path, height_map: HeightMap, crs: str = "") -> int:
    """Write the known cells; how many they are.

    Parameters
    ----------
    path : Path
    height_map : HeightMap
    crs : str
        Coordinate reference system of the map's frame, such as EPSG:32632; empty: none.

    Raises
    ------
    InputError
        If the reference system is not known, or not one of metres.
    """
    geometry, known = height_map.geometry, height_map.known
    system = _system(crs)
    top = geometry.origin[1] + geometry.shape[0] * geometry.resolution
    bands = np.full((2, *geometry.shape), NODATA, np.float32)
    bands[0][known] = height_map.metres[known]
    bands[1][known] = height_map.probability[known] / np.float32(PROBABILITY_SCALE)
    with as_input_error(str(path)), rasterio.open(
        path, "w", driver="GTiff", height=geometry.shape[0], width=geometry.shape[1], count=2,
        dtype="float32", nodata=NODATA, compress="deflate", predictor=3, crs=system,
        transform=rasterio.Affine(
            geometry.resolution, 0.0, geometry.origin[0], 0.0, -geometry.resolution, top
        ),
    ) as file:  # fmt: skip
        file.write(bands[:, ::-1])
        file.set_band_description(1, "height [m]")
        file.set_band_description(2, PROBABILITY)
    return int(known.sum())


def _system(crs: str) -> Any:
    """A coordinate reference system of metres; None: none is named."""
    if not crs:
        return None
    try:
        system = rasterio.CRS.from_user_input(crs)
    except rasterio.errors.CRSError:
        raise InputError(f"crs: {crs} is not a coordinate reference system") from None
    _require_metres("crs", system)
    return system


def _require_metres(name: str, system: Any) -> None:
    unit, factor = system.linear_units_factor if system.is_projected else ("degrees", 0.0)
    if factor != 1.0:
        raise InputError(
            f"{name}: {system} counts in {unit}, not in metres; reproject it, with gdalwarp"
        )


def read(path: Path) -> HeightMap:
    """Read an elevation model: its first band, with the probability where there is that band.

    Ground zero is a whole number of metres in the middle of the heights.

    Raises
    ------
    InputError
        If the file cannot be read, its pixels are no squares of metres along x and y, nothing in
        it is known, or its heights differ by more than a map holds.
    """
    require_file(path)
    with as_input_error(str(path)), rasterio.open(path) as file:
        if file.width * file.height > MOST_CELLS:
            raise InputError(
                f"{path}: {file.width} x {file.height} pixels are more than {MOST_CELLS}"
            )
        if file.crs is not None:
            _require_metres(str(path), file.crs)
        geometry = _geometry(path, file)
        metres = _band(file, 1)
        names = [str(name).lower() for name in file.descriptions]
        belief = np.ones_like(metres)
        if PROBABILITY in names:
            belief = _band(file, 1 + names.index(PROBABILITY))
    return _height_map(path, metres, belief, geometry)


def _geometry(path: Path, file: Any) -> Geometry:
    transform, side = file.transform, abs(file.transform.a)
    is_slanted = max(abs(transform.b), abs(transform.d)) > _SQUARE * side
    if is_slanted or transform.a <= 0.0 or transform.e >= 0.0:
        raise InputError(f"{path}: is turned, or mirrored; warp it with its north upwards")
    if abs(-transform.e - side) > _SQUARE * side:
        raise InputError(f"{path}: pixels of {side:g} x {-transform.e:g} m are not square")
    bottom = transform.f + file.height * transform.e
    return Geometry(resolution=side, origin=(transform.c, bottom), shape=(file.height, file.width))


def _band(file: Any, index: int) -> NDArray[np.float64]:
    """(rows, columns), the first row that of the least y; NaN: nothing there."""
    values = file.read(index, masked=True).astype(np.float64)
    scaled = values * file.scales[index - 1] + file.offsets[index - 1]
    return np.asarray(np.ma.filled(scaled, np.nan)[::-1])


def _height_map(
    path: Path, metres: NDArray[np.float64], belief: NDArray[np.float64], geometry: Geometry
) -> HeightMap:
    is_known = np.isfinite(metres) & (belief > 0.0) & (belief <= 1.0)
    if not is_known.any():
        raise InputError(f"{path}: no pixel of band 1 holds a height")
    low, high = float(metres[is_known].min()), float(metres[is_known].max())
    ground_zero = 0.0
    if max(-low, high) > HEIGHT_LIMIT * HEIGHT_RESOLUTION:
        ground_zero = float(round((low + high) / 2))
    if max(ground_zero - low, high - ground_zero) > HEIGHT_LIMIT * HEIGHT_RESOLUTION:
        raise InputError(
            f"{path}: heights of {low:g} to {high:g} m; a map holds "
            f"{2 * HEIGHT_LIMIT * HEIGHT_RESOLUTION:g} m from the lowest to the highest"
        )
    placed = replace(geometry, ground_zero=ground_zero)
    require_plausible(placed)
    height = np.rint((np.where(is_known, metres, ground_zero) - ground_zero) / HEIGHT_RESOLUTION)
    probability = np.rint(np.where(is_known, belief, 0.0) * PROBABILITY_SCALE)
    return HeightMap(
        geometry=placed, height=height.astype(np.int16), probability=probability.astype(np.uint16)
    )
