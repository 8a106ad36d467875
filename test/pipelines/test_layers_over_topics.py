# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A long-term map that comes over topics is localized in as one from a file."""

from dataclasses import replace

import numpy as np
import pytest
from bag_writer import rclpy_type

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.localization.long_term_map import LongTermMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer

SHAPE = 12, 20
FLAT = HeightMap.from_metres(np.zeros(SHAPE), resolution=0.125, origin=(1.0, -2.0))


def layers_of(seed: int) -> LayerMap:
    """Layers of a third of the cells."""
    rng = np.random.default_rng(seed)
    is_seen = rng.random(SHAPE) < 0.3
    dense = {name: np.where(is_seen, rng.uniform(0.001, 0.015, SHAPE), 0.0) for name in NAMES}
    return LayerMap(
        geometry=FLAT.geometry, **{name: np.float32(layer) for name, layer in dense.items()}
    )


LAYERS = replace(layers_of(1), above=(layers_of(2), layers_of(3)))


def grid_message(stamp=1):
    message = rclpy_type("heightmap25d_msgs/msg/HeightGrid")()
    encode.fill_height_grid(message, FLAT, stamp, "map")
    return message


def layers_message(stamp=1, **changes):
    message = rclpy_type("heightmap25d_msgs/msg/LocalizationLayers")()
    encode.fill_localization_layers(message, LAYERS, stamp, "map")
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_a_message_holds_all_layers_of_all_levels():
    found = decode.localization_layers(layers_message(), "map")
    assert isinstance(found.geometry, Geometry)
    assert found.geometry.origin == FLAT.geometry.origin
    assert len(found.above) == 2
    for told, level in zip((found, *found.above), (LAYERS, *LAYERS.above), strict=True):
        for name in NAMES:
            np.testing.assert_array_equal(getattr(told, name), getattr(level, name))


@pytest.mark.parametrize("is_grid_first", [False, True])
def test_in_either_order_they_are_one_map_if_they_are_of_one_stamp(monkeypatch, is_grid_first):
    used = []
    of = LongTermMap.of
    monkeypatch.setattr(LongTermMap, "of", lambda *args: used.append(args) or of(*args))
    localizer = Localizer(Params())

    def take(stamp_of_grid, stamp_of_layers):
        used.clear()
        steps = [
            lambda: localizer.take_long_term_layers(layers_message(stamp_of_layers)),
            lambda: localizer.take_long_term(grid_message(stamp_of_grid)),
        ]
        for step in reversed(steps) if is_grid_first else steps:
            step()
        assert not localizer.dropped
        return used[-1][1]

    np.testing.assert_array_equal(take(1, 1).elevated_x, LAYERS.elevated_x)
    assert take(3, 2) is None
    np.testing.assert_array_equal(take(4, 4).above[1].ground_height, LAYERS.above[1].ground_height)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"ground_x": [0.0]}, "ground_x: 1 values for"),
        ({"cell": [10**6] * len(layers_message().cell)}, "cell: 1000000 is not one of 20 x 12"),
        ({"level": [99] * len(layers_message().cell)}, "level: 99 is not 0 .. 15"),
        ({"spread_xx": [np.nan] * len(layers_message().cell)}, "spread_xx: holds values that are"),
        ({"elevated_y": [0.2] * len(layers_message().cell)}, "elevated_y: holds values that no"),
        ({"ground_count": [-1.0] * len(layers_message().cell)}, "ground_count: holds negative"),
    ],
)
def test_what_no_layers_are_is_refused_by_its_field(changes, reason):
    with pytest.raises(InputError, match=reason):
        decode.localization_layers(layers_message(**changes), "map")
    localizer = Localizer(Params())
    localizer.take_long_term_layers(layers_message(**changes))
    assert localizer.dropped == {f"long_term_layers: bad {reason.partition(':')[0]}": 1}
