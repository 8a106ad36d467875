# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The attacks at length: the table of docs/reliability.md.

``make attack`` runs all of it, which takes hours; ``--share 0.01`` a hundredth, ``--only messages``
one attack. A seed and the number of a case repeat a failure. The exit status is 1 if there is one.
"""

from __future__ import annotations

import argparse
import logging
import os
import re
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))
os.environ["ROS_DOMAIN_ID"] = str(102 + os.getpid() % 100)  # tests have the ones below
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import file_attack
import node_attack
from message_attack import attack_messages
from tally import Tally

FUZZED = {
    "messages": 2_000_000, "transforms": 5_000_000, "scans": 2_000_000, "odometry": 2_000_000,
    "parameters": 100_000, "trajectories": 200_000,
    "maps": 200_000, "layers": 100_000, "mcap": 10_000, "sqlite": 20_000,
}  # fmt: skip
"""Inputs for each target of fuzz.py."""

Attack = Callable[[int, float, Path], Tally]
"""From a seed, the share of the whole, and a directory to work in."""


def _fuzz(target: str) -> Attack:
    def fuzz(seed: int, share: float, directory: Path) -> Tally:
        tally = Tally(f"coverage-guided fuzzing: {target}")
        if find_spec("atheris") is None:
            tally.outcomes["runs, since atheris is not installed"] = 0
            return tally
        command = [
            sys.executable, str(Path(__file__).parent / "fuzz.py"), target, f"-seed={seed or 1}",
            f"-runs={max(100, round(share * FUZZED[target]))}", "-timeout=60", "-rss_limit_mb=4096",
            f"-artifact_prefix={Path.cwd()}/",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=directory)
        runs = re.search(r"Done (\d+) runs", done.stderr)
        tally.outcomes["inputs"] = int(runs[1]) if runs else 0
        edges = re.findall(r"cov: (\d+)", done.stderr)
        tally.outcomes["branches reached"] = int(edges[-1]) if edges else 0
        if done.returncode:
            tally.failures.append(done.stderr[-3000:])
        return tally

    return fuzz


def _part(share: float, whole: int) -> int:
    return max(1, round(share * whole))


ATTACKS: dict[str, Attack] = {
    "messages": lambda seed, share, _: attack_messages(seed, _part(share, 1_000_000)),
    "maps": lambda seed, share, d: file_attack.attack_maps(seed, _part(share, 20_000), d),
    "parameters": lambda seed, share, d: file_attack.attack_yaml(seed, _part(share, 20_000), d),
    "trajectories": lambda seed, share, d: file_attack.attack_trajectories(
        seed, _part(share, 20_000), d
    ),
    "bags": lambda seed, share, d: file_attack.attack_bags(seed, _part(share, 500), d),
    **{f"fuzz-{target}": _fuzz(target) for target in FUZZED},
    "saves": lambda seed, share, d: node_attack.attack_saves(seed, _part(share, 200), d),
    "node-saves": lambda seed, share, d: node_attack.attack_node_saves(seed, _part(share, 200), d),
    "lifecycle": lambda seed, share, _: node_attack.attack_lifecycle(seed, _part(share, 500)),
    "soak": lambda _, share, d: node_attack.soak(max(30.0, share * 3600.0), 2.0, d),
}


def main() -> int:
    """Run the attacks, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=1.0, help="of the whole campaign")
    parser.add_argument("--only", nargs="+", choices=ATTACKS, default=list(ATTACKS))
    args = parser.parse_args()
    logging.disable()
    warnings.simplefilter("error", RuntimeWarning)
    print("| attack | outcomes | failures |\n|---|---|---|", flush=True)
    failures = []
    for name in args.only:
        with tempfile.TemporaryDirectory() as directory:
            tally = ATTACKS[name](args.seed, args.share, Path(directory))
        print(tally.row, flush=True)
        failures += [f"{name}: {failure}" for failure in tally.failures]
    print(*failures, sep="\n", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
