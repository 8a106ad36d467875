# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that compiles when its first scan comes loses those that come meanwhile."""

import subprocess
import sys

from repository import ROOT

# In a process of its own, in which no other test has compiled anything.
SCRIPT = """
import sys
from itertools import islice
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping, compile_kernels
from heightmap25d_ros.pipelines.replay import replayed, with_sources
def compiled():
    modules = [m for name, m in sys.modules.items() if name.startswith("heightmap25d_ros")]
    kernels = {k for m in modules for k in vars(m).values() if hasattr(k, "signatures")}
    return {(k.__module__, k.py_func.__qualname__): len(k.signatures) for k in kernels}
with Bag(sys.argv[1]) as bag:
    params = with_sources(Params(), [bag])
    compile_kernels(params)
    before = compiled()
    mapping = Mapping(params)
    for step in islice(replayed(bag, mapping, "/odom"), 300):
        pass
    mapping.maps()
assert mapping.merged["scans"] > 100
assert compiled() == before, set(compiled().items()) - set(before.items())
"""


def test_no_scan_compiles_a_kernel():
    subprocess.run([sys.executable, "-c", SCRIPT, ROOT / "bags" / "ramp"], check=True)
