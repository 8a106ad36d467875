# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_levels import LiteralLevels
from literal_mapper import Cell
from properties import draws

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid
from heightmap25d_ros.grid.height_map import PROBABILITY_SCALE, Area
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import (
    GridParams,
    LevelsParams,
    MapperParams,
    SensorParams,
)

GRID = GridParams(resolution=0.125, extent=64.0)
SENSOR = SensorParams()
PLACE = (3.06, 4.06)
"""In the middle of a cell."""


def mapper(max_surfaces=3, clear_height=0.7, **params):
    levels = LevelsParams(max_surfaces=max_surfaces, clear_height=clear_height)
    return Mapper(HeightGrid(GRID, levels=levels), SENSOR, MapperParams(**params))


def beams(origin, ends, is_hit=True, is_lone=False):
    ends = np.atleast_2d(np.asarray(ends, float))
    return Beams(
        origins=np.broadcast_to(np.asarray(origin, float), ends.shape).copy(),
        ends=ends,
        is_hit=np.broadcast_to(is_hit, len(ends)).copy(),
        is_lone=np.broadcast_to(is_lone, len(ends)).copy(),
    )


def see(m, *heights, place=PLACE):
    """One return at each height, each from beside the cell so that nothing is cleared."""
    for z in heights:
        m.integrate(beams((place[0] - 0.125, place[1], z + 0.01), [(*place, z)]))


def pass_at(m, z, times=1, place=PLACE):
    """Level beams through the middle of the cell."""
    ends = [(place[0] + 3.0, place[1], z)]
    for _ in range(times):
        m.integrate(beams((place[0] - 3.0, place[1], z), ends, is_hit=False))


def surfaces(m, place=PLACE):
    """(bottom, top) [cm] of the known surfaces of a cell from below; the lowest has no bottom."""
    iy, ix = m.grid.geometry.cell_at(place)
    part = m.grid.read(m.params.probability_threshold, Area(int(iy), int(ix), 1, 1))
    lowest = [(None, int(part.height[0, 0]))] if part.known[0, 0] else []
    upper = zip(part.upper.bottom.tolist(), part.upper.top.tolist(), strict=True)
    return lowest + sorted(upper)


def random_scan(rng, count, spread=6.0):
    """Beams among ground, objects, decks and what hangs below these."""
    origin = rng.uniform(-2, 2, 3) * (1, 1, 0) + (0, 0, rng.choice([0.4, 1.0, 2.8]))
    ends = rng.uniform(-spread, spread, (count, 3))
    levels = [0.0, 0.05, 0.3, 0.68, 0.72, 0.9, 1.2, 1.7, 2.1, 2.4, 2.5, 3.3, 4.2]
    ends[:, 2] = rng.choice(levels, count) + rng.normal(0, 0.03, count)
    level = rng.random(count) < 0.3
    ends[level, 2] = origin[2] + rng.choice([0.0, 0.02, 0.15], level.sum())
    return beams(origin, ends, rng.random(count) < 0.8, rng.random(count) < 0.05)


@pytest.mark.parametrize("rule", ["paper", "candidate"])
@draws(8)
@given(
    seed=st.integers(0, 2**32 - 1),
    max_surfaces=st.integers(1, 4),
    clear_height=st.sampled_from([0.5, 0.7, 1.6]),
    replace_belief=st.sampled_from([0.5, 0.75]),
)
def test_equals_the_literal_rules_cell_by_cell(
    rule, seed, max_surfaces, clear_height, replace_belief
):
    rng = np.random.default_rng(seed)
    fast = mapper(max_surfaces, clear_height, update_rule=rule, replace_belief=replace_belief)
    levels = LevelsParams(
        max_surfaces=max_surfaces, clear_height=clear_height if max_surfaces > 1 else 99.0
    )
    literal = LiteralLevels(GRID.resolution, SENSOR, fast.params, levels=levels)
    surplus = 0
    for _ in range(25):
        scan = random_scan(rng, 60, spread=1.4)
        surplus += fast.integrate(scan).surplus
        literal.scan(scan.origins, scan.ends, scan.is_hit, scan.is_lone)
    assert surplus == literal.surplus
    middle = fast.grid.geometry.shape[0] // 2
    for (iy, ix), lowest in literal.cells.items():
        decks = sorted(literal.decks.get((iy, ix), []), key=lambda deck: deck.height)
        expected = [(*numbers(lowest), None), *((*numbers(deck), deck.bottom) for deck in decks)]
        assert contents(fast.grid, iy + middle, ix + middle) == expected
        if max_surfaces > 1:
            waiting = numbers(literal.hidden.get((iy, ix), Cell()))
            assert hidden(fast.grid, iy + middle, ix + middle) == waiting


def numbers(surface):
    """(height, probability, candidate height and probability) as stored; 0, 0: no candidate."""
    height, belief = surface.candidate or (0, 0.0)
    return surface.height, stored(surface.probability), height, stored(belief)


def contents(grid, iy, ix):
    """(height, probability, candidate height and probability, bottom) of a cell's surfaces."""
    at = iy // TILE, ix // TILE, iy % TILE, ix % TILE
    arrays = grid.height, grid.probability, grid.candidate_height, grid.candidate_probability
    top, belief, held, held_belief = (int(array.cells[at]) for array in arrays)
    found = [(top, belief, held if held_belief else 0, held_belief, None)]
    upper = []
    for layer in range(grid.upper.count):
        top, bottom, held = grid.upper.heights[(layer, *at)].tolist()
        belief, held_belief = grid.upper.beliefs[(layer, *at)].tolist()
        if belief >= PROBABILITY_SCALE / 2:
            upper.append((top, belief, held if held_belief else 0, held_belief, bottom))
    return found + sorted(upper)


def hidden(grid, iy, ix):
    """(height, probability, candidate height and probability) below a cell's lowest surface."""
    at = -1, iy // TILE, ix // TILE, iy % TILE, ix % TILE
    (top, _, held), (belief, held_belief) = (array[at] for array in grid.upper.stored)
    heights = (int(top) if belief else 0), int(held) if held_belief else 0
    return heights[0], int(belief), heights[1], int(held_belief)


def stored(probability):
    return round(probability * PROBABILITY_SCALE)


def test_the_literal_worlds_have_several_surfaces():
    """What the comparison above is worth."""
    scans = [random_scan(np.random.default_rng(seed), 80, spread=1.6) for seed in range(25)]
    roomy, narrow = mapper(4), mapper(2)
    for scan in scans:
        roomy.integrate(scan)
    upper = roomy.grid.read().upper
    assert len(upper) > 50
    assert upper.rank.max() >= 1
    assert sum(narrow.integrate(scan).surplus for scan in scans) > 0


@pytest.mark.parametrize("gap", [0.60, 0.69, 0.70, 0.71, 0.80])
def test_a_slab_over_the_floor_is_a_surface_where_the_robot_fits_below(gap):
    m = mapper()
    see(m, 0.0, 0.0, gap, gap, gap + 0.1, gap + 0.1)
    floor, slab = round(100 * gap), round(100 * gap) + 9
    if gap < 0.70:
        assert surfaces(m) == [(None, slab)]
    else:
        assert surfaces(m) == [(None, 0), (floor, slab)]


def test_two_slabs_are_two_surfaces_and_a_third_is_surplus():
    m = mapper()
    see(m, 0.0, 0.0, 2.4, 2.4, 4.8, 4.8)
    assert surfaces(m) == [(None, 0), (240, 240), (480, 480)]
    far = beams((PLACE[0] - 0.125, PLACE[1], 7.21), [(*PLACE, 7.2)])
    assert [m.integrate(far).surplus for _ in range(3)] == [0, 1, 1]
    assert surfaces(m) == [(None, 0), (240, 240), (480, 480)]


def test_the_order_of_decks_makes_no_difference():
    """But for the underside: of a lowest surface only the top is known when it is lifted."""
    readings = [0.0, 0.0, 0.02, 2.4, 2.4, 2.42]
    over_last, over_first = mapper(), mapper()
    see(over_last, *readings)
    see(over_first, *readings[3:])
    pass_at(over_first, 0.4, times=8)
    assert surfaces(over_first) == [(241, 241)]
    see(over_first, *readings[:3])
    under_deck = mapper()
    see(under_deck, *readings[3:], *readings[:3])
    pass_at(under_deck, 0.4, times=8)
    assert surfaces(over_first) == surfaces(under_deck) == [(None, 1), (241, 241)]
    assert surfaces(over_last) == [(None, 1), (240, 241)]


@pytest.mark.parametrize(("below", "is_kept"), [(0.32, True), (0.22, False)])
def test_a_beam_that_rises_to_the_underside_of_a_deck_leaves_the_deck(below, is_kept):
    """From less than the clear height below it would speak against what stands there."""
    m = mapper()
    see(m, 2.4, 2.4)
    middle = 2.4 - below
    for _ in range(8):  # from 0.4 m, through the middle of the cell
        ends = [(PLACE[0] + 3.0, PLACE[1], 2 * middle - 0.4)]
        m.integrate(beams((PLACE[0] - 3.0, PLACE[1], 0.4), ends, is_hit=False))
    assert surfaces(m) == ([(240, 240)] if is_kept else [])


def test_a_beam_below_a_deck_leaves_it_alone_and_one_through_it_does_not():
    m = mapper()
    see(m, 0.0, 0.0, 2.1, 2.1, *[2.1 + 0.05 * i for i in range(7)])
    assert surfaces(m) == [(None, 0), (210, 239)]
    pass_at(m, 1.9, times=20)
    pass_at(m, 2.6, times=20)
    assert surfaces(m) == [(None, 0), (210, 239)]
    pass_at(m, 2.2, times=20)
    assert surfaces(m) == [(None, 0)]


def test_the_first_surface_that_is_raised_to_the_one_above_unites_with_it():
    m = mapper()
    see(m, 0.0, 0.0, 1.0, 1.0)
    assert surfaces(m) == [(None, 0), (100, 100)]
    see(m, 0.4, 0.4)
    assert surfaces(m) == [(None, 100)]


def test_a_reading_just_below_a_deck_is_its_underside():
    m = mapper()
    see(m, 0.0, 0.0, 2.4, 2.4, 2.1)
    assert surfaces(m) == [(None, 0), (210, 240)]
    see(m, 1.3)  # more than the clear height below: waits
    assert surfaces(m) == [(None, 0), (210, 240)]


def test_nothing_is_below_the_lowest_known_surface():
    m = mapper()
    see(m, 2.4, 2.4, 0.0, 0.0)
    assert surfaces(m) == [(None, 240)]


@pytest.mark.parametrize(("crate", "beam", "expected"), [
    ((0.6, 0.6), 0.8, [(None, 60), (240, 240)]),
    ((1.8, 1.8), 0.8, [(240, 240)]),
])  # fmt: skip
def test_what_was_seen_below_a_deck_is_there_when_the_deck_is_lifted(crate, beam, expected):
    """The side of a crate; not what is of the deck's own side."""
    m = mapper()
    see(m, 2.4, 2.4, *crate)
    assert surfaces(m) == [(None, 240)]
    pass_at(m, beam, times=8)
    assert surfaces(m) == expected
    pass_at(m, 0.3, times=8)  # what it proves to be afterwards counts
    assert surfaces(m) == [(240, 240)]


def test_what_was_seen_below_a_surface_that_is_gone_is_forgotten():
    m = mapper()
    see(m, 2.4, 2.4, 0.6, 0.6)
    pass_at(m, 2.3, times=8)
    assert surfaces(m) == []
    see(m, 2.4, 2.4)
    pass_at(m, 0.8, times=8)
    assert surfaces(m) == [(240, 240)]


def test_a_map_that_is_written_has_nothing_hidden():
    m = mapper()
    see(m, 2.4, 2.4, 0.6, 0.6)
    m.grid.write(m.grid.read())
    pass_at(m, 0.8, times=8)
    assert surfaces(m) == [(240, 240)]


def test_what_stands_on_a_deck_raises_it_and_decays():
    m = mapper()
    see(m, 0.0, 0.0, 2.4, 2.4, 2.8, 2.8)
    assert surfaces(m) == [(None, 0), (240, 280)]
    pass_at(m, 2.7, times=20)
    assert surfaces(m) == [(None, 0)]


@pytest.mark.parametrize(("z", "neighbours", "count"), [(2.45, 2, 1), (2.45, 1, 0), (2.55, 2, 0)])
def test_one_reading_that_continues_a_deck_is_of_the_deck(z, neighbours, count):
    m = mapper()
    for number in range(neighbours):
        see(m, 0.0, 0.0, 2.4, 2.4, place=(PLACE[0], PLACE[1] + 0.125 * (2 * number - 1)))
    see(m, 0.0, 0.0, z)
    deck = round(100 * z)
    assert surfaces(m) == [(None, 0), *[(deck, deck)] * count]
    pass_at(m, z - 0.1, times=20)  # what is not there does not wait for ever
    assert surfaces(m) == [(None, 0)]


def test_far_readings_do_not_support_one_another():
    m = mapper()
    see(m, 0.0, 0.0, 2.4, 0.4)  # by the rule of one level the second one would raise to 0.4
    assert surfaces(m) == [(None, 0)]
    see(m, 0.4)
    assert surfaces(m) == [(None, 40)]


def test_with_one_surface_a_cell_has_no_other():
    m = mapper(max_surfaces=1)
    see(m, 0.0, 0.0, 2.4, 2.4)
    assert surfaces(m) == [(None, 240)]
    assert m.grid.upper.heights.size == 0
