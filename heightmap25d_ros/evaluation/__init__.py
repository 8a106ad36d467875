# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results against the truth.

`truth` reads what the simulator knows; the others hold maps, paths, trajectories and reachable
goals against it. They share no code with what they judge.
"""
