# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that compiles when its first scan comes loses those that come meanwhile."""

import subprocess
import sys

import pytest
from repository import ROOT

from heightmap25d_ros import cli

BAG = ROOT / "bags" / "ramp"

# In processes of their own, in which no other test has compiled anything.
COMPILED = """
import sys
from itertools import islice
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.replay import replayed, with_sources
def compiled():
    modules = [m for name, m in sys.modules.items() if name.startswith("heightmap25d_ros")]
    kernels = {k for m in modules for k in vars(m).values() if hasattr(k, "signatures")}
    return {(k.__module__, k.py_func.__qualname__): len(k.signatures) for k in kernels}
"""
OF_MAPPING = """
import numpy as np
from heightmap25d_ros import se3
from heightmap25d_ros.pipelines.mapping import Mapping, compile_kernels
with Bag(sys.argv[1]) as bag:
    params = with_sources(Params(), [bag])
    compile_kernels(params)
    before = compiled()
    mapping = Mapping(params)
    for step in islice(replayed(bag, mapping, "/odom"), 1500):
        pass
    mapping.maps()
mapping.upper(mapping.area())
se3.to_quaternion(np.eye(4))
assert mapping.merged["scans"] > 100, mapping.merged
assert compiled() == before, set(compiled().items()) - set(before.items())
"""
# A pose that is 1 m off, so that scans contradict the map.
OF_LOCALIZATION = """
from pathlib import Path
import numpy as np
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.localization.global_search import Prior, relocalize
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.surface import surface_of
from heightmap25d_ros.pipelines.localization import Localizer, compile_kernels
from heightmap25d_ros.io import layers_file, map_directory
height_map = map_directory.load(sys.argv[2]).height_map
with Bag(sys.argv[1]) as bag:
    params = with_sources(Params(), [bag])
    localizer = Localizer(params)
    compile_kernels(params)
    localizer.set_long_term(height_map, layers_file.load(Path(sys.argv[2]), height_map))
    before = compiled()
    attempts = 0
    for step in islice(replayed(bag, localizer, "/odom"), 1200):
        attempts += 1
        if attempts == 600:
            localizer.begin_at(np.array([1.0, 1.0, 0.0, 0.5]))
# A search of a flat map, in which there are more places than are kept.
rng = np.random.default_rng(1)
xyz = np.column_stack([rng.uniform(-3.0, 3.0, (200, 2)), np.zeros(200)])
points = RegistrationPoints(xyz, np.zeros(200, bool), np.ones(200))
flat = surface_of(HeightMap.from_metres(np.zeros((300, 300))), params.registration.edge_step)
for prior in (None, Prior(15.0, 15.0, 3.0, turn=0.2)):
    assert relocalize(points, flat, params.registration, prior).reason is Reason.AMBIGUOUS
assert compiled() == before, set(compiled().items()) - set(before.items())
# Called where scans contradict the map, which those of this drive do not.
assert before["heightmap25d_ros.localization.scan_search", "_score"]
"""

# As far as the last metres are refined together.
OF_OWN_MAP = """
from heightmap25d_ros.pipelines.localization import Localizer, compile_kernels
with Bag(sys.argv[1]) as bag:
    params = with_values(with_sources(Params(), [bag]), {"localization.own_map": True})
    compile_kernels(params)
    localizer = Localizer(params)
    before = compiled()
    for _ in replayed(bag, localizer, "/odom"):
        _, submaps, moved = localizer.map_version
        if moved:
            break
assert moved and submaps
assert compiled() == before, set(compiled().items()) - set(before.items())
"""


def run(script, *arguments):
    subprocess.run([sys.executable, "-c", COMPILED + script, *arguments], check=True)


@pytest.mark.parametrize("bag", ["ramp", "garage_1"])
def test_no_scan_compiles_a_kernel_of_mapping(bag):
    """Whether of one level or of several."""
    run(OF_MAPPING, BAG.parent / bag)


def test_no_scan_compiles_a_kernel_of_localization(tmp_path):
    options = ["--odom-topic", "/ground_truth", "--duration", "15"]
    assert cli.main(["map", str(BAG), "-o", str(tmp_path), *options]) == 0
    run(OF_LOCALIZATION, BAG, tmp_path)


def test_no_scan_compiles_a_kernel_of_localization_on_the_own_map():
    run(OF_OWN_MAP, BAG)
