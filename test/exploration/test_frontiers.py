# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from explored_worlds import SENSOR, seen
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from scipy import ndimage

from heightmap25d_ros.exploration import frontiers, sight

MAP = """
#######????
#.....#????
#.....#????
#.....?????
#.....#????
#######????
"""


def parsed(text):
    """Known, occupied of a map: # is a wall, . free, ? unknown."""
    cells = np.array([list(line) for line in text.strip().splitlines()])
    return cells != "?", cells == "#"


def wanted_of(known, occupied, reachable, allowed, radius, depth):
    touched = frontiers.touched(known, occupied, reachable, radius)
    return frontiers.wanted(known, touched, allowed, depth)


def test_only_the_unknown_behind_a_door_is_wanted():
    known, occupied = parsed(MAP)
    reachable = known & ~occupied
    wanted = wanted_of(known, occupied, reachable, np.ones_like(known), radius=0, depth=2)
    assert np.argwhere(wanted).tolist() == [[3, 6], [3, 7]]


def test_the_robot_touches_free_cells_beside_those_that_it_can_come_to():
    known, occupied = parsed(MAP)
    reachable = np.zeros_like(known)
    reachable[3, 3] = True
    near = wanted_of(known, occupied, reachable, np.ones_like(known), radius=1, depth=1)
    assert not near.any()
    wide = wanted_of(known, occupied, reachable, np.ones_like(known), radius=2, depth=1)
    assert np.argwhere(wide).tolist() == [[3, 6]]


def test_what_is_not_allowed_is_not_wanted_and_not_passed():
    known, occupied = parsed(MAP)
    allowed = np.ones_like(known)
    allowed[3, 6] = False
    wanted = wanted_of(known, occupied, known & ~occupied, allowed, radius=0, depth=5)
    assert not wanted.any()


@draws(40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 8))
def test_sums_over_squares(seed, spacing, reach):
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 20, 2)) < 0.3
    cells = frontiers.viewpoints(np.ones_like(mask), spacing)
    scenery = sight.Scenery(
        height=np.zeros(mask.shape, np.float32), known=~mask, wanted=mask, sensor_height=SENSOR,
        reach=reach, blind=0.0,
    )  # fmt: skip
    counted = sight.Outlook(scenery).most(cells)
    for (y, x), count in zip(cells, counted, strict=True):
        part = mask[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
        assert count == part.sum()
        assert y % spacing == x % spacing == 0


@draws(25)
@given(st.integers(0, 2**32 - 1))
def test_sight_is_that_along_each_cells_own_line(seed):
    """All of the ground is unknown but for boxes. At the edges of shadows rays and lines differ."""
    rng = np.random.default_rng(seed)
    height, known = np.zeros((50, 50), np.float32), np.zeros((50, 50), bool)
    for _ in range(6):
        iy, ix = rng.integers(0, 46, 2)
        part = slice(iy, iy + rng.integers(2, 8)), slice(ix, ix + rng.integers(2, 8))
        height[part], known[part] = rng.choice([0.3, 1.0, 2.0]), True
    cell = tuple(int(n) for n in rng.integers(5, 45, 2))
    near = tuple(slice(max(n - 10, 0), n + 11) for n in cell)  # from there shadows widen too fast
    height[near], known[near] = 0.0, True
    scenery = sight.Scenery(
        height=height, known=known, wanted=~known, sensor_height=SENSOR, reach=40.0, blind=11.2
    )
    predicted = sight.seen_from(scenery, cell)
    truth = seen(height.astype(float), cell, blind=1.4)
    around = np.ones((7, 7), bool)
    surely = ndimage.binary_erosion(truth, around) & ~known
    hardly = ndimage.binary_dilation(truth, around) & ~known
    assert (predicted & ~hardly).sum() <= 0.02 * predicted.sum()
    assert (surely & ~predicted).sum() <= 0.02 * surely.sum()
    outlook = sight.Outlook(scenery)
    assert outlook.gain(cell) == outlook.gain(cell) == predicted.sum()


def test_heights_go_on_into_what_is_wanted():
    """Each wanted cell gets that of ground over which it is reached, and not of the wall beside."""
    height = np.array([[0.3, 9.0, 9.0, 9.0], [2.0, 9.0, 9.0, 9.0]], np.float32)
    known = np.array([[True, False, False, False], [True, False, False, False]])
    touched = np.array([[True, False, False, False], [False] * 4])
    found = frontiers.wanted(known, touched, ~touched, depth=2.0, height=height)
    np.testing.assert_array_equal(found, [[False, True, True, False], [False, True, False, False]])
    np.testing.assert_array_equal(height, np.float32([[0.3, 0.3, 0.3, 9.0], [2.0, 0.3, 9.0, 9.0]]))
