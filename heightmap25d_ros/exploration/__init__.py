# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frontier exploration: from a map that is not complete to the next place to look from.

`boundary` is the area that the robot may not leave, `frontiers` says which unknown cells matter
and which cells can be looked from, `sight` predicts what would be seen there, and `explorer`
chooses the next one, after Yamauchi, Schultz and Adams (1999), as the first of a `tour`. `looking`
is the turn on the spot at such a place, and `unseen_decks` is for maps with several levels.
"""
