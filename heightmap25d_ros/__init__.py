# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 2 1/2-D map for ROS 2: a height and a probability per cell (Fong et al., 2003).

Read the modules in this order; imports point only upwards:

1. ``se3``, ``params``: poses, and every tunable number once.
2. ``grid``: the cells and their geometry.
3. ``sensor``: a scan, its mount and the poses of the robot become beams.
4. ``mapper``: the paper on one screen, beams into cells.
5. ``terrain``, ``footprint``, ``traversability``: heights become transitions, obstacles and cost.
6. ``planner``, ``transition_costs``, ``path``, ``route``: transitions and a goal become a path.
7. ``messages``, ``transforms``, ``intake``: ROS messages become scans with poses; ``mapping`` and
   ``planning``: messages in, maps and plans out.
8. ``bag``, ``map_io``, ``evaluation``, ``render``: files in, files out; ``display``,
   ``triangle_list``, ``scene_3d``: what 3-D viewers are shown.
9. ``matching``, ``short_term``, ``registration``, ``relocalization``: a map of the last metres
   against the long-term map; ``health``, ``pose_filter``, ``tracking``, ``localization``: the
   pose held to it.
10. ``commands``, ``cli`` and ``nodes``: the same objects driven from a bag and from topics.
"""
