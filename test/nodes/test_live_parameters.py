# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters that are changed while the nodes run, over DDS."""

from __future__ import annotations

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from node_client import MAPS, Client, mapping_node, node_process
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter

from heightmap25d_ros.nodes.mapping import MappingNode
from heightmap25d_ros.nodes.parameters import used_by
from heightmap25d_ros.params.by_name import flatten, is_live
from heightmap25d_ros.params.sections import Params

MS = 10**6
START_NS = 1_700_000_000 * 10**9
LASERS = (
    "-p", "intake.scan_topics:=[low, high]",
    "-p", "intake.mounts:=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0]",
    "-p", "traversability.robot_radius:=0.1",
)  # fmt: skip


class Setter(Client):
    """Sets parameters of a node."""

    def __init__(self, node, namespace):
        super().__init__(namespace)
        self._set = node

    def set_together(self, **values):
        """By names with __ for the dot; the result."""
        service = f"{self._set}/set_parameters_atomically"
        parameters = messages_of(values)
        return self.call(service, SetParametersAtomically, parameters=parameters).result

    def get(self, name):
        values = self.call(f"{self._set}/get_parameters", GetParameters, names=[name]).values
        return values[0].double_value


def messages_of(values):
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]


def test_prefixes_of_live_parameters_name_parameters():
    names = [name for name in flatten(Params()) if is_live(name)]
    assert {"traversability.max_step", "planner.unknown", "planning.goal_reached",
            "mapping.publish_rate", "sensor.max_height"} <= set(names)  # fmt: skip
    for fixed in ("grid.resolution", "mapper.update_rule", "intake.scan_topics", "autostart",
                  "mapping.map_directory", "localization.map_directory"):  # fmt: skip
        assert fixed not in names


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    """`mapping` with a row of cells at 0 m beside one at 0.3 m in its map."""
    client = Setter("mapping", "/live")
    client.subscribe("map", MAPS["map"])
    with mapping_node(tmp_path_factory.mktemp("maps"), *LASERS, namespace="/live") as process:
        for milliseconds in (0, 20):
            stamp = START_NS + milliseconds * MS
            client.publish("odom", odometry(stamp, (0, 0, 0), type_of=rclpy_type))
        for topic, distance in (("low", 1.80), ("high", 1.93)):
            stamp = START_NS + 10 * MS
            scan = laser_scan(stamp, [distance] * 5, angle_min=-0.2, angle_max=0.2,
                              type_of=rclpy_type)  # fmt: skip
            client.publish(topic, scan)
        client.wait(lambda: "map" in client.newest)
        client.spin(1.0)  # the last of the scans
        yield client
        assert process.poll() is None
    client.close()


def occupied(client):
    client.newest.clear()
    client.wait(lambda: "map" in client.newest)
    return np.count_nonzero(np.array(client.newest["map"].data) == 100)


def test_the_map_is_converted_anew_by_a_higher_step(stepped):
    assert stepped.set_together(traversability__max_step=0.4).successful
    assert occupied(stepped) == 0
    assert stepped.set_together(traversability__max_step=0.1).successful
    assert occupied(stepped) > 0


def test_parameters_are_set_together_or_not_at_all(stepped):
    result = stepped.set_together(traversability__max_step=0.3, sensor__min_height=1.6)
    assert not result.successful
    assert "sensor.min_height: must be below max_height" in result.reason
    assert stepped.get("traversability.max_step") == 0.1
    result = stepped.set_together(sensor__min_height=1.6, sensor__max_height=2.0)
    assert result.successful, result.reason
    assert stepped.get("sensor.min_height") == 1.6


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"grid__resolution": 0.2}, "read-only parameter: grid.resolution"),
        ({"traversability__max_step": 20.0}, "max_step out of range Min: 0.01, Max: 10.0"),
        ({"traversability__max_step": "high"}, "Wrong parameter type"),
        ({"traversability__robot_radius": 5.0, "grid__resolution": 1.0}, "read-only"),
        ({"traversability__max_stop": 0.2}, "unknown; did you mean traversability.max_step?"),
    ],
)
def test_what_cannot_be_set_is_refused_with_a_reason(stepped, values, reason):
    result = stepped.set_together(**values)
    assert not result.successful
    assert reason in result.reason


def test_each_of_several_parameters_has_its_own_answer(stepped):
    values = {"traversability__max_slope": 0.3, "grid__extent": 64.0}
    parameters = messages_of(values)
    answer = stepped.call("mapping/set_parameters", SetParameters, parameters=parameters)
    assert [result.successful for result in answer.results] == [True, False]


def test_the_rate_of_publishing_changes_at_once(stepped):
    assert stepped.set_together(mapping__publish_rate=0.05).successful
    assert stepped.set_together(traversability__max_step=0.2).successful
    stepped.newest.clear()
    stepped.spin(1.5)
    assert stepped.newest == {}
    assert stepped.set_together(mapping__publish_rate=20.0).successful
    stepped.wait(lambda: "map" in stepped.newest, 5.0)


def test_all_parameters_can_be_read_at_once(tmp_path):
    client = Setter("mapping", "/dumped")
    with mapping_node(tmp_path, namespace="/dumped"):
        names = list(used_by(Params(), MappingNode.PARAMETERS))
        values = client.call("mapping/get_parameters", GetParameters, names=names).values
        assert len(values) == len(names)
        types = {name: value.type for name, value in zip(names, values, strict=True)}
        assert types["intake.mounts"] == ParameterType.PARAMETER_DOUBLE_ARRAY
    client.close()


def test_a_parameter_says_whether_it_can_be_set(stepped):
    names = ["traversability.max_step", "grid.resolution"]
    answer = stepped.call("mapping/describe_parameters", DescribeParameters, names=names)
    assert [descriptor.read_only for descriptor in answer.descriptors] == [False, True]


def test_the_planner_takes_other_parameters_and_refuses_bad_ones():
    client = Setter("planning", "/live_planner")
    with node_process("planning", namespace="/live_planner") as process:
        assert client.set_together(planner__unknown="cost", planning__goal_reached=0.5).successful
        assert not client.set_together(planner__unknown="perhaps").successful
        assert client.get("planning.goal_reached") == 0.5
        assert process.poll() is None
    client.close()


def test_nobody_on_the_graph_moves_the_directory_of_maps_or_names_a_map_outside(stepped):
    kept = stepped.call("mapping/get_parameters", GetParameters, names=["mapping.map_directory"])
    assert not stepped.set_together(mapping__map_directory="/tmp").successful
    again = stepped.call("mapping/get_parameters", GetParameters, names=["mapping.map_directory"])
    assert again.values == kept.values
    for name in ("../last", "/tmp/last", "a\nb", "x" * 201):
        refused = stepped.set_together(mapping__autosave=name)
        assert (refused.successful, "map name" in refused.reason) == (False, True)
