# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planner beside pyastar2d, scikit-image and the same search in C, on square maps.

    python benchmarks/planning.py

From one corner of each map to the opposite one, medians of interleaved runs. All get the same
weights of the cells; each peer's own input is prepared once per map and not timed. What ours
costs to prepare is shown by itself: `incoming_costs`, and all of `transition_graph`. They do not
solve quite the same problem:

- pyastar2d (C++) charges a step across like a straight one, the weight of the cell it enters.
  Where all weights are equal (Chebyshev's distance) many paths cost the same then, and on open
  ground its estimate is all but exact: an easier problem.
- MCP_Geometric (Cython) has our lengths, and spreads without an estimate until it meets the goal.
- Neither keeps off the corners of closed cells. Ours goes across only where both corners are free,
  which among single closed cells is a much harder problem. There, ours is also timed with corners
  cut.

Maps of corridors 12 cells wide, of rooms, of boxes and of open terrain are what a robot's map
looks like in cells of 0.125 m. Corridors of 4 cells and single closed cells, one in five, are
where a search of this kind gains the least.

Our times include the cells of the path, as pyastar2d's do; the ratio to C is of the searches.

Before anything is timed, the cost of the guided search is compared with the field's, both with
C's, and, with corners allowed, the length with MCP_Geometric's.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial

import c_planner
import numpy as np
import pyastar2d
from numpy.typing import NDArray
from scipy import ndimage, sparse
from skimage.graph import MCP_Geometric
from terrains import rolling_terrain

from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.search import DIAGONAL, STRAIGHT, cost_to_go
from heightmap25d_ros.planning.transition_costs import incoming_costs
from heightmap25d_ros.terrain.steps import NEIGHBOURS

ROUNDS = {512: 7, 2048: 5, 4096: 3}
MCP_ROUNDS = {512: 7, 2048: 3, 4096: 1}
KINDS = ("maze", "rooms", "clutter", "terrain", "narrow maze", "salt")
FIELD_SIDE = 2048
WALL, DOOR, ROOM = 1, 8, 64
CLOSED = np.inf

Weights = NDArray[np.float32]
"""Of cells: 1 or more, `CLOSED` where nothing may be."""


def measure(sides: tuple[int, ...] = tuple(ROUNDS)) -> dict[str, float]:
    """Medians in milliseconds, and ratios of times."""
    figures: dict[str, float] = {}
    ratios: dict[str, list[float]] = {}
    for side in sides:
        for name, weights in maps(side):
            for peer, ratio in _on_map(f"{name} {side}", weights, figures).items():
                ratios.setdefault(peer, []).append(ratio)
    for peer, values in ratios.items():
        figures[f"median of maps: {peer}"] = statistics.median(values)
    return {**figures, **_preparation()}


def maps(side: int) -> Iterator[tuple[str, Weights]]:
    """One of each kind."""
    rng = np.random.default_rng(side)
    makers = (
        partial(_maze, corridor=12),
        _rooms,
        _clutter,
        _terrain,
        partial(_maze, corridor=4),
        _salt,
    )
    for name, make in zip(KINDS, makers, strict=True):
        yield name, make(rng, side)


def _maze(rng: np.random.Generator, side: int, corridor: int) -> Weights:
    """One path between any two cells: a random spanning tree."""
    pitch = corridor + WALL
    count = (side - WALL) // pitch
    index = np.arange(count * count).reshape(count, count)
    one = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    other = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    edges = sparse.coo_array((rng.random(one.size) + 1.0, (one, other)), (index.size,) * 2)
    tree = sparse.csgraph.minimum_spanning_tree(edges.tocsr()).tocoo()
    weights = np.full((side, side), CLOSED, np.float32)
    for a, b in zip(tree.row.tolist(), tree.col.tolist(), strict=True):
        y, x = (WALL + pitch * i for i in divmod(min(a, b), count))
        down, right = (max(a, b) // count) * pitch + WALL, (max(a, b) % count) * pitch + WALL
        weights[y : down + corridor, x : right + corridor] = 1.0
    return weights


def _rooms(rng: np.random.Generator, side: int) -> Weights:
    """A door in each wall between two rooms."""
    weights = np.ones((side, side), np.float32)
    for wall in range(0, side, ROOM):
        weights[wall : wall + WALL] = weights[:, wall : wall + WALL] = CLOSED
    for wall in range(ROOM, side, ROOM):
        for room in range(0, side, ROOM):
            for lines in (weights, weights.T):
                door = room + WALL + int(rng.integers(ROOM - WALL - DOOR))
                lines[wall : wall + WALL, door : door + DOOR] = 1.0
    return weights


def _clutter(rng: np.random.Generator, side: int) -> Weights:
    """Boxes with sides of 4 to 24 cells over a fifth of the ground."""
    weights = np.ones((side, side), np.float32)
    while np.isinf(weights).mean() < 0.2:
        for _ in range(max(side * side // 50_000, 1)):
            (y, x), (height, width) = rng.integers(side, size=2), rng.integers(4, 25, size=2)
            weights[y : y + height, x : x + width] = CLOSED
    return weights


def _terrain(rng: np.random.Generator, side: int) -> Weights:
    """Nothing is closed; weights from 1 to 7, alike over some 16 cells."""
    smooth = ndimage.gaussian_filter(rng.normal(size=(side, side)).astype(np.float32), 16.0)
    smooth -= smooth.min()
    return 1.0 + 6.0 * smooth / smooth.max()


def _salt(rng: np.random.Generator, side: int) -> Weights:
    """Single closed cells, one in five."""
    return np.where(rng.random((side, side)) < 0.2, CLOSED, 1.0).astype(np.float32)


def _ends(weights: Weights) -> tuple[Cell, Cell]:
    """Connected free cells, next to opposite corners of the map."""
    labels, count = ndimage.label(np.isfinite(weights))
    largest = 1 + np.argmax(np.bincount(labels.ravel(), minlength=count + 1)[1:])
    cells = np.argwhere(labels == largest)
    from_corner = cells.sum(axis=1)
    first, last = cells[from_corner.argmin()].tolist(), cells[from_corner.argmax()].tolist()
    return (first[0], first[1]), (last[0], last[1])


def _costs(weights: Weights) -> NDArray[np.uint16]:
    """What the planner searches, of flat ground."""
    is_free = np.isfinite(weights)
    return incoming_costs(
        is_free,
        np.zeros(weights.shape, np.uint8),
        np.zeros((2, *weights.shape), np.float32),
        np.where(is_free, weights, np.float32(1.0)),
        (0.0, 0.0, 0.0),
    )


def _on_map(name: str, weights: Weights, figures: dict[str, float]) -> dict[str, float]:
    """Put a map's figures to the others; the ratios."""
    side = len(weights)
    start, goal = _ends(weights)
    incoming = _costs(weights)
    for_mcp = np.where(np.isfinite(weights), weights, -1.0).astype(np.float64)
    _assert_exact(name, incoming, weights, for_mcp, (start, goal))
    runs: dict[str, Callable[[], object]] = {
        "ours": lambda: cost_to_go(incoming, goal, start=start).cheapest_path(start),
        "search": partial(cost_to_go, incoming, goal, start=start),
        "C": partial(c_planner.cost_to_go, incoming, goal, start=start),
        "pyastar2d": lambda: pyastar2d.astar_path(weights, start, goal, allow_diagonal=True),
        "MCP_Geometric": lambda: MCP_Geometric(for_mcp).find_costs([start], [goal]),
    }
    rounds = {run: ROUNDS.get(side, 3) for run in runs} | {"MCP_Geometric": MCP_ROUNDS[side]}
    if side == FIELD_SIDE:
        runs |= {
            "field": partial(cost_to_go, incoming, goal),
            "C, field": partial(c_planner.cost_to_go, incoming, goal),
        }
        rounds |= {"field": ROUNDS[side], "C, field": ROUNDS[side]}
    if name.startswith("salt"):
        cut = _with_corners(weights)
        runs["ours, corners cut"] = lambda: cost_to_go(cut, goal, start=start).cheapest_path(start)
        rounds["ours, corners cut"] = rounds["ours"]
    times = _interleaved(runs, rounds)
    search = times.pop("search")
    ratios = {
        "pyastar2d / ours": times["pyastar2d"] / times["ours"],
        "MCP_Geometric / ours": times["MCP_Geometric"] / times["ours"],
        "ours / C": search / times["C"],
    }
    figures |= {f"{name}: {run} [ms]": milliseconds for run, milliseconds in times.items()}
    figures |= {f"{name}: {peer}": ratio for peer, ratio in ratios.items()}
    if side == FIELD_SIDE:
        figures[f"{name}: field, ours / C"] = times["field"] / times["C, field"]
    if "ours, corners cut" in times:
        ratio = times["pyastar2d"] / times["ours, corners cut"]
        figures[f"{name}: pyastar2d / ours, corners cut"] = ratio
    return ratios


def _interleaved(runs: dict[str, Callable[[], object]], rounds: dict[str, int]) -> dict[str, float]:
    """Median milliseconds of each; all have been compiled before."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for done in range(max(rounds.values())):
        for name, run in runs.items():
            if done < rounds[name]:
                began = time.perf_counter()
                run()
                times[name].append(1e3 * (time.perf_counter() - began))
    return {name: statistics.median(values) for name, values in times.items()}


def _assert_exact(
    name: str,
    incoming: NDArray[np.uint16],
    weights: Weights,
    for_mcp: NDArray[np.float64],
    ends: tuple[Cell, Cell],
) -> None:
    """Guided or not, in C or not, the same costs; and MCP_Geometric's length but for rounding."""
    start, goal = ends
    field, guided = cost_to_go(incoming, goal), cost_to_go(incoming, goal, start=start)
    in_c = c_planner.cost_to_go(incoming, goal, start=start)
    np.testing.assert_array_equal(
        field.remaining, c_planner.cost_to_go(incoming, goal).remaining, err_msg=name
    )
    np.testing.assert_array_equal(guided.remaining, in_c.remaining, err_msg=name)
    if not field[start] == guided[start] > 0:
        raise AssertionError(f"{name}: {guided[start]} to go when guided, not {field[start]}")
    if len(weights) > FIELD_SIDE:
        return
    expected = MCP_Geometric(for_mcp).find_costs([start], [goal])[0][goal]
    length = cost_to_go(_with_corners(weights), goal, start=start)[start] / STRAIGHT
    if not math.isclose(length, expected, rel_tol=1e-3):
        raise AssertionError(f"{name}: a length of {length:.1f}, not {expected:.1f}")


def _with_corners(weights: Weights) -> NDArray[np.uint16]:
    """The same costs, but steps across may cut corners."""
    rows, columns = weights.shape
    incoming = np.zeros((rows + 2, columns + 2, 8), np.uint16)
    padded = np.pad(weights, 1, constant_values=CLOSED)
    for k, (dy, dx) in enumerate(NEIGHBOURS):
        there = padded[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns]
        cost = (DIAGONAL if k & 1 else STRAIGHT) * 0.5 * (weights + there)
        incoming[1:-1, 1:-1, k] = np.where(np.isfinite(cost), cost + 0.5, 0.0)
    return incoming


def _preparation() -> dict[str, float]:
    """What becomes of a map before a search, once per map."""
    rng = np.random.default_rng(25)
    small, large = (_terrain(rng, side) for side in (1024, FIELD_SIDE))
    height_map = rolling_terrain(1024)
    runs = {
        "prepare 1024: incoming_costs [ms]": partial(_costs, small),
        "prepare 2048: incoming_costs [ms]": partial(_costs, large),
        "prepare 1024: transition_graph [ms]": partial(
            transition_graph, height_map, TraversabilityParams(), PlannerParams()
        ),
    }
    for run in runs.values():
        run()
    return _interleaved(runs, dict.fromkeys(runs, 5))


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:45} {value:>10,.2f}")
