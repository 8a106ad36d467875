# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map of the ramp from odometry that jumps is as good as that from odometry that does not."""

from __future__ import annotations

import importlib.util

import pytest
from repository import BAGS, ROOT

from heightmap25d_ros.evaluation.map_error import evaluate_map
from heightmap25d_ros.evaluation.truth import read_truth
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import TraversabilityParams

RAMP = BAGS / "ramp"
SPEC = importlib.util.spec_from_file_location(
    "measure_odometry_jumps", ROOT / "studies" / "measure_odometry_jumps.py"
)
STUDY = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(STUDY)


def score(disturb):
    mapping = STUDY.mapped(RAMP, disturb)
    error = evaluate_map(
        mapping.maps()[0], TraversabilityParams(), read_truth(RAMP / "truth" / "surface.npz")
    )
    assert mapping.trouble == ""
    return error.blocked_transitions.f1, error.known_cells_outside, mapping.merged["scans"]


@pytest.fixture(scope="module")
def half():
    with Bag(RAMP) as bag:
        return bag.duration / 2


@pytest.fixture(scope="module")
def undisturbed(half):
    return score(STUDY.disturbances(half)["undisturbed"])


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in STUDY.disturbances(0.0) if name[0] != "u"])
def test_a_jump_costs_no_more_than_the_scans_around_it(half, undisturbed, name):
    f1, outside, scans = score(STUDY.disturbances(half)[name])
    assert f1 >= undisturbed[0] - 0.01
    assert outside == undisturbed[1] == 0
    assert scans >= 0.97 * undisturbed[2]
