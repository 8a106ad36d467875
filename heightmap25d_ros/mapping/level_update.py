# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The update of a cell with several surfaces, one above the other.

Each surface is treated as the only one of a cell is by `cell_update`: a reading belongs to the
surface below it. What is added:

- What would raise a surface by the clear height of the robot or more opens a new one above it.
- Readings that are the clear height or more apart do not support one another: an object is
  complete from the ground up, but only as far as nothing could stand between.
- A reading with less than the clear height left to the surface above it, and more to the one
  below, is the underside of the one above.
- A surface that is raised until less than the clear height is left becomes one with that above.
- A reading the clear height or more below the lowest surface is off the side of what stands there,
  or off what is below a deck. It waits: such readings are of a surface of their own, hidden below
  the lowest one. Beams are evidence against the lowest one alone, as long as that is known.
- A lowest surface that is lost to a beam the clear height or more below it hangs in the air: it
  becomes an upper one with the belief that it had, and what is hidden below it the lowest one;
  where nothing is, the ground is unknown. So a deck that was driven first is kept, and so is what
  was seen below it. One beam is not enough for that: beside a wall, beams pass through cells of
  which it fills a part, and returns from it speak for it again.
- So does one that is lost to a beam that rises to it, from a laser the clear height or more below
  it: a robot on a ramp looks up at the underside of a deck. Such a beam passes two tolerances or
  more below the surface; nearer ones graze what ascends.

Upper surfaces are in the layers of a `UpperLayers`, and the hidden one in the last of them; the
kernels take its flat arrays as ``layers``: (heights, beliefs, tile_span). They are called where a
cell has, or may get, more than one surface: elsewhere `mapper` does not come here.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.grid.height_grid import TILE, TOP_BIAS
from heightmap25d_ros.grid.levels import BELIEF, BOTTOM, CANDIDATE, CANDIDATE_BELIEF, TOP
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.mapping.cell_update import hit, is_contradicted, miss

SURPLUS, KEPT, CHANGED = -1, 0, 1
"""What a return did: it needed a surface more than a cell holds; it changed no height, or one."""

BELIEFS = 2
"""Probabilities of a surface in the arrays of `UpperLayers`."""

_HEIGHTS = 3  # the heights of one
_NONE, _LOWEST = -2, -1  # in place of a layer
_FAR = np.int64(1 << 30)  # [cm]
_NOTHING = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
_TILE_CELLS = TILE * TILE


@kernel
def hit_surface(cell, tile, z, distance, lowest, layers, model, rule):
    """The lowest surface of a cell after a return at height z [cm], and what the return did.

    A surface is (height, probability, candidate height, candidate probability). The upper ones
    are updated in place.
    """
    heights, beliefs, _ = layers
    below, above = _beside(cell, z, lowest, layers, rule)
    surface = lowest
    if below >= 0:
        surface = _surface(cell, below, layers, rule)
        if z <= surface[0] + rule.tolerance:
            confirmed = hit(surface, max(z, surface[0] - rule.tolerance), distance, model, rule)
            bottom = min(z, np.int64(heights[_at(cell, below, layers, rule) * _HEIGHTS + BOTTOM]))
            _store(cell, tile, below, confirmed, bottom, layers, rule)
            return lowest, CHANGED if confirmed[0] != surface[0] else KEPT
    elif below == _NONE and lowest[1] >= rule.known:
        if lowest[0] - z >= rule.clear:
            hidden = _surface(cell, rule.layers, layers, rule)
            hidden = hit(hidden, z, distance, model, rule)
            _put(cell, rule.layers, hidden, layers, rule)
        return lowest, KEPT
    underside = _bottom(cell, above, layers, rule)
    is_clear_below = below == _NONE or z - surface[0] >= rule.clear
    if is_clear_below and underside - z < rule.clear:
        _store(cell, tile, above, _surface(cell, above, layers, rule), z, layers, rule)
        return lowest, CHANGED
    after = _hit_near(surface, z, distance, model, rule)
    rise = after[0] - surface[0] if below != _NONE else 0
    if rise >= rule.clear:
        layer = _free_layer(cell, layers, rule)
        if layer == _NONE:
            return lowest, SURPLUS
        bottom = min(z, surface[2]) if surface[3] > 0 else z
        _store(cell, tile, layer, after, bottom, layers, rule)
        after = surface[0], surface[1], np.int64(0), np.int64(0)
    elif rise > rule.tolerance and underside - after[0] < rule.clear:
        after = _surface(cell, above, layers, rule)
        beliefs[_at(cell, above, layers, rule) * BELIEFS + BELIEF] = 0
    is_changed = after[0] != surface[0] or rise != 0 or below == _NONE
    if below >= 0:
        bottom = _bottom(cell, below, layers, rule)
        _store(cell, tile, below, after, bottom, layers, rule)
        after = lowest
    return after, CHANGED if is_changed else KEPT


@kernel
def _hit_near(surface, z, distance, model, rule):
    """`hit`, by which a candidate that is far from a higher reading makes room for it."""
    if z <= surface[0] + rule.tolerance or abs(surface[2] - z) < rule.clear:
        return hit(surface, z, distance, model, rule)
    alone = surface[0], surface[1], np.int64(0), np.int64(0)
    after = hit(alone, z, distance, model, rule)
    return surface if after == alone else after


@kernel
def lost(cell, tile, before, after, beam_height, sensor_z, layers, rule):
    """The lowest surface of a cell when it is lost to a beam: what is hidden, if it is lifted.

    Parameters
    ----------
    before, after : (height, probability, candidate height, candidate probability)
        The surface that is lost, and what `miss` made of it.
    beam_height, sensor_z : float [cm]
        Above the first one the beam contradicts heights; the second one is that of the laser.
    """
    hidden = _surface(cell, rule.layers, layers, rule)
    if hidden[1] > 0:
        _put(cell, rule.layers, _NOTHING, layers, rule)
    beyond = before[0] - beam_height
    is_overhead = beyond >= rule.clear or (
        beyond >= 2 * rule.tolerance and before[0] - sensor_z >= rule.clear
    )
    layer = _free_layer(cell, layers, rule)
    if not is_overhead or layer == _NONE:
        return after
    _store(cell, tile, layer, before, before[0], layers, rule)
    return hidden


@kernel
def is_in_the_way(cell, beam_height, entry, layers, rule):
    """Whether a beam contradicts an upper surface of a cell, or a candidate above one.

    Parameters
    ----------
    beam_height : float [cm]
        Above which it contradicts heights: that of the beam and a margin.
    entry : float [cm]
        Height at which the beam enters the cell.
    """
    for layer in range(rule.layers):
        if _is_over_bottom(cell, layer, entry, layers, rule):
            surface = _surface(cell, layer, layers, rule)
            if is_contradicted(surface, beam_height, rule):
                return True
    return False


@kernel
def miss_upper(cell, beam_height, entry, distance, layers, model, rule):
    """Lower the probability of what `is_in_the_way`; true if a surface was lost."""
    is_lost = False
    beliefs = layers[1]
    for layer in range(rule.layers):
        if _is_over_bottom(cell, layer, entry, layers, rule):
            after = miss(_surface(cell, layer, layers, rule), beam_height, distance, model, rule)
            at = _at(cell, layer, layers, rule) * BELIEFS
            beliefs[at + BELIEF], beliefs[at + CANDIDATE_BELIEF] = after[1], after[3]
            is_lost |= after[1] < rule.known
    return is_lost


@kernel
def update_span(tile, layers, rule):
    """Find the lowest bottom and the highest top of a tile's upper surfaces anew."""
    spans = layers[2]
    low, high = _FAR, np.int64(0)
    first = np.int64(tile) * _TILE_CELLS
    for cell in range(first, first + _TILE_CELLS):
        for layer in range(rule.layers):
            surface = _surface(cell, layer, layers, rule)
            if surface[1] >= rule.known:
                low = min(low, _bottom(cell, layer, layers, rule) + TOP_BIAS)
                high = max(high, _highest(surface) + TOP_BIAS)
    spans[2 * tile], spans[2 * tile + 1] = (low, high) if high else (0, 0)


@kernel
def _beside(cell, z, lowest, layers, rule):
    """The layers of the surfaces that a reading is on or above, and next below."""
    below, above = _NONE, _NONE
    highest, least = -_FAR, _FAR
    if lowest[1] >= rule.known and z >= lowest[0] - rule.tolerance:
        below = _LOWEST
        highest = lowest[0]
    for layer in range(rule.layers):
        if _surface(cell, layer, layers, rule)[1] >= rule.known:
            bottom = _bottom(cell, layer, layers, rule)
            if bottom - rule.tolerance <= z:
                if bottom > highest:
                    below, highest = layer, bottom
            elif bottom < least:
                above, least = layer, bottom
    return below, above


@kernel
def _is_over_bottom(cell, layer, entry, layers, rule):
    """Whether a beam is not below an upper surface, which is at least T thick."""
    surface = _surface(cell, layer, layers, rule)
    bottom = min(_bottom(cell, layer, layers, rule), surface[0] - rule.tolerance)
    return surface[1] >= rule.known and entry >= bottom


@kernel
def _at(cell, layer, layers, rule):
    """The number of a surface in the arrays of `UpperLayers`."""
    return layer * (layers[1].size // (BELIEFS * (rule.layers + 1))) + np.int64(cell)


@kernel
def _surface(cell, layer, layers, rule):
    heights, beliefs, _ = layers
    at = _at(cell, layer, layers, rule)
    return (
        np.int64(heights[at * _HEIGHTS + TOP]),
        np.int64(beliefs[at * BELIEFS + BELIEF]),
        np.int64(heights[at * _HEIGHTS + CANDIDATE]),
        np.int64(beliefs[at * BELIEFS + CANDIDATE_BELIEF]),
    )


@kernel
def _bottom(cell, layer, layers, rule):
    """The bottom of an upper surface; far above where there is none."""
    if layer == _NONE:
        return _FAR
    return np.int64(layers[0][_at(cell, layer, layers, rule) * _HEIGHTS + BOTTOM])


@kernel
def _highest(surface):
    return max(surface[0], surface[2]) if surface[3] > 0 else surface[0]


@kernel
def _free_layer(cell, layers, rule):
    for layer in range(rule.layers):
        if _surface(cell, layer, layers, rule)[1] < rule.known:
            return layer
    return _NONE


@kernel
def _put(cell, layer, surface, layers, rule):
    heights, beliefs, _ = layers
    at = _at(cell, layer, layers, rule)
    heights[at * _HEIGHTS + TOP], heights[at * _HEIGHTS + CANDIDATE] = surface[0], surface[2]
    beliefs[at * BELIEFS + BELIEF] = surface[1]
    beliefs[at * BELIEFS + CANDIDATE_BELIEF] = surface[3]


@kernel
def _store(cell, tile, layer, surface, bottom, layers, rule):
    heights, _, spans = layers
    _put(cell, layer, surface, layers, rule)
    heights[_at(cell, layer, layers, rule) * _HEIGHTS + BOTTOM] = bottom
    low, high = bottom + TOP_BIAS, _highest(surface) + TOP_BIAS
    is_first = spans[2 * tile + 1] == 0
    spans[2 * tile] = low if is_first else min(np.int64(spans[2 * tile]), low)
    spans[2 * tile + 1] = max(np.int64(spans[2 * tile + 1]), high)
