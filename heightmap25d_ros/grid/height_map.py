# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A dense rectangle of cells: its geometry, its heights and probabilities, and their units.

`Geometry` converts between points and cells, `Area` is a rectangle of cells within a larger one,
and `HeightMap` is what is saved, published, converted to obstacles and drawn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.levels import NO_UPPER, UpperSurfaces
from heightmap25d_ros.params.sections import GridParams, MapperParams

HEIGHT_RESOLUTION = 0.01
"""One step of a stored height [m]: int16 centimetres, as in the paper."""

HEIGHT_LIMIT = 32700
"""Largest stored height [cm]: the paper's +-327 m. Readings beyond it are not stored."""

SUSPECTED = -32768
"""In place of the height of an unknown cell: a drop-off is suspected there."""

PROBABILITY_SCALE = 65535
"""Stored value of probability 1."""

PROBABILITY_THRESHOLD = MapperParams().probability_threshold
"""Cells believed less than this are unknown, by default."""

FLOAT32_REACH = 4096.0
"""Coordinates up to here keep a quarter of a millimetre in single precision [m]."""

POSITION_LIMIT = 1e8
"""Coordinates beyond this are nonsense [m]: a place on Earth has none as large."""

FINEST, COARSEST = 0.01, 10.0
"""Sides of cells [m], as of parameter ``grid.resolution``."""

Cell = tuple[int, int]
"""Row and column, (iy, ix)."""


def local_origin(position: ArrayLike) -> NDArray[np.float64]:
    """Origin (3,) [m] for coordinates in single precision around a position (3,) [m].

    Zero where that is near enough, otherwise the position in whole metres.

    Examples
    --------
    >>> local_origin((120.0, -80.0, 2500.0))
    array([0., 0., 0.])
    >>> local_origin((500_000.4, 4_500_000.0, 2500.3)).tolist()
    [500000.0, 4500000.0, 2500.0]
    """
    exact = np.asarray(position, np.float64)
    is_near = (np.abs(exact) <= FLOAT32_REACH).all()
    return np.zeros(3) if is_near else np.floor(exact + 0.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """A rectangle of cells in the world, as nav_msgs/MapMetaData without rotation.

    Attributes
    ----------
    resolution : float [m]
    origin : (2,) float [m], map
        The outer corner of cell (0, 0).
    shape : (rows, columns)
        Rows along y, columns along x.
    ground_zero : float [m], map
        z of height 0.
    """

    resolution: float
    origin: tuple[float, float]
    shape: tuple[int, int]
    ground_zero: float = 0.0

    def cell_at(self, point: ArrayLike) -> NDArray[np.int64]:
        """Cell (..., 2) as (iy, ix) that contains a point (..., 2) as (x, y) [m]; unbounded."""
        index = np.floor((np.asarray(point, dtype=np.float64) - self.origin) / self.resolution)
        return index[..., ::-1].astype(np.int64)

    def cell_corner(self, cell: ArrayLike) -> NDArray[np.float64]:
        """Corner (..., 2) as (x, y) [m] of a cell (..., 2) as (iy, ix): its smallest x and y."""
        index = np.asarray(cell, dtype=np.float64)[..., ::-1]
        return np.asarray(self.origin + index * self.resolution)

    def cell_center(self, cell: ArrayLike) -> NDArray[np.float64]:
        """Center (..., 2) as (x, y) [m] of a cell (..., 2) as (iy, ix)."""
        return self.cell_corner(cell) + 0.5 * self.resolution

    def contains(self, cell: ArrayLike) -> NDArray[np.bool_]:
        """Whether cells (..., 2) as (iy, ix) lie inside."""
        index = np.asarray(cell)
        return np.asarray(((index >= 0) & (index < self.shape)).all(axis=-1))

    def part(self, area: Area) -> Geometry:
        """The geometry of a part of these cells."""
        x, y = self.cell_corner((area.iy, area.ix))
        return replace(self, origin=(float(x), float(y)), shape=area.shape)


def require_plausible(geometry: Geometry) -> None:
    """Refuse cells that come from outside and are none of a map on Earth.

    Raises
    ------
    InputError
        If their side is not within `FINEST` and `COARSEST`, or one of them lies beyond
        `POSITION_LIMIT`.
    """
    if not FINEST * (1.0 - 1e-6) <= geometry.resolution <= COARSEST * (1.0 + 1e-6):
        raise InputError(
            f"resolution: {geometry.resolution:g} m is not within {FINEST:g} .. {COARSEST:g} m"
        )
    corners = *geometry.origin, *geometry.cell_corner(geometry.shape), geometry.ground_zero
    if not all(abs(coordinate) <= POSITION_LIMIT for coordinate in corners):
        raise InputError(f"origin: {geometry.origin} and {geometry.ground_zero} m are not a place")


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of cells: rows ``iy .. iy + rows - 1``, columns likewise."""

    iy: int
    ix: int
    rows: int
    columns: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.columns

    def grown(self, cells: int) -> Area:
        """The area with a margin on every side."""
        return Area(
            self.iy - cells, self.ix - cells, self.rows + 2 * cells, self.columns + 2 * cells
        )

    def within(self, outer: Area) -> Area:
        """The intersection with another area; empty where they do not meet."""
        iy, ix = max(self.iy, outer.iy), max(self.ix, outer.ix)
        rows = min(self.iy + self.rows, outer.iy + outer.rows) - iy
        columns = min(self.ix + self.columns, outer.ix + outer.columns) - ix
        return Area(iy, ix, max(rows, 0), max(columns, 0))

    def hull(self, other: Area) -> Area:
        """The smallest area that contains both; an empty one is in any."""
        filled = [area for area in (self, other) if area.rows and area.columns]
        if len(filled) < 2:
            return filled[0] if filled else self
        iy, ix = min(self.iy, other.iy), min(self.ix, other.ix)
        rows = max(self.iy + self.rows, other.iy + other.rows) - iy
        columns = max(self.ix + self.columns, other.ix + other.columns) - ix
        return Area(iy, ix, rows, columns)

    def slices(self, outer: Area) -> tuple[slice, slice]:
        """The slices of this area in a dense array of another area."""
        y, x = self.iy - outer.iy, self.ix - outer.ix
        return slice(y, y + self.rows), slice(x, x + self.columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMap:
    """A dense rectangle of the map: the lowest surface in each cell, and those above.

    Attributes
    ----------
    geometry : Geometry
    height : (rows, columns) int16 [cm] above ground zero
        Of the lowest surface. `SUSPECTED` marks unknown cells in which a drop-off is suspected.
    probability : (rows, columns) uint16, 0 .. `PROBABILITY_SCALE` for 0 .. 1
    probability_threshold : float
        Below it a cell is unknown and its height has no meaning.
    upper : UpperSurfaces
        All of them known; none in a map of one level.
    is_level : bool
        Whether level lasers alone have made it, which see no ground: what is known stands.

    Examples
    --------
    A row of three cells, of which the last one is unknown:

    >>> shown = HeightMap(
    ...     geometry=Geometry(resolution=0.5, origin=(0.0, 0.0), shape=(1, 3)),
    ...     height=np.array([[0, 12, 99]], np.int16),
    ...     probability=np.array([[65535, 40000, 100]], np.uint16),
    ...     probability_threshold=0.5,
    ... )
    >>> shown.known
    array([[ True,  True, False]])
    >>> shown.metres
    array([[0.  , 0.12,  nan]])
    """

    geometry: Geometry
    height: NDArray[np.int16]
    probability: NDArray[np.uint16]
    probability_threshold: float = PROBABILITY_THRESHOLD
    upper: UpperSurfaces = NO_UPPER
    is_level: bool = False

    def __post_init__(self) -> None:
        for name, array in (("height", self.height), ("probability", self.probability)):
            if array.shape != self.geometry.shape:
                raise ValueError(
                    f"{name}: shape {array.shape}, the geometry's is {self.geometry.shape}"
                )

    @classmethod
    def from_metres(
        cls,
        metres: ArrayLike,
        *,
        resolution: float | None = None,
        origin: tuple[float, float] = (0.0, 0.0),
        ground_zero: float = 0.0,
    ) -> HeightMap:
        """The map of an array of heights; those that are given are certain.

        Parameters
        ----------
        metres : (rows, columns) [m], map
            z; rows along y, columns along x; NaN: unknown.
        resolution : float [m], optional
            Side of a cell; that of `GridParams` by default.
        origin : (2,) [m], map
            x and y of the outer corner of cell (0, 0).
        ground_zero : float [m], map
            z of height 0.

        Raises
        ------
        ValueError
            If an array has another shape, or a number is out of range.

        Examples
        --------
        >>> height_map = HeightMap.from_metres([[0.0, 0.25], [np.nan, 1.0]])
        >>> height_map.height
        array([[  0,  25],
               [  0, 100]], dtype=int16)
        >>> height_map.known
        array([[ True,  True],
               [False,  True]])
        """
        array = np.asarray(metres, np.float64)
        side = GridParams().resolution if resolution is None else float(resolution)
        corner = np.asarray(origin, np.float64)
        if array.ndim != 2:
            raise ValueError(f"metres: shape {array.shape}, not (rows, columns)")
        if not 0.0 < side < np.inf:
            raise ValueError(f"resolution: {side:g} m is not the side of a cell")
        if corner.shape != (2,) or not np.isfinite(corner).all():
            raise ValueError(f"origin: {origin} is not x, y")
        known = ~np.isnan(array)
        height = np.rint(np.where(known, array - ground_zero, 0.0) / HEIGHT_RESOLUTION)
        if height.size and np.abs(height).max() > HEIGHT_LIMIT:
            raise ValueError(f"metres: a height is beyond +-{HEIGHT_LIMIT * HEIGHT_RESOLUTION:g} m")
        return cls(
            geometry=Geometry(
                resolution=side,
                origin=(float(corner[0]), float(corner[1])),
                shape=(array.shape[0], array.shape[1]),
                ground_zero=float(ground_zero),
            ),
            height=height.astype(np.int16),
            probability=np.where(known, PROBABILITY_SCALE, 0).astype(np.uint16),
        )

    def part(self, area: Area) -> HeightMap:
        """An area of these cells."""
        here = area.slices(Area(0, 0, *self.geometry.shape))
        return replace(
            self,
            geometry=self.geometry.part(area),
            height=self.height[here],
            probability=self.probability[here],
            upper=self.upper.part(area.iy, area.ix, *area.shape),
        )

    @property
    def known(self) -> NDArray[np.bool_]:
        """(rows, columns): whether the height of a cell can be used."""
        return self.probability >= stored_probability(self.probability_threshold)

    @property
    def suspected(self) -> NDArray[np.bool_]:
        """(rows, columns): unknown cells in which a drop-off is suspected."""
        return np.asarray((self.height == SUSPECTED) & ~self.known)

    @property
    def metres(self) -> NDArray[np.float64]:
        """(rows, columns) float64 [m], map: z of the surface, NaN where unknown."""
        heights = np.multiply(self.height, HEIGHT_RESOLUTION, dtype=np.float64)
        return np.where(self.known, heights + self.geometry.ground_zero, np.nan)


def stored_probability(probability: float) -> int:
    """The stored value of a probability; also for comparison with stored values."""
    return int(np.floor(probability * PROBABILITY_SCALE + 0.5))
