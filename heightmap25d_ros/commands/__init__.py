# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of ``heightmap25d``, one file each.

A module adds its command to the parser (``add_to``) and runs it; `common` has what they share, and
`stretch` the options of a part of a bag.
"""

SUMMARIES = {
    "map": "a map directory from bags",
    "localize": "the pose of a bag, held to a map",
    "slam": "a map directory from bags whose poses drift",
    "merge": "one map directory of several of one place",
    "plan": "a path over a map directory",
    "explain": "why a cell is occupied, dear or unknown",
    "convert": "the obstacle grid of a map anew",
    "render": "pictures of a map directory",
    "evaluate": "a map directory against the truth",
    "info": "what is in a bag or a map directory",
    "view": "a map or a bag in 3-D (needs rerun)",
    "import": "a map directory from a map of others, a bag from clouds",
    "export": "a map as points (PLY, PCD) or as a GeoTIFF",
    "simulate": "a bag of a simulated drive, and its truth",
    "explore": "a simulated robot explores a world",
    "bringup": "the nodes, until Ctrl-C",
}
"""What each command does, in the order of ``--help``; each is a module with an ``add_to``; that of
``import``, a word of Python's, is `import_map`."""
