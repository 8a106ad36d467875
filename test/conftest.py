# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from properties import USUAL

import heightmap25d_ros  # noqa: F401 - before NumPy, so that BLAS has one thread here as in commands

# No test is timed: the machine may be busy, and the first call of a kernel compiles it.
UNTIMED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
# The same examples in each run; `pytest --hypothesis-profile explore` looks for new ones.
settings.register_profile("repeatable", UNTIMED, max_examples=USUAL, derandomize=True)
settings.register_profile("explore", UNTIMED, max_examples=20 * USUAL)
settings.load_profile("repeatable")

NODES = Path(__file__).parent / "nodes"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All that is in nodes/ starts ROS processes, and is slow; other slow tests are marked.

    Such tests come first, so that none of them is left alone at the end of a parallel run.
    """
    items.sort(key=lambda item: NODES not in item.path.parents)  # stable
    for item in items:
        if NODES in item.path.parents:
            item.add_marker(pytest.mark.slow)


# Nodes of a test see one another, and no other ROS on the machine or the network.
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
