# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small maps and graphs for the tests of planning, made from a few arrays."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from literal_transitions import random_steps

from heightmap25d_ros.grid.height_map import PROBABILITY_SCALE, Geometry, HeightMap
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.transition_costs import incoming_costs


def drawn(*rows):
    """Enterable cells of a map drawn in text: '#' is closed."""
    return np.array([[letter != "#" for letter in row] for row in rows])


def height_map(height_cm, known=None, resolution=0.125, origin=(0.0, 0.0)):
    height = np.rint(height_cm).astype(np.int16)
    known = np.ones(height.shape, bool) if known is None else known
    return HeightMap(
        geometry=Geometry(resolution=resolution, origin=origin, shape=height.shape),
        height=height,
        probability=np.where(known, np.uint16(PROBABILITY_SCALE), np.uint16(0)),
        probability_threshold=0.5,
    )


def graph(
    enterable,
    *,
    blocked=None,
    gradient=None,
    weight=None,
    slope_weights=(2.0, 1.0, 3.0),
    occupied=None,
    height=None,
    resolution=0.125,
    origin=(0.0, 0.0),
):
    """A graph of these cells; what is left out is flat, open and free."""
    shape = enterable.shape
    blocked = np.zeros(shape, np.uint8) if blocked is None else blocked
    gradient = np.zeros((2, *shape), np.float32) if gradient is None else gradient
    weight = np.ones(shape, np.float32) if weight is None else weight
    return TransitionGraph(
        geometry=Geometry(resolution=resolution, origin=origin, shape=shape),
        height=np.zeros(shape, np.float32) if height is None else height,
        gradient=gradient,
        weight=weight,
        occupied=np.zeros(shape, bool) if occupied is None else occupied,
        forbidden=np.zeros(shape, bool),
        enterable=enterable,
        blocked=blocked,
        slope_weights=slope_weights,
        incoming=incoming_costs(enterable, blocked, gradient, weight, slope_weights),
    )


def random_graph(seed, *, most_side=14, share_closed=0.3, is_weighted=True, resolution=0.125):
    """Closed cells, blocked steps, slopes and weights at random; some maps have none of them."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(side) for side in rng.integers(1, most_side + 1, 2))
    gradient = rng.uniform(-0.6, 0.6, (2, *shape)) * rng.integers(0, 2)
    weight = 1 + rng.exponential(rng.choice([0.0, 0.5, 10.0]), shape)
    slope_weights = tuple(rng.choice([0.0, 1.0, 5.0, 50.0], 3))
    if not is_weighted:
        gradient, weight = np.zeros((2, *shape)), np.ones(shape)
    return graph(
        rng.random(shape) >= share_closed * rng.random(),
        blocked=random_steps(rng, shape, rng.choice([0.0, 0.05, 0.2])),
        gradient=gradient.astype(np.float32),
        weight=weight.astype(np.float32),
        slope_weights=slope_weights,
        resolution=resolution,
    )


SEEDS = st.integers(0, 2**32 - 1)


def random_cells(graph, seed, count):
    """Enterable cells (row, column) at random, the same one perhaps twice; [] if there is none."""
    rng = np.random.default_rng(seed)
    cells = np.argwhere(graph.enterable)
    if not len(cells):
        return []
    return [tuple(map(int, cells[rng.integers(len(cells))])) for _ in range(count)]
