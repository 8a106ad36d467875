# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why a cell is occupied, dear or unknown: the rule that made it so, with its numbers.

Of a cell with several surfaces it is the lowest one that is explained.

The rules are those of `traversability`, which is asked about the surroundings of the one cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Area,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.grid.levels import NO_UPPER
from heightmap25d_ros.params.sections import TraversabilityParams
from heightmap25d_ros.terrain.steps import NEIGHBOURS
from heightmap25d_ros.terrain.traversability import (
    INFLATED,
    OCCUPIED,
    Ground,
    ObstacleMap,
    analyse_ground,
    covering_disc,
    to_obstacle_map,
)

_DIRECTIONS = (
    "east", "northeast", "north", "northwest", "west", "southwest", "south", "southeast",
)  # fmt: skip
"""Of `NEIGHBOURS`: x points east, y north (REP-103)."""


class Rule(Enum):
    """What makes a cell what it is."""

    OUTSIDE = "outside of the map"
    UNOBSERVED = "never observed"
    DOUBTED = "doubted"
    DROP_OFF = "suspected drop-off"
    STEP = "step"
    SLOPE = "slope"
    ROUGHNESS = "roughness"
    INFLATION = "inflation"
    LEVEL = "level ground"


@dataclass(frozen=True, slots=True, kw_only=True)
class Waiting:
    """A higher reading that waits for its confirmation: height [m, map] and probability."""

    height: float
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What a cell holds, and why it is what it is.

    Attributes
    ----------
    position : (x, y) [m], map
        The middle of the cell.
    occupancy, cost : int
        As in `ObstacleMap`: -1 unknown, 0 and 0 .. 99 free, 100 occupied.
    rule : Rule
        That decides: of a free cell what makes it dearest.
    height : float [m], map
        NaN where unknown.
    probability : float
    value, limit : float
        What the rule compares: a step, a roughness or a distance [m], a slope [rad], a
        probability; NaN where it compares nothing.
    because_of : (x, y) [m], map, optional
        The other cell of a step, or the occupied one of an inflation.
    sentence : str
    """

    position: tuple[float, float]
    occupancy: int
    cost: int
    rule: Rule
    height: float
    probability: float
    value: float = math.nan
    limit: float = math.nan
    because_of: tuple[float, float] | None = None
    sentence: str


def explain(
    height_map: HeightMap,
    point: ArrayLike,
    params: TraversabilityParams | None = None,
    waiting: Waiting | None = None,
) -> Explanation:
    """Explain the cell at a point.

    Parameters
    ----------
    height_map : HeightMap
        All cells beyond it are unknown.
    point : (2,) float [m], map
    params : TraversabilityParams, optional
    waiting : Waiting, optional
        What waits there to replace the height.

    Examples
    --------
    A step of half a metre, from above and from beside it:

    >>> height_map = HeightMap.from_metres([[0.0, 0.0, 0.0, 0.5, 0.5]])
    >>> print(explain(height_map, (0.4, 0.1)).sentence)
    (0.44, 0.06): occupied, 0.50 m above its neighbour to the west at (0.31, 0.06), max_step is \
0.10 m; height 0.50 m, probability 1.00
    >>> explain(height_map, (0.3, 0.1)).rule
    <Rule.INFLATION: 'inflation'>
    """
    params = params or TraversabilityParams()
    geometry = height_map.geometry
    iy, ix = (int(index) for index in geometry.cell_at(point))
    x, y = geometry.cell_center((iy, ix)).tolist()
    if not geometry.contains((iy, ix)):
        here = Explanation(
            position=(x, y), occupancy=-1, cost=-1, rule=Rule.OUTSIDE, height=math.nan,
            probability=0.0, sentence="unknown, outside of the map",
        )  # fmt: skip
        return replace(here, sentence=f"{_place((x, y))}: {here.sentence}")
    window = surroundings(geometry, point, params).within(Area(0, 0, *geometry.shape))
    view = _View(replace(height_map.part(window), upper=NO_UPPER), params)
    found = view.explain((iy - window.iy, ix - window.ix))
    holds = f"height {found.height:.2f} m, " if math.isfinite(found.height) else ""
    parts = [found.sentence, f"{holds}probability {found.probability:.2f}"]
    if waiting is not None:
        parts.append(
            f"a reading of {waiting.height:.2f} m waits, with probability {waiting.probability:.2f}"
        )
    return replace(found, sentence=f"{_place(found.position)}: {'; '.join(parts)}")


def surroundings(geometry: Geometry, point: ArrayLike, params: TraversabilityParams) -> Area:
    """The cells that decide about the one at a point (2,) [m], map; unbounded."""
    iy, ix = (int(index) for index in geometry.cell_at(point))
    reach = 2 * max(covering_disc(params, geometry.resolution).radius, 1) + 1
    return Area(iy, ix, 1, 1).grown(reach)


class _View:
    """The surroundings of a cell, with what the rules make of them."""

    def __init__(self, height_map: HeightMap, params: TraversabilityParams) -> None:
        self._map, self._params = height_map, params
        self._ground: Ground = analyse_ground(height_map, params)
        self._obstacles: ObstacleMap = to_obstacle_map(height_map, params, self._ground)
        self._metres = height_map.metres

    def explain(self, cell: tuple[int, int]) -> Explanation:
        """Why a cell is what it is; the sentence is without its place and content."""
        here = Explanation(
            position=self._position(cell),
            occupancy=int(self._obstacles.occupancy[cell]),
            cost=int(self._obstacles.cost[cell]),
            rule=Rule.LEVEL,
            height=float(self._metres[cell]),
            probability=float(self._map.probability[cell]) / PROBABILITY_SCALE,
            sentence="",
        )
        if here.occupancy < 0 and here.cost == OCCUPIED:
            told = "closed, a drop-off is suspected: beams over an edge pass too low for any ground"
            return replace(here, rule=Rule.DROP_OFF, sentence=told)
        if here.occupancy < 0:
            return self._unknown(here)
        if here.occupancy == OCCUPIED:
            return self._occupied(here, cell)
        if here.cost == INFLATED:
            return self._inflated(here, cell)
        return self._free(here, cell)

    def _position(self, cell: tuple[int, int]) -> tuple[float, float]:
        x, y = self._map.geometry.cell_center(cell).tolist()
        return x, y

    def _unknown(self, here: Explanation) -> Explanation:
        if not here.probability:
            return replace(here, rule=Rule.UNOBSERVED, sentence="unknown, no return has ended here")
        limit = self._map.probability_threshold
        return replace(
            here, rule=Rule.DOUBTED, value=here.probability, limit=limit,
            sentence=f"unknown, beams contradict what was seen here, probability_threshold is "
            f"{limit:.2f}",
        )  # fmt: skip

    def _occupied(self, here: Explanation, cell: tuple[int, int]) -> Explanation:
        drop, bit = self._largest_drop(cell)
        if drop > self._params.max_step + 1e-6:
            dy, dx = NEIGHBOURS[bit]
            other = self._position((cell[0] + dy, cell[1] + dx))
            return replace(
                here, rule=Rule.STEP, value=drop, limit=self._params.max_step, because_of=other,
                sentence=f"occupied, {drop:.2f} m above its neighbour to the {_DIRECTIONS[bit]} at "
                f"{_place(other)}, max_step is {self._params.max_step:.2f} m",
            )  # fmt: skip
        slope = self._slope(cell)
        return replace(
            here, rule=Rule.SLOPE, value=slope, limit=self._params.max_slope,
            sentence=f"occupied, the ground under the footprint is {_degrees(slope)} steep, "
            f"max_slope is {_degrees(self._params.max_slope)}",
        )  # fmt: skip

    def _inflated(self, here: Explanation, cell: tuple[int, int]) -> Explanation:
        occupied = np.argwhere(self._obstacles.cost == OCCUPIED)
        apart = np.hypot(*(occupied - cell).T) * self._map.geometry.resolution
        nearest = tuple(int(index) for index in occupied[np.argmin(apart)])
        cause = self.explain((nearest[0], nearest[1]))
        return replace(
            here, rule=Rule.INFLATION, value=float(apart.min()), limit=self._params.robot_radius,
            because_of=cause.position,
            sentence=f"free, but {apart.min():.2f} m from {_place(cause.position)}, robot_radius "
            f"is {self._params.robot_radius:.2f} m; that cell is {cause.sentence}",
        )  # fmt: skip

    def _free(self, here: Explanation, cell: tuple[int, int]) -> Explanation:
        params = self._params
        step = float(self._ground.step[cell]) * HEIGHT_RESOLUTION
        roughness = float(self._ground.roughness[cell]) * HEIGHT_RESOLUTION
        slope = self._slope(cell)
        shares = {
            Rule.STEP: (step / params.max_step, step, params.max_step),
            Rule.SLOPE: (math.tan(slope) / math.tan(params.max_slope), slope, params.max_slope),
            Rule.ROUGHNESS: (roughness / params.max_roughness, roughness, params.max_roughness),
        }
        rule = max(shares, key=lambda rule: shares[rule][0])
        share, value, limit = shares[rule]
        if not here.cost or not share:
            return replace(here, sentence="free, on level ground")
        told = {
            Rule.STEP: f"a step of {step:.2f} m to a neighbour, max_step is {limit:.2f} m",
            Rule.SLOPE: f"the slope of {_degrees(slope)}, max_slope is {_degrees(limit)}",
            Rule.ROUGHNESS: f"the roughness of {roughness:.3f} m, max_roughness is {limit:.3f} m",
        }[rule]
        return replace(
            here, rule=rule, value=value, limit=limit,
            sentence=f"free, cost {here.cost} of 100 by {told}",
        )  # fmt: skip

    def _largest_drop(self, cell: tuple[int, int]) -> tuple[float, int]:
        """How far the lowest known neighbour lies below a cell [m], and in which direction.

        Of several that are as low, one that has a side in common with the cell.
        """
        drops = [(-math.inf, 0)]
        rows, columns = self._metres.shape
        for bit, (dy, dx) in enumerate(NEIGHBOURS):
            iy, ix = cell[0] + dy, cell[1] + dx
            if 0 <= iy < rows and 0 <= ix < columns and math.isfinite(self._metres[iy, ix]):
                drops.append((float(self._metres[cell] - self._metres[iy, ix]), bit))
        return max(drops, key=lambda entry: (entry[0], entry[1] % 2 == 0))

    def _slope(self, cell: tuple[int, int]) -> float:
        """Of the ground under the footprint [rad]."""
        gradient = self._ground.gradient[:, cell[0], cell[1]].astype(np.float64)
        return math.atan(
            float(np.hypot(*gradient)) * HEIGHT_RESOLUTION / self._map.geometry.resolution
        )


def _place(position: tuple[float, float]) -> str:
    return f"({position[0]:.2f}, {position[1]:.2f})"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.1f} degrees"
