# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""heightmap25d simulate, what it records, and the committed recordings."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from repository import BAGS
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

from heightmap25d_ros.cli import main
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.simulation import recording
from heightmap25d_ros.simulation.recording import BUILDERS, world_of
from heightmap25d_ros.simulation.worlds import World, distance_to_way, floor, walls

COMMITTED = ("arch", "garage", "moving", "ramp", "room", "rough", "street")


def sha256(directory: Path) -> dict[str, str]:
    files = (path for path in sorted(directory.rglob("*")) if path.is_file())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def beginning(way: np.ndarray, metres: float) -> np.ndarray:
    """The first part of a path."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T)))
    end = [np.interp(metres, along, axis) for axis in way.T]
    return np.vstack([way[along < metres], end])


def short(name: str, metres: float) -> Callable[[np.random.Generator], World]:
    """A world with the first metres of its drive."""

    def built(rng: np.random.Generator) -> World:
        world = BUILDERS[name](rng)
        return replace(world, way=beginning(world.way, metres))

    return built


@pytest.fixture(scope="module", autouse=True)
def short_worlds() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, metres in (("arch", 6.0), ("plain_ramp", 12.0)):
            patch.setitem(BUILDERS, f"short_{name}", short(name, metres))
        yield


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("first") / "arch_1"
    assert main(["simulate", "short_arch", "--seed", "1", "-o", str(bag), "--json"]) == 0
    return bag


def messages(bag: Path, *topics: str):
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic in topics]
        for connection, logged, data in reader.messages(connections):
            yield connection.topic, logged, reader.deserialize(data, connection.msgtype)


def stamp(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@pytest.mark.slow
def test_same_seed_same_bytes(recorded: Path, tmp_path: Path) -> None:
    assert main(["simulate", "short_arch", "--seed", "1", "-o", str(tmp_path / "arch_1")]) == 0
    assert sha256(recorded) == sha256(tmp_path / "arch_1")


@pytest.mark.slow
def test_stamps_and_increments(recorded: Path) -> None:
    poses, scans = [], {"/scan": [], "/scan_down": []}
    for topic, logged, message in messages(recorded, "/odom", *scans):
        if topic == "/odom":
            assert stamp(message) == logged
            poses.append(stamp(message))
            continue
        assert len(message.ranges) == 361
        assert message.scan_time == pytest.approx(1 / 37.5)
        assert 361 * message.time_increment == pytest.approx(1 / 75)
        assert message.angle_min + 360 * message.angle_increment == pytest.approx(message.angle_max)
        assert logged - stamp(message) == pytest.approx(1e9 / 75, abs=2)
        scans[topic].append(stamp(message))
    assert set(np.diff(poses)) == {20_000_000}
    for stamps in scans.values():
        np.testing.assert_allclose(np.diff(stamps), 1e9 / 37.5, atol=2)
        assert poses[0] <= stamps[0]
        assert stamps[-1] + 1e9 / 75 <= poses[-1] + 2


@pytest.mark.slow
def test_ranges_follow_rep_117(recorded: Path) -> None:
    for _, _, message in messages(recorded, "/scan", "/scan_down"):
        finite = np.isfinite(message.ranges)
        assert (message.ranges[~finite] == np.inf).all()
        assert (message.ranges[finite] >= np.float32(message.range_min)).all()
        assert (message.ranges[finite] <= np.float32(message.range_max)).all()


@pytest.mark.slow
def test_mounts_frames_and_qualities(recorded: Path) -> None:
    mounts = {
        t.child_frame_id: t
        for _, _, message in messages(recorded, "/tf_static")
        for t in message.transforms
    }
    assert set(mounts) == {"laser", "laser_down"}
    rotation = mounts["laser_down"].transform.rotation
    assert 2 * np.degrees(np.arctan2(rotation.y, rotation.w)) == pytest.approx(28.0)
    frames = {
        "/scan": "laser", "/scan_down": "laser_down", "/odom": "odom", "/ground_truth": "map",
    }  # fmt: skip
    for topic, frame_id in frames.items():
        assert next(messages(recorded, topic))[2].header.frame_id == frame_id
    with AnyReader([recorded]) as reader:
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert offered["/scan"].reliability == QosReliability.BEST_EFFORT
    assert offered["/tf_static"].durability == QosDurability.TRANSIENT_LOCAL


@pytest.mark.slow
def test_true_odometry_is_the_truth_and_the_other_drifts(recorded: Path, tmp_path: Path) -> None:
    exact = tmp_path / "exact"
    options = ["--scan-rate", "1", "--true-odometry", "--nodding"]
    assert main(["simulate", "short_arch", "-o", str(exact), *options]) == 0

    def last(bag: Path, topic: str) -> np.ndarray:
        position = list(messages(bag, topic))[-1][2].pose.pose.position
        return np.array([position.x, position.y, position.z])

    np.testing.assert_array_equal(last(exact, "/odom"), last(exact, "/ground_truth"))
    off = np.linalg.norm(last(recorded, "/odom") - last(recorded, "/ground_truth"))
    assert 0.02 < off < 3.0
    nods = [
        t.child_frame_id for _, _, message in messages(exact, "/tf") for t in message.transforms
    ]
    assert nods.count("laser_nod") == nods.count("base_link")


@pytest.mark.parametrize("world", [
    "moon", "room --seed -1", f"room --seed {2**63}", f"room --seed {10**80}",
    "room --scan-rate 80", "room --speed 0", "room --speed 1.6", "room --speed nan",
    "room --slip -0.1", "room --slip 1.1", "room --slip nan", "room --slip 0.1 --true-odometry",
    "room --slip 0.1 --noise-free",
])  # fmt: skip
def test_what_cannot_be_simulated_is_told(
    world: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", *world.split(), "-o", str(tmp_path / "bag")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "bag").exists()


def test_number_of_too_many_digits_is_told_without_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["simulate", "room", "--seed", "9" * 5000, "-o", str(tmp_path / "bag")])
    assert stopped.value.code == 2
    assert "5000 characters" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.slow
def test_largest_seed_works(tmp_path: Path) -> None:
    bag, seed = tmp_path / "bag", 2**63 - 1
    options = ["--seed", str(seed), "--scan-rate", "1"]
    assert main(["simulate", "short_plain_ramp", "-o", str(bag), *options]) == 0
    with np.load(bag / "truth" / "surface.npz") as surface:
        assert int(surface["seed"]) == seed


def test_the_way_through_the_garage_keeps_clear_of_what_stands_there() -> None:
    """The lower deck; half of the robot's width is 0.32 m."""
    for seed in range(1, 41):
        world = world_of("garage", seed)
        back = np.flatnonzero(np.diff((world.way[:, 1] > 1.6).astype(int)) < 0)[0]
        for solid in world.solids:
            (x, y, _), (half_x, half_y, _) = solid.center, solid.size
            if solid.is_overhead or max(half_x, half_y) > 0.5:
                continue
            side = np.linspace(-1.0, 1.0, 9)
            (across_x, across_y), turn = np.meshgrid(half_x * side, half_y * side), solid.yaw
            outline = (
                x + across_x * np.cos(turn) - across_y * np.sin(turn),
                y + across_x * np.sin(turn) + across_y * np.cos(turn),
            )
            assert distance_to_way(world.way[: back + 2], *outline).min() > 0.4, (seed, x, y)


def test_drive_that_is_blocked_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    solids = (floor(), *walls((-2.0, 3.0), (-2.0, 2.0), 2.0))
    path = np.array([(0.0, 0.0), (6.0, 0.0)])
    blocked = World(name="cell", area=((-2.5, 3.5), (-2.5, 2.5)), way=path, solids=solids)
    monkeypatch.setitem(BUILDERS, "cell", lambda rng: blocked)
    assert main(["simulate", "cell", "--scan-rate", "1", "-o", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "blocked at (2." in error
    assert not (tmp_path / "bag").exists()


def ramp_bag(directory: Path, *options: str) -> Path:
    """A bag of few scans at the foot of a ramp."""
    arguments = ["simulate", "short_plain_ramp", "--scan-rate", "5", "-o", str(directory), *options]
    assert main(arguments) == 0
    return directory


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ramp_bag(tmp_path_factory.mktemp("plain") / "ramp")


def serialized(bag: Path, *topics: str) -> list[tuple[str, int, bytes]]:
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic in topics]
        return [(c.topic, at, bytes(data)) for c, at, data in reader.messages(connections)]


@pytest.mark.slow
def test_slip_is_in_the_odometry_only(plain: Path, tmp_path: Path) -> None:
    slipping = ramp_bag(tmp_path / "ramp", "--slip", "0.2")
    true = ("/ground_truth", "/scan", "/scan_down", "/tf_static")
    assert serialized(plain, *true) == serialized(slipping, *true)
    assert sha256(plain / "truth") == sha256(slipping / "truth")
    for topic in ("/odom", "/tf"):
        before, after = serialized(plain, topic), serialized(slipping, topic)
        assert [at for _, at, _ in before] == [at for _, at, _ in after]
        assert before != after


@pytest.mark.slow
def test_same_speed_and_slip_same_bytes(plain: Path, tmp_path: Path) -> None:
    """The defaults as well when they are said."""
    said = ramp_bag(tmp_path / "said" / "ramp", "--speed", "1.0", "--slip", "0.055")
    assert sha256(said) == sha256(plain)
    options = "--speed", "1.4", "--slip", "0.165", "--seed", "3"
    first, second = (ramp_bag(tmp_path / name / "ramp", *options) for name in ("a", "b"))
    assert sha256(first) == sha256(second)
    assert sha256(first) != sha256(plain)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.4, 1.4])
def test_drive_is_as_fast_as_said(speed: float, tmp_path: Path) -> None:
    bag = ramp_bag(tmp_path / "ramp", "--speed", str(speed), "--scan-rate", "1")
    poses = [message.pose.pose.position for _, _, message in messages(bag, "/ground_truth")]
    steps = np.linalg.norm(np.diff([(p.x, p.y, p.z) for p in poses], axis=0), axis=1)
    assert np.median(steps) / 0.02 == pytest.approx(speed, rel=1e-3)
    assert steps.max() / 0.02 <= speed * 1.01


@pytest.mark.slow
def test_existing_directory_is_kept(recorded: Path) -> None:
    before = sha256(recorded)
    assert main(["simulate", "arch", "-o", str(recorded)]) == 2
    assert sha256(recorded) == before


def test_missing_mujoco_is_told_with_its_cure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [n for n in sys.modules if n.startswith("heightmap25d_ros.simulation")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("heightmap25d_ros.simulation", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["simulate", "room", "-o", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert "pip install 'mujoco" in error
    assert error.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("world", COMMITTED)
def test_committed_bag_is_mapped_without_drops(
    world: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = BAGS / f"{world}_1"
    assert main(["map", str(bag), "-o", str(tmp_path / "map"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["dropped"] == figures["damaged"] == {}
    with AnyReader([bag]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert figures["merged"]["scans"] == counts["/scan"] + counts["/scan_down"]


@pytest.mark.parametrize("world", COMMITTED)
def test_truth_holds_together(world: str) -> None:
    with np.load(BAGS / f"{world}_1" / "truth" / "surface.npz") as surface:
        top, seen, ground = surface["top"], surface["seen"], surface["ground"]
        resolution, origin = float(surface["resolution"]), surface["origin"]
    is_seen = np.isfinite(seen)
    assert 0.3 < is_seen.mean() < 0.95
    assert (seen <= top + 1e-6)[is_seen].all()
    assert (ground <= top + 1e-6).all()
    with np.load(BAGS / f"{world}_1" / "truth" / "goals.npz") as pairs:
        reachable, observed = pairs["reachable"], pairs["observed"]
        goal = np.floor((pairs["goal"][:, :2] - origin) / resolution).astype(int)
    assert reachable.sum() == 20
    assert (~reachable).sum() == 20
    assert not observed[~reachable].any()
    assert is_seen[goal[:, 1], goal[:, 0]].all()


def test_box_that_goes_is_marked_and_not_in_the_truth() -> None:
    with np.load(BAGS / "moving_1" / "truth" / "surface.npz") as surface:
        gone = np.isfinite(surface["removed_at"])
        assert 16 <= gone.sum() <= 30  # 0.6 m x 0.5 m
        assert (surface["top"][gone] == 0.0).all()
        assert (surface["seen"][gone] < 0.01).all()
        assert 12.0 < surface["removed_at"][gone].min() < 16.0


def test_recordings_stay_small() -> None:
    assert sum(p.stat().st_size for p in BAGS.rglob("*") if p.is_file()) < 25e6


@pytest.mark.parametrize("world", sorted(BUILDERS))
def test_another_drive_is_another_way_beside_the_first(world: str) -> None:
    first = recording.world_of(world, 2)
    assert recording.another_drive(first, 2, 0) is first
    other = recording.another_drive(first, 2, 1)
    assert other.solids is first.solids
    aside = distance_to_way(first.way, other.way[:, 0], other.way[:, 1])
    assert np.abs(other.way[0]).max() < 1e-9
    assert 0.08 < aside.max() <= 0.2 + 1e-6
    with pytest.raises(InputError):
        recording.another_drive(first, 2, -1)
