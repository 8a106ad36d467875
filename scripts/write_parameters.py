# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write config/heightmap25d.yaml and the table in docs/interface.md from params/sections.py."""

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from heightmap25d_ros.params.files import as_markdown, as_yaml  # noqa: E402
from heightmap25d_ros.params.sections import Params  # noqa: E402

BEGIN, END = "<!-- parameters: begin -->\n", "<!-- parameters: end -->\n"


def main() -> None:
    (ROOT / "config" / "heightmap25d.yaml").write_text(as_yaml(Params()))
    page = ROOT / "docs" / "interface.md"
    before, _, rest = page.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    page.write_text(before + BEGIN + as_markdown(Params()) + END + after)


if __name__ == "__main__":
    main()
