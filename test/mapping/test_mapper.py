# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_mapper import LiteralMap
from properties import draws

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import PROBABILITY_SCALE, Area
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import GridParams, LevelsParams, MapperParams, SensorParams

GRID = GridParams(resolution=0.125, extent=64.0)
SENSOR = SensorParams()
ONE_LEVEL = LevelsParams(max_surfaces=1)
RULES = ("paper", "candidate")


def mapper(grid=GRID, sensor=SENSOR, levels=ONE_LEVEL, **params):
    return Mapper(HeightGrid(grid, levels=levels), sensor, MapperParams(**params))


def beams(origin, ends, is_hit=True, is_lone=False):
    ends = np.atleast_2d(np.asarray(ends, float))
    return Beams(
        origins=np.broadcast_to(np.asarray(origin, float), ends.shape).copy(),
        ends=ends,
        is_hit=np.broadcast_to(is_hit, len(ends)).copy(),
        is_lone=np.broadcast_to(is_lone, len(ends)).copy(),
    )


def elsewhere(scan, origins, ends):
    """The same scan elsewhere."""
    return Beams(origins=origins, ends=ends, is_hit=scan.is_hit, is_lone=scan.is_lone)


def cell(mapper, x, y):
    """(height [cm], probability, candidate height [cm], candidate probability) at a point."""
    iy, ix = mapper.grid.geometry.cell_at((x, y))
    area = Area(int(iy), int(ix), 1, 1)
    grid = mapper.grid
    arrays = (
        grid.height,
        grid.probability,
        grid.candidate_height,
        grid.candidate_probability,
    )
    return tuple(int(array.read(area)[0, 0]) for array in arrays)


def belief(mapper, x, y):
    return cell(mapper, x, y)[1] / PROBABILITY_SCALE


def random_scan(rng, count, spread=6.0):
    """Beams over a bumpy ground, some far too short, some without return, some nearly level."""
    origin = rng.uniform(-2, 2, 3) + (0, 0, 1)
    ends = rng.uniform(-spread, spread, (count, 3))
    ends[:, 2] = rng.choice([0.0, 0.05, 0.3, 1.2], count) + rng.normal(0, 0.03, count)
    level = rng.random(count) < 0.2
    ends[level, 2] = origin[2] + rng.choice([0.0, 0.02, 0.15], level.sum())
    short = rng.random(count) < 0.1
    ends[short] = origin + rng.uniform(0.1, 0.9, (short.sum(), 1)) * (ends[short] - origin)
    return beams(origin, ends, rng.random(count) < 0.9, rng.random(count) < 0.1)


@pytest.mark.parametrize(("growth", "share"), [("linear", 0.5), ("quadratic", 0.25)])
def test_the_belief_of_a_return_falls_with_the_range_or_with_its_square(growth, share):
    """Half of max_range away; the sensor of the beams goes before that of the mapper."""
    m = mapper()
    sensor = SensorParams(max_range=8.0, hit_given_object=(0.9, 0.5), error_growth=growth)
    m.integrate(replace(beams((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), sensor=sensor))
    assert belief(m, 4.0, 0.0) == pytest.approx(0.9 - share * 0.4, abs=1e-4)


@pytest.mark.parametrize("rule", RULES)
@given(heights=st.lists(st.integers(-50, 300), min_size=1, max_size=40))
def test_no_reading_lowers_a_known_cell(rule, heights):
    m = mapper(update_rule=rule)
    stored = -(10**6)
    for height in heights:
        m.integrate(beams((3.0, 3.5, 4.0), (3.0, 4.0, height / 100)))
        assert cell(m, 3.0, 4.0)[0] >= stored
        stored = cell(m, 3.0, 4.0)[0]


def test_a_candidate_that_the_height_has_grown_up_to_is_forgotten():
    m = mapper(update_rule="candidate")
    m.integrate(beams((3.0, 3.5, 2.0), [(3.0, 4.0, z) for z in (0.0, 0.12, 0.10, 0.20, 0.50)]))
    assert cell(m, 3.0, 4.0)[0] == 20


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_a_beam_through_the_corners_of_cells_passes_only_the_diagonal(signs):
    m = mapper(update_rule="paper")
    centers = (np.array([(x, y) for x in range(8) for y in range(8)]) + 0.5) * 0.125 * signs
    for x, y in centers:
        m.integrate(beams((x, y, 2.0), (x, y, 0.5)))
    before = {tuple(c): cell(m, *c)[1] for c in centers}
    m.integrate(beams((0.0, 0.0, 0.2), (*(0.75 * np.array(signs)), 0.2), is_hit=False))
    changed = {c for c in before if cell(m, *c)[1] != before[c]}
    # A corner belongs to the cell of larger x and y, so both ends are at home in one of these.
    assert {abs(x) - abs(y) for x, y in changed} == {0.0}
    assert 5 <= len(changed) <= 6


@pytest.mark.parametrize("rule", RULES)
@draws(20)
@given(
    seed=st.integers(0, 2**32 - 1),
    probability_max=st.sampled_from([0.9, 0.98, 1.0]),
    replace_belief=st.sampled_from([0.5, 0.75]),
    tolerance=st.sampled_from([0.0, 0.04, 0.1]),
)
def test_equals_the_literal_rules_cell_by_cell(
    rule, seed, probability_max, replace_belief, tolerance
):
    rng = np.random.default_rng(seed)
    fast = mapper(
        update_rule=rule,
        probability_max=probability_max,
        replace_belief=replace_belief,
        height_tolerance=tolerance,
    )
    literal = LiteralMap(GRID.resolution, SENSOR, fast.params)
    for _ in range(15):
        scan = random_scan(rng, 60)
        fast.integrate(scan)
        literal.scan(scan.origins, scan.ends, scan.is_hit, scan.is_lone)

    area = Area(0, 0, *fast.grid.geometry.shape)
    corner = area.rows // 2, area.rows // 2  # cell (0, 0) of the literal map
    arrays = [np.zeros(area.shape, int) for _ in range(4)]
    for (iy, ix), expected in literal.cells.items():
        at = iy + corner[0], ix + corner[1]
        arrays[0][at] = expected.height
        arrays[1][at] = round(expected.probability * PROBABILITY_SCALE)
        if expected.candidate is not None:
            arrays[2][at] = expected.candidate[0]
            arrays[3][at] = round(expected.candidate[1] * PROBABILITY_SCALE)
    grid = fast.grid
    np.testing.assert_array_equal(grid.height.read(area), arrays[0])
    np.testing.assert_array_equal(grid.probability.read(area), arrays[1])
    held = grid.candidate_probability.read(area)
    np.testing.assert_array_equal(held, arrays[3])
    np.testing.assert_array_equal(grid.candidate_height.read(area) * (held > 0), arrays[2])


@pytest.mark.parametrize("rule", RULES)
def test_first_reading_is_stored_with_its_belief(rule):
    m = mapper(update_rule=rule)
    m.integrate(beams((0, 0, 1), (3.0, 4.0, 0.237)))
    height, probability, _, held = cell(m, 3.0, 4.0)
    distance = np.sqrt(25 + 0.763**2)
    assert (height, held) == (24, 0)
    assert probability / PROBABILITY_SCALE == pytest.approx(0.8 - 0.2 * distance / 30, abs=1e-5)


def test_within_tolerance_the_higher_height_stays_and_the_belief_grows():
    m = mapper(update_rule="paper")
    m.integrate(beams((0, 0, 1), [(3, 4, 0.20), (3, 4, 0.28)]))
    first = 0.8 - 0.2 * np.sqrt(25 + 0.8**2) / 30
    given = 0.8 - 0.2 * np.sqrt(25 + 0.72**2) / 30
    bayes = given * first / (given * first + (1 - given) * (1 - first))
    assert cell(m, 3, 4)[0] == 28
    assert belief(m, 3, 4) == pytest.approx(bayes, abs=1e-4)
    m.integrate(beams((0, 0, 1), (3, 4, 0.19)))
    assert cell(m, 3, 4)[0] == 28


@pytest.mark.parametrize("rule", RULES)
def test_a_lower_reading_is_ignored(rule):
    m = mapper(update_rule=rule)
    m.integrate(beams((3, 3.5, 2), (3, 4, 1.0)))
    before = cell(m, 3, 4)
    m.integrate(beams((3, 3.5, 2), (3, 4, 0.5)))
    assert cell(m, 3, 4) == before


def test_paper_replaces_at_once_and_the_candidate_waits_for_a_second_reading():
    low, high = (3, 4, 0.0), (3, 4, 0.8)
    paper, candidate = mapper(update_rule="paper"), mapper(update_rule="candidate")
    for m in (paper, candidate):
        m.integrate(beams((0, 0, 1), [low, high]))
    assert cell(paper, 3, 4)[0] == 80
    assert cell(candidate, 3, 4)[0] == 0
    candidate.integrate(beams((0, 0, 1), high))
    assert cell(candidate, 3, 4)[0] == 80
    assert cell(candidate, 3, 4)[3] == 0


def test_two_different_higher_readings_support_the_lower_one():
    m = mapper(update_rule="candidate")
    m.integrate(beams((0, 0, 1), [(3, 4, 0.0), (3, 4, 1.5), (3, 4, 0.6)]))
    height, _, candidate_height, held = cell(m, 3, 4)
    assert (height, candidate_height) == (60, 150)
    assert held > 0


def test_too_weak_a_reading_never_replaces():
    m = mapper(update_rule="paper", replace_belief=0.9)
    m.integrate(beams((0, 0, 1), [(3, 4, 0.0), (3, 4, 0.8)]))
    assert cell(m, 3, 4)[0] == 0


@pytest.mark.parametrize("rule", RULES)
def test_a_removed_object_disappears_within_a_bounded_number_of_beams(rule):
    m = mapper(update_rule=rule)
    box, behind = (3.0, 0.3, 0.8), (6.0, 0.3, 0.3)
    for _ in range(1000):
        m.integrate(beams((0, 0.3, 0.4), box))
    assert belief(m, 3.0, 0.3) <= 0.98 + 1e-4
    beams_needed = 0
    while belief(m, 3.0, 0.3) >= 0.5:
        m.integrate(beams((0, 0.3, 0.4), behind))
        beams_needed += 1
    assert beams_needed <= 6
    assert cell(m, 3.0, 0.3)[0] == 80  # the height stays, unused
    m.integrate(beams((2.0, 0.3, 0.6), (3.0, 0.3, 0.0)))
    assert cell(m, 3.0, 0.3)[0] == 0  # and the next reading starts over


def test_without_the_clamp_a_cell_becomes_immune():
    """The trap that `probability_max` is there for."""
    m = mapper(update_rule="paper", probability_max=1.0)
    for _ in range(40):
        m.integrate(beams((0, 0.3, 0.4), (3.0, 0.3, 0.8)))
    for _ in range(100):
        m.integrate(beams((0, 0.3, 0.4), (6.0, 0.3, 0.3)))
    assert belief(m, 3.0, 0.3) == 1.0


@pytest.mark.parametrize("rule", RULES)
def test_a_removed_candidate_disappears_too(rule):
    m = mapper(update_rule=rule)
    m.integrate(beams((0, 0.3, 0.4), [(3.0, 0.3, 0.0), (3.0, 0.3, 0.8)]))
    for _ in range(6):
        m.integrate(beams((0, 0.3, 0.4), (6.0, 0.3, 0.3)))
    m.integrate(beams((0, 0.3, 0.4), (3.0, 0.3, 0.0)))
    assert cell(m, 3.0, 0.3)[0] == 0
    assert cell(m, 3.0, 0.3)[3] == 0


@pytest.mark.parametrize("rule", RULES)
def test_cells_not_under_a_beam_stay_bit_identical(rule):
    rng = np.random.default_rng(3)
    m = mapper(update_rule=rule)
    m.integrate(random_scan(rng, 3000))
    area = m.grid.area
    before = m.grid.height.read(area), m.grid.probability.read(area)
    m.integrate(beams((-5, -5, 0.1), (5, -4, 0.1)))  # y from -5 to -4: all else is not under it
    untouched = np.s_[int(m.grid.geometry.cell_at((0, -4))[0]) + 1 :]
    np.testing.assert_array_equal(m.grid.height.read(area)[untouched], before[0][untouched])
    np.testing.assert_array_equal(m.grid.probability.read(area)[untouched], before[1][untouched])
    assert (m.grid.probability.read(area) != before[1]).any()


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("shift", [(1, 0), (-37, 21)])
@draws(20)
@given(seed=st.integers(0, 2**32 - 1))
def test_moving_the_world_by_whole_cells_moves_the_map(rule, shift, seed):
    rng = np.random.default_rng(seed)
    scans = [random_scan(rng, 100) for _ in range(3)]
    offset = np.array([*shift, 0]) * 0.125
    here, there = mapper(update_rule=rule), mapper(update_rule=rule)
    for scan in scans:
        here.integrate(scan)
        there.integrate(elsewhere(scan, scan.origins + offset, scan.ends + offset))
    area = Area(128, 128, 256, 256)
    moved = Area(area.iy + shift[1], area.ix + shift[0], area.rows, area.columns)
    for name in ("height", "probability", "candidate_probability"):
        np.testing.assert_array_equal(
            getattr(here.grid, name).read(area), getattr(there.grid, name).read(moved)
        )


@pytest.mark.parametrize("rule", RULES)
@draws(20)
@given(seed=st.integers(0, 2**32 - 1))
def test_turning_the_world_by_90_degrees_turns_the_map(rule, seed):
    rng = np.random.default_rng(seed)
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    here, there = mapper(update_rule=rule), mapper(update_rule=rule)
    for _ in range(3):
        scan = random_scan(rng, 100)
        here.integrate(scan)
        there.integrate(elsewhere(scan, scan.origins @ quarter.T, scan.ends @ quarter.T))
    center = here.grid.area.rows // 2
    area = Area(center - 128, center - 128, 256, 256)
    for name in ("height", "probability", "candidate_probability"):
        np.testing.assert_array_equal(
            np.rot90(getattr(here.grid, name).read(area), -1),
            getattr(there.grid, name).read(area),
        )


@pytest.mark.parametrize("rule", RULES)
@draws(20)
@given(seed=st.integers(0, 2**32 - 1))
def test_beams_over_different_cells_may_come_in_any_order(rule, seed):
    rng = np.random.default_rng(seed)
    # One row of cells each: none of these beams shares a cell with another.
    y = (np.arange(-40, 40) + 0.5) * 0.125
    start = np.stack([np.full(80, -4.0), y, rng.uniform(0.2, 1, 80)], axis=1)
    end = np.stack([rng.uniform(-3, 6, 80), y, rng.uniform(-0.2, 1, 80)], axis=1)
    order = rng.permutation(80)
    one, other = mapper(update_rule=rule), mapper(update_rule=rule)
    for _ in range(3):
        hit = rng.random(80) < 0.9
        scan = beams(start, end, hit)
        one.integrate(scan)
        other.integrate(beams(start[order], end[order], hit[order]))
        end[:, 0] = rng.uniform(-3, 6, 80)
    for name in ("height", "probability", "candidate_height", "candidate_probability"):
        np.testing.assert_array_equal(
            getattr(one.grid, name).read(one.grid.area),
            getattr(other.grid, name).read(one.grid.area),
        )


@pytest.mark.parametrize("rule", RULES)
def test_probabilities_stay_within_their_bounds(rule):
    rng = np.random.default_rng(5)
    m = mapper(update_rule=rule, probability_min=0.1, probability_max=0.9)
    for _ in range(200):
        m.integrate(random_scan(rng, 300, spread=2.0))
    stored = m.grid.probability.read(m.grid.area)
    stored = stored[stored > 0] / PROBABILITY_SCALE
    assert stored.min() >= 0.1 - 1e-4
    assert stored.max() <= 0.9 + 1e-4
    assert len(stored) > 500


def test_heights_that_cannot_be_stored_are_counted_and_not_stored():
    m = mapper(sensor=SensorParams(max_range=200.0))
    ends = [(1, 1, 350), (2, 2, -400), (3, 3, 10), (4, 4, 327), (5, 5, -327)]
    result = m.integrate(beams((0, 0, 400), ends))
    assert (result.hits, result.out_of_range) == (3, 2)
    assert [cell(m, *xy)[:2] for xy in ((1, 1), (2, 2))] == [(0, 0), (0, 0)]
    assert [cell(m, *xy)[0] for xy in ((3, 3), (4, 4), (5, 5))] == [1000, 32700, -32700]


def test_returns_beyond_the_extent_are_counted_and_do_no_harm():
    m = mapper()
    result = m.integrate(beams((31, 0, 1), [(40, 0, 0), (31.5, 0, 0)]))
    assert (result.hits, result.outside) == (1, 1)
    assert m.integrate(beams((500, 500, 1), (505, 505, 0))).outside == 1


def test_straight_down_and_along_cell_borders():
    m = mapper()
    m.integrate(beams((1.0, 1.0, 1.0), [(1.0, 1.0, 0.0), (3.0, 1.0, 0.0), (1.0, -1.0, 0.0)]))
    assert [cell(m, *xy)[0] for xy in ((1.0, 1.0), (3.0, 1.0), (1.0, -1.0))] == [0, 0, 0]
    assert belief(m, 3.0, 1.0) > 0.5


def test_a_change_is_reported_once_and_only_when_a_height_changes():
    m = mapper()
    m.integrate(beams((0.1, 0.1, 1), (3.05, 4.05, 0.2)))
    tile = (m.grid.geometry.cell_at((3.05, 4.05)) // 16).tolist()
    assert m.grid.take_changed().tolist() == [tile]
    m.integrate(beams((0.1, 0.1, 1), (3.05, 4.05, 0.2)))
    assert m.grid.take_changed().tolist() == []


def test_flat_ground_seen_at_a_grazing_angle_stays_in_the_map():
    """The trap of grazing beams: the literal rule eats ground that the default keeps.

    A laser 0.3 m up whose pitch is known to 0.1 degrees sees ground up to 12 m ahead.
    """
    kept = {}
    for rule in RULES:
        rng = np.random.default_rng(11)
        m = mapper(update_rule=rule)
        for k in range(100):
            origin = np.array([0.02 * k, 0, 0.3])
            x = rng.uniform(2.0, 12.0, 40)
            z = rng.normal(0, np.radians(0.1) * x)
            m.integrate(beams(origin, np.stack([x, rng.uniform(-0.5, 0.5, 40), z], axis=1)))
        iy, ix = m.grid.geometry.cell_at((4.0, -0.5))
        area = Area(int(iy), int(ix), 8, 64)
        observed = m.grid.probability.read(area) > 0
        kept[rule] = m.grid.read(0.5, area).known[observed].mean()
    assert kept["candidate"] > 0.97
    assert kept["paper"] < 0.9
