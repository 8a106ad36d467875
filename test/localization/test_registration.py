# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Registration over made-up places, where the offset is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from box_places import CELL, boxes, long_term, short_term

from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.paper_registration import register_by_paper
from heightmap25d_ros.localization.registration import Reason, register, search_points
from heightmap25d_ros.params.sections import RegistrationParams

PARAMS = RegistrationParams()
WIDE = np.diag([0.3**2, 0.3**2, 0.06**2])


@pytest.mark.slow
def test_random_offsets_are_found():
    errors = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        place = boxes(rng)
        truth = rng.uniform((-0.5, -0.5, -0.1), (0.5, 0.5, 0.1))
        found = register(
            short_term(place, rng, truth, reach=6.0),
            long_term(place, rng, 0.025),
            WIDE,
            PARAMS,
        )
        assert found.is_accepted, (seed, found)
        errors.append(np.abs(found.offset - truth))
        assert abs(found.z) < 0.02
    distance, yaw = np.linalg.norm(np.array(errors)[:, :2], axis=1), np.array(errors)[:, 2]
    assert np.median(distance) <= 0.03
    assert np.percentile(distance, 95) <= 0.06
    assert np.degrees(np.median(yaw)) <= 0.2


def test_z_does_not_drag_the_map_and_is_told():
    rng = np.random.default_rng(1)
    place, truth = boxes(rng), np.array([0.2, -0.1, 0.03])
    seen, over = short_term(place, rng, truth), long_term(place, rng)
    level = register(seen, over, WIDE, PARAMS)
    lifted = register(seen._replace(xyz=seen.xyz + (0.0, 0.0, 0.4)), over, WIDE, PARAMS)
    assert lifted.offset == pytest.approx(level.offset, abs=1e-2)
    assert lifted.z - level.z == pytest.approx(-0.4, abs=1e-2)


def test_a_flat_place_corrects_nothing():
    rng = np.random.default_rng(2)
    flat = np.zeros((0, 6))
    over = long_term(flat, rng)
    found = register(short_term(flat, rng, np.zeros(3)), over, WIDE, PARAMS)
    assert found.reason is Reason.UNOBSERVED
    assert not found.information.any()


def test_a_street_corrects_across_and_not_along():
    rng = np.random.default_rng(3)
    kerbs = np.array([[0, 1.6, 30, 0.3, 0, 0.25], [0, -1.9, 30, 0.4, 0, 0.25]], float)
    truth = np.array([0.3, 0.15, 0.02])
    found = register(short_term(kerbs, rng, truth, reach=3.0), long_term(kerbs, rng), WIDE, PARAMS)
    assert found.is_accepted
    across = np.array([-np.sin(0.0), 1.0, 0.0])
    assert across @ found.information @ across > 400.0
    assert found.information[0, 0] < 1e-3 * found.information[1, 1]
    corrected = np.linalg.solve(np.linalg.inv(WIDE) + found.information,
                                found.information @ found.offset)  # fmt: skip
    assert corrected[1] == pytest.approx(0.15, abs=0.05)
    assert abs(corrected[0]) < 0.02


def test_another_place_is_refused():
    refused = 0
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        seen = short_term(boxes(rng, 60), rng, np.zeros(3))
        over = long_term(boxes(rng, 60), rng)
        refused += not register(seen, over, WIDE, PARAMS).is_accepted
    assert refused == 10


def test_too_few_points_are_refused():
    rng = np.random.default_rng(4)
    place = boxes(rng)
    few = short_term(place, rng, np.zeros(3)).some(np.arange(20))
    found = register(few, long_term(place, rng), WIDE, PARAMS)
    assert found.reason is Reason.FEW_POINTS


def test_beyond_the_map_there_is_too_little_overlap():
    rng = np.random.default_rng(5)
    place = boxes(rng)
    far = short_term(place, rng, np.zeros(3))._replace(pivot=(30.0, 30.0))
    assert register(far, long_term(place, rng), WIDE, PARAMS).reason is Reason.LITTLE_OVERLAP


def test_a_sharp_prior_contradicted_is_refused():
    rng = np.random.default_rng(6)
    place = boxes(rng)
    sure = np.diag([0.04**2, 0.04**2, 0.01**2])
    found = register(
        short_term(place, rng, np.array([0.24, 0.24, 0.0])), long_term(place, rng),
        sure, dataclasses.replace(PARAMS, max_deviation=2.0),
    )  # fmt: skip
    assert found.reason in (Reason.FAR_FROM_PRIOR, Reason.HIGH_RESIDUAL)


def test_paper_method_comes_within_a_cell():
    rng = np.random.default_rng(7)
    place, truth = boxes(rng), np.array([0.25, -0.375, 0.0])
    seen = short_term(place, rng, truth)
    found = register_by_paper(seen, long_term(place, rng), WIDE)
    assert np.linalg.norm(found.offset[:2] - truth[:2]) < CELL
    assert abs(np.degrees(found.offset[2])) < 1.0


def test_search_points_are_mostly_edges_and_spread():
    is_edge = np.arange(3000) % 3 == 0
    some = RegistrationPoints(np.zeros((3000, 3)), is_edge, np.ones(3000))
    index = search_points(some, 600)
    assert len(np.unique(index)) == 600
    assert is_edge[index].sum() == 400
    assert np.diff(index).max() < 40
    assert len(search_points(some.some(np.arange(50)), 600)) == 50
