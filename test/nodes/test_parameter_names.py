# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Old names, and integers, in a node's parameter overrides; the node runs in this process."""

import pytest
import rclpy
from rclpy.parameter import Parameter

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes.parameters import declare_params

OLD, NEW = "short_term.mature_way", "short_term.mature_distance"


@pytest.fixture
def make_node():
    """Makes a node with overrides by name."""
    context, nodes = rclpy.Context(), []
    rclpy.init(args=[], context=context)

    def make(overrides):
        parameters = [Parameter(name, value=value) for name, value in overrides.items()]
        nodes.append(
            rclpy.create_node(
                "renamed",
                context=context,
                parameter_overrides=parameters,
                automatically_declare_parameters_from_overrides=True,
            )
        )
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_an_old_name_sets_the_parameter_is_logged_and_is_not_declared(make_node, capfd):
    node = make_node({OLD: 1.5, "grid.resolution": 0.25})
    params = declare_params(node, ("short_term", "grid"))
    assert (params.short_term.mature_distance, params.grid.resolution) == (1.5, 0.25)
    assert node.get_parameter(NEW).value == 1.5
    assert not node.has_parameter(OLD)
    lines = [line for line in capfd.readouterr().err.splitlines() if OLD in line]
    assert len(lines) == 1
    assert "[WARN]" in lines[0]
    assert NEW in lines[0]


def test_integers_are_taken_for_floats_as_on_the_command_line(make_node):
    node = make_node({"sensor.max_range": 20, "sensor.body_box": [0, 0, 0, 1, 1, 1]})
    params = declare_params(node, ("sensor",))
    assert (params.sensor.max_range, params.sensor.body_box) == (20.0, (0, 0, 0, 1, 1, 1))
    assert isinstance(node.get_parameter("sensor.max_range").value, float)
    assert list(node.get_parameter("sensor.body_box").value) == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def test_both_names_at_once_are_refused(make_node):
    with pytest.raises(InputError, match="as well"):
        declare_params(make_node({OLD: 1.5, NEW: 1.0}), ("short_term",))
