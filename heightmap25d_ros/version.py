# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The version of the package, as package.xml and setup.py have it."""

VERSION = "0.1.0"
