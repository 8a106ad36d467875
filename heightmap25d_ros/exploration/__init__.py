# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frontier exploration: from a map that is not complete to the next place to look from.

`surveyor` makes a `survey` of a map: `travel_costs` are those of all ways over the planner's
graph, `frontiers` says which unknown cells matter, `doubtful_obstacles` which obstacles are as
good as unknown, and `looks` which were looked for in vain; `unseen_decks` is for maps with several
levels. `sight` predicts what would be seen from a place, `stops` are places that together show
most, and `explorer` chooses one of them, after Yamauchi, Schultz and Adams (1999), as the first of
a `tour`. `looking` is the turn on the spot there.
"""
