# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search of the whole map over made-up places: unique ones are found, others are told."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from box_places import CELL, SIDE, boxes, long_term, short_term

from heightmap25d_ros.localization.global_search import GlobalSearch, Prior, relocalize
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.params.sections import RegistrationParams

PARAMS = RegistrationParams()


def twice(rng: np.random.Generator):
    """A room, and the same one 8 m beside it."""
    half = boxes(rng, 30)
    half[:, 0] = rng.uniform(-7.5, -0.5, 30)
    return np.concatenate([half, half + (8.0, 0, 0, 0, 0, 0)])


@pytest.mark.parametrize("seed", range(4))
def test_the_whole_map_is_searched(seed):
    rng = np.random.default_rng(seed)
    place = boxes(rng, 60)
    truth = np.append(rng.uniform(-3.5, 3.5, 2), rng.uniform(-np.pi, np.pi))
    # The robot stands on the floor.
    place = place[np.hypot(*(place[:, :2] - truth[:2]).T) > 1.0]
    found = relocalize(short_term(place, rng, truth), long_term(place, rng), PARAMS)
    assert found.is_accepted, found
    assert found.offset[:2] == pytest.approx(truth[:2], abs=0.06)
    turn = np.angle(np.exp(1j * (found.offset[2] - truth[2])))
    assert abs(turn) < np.radians(1.0)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_two_equal_rooms_are_both_told(noise):
    rng = np.random.default_rng(8)
    place = twice(rng)
    seen = short_term(place, rng, np.array([-4.0, 0.0, 0.3]), reach=2.5)
    found = relocalize(seen, long_term(place, rng, noise), PARAMS)
    assert found.reason is Reason.AMBIGUOUS
    assert len(found.candidates) >= 2
    scores = [candidate.score for candidate in found.candidates]
    for x in (-4.0, 4.0):
        distance = [np.hypot(c.offset[0] - x, c.offset[1]) for c in found.candidates]
        assert min(distance) < CELL
        assert scores[int(np.argmin(distance))] < min(scores) + PARAMS.search_margin


def test_a_prior_tells_two_equal_rooms_apart():
    rng = np.random.default_rng(8)
    place = twice(rng)
    seen, over = (
        short_term(place, rng, np.array([-4.0, 0.0, 0.3]), reach=2.5),
        long_term(place, rng),
    )
    for x in (-4.0, 4.0):
        found = relocalize(seen, over, PARAMS, Prior(x + 1.0, 0.5, 3.0))
        assert found.is_accepted, found
        assert found.offset == pytest.approx((x, 0.0, 0.3), abs=0.06)


def test_a_place_that_looks_the_same_from_two_sides_is_not_unique():
    rng = np.random.default_rng(9)
    half = boxes(rng, 30)
    half[:, 0] = -np.abs(half[:, 0])
    turned = half * (-1, -1, 1, 1, 1, 1)
    place = np.concatenate([half, turned])
    truth = np.array([-3.0, 1.0, 0.4])
    found = relocalize(short_term(place, rng, truth, reach=3.0), long_term(place, rng), PARAMS)
    assert found.reason is Reason.AMBIGUOUS
    for pose in (truth, (3.0, -1.0, 0.4 - np.pi)):
        assert any(
            np.hypot(*(c.offset - pose)[:2]) < CELL and np.cos(c.offset[2] - pose[2]) > 0.99
            for c in found.candidates
        )


def test_what_noise_explains_does_not_tell_two_places_apart():
    """Of two equal rooms one lacks a low box: without a margin that decides."""
    rng = np.random.default_rng(8)
    place = twice(rng)
    seen = short_term(place, rng, np.array([-4.0, 0.0, 0.3]), reach=2.5, noise=0.0)
    lacking = np.delete(place, 30 + np.abs(place[30:, 0] - 4.0).argmin(), axis=0)
    over = long_term(lacking, rng)
    sharp = dataclasses.replace(PARAMS, search_margin=0.0, max_search_ratio=1.0)
    best, second = relocalize(seen, over, dataclasses.replace(sharp, search_margin=0.1)).candidates[
        :2
    ]
    gap = second.score - best.score
    assert gap > 0.0
    for margin, expected in ((0.5 * gap, Reason.ACCEPTED), (1.5 * gap, Reason.AMBIGUOUS)):
        params = dataclasses.replace(sharp, search_margin=margin)
        assert relocalize(seen, over, params).reason is expected


def test_a_floor_alone_is_everywhere():
    rng = np.random.default_rng(10)
    flat = np.zeros((0, 6))
    found = relocalize(short_term(flat, rng, np.zeros(3)), long_term(flat, rng), PARAMS)
    assert found.reason is Reason.AMBIGUOUS


def test_an_unknown_map_is_refused():
    rng = np.random.default_rng(11)
    unknown = Surface(
        np.full((SIDE, SIDE), np.nan, np.float32), np.zeros((SIDE, SIDE), bool), (-8.0, -8.0), CELL
    )
    seen = short_term(boxes(rng), rng, np.zeros(3))
    assert not relocalize(seen, unknown, PARAMS).is_accepted
    assert not relocalize(
        seen, long_term(boxes(rng), rng), PARAMS, Prior(90.0, 0.0, 5.0)
    ).is_accepted


def test_budgets_are_kept():
    rng = np.random.default_rng(12)
    place = boxes(rng, 60)
    seen, over = short_term(place, rng, np.zeros(3)), long_term(place, rng)
    few = dataclasses.replace(PARAMS, search_nodes=100)
    ended = relocalize(seen, over, few)
    assert ended.reason is Reason.UNFINISHED
    assert ended.nodes < 1000 + 25_000
    huge = Surface(
        np.broadcast_to(np.float32(0.0), (30_000, 30_000)),
        np.broadcast_to(np.False_, (30_000, 30_000)), (0.0, 0.0), CELL,
    )  # fmt: skip
    assert relocalize(seen, huge, PARAMS).reason is Reason.TOO_LARGE


def test_slices_are_short_and_lead_to_the_same():
    rng = np.random.default_rng(13)
    place = boxes(rng, 60)
    seen, over = short_term(place, rng, np.array([1.0, 0.5, 0.2])), long_term(place, rng)
    at_once = relocalize(seen, over, PARAMS)  # compiled, and the pyramid made
    search = GlobalSearch(seen, over, PARAMS)
    with pytest.raises(ValueError, match="not done"):
        _ = search.result
    lasted, is_done = [], False
    while not is_done:
        began = time.thread_time()
        is_done = search.step(0.0)
        lasted.append(time.thread_time() - began)
    assert len(lasted) > 5
    assert np.percentile(lasted, 90) < 0.05
    np.testing.assert_array_equal(search.result.offset, at_once.offset)
    assert search.result.nodes == at_once.nodes
    assert search.step(0.0)
