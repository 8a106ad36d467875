# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What goes wrong in a callback, a service or a timer: told once, counted, and survived."""

from __future__ import annotations

import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from node_client import Client, mapping_node, node_process
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.experimental.events_executor import EventsExecutor
from std_msgs.msg import String
from std_srvs.srv import Trigger

from heightmap25d_ros.nodes.plain import PlainNode


class Faulty(PlainNode):
    """Fails in all that it does, in several ways, and logs into a list."""

    NAME = "faulty"

    def __init__(self):
        super().__init__()
        self.logged = []
        self.get_logger = lambda: self
        self.create_subscription(String, "text", self._on_text, 10)
        self.create_service(Trigger, "~/refuse", self._refuse)
        self.create_service(Trigger, "~/unsendable", self._unsendable)
        self.create_timer(0.05, lambda: 1 / 0)

    def error(self, text):
        self.logged.append(text)

    def _on_text(self, message):
        raise ValueError(message.data)

    def _refuse(self, request, response):
        raise KeyError("\ud800\n" * 10_000)

    def _unsendable(self, request, response):
        response.message = "\ud800"
        return response


@pytest.fixture
def faulty():
    rclpy.init()
    node = Faulty()
    executor = EventsExecutor()
    executor.add_node(node)
    yield node, executor
    node.destroy_node()
    rclpy.shutdown()


def spin(node, executor, is_done):
    end = time.monotonic() + 60.0
    while not is_done():
        assert time.monotonic() < end
        with node.guard.catching():
            executor.spin_once(timeout_sec=0.05)


def test_failures_are_told_once_a_kind_and_counted_and_the_node_goes_on(faulty):
    node, executor = faulty
    statuses = []
    node.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, 10)
    publisher = node.create_publisher(String, "text", 10)
    for text in "abc":
        publisher.publish(String(data=text))
    client = node.create_client(Trigger, "~/refuse")
    answer = client.call_async(Trigger.Request())
    node.create_client(Trigger, "~/unsendable").call_async(Trigger.Request())
    spin(
        node, executor,
        lambda: len(node.guard.failures) == 4 and node.guard.failures.total() > 8
        and answer.done() and statuses,
    )  # fmt: skip
    assert not answer.result().success
    assert len(node.logged) == 4
    assert sorted(text.partition(":")[0] for text in node.logged) == [
        "KeyError", "UnicodeEncodeError", "ValueError", "ZeroDivisionError"
    ]  # fmt: skip
    assert all("test_guard.py" in text and len(text) < 5000 for text in node.logged)
    spin(node, executor, lambda: statuses[-1].status[0].level == DiagnosticStatus.ERROR)
    assert "callbacks failed" in statuses[-1].status[0].message


def test_a_type_of_parameters_that_does_not_exist_is_refused(tmp_path):
    client = Client("/types")
    wrong = [
        Parameter(name="sensor.max_range", value=ParameterValue(type=kind)) for kind in (99, 3)
    ]
    with mapping_node(tmp_path, namespace="/types") as process:
        refused = client.call("mapping/set_parameters", SetParameters, parameters=wrong)
        assert [result.reason for result in refused.results] == [
            "there is no type 99 of parameters"
        ] * 2
        whole = client.call(
            "mapping/set_parameters_atomically", SetParametersAtomically, parameters=wrong
        )
        assert not whole.result.successful
        names = ["sensor.max_range"]
        (kept,) = client.call("mapping/get_parameters", GetParameters, names=names).values
        assert kept.double_value == 30.0
        assert process.poll() is None
    client.close()
    assert "Traceback" not in process.log


def test_nodes_without_a_life_cycle_report_as_well():
    client, statuses = Client("/plain"), []
    client.node.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, 10)
    with node_process("simulator", namespace="/plain"):
        client.wait(lambda: any(s.name == "/plain/simulator" for m in statuses for s in m.status))
    client.close()
