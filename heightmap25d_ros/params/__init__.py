# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every tunable number, once: default, unit, range and meaning.

One frozen section per class of the package (`sections`, made with `spec`). A class takes its own
section; a node declares ROS parameters (``section.name``, `by_name`) from those that it uses;
`files` reads parameter files and writes ``config/heightmap25d.yaml`` and the table of
docs/interface.md. Import from these modules.
"""
