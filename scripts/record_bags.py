# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Record all of bags/ anew: on one machine the same bytes every time.

Usage: python scripts/record_bags.py [DIRECTORY]
"""

import shutil
import subprocess
import sys
from pathlib import Path

from heightmap25d_ros.simulation import recording

ROOT = Path(__file__).resolve().parent.parent
SEED = 1
SCAN_RATES = {
    "ramp": 37.5,
    "room": 37.5,
    "rough": 18.75,
    "street": 18.75,
    "arch": 37.5,
    "garage": 12.5,
    "moving": 37.5,
}


def main(directory: Path) -> None:
    shutil.rmtree(directory / "ramp", ignore_errors=True)
    subprocess.run(
        [sys.executable, ROOT / "test" / "helpers" / "record_ramp.py", directory / "ramp"],
        check=True,
    )
    for world, scan_rate in SCAN_RATES.items():
        bag = directory / f"{world}_{SEED}"
        shutil.rmtree(bag, ignore_errors=True)
        recording.simulate(world, SEED, bag, mounted=recording.mounted_sensors(scan_rate))
        size = sum(path.stat().st_size for path in bag.rglob("*") if path.is_file())
        print(f"{bag}: {size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "bags")
