# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps without known poses.

`own_map_tracker` holds each scan against what has been mapped so far and inserts it at its
corrected pose; how far it may be off since, `drift` tells. Where lasers are level, `laser_odometry`
takes the place of that of the wheels. What was mapped is kept in `submaps` of some metres, each
rigid in itself, with the `sightings` of their cells, less what `trimming` finds needless; `own_map`
joins those around the robot for the scan filter and for searches. `loop_closure` finds the robot in
older submaps, and `submap_graph`, over the `pose_graph`, moves all of them to where they agree; a
`saved_map` of another day may be the first one. `moved_parts` moves what others made with them.
`own_map_localization` does all of this while the robot drives, with the last metres refined
together where scans leave them open (`live_refinement`). Of a recorded drive, `refinement`
finds all poses together afterwards: a `bundle` of poses and of the `patches` and upright `edges`
that they have seen, and the `contacts` of the wheels. `map_pass` holds a drive against a map of
several. `map_registration` finds a finished map in another one, and `map_merge` makes one of both.
"""
