# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of ``heightmap25d``, one file each.

A module adds its command to the parser (``add_to``) and runs it; `common` has what they share, and
`stretch` the options of a part of a bag.
"""
