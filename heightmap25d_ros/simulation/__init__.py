# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated ATRV-Jr with laser scanners, in worlds with known ground truth. Needs MuJoCo.

Read in this order: `scene` (solids and rays), `worlds` with `indoor`, `outdoor`, `plain` and
`repeats` (the worlds), `robot` (wheels on the ground), `lasers`, `cloud_sensors` and `odometry`
(the sensors and their noise), `simulation` (all of it in time steps), `messages` (ROS messages),
`pure_pursuit` and `recording` (a bag), `goals` and `truth` (the ground truth), `explored` (a robot
that explores). Only the command line and the simulator node import this room.
"""
