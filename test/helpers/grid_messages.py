# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""HeightGrid messages of small maps."""

import array

import numpy as np

from heightmap25d_msgs.msg import HeightGrid

CELL = 0.125


def grid(height, origin=(0.0, 0.0)):
    """A HeightGrid of heights in centimetres; NaN: unknown."""
    message = HeightGrid()
    message.header.frame_id = "map"
    message.info.resolution = CELL
    message.info.height, message.info.width = height.shape
    message.info.origin.position.x, message.info.origin.position.y = origin
    message.info.origin.orientation.w = 1.0
    message.height_resolution, message.probability_threshold = 0.01, 0.5
    known = np.isfinite(height)
    message.height = array.array("h", np.where(known, height, 0).astype(np.int16).tobytes())
    message.probability = array.array("B", np.where(known, 200, 0).astype(np.uint8).tobytes())
    return message
