# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the repository lies, and its recordings."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BAGS = ROOT / "bags"
