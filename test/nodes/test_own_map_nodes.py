# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot without a map: localization and mapping over DDS, ended in the middle and begun again."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from localization_bags import PARAMS, events_of, truth_of
from nav_msgs.msg import Path
from node_client import PATIENCE, Client, mapping_node, node_process, replay
from repository import BAGS
from std_srvs.srv import Trigger

from heightmap25d_msgs.msg import HeightGrid, LocalizationStatus
from heightmap25d_ros.io import decode, map_directory
from heightmap25d_ros.pose_interpolation import interpolate

SCANS = (
    "-p", "intake.scan_topics:=[scan, scan_down]",
    "-p", "intake.timeout:=30.0",  # the last status is that of the drive
)  # fmt: skip
OWN = (*SCANS, "-p", "localization.own_map:=true")
BEGIN = 10**18  # [ns]
MIDDLE, END = 4.0, 8.0  # [s] of the drive


@pytest.fixture(scope="module")
def truth():
    return truth_of(events_of(BAGS / "room_1", END + 1.0))


@contextmanager
def nodes(client, directory, own_map, *mapping):
    """Both nodes, listening; what they tell is the client's."""
    said = {"pose": [], "localization/status": []}
    kinds = PoseWithCovarianceStamped, LocalizationStatus
    for (topic, messages), kind in zip(said.items(), kinds, strict=True):
        client.node.create_subscription(kind, topic, messages.append, 100)
    follow = "-p", "mapping.needs_localization:=true", "-p", "mapping.autosave:=hall"
    with (
        node_process("localization", *OWN, *own_map),
        mapping_node(directory, *SCANS, *follow, *mapping),
    ):
        client.wait_for_node()
        client.wait(lambda: bool(said["localization/status"]))
        yield said


def play(client, poses, begin, end):
    """Play a part of the drive, and wait until poses and map have come to its end."""
    part = "--start", str(begin), "--duration", str(end - begin)
    played = replay(BAGS / "room_1", *part)
    client.wait(lambda: played.poll() is not None, 2 * PATIENCE)
    last = BEGIN + round((end - 0.3) * 1e9)

    def are_told():
        newest = [*poses[-1:], *filter(None, [client.newest.get("height_grid")])]
        return len(newest) == 2 and all(decode.stamp_ns(m.header) >= last for m in newest)

    client.wait(are_told, PATIENCE)


def errors(messages, truth):
    """(N,) [m]: distances of poses that were told from the true ones."""
    stamps, true = truth
    told = np.array([decode.pose(m.pose.pose, "pose") for m in messages])
    asked = [np.clip(decode.stamp_ns(m.header), stamps[0], stamps[-1]) for m in messages]
    return np.linalg.norm((told - interpolate(stamps, true, np.array(asked)))[:, :2, 3], axis=1)


def known_of(directory):
    threshold = PARAMS.mapper.probability_threshold
    return map_directory.load_in(directory / "hall", threshold, "map")


@pytest.fixture
def client():
    made = Client(name="own_map_client")
    yield made
    made.close()


def test_a_lap_on_its_own_map_that_is_ended_and_gone_on_with(client, tmp_path, truth):
    client.subscribe("localization/submaps", Path)
    client.subscribe("height_grid", HeightGrid)
    with nodes(client, tmp_path, ()) as said:
        play(client, said["pose"], 0.0, MIDDLE)
        refused = client.call("localization/relocalize", Trigger)
    assert not refused.success
    assert "localization.map_directory names no saved map" in refused.message
    assert np.median(errors(said["pose"], truth)) < 0.05
    assert errors(said["pose"], truth).max() < 0.25  # where a busy machine loses scans
    assert said["localization/status"][-1].state == LocalizationStatus.TRACKING
    assert len(client.newest["localization/submaps"].poses) == 1
    saved = known_of(tmp_path)  # by autosave
    assert saved.known.sum() > 1000

    client.newest.clear()
    given = "-p", f"localization.map_directory:={tmp_path / 'hall'}"
    with nodes(client, tmp_path, given, "-p", "mapping.initial_map:=hall") as said:
        client.wait(lambda: "height_grid" in client.newest)
        loaded = decode.height_map(client.newest["height_grid"])
        assert loaded.known.sum() == saved.known.sum()
        play(client, said["pose"], MIDDLE - 1.0, END)
    states = [message.state for message in said["localization/status"]]
    assert states[0] == LocalizationStatus.LOST
    assert states[-1] == LocalizationStatus.TRACKING
    found = next(s for s in said["localization/status"] if s.state == LocalizationStatus.TRACKING)
    late = [m for m in said["pose"] if decode.stamp_ns(m.header) > decode.stamp_ns(found.header)]
    assert len(late) > 20
    assert np.median(errors(late, truth)) < 0.05
    assert errors(late, truth).max() < 0.25
    now = known_of(tmp_path)
    assert now.known.sum() > 1.1 * saved.known.sum()
