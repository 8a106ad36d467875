# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every tunable parameter, defined once: default, unit, range and meaning.

`sections` holds one frozen dataclass for each class of the package that has parameters; the class
takes its own section. `spec` is the vocabulary of these definitions, `sources` holds what is set
for a single laser or camera. `by_name` addresses parameters as ROS does (``section.name``), so that
a node can declare them; `files` reads parameter files and writes ``config/heightmap25d.yaml`` and
the table of docs/interface.md.
"""
