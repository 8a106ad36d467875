# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of worlds with two levels against the truth: all tables of docs/levels.md.

    python studies/measure_levels.py [--bags DIR] [--seeds 31 32 33] [--only SECTION ...]

Each drive is mapped with true poses, its scans in their order and in the reverse order: so each
deck is seen first once. Recordings are kept, and reused, in ``--bags``. The sections are those of
`level_goals`, `level_gates`, `level_localization`, `level_cost` and `drive_over_levels`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from drive_over_levels import drives
from level_cost import cost
from level_gates import gates
from level_goals import places, two_levels
from level_localization import localization

from heightmap25d_ros.params.sections import Params

SECTIONS = {
    "levels": two_levels,
    "places": places,
    "gates": gates,
    "localization": localization,
    "drives": drives,
    "cost": cost,
}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=Path, help="directory of recordings, kept and reused")
    parser.add_argument("--seeds", type=int, nargs="+", default=[31, 32, 33])
    parser.add_argument("--only", nargs="+", choices=list(SECTIONS), default=list(SECTIONS))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.bags or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for section in options.only:
            SECTIONS[section](folder, options.seeds, Params())


if __name__ == "__main__":
    main()
