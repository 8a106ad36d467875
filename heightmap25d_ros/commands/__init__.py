# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of ``heightmap25d``: each module adds its own to the parser."""
