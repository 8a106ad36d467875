# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What fuzz.py feeds with bytes: a reader for each target, and sound inputs to begin with."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from bag_writer import STORE
from file_attack import STORAGES, sound_map_directory, write_sound_bag
from message_attack import OTHERS, drive, sound
from mutated_messages import default
from repository import ROOT
from rosbags.serde import SerdeError

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode, layers_file, map_directory, message_bytes, point_cloud
from heightmap25d_ros.io.bag import LASER_SCAN, ODOMETRY, TF_MESSAGE, Bag
from heightmap25d_ros.io.trajectory import read_tum, write_tum
from heightmap25d_ros.params import files as parameter_files

_scratch = tempfile.TemporaryDirectory(prefix="heightmap25d_fuzz_")
DIRECTORY = Path(_scratch.name)
MAP = DIRECTORY / "map"
_HEIGHT_GRID, _LAYERS = "height_grid.npz", "localization_layers.npz"

READ_AS: list[tuple[str, Callable[..., object]]] = [
    ("sensor_msgs/msg/LaserScan", decode.scan),
    ("nav_msgs/msg/Odometry", decode.odometry),
    ("geometry_msgs/msg/PoseStamped", decode.odometry),
    ("geometry_msgs/msg/PoseWithCovarianceStamped", lambda m: decode.pose_in(m, "map")),
    ("geometry_msgs/msg/PoseWithCovarianceStamped",
     lambda m: decode.planar_covariance(m, (10.0, 10.0, 3.0))),
    ("heightmap25d_msgs/msg/HeightGrid", lambda m: decode.height_map(m, "map")),
    ("nav_msgs/msg/Path", lambda m: decode.path_in(m, "map")),
    ("nav_msgs/msg/Path", decode.path_poses),
    ("geometry_msgs/msg/Point", decode.point),
    ("geometry_msgs/msg/PolygonStamped", lambda m: decode.polygon(m, "map")),
    ("heightmap25d_msgs/msg/UpperSurfaces", lambda m: decode.upper_surfaces(m, "map")),
    ("geometry_msgs/msg/Twist", decode.twist),
    ("sensor_msgs/msg/PointCloud2", point_cloud.cloud),
]  # fmt: skip
"""Types of messages, and what reads them; the first byte of an input chooses."""


def read_message(data: bytes) -> None:
    """A message, as DDS would let it through."""
    if len(data) < 5:
        return
    name, read = READ_AS[data[0] % len(READ_AS)]
    with suppress(SerdeError, UnicodeDecodeError, ValueError, MemoryError):
        message = STORE.deserialize_cdr(b"\0\1\0\0" + data[1:], name)
        read_sound(read, message)


def read_sound(read: Callable[..., object], message: object) -> None:
    """What a reader raises besides `InputError` is not to be taken for rosbags' errors."""
    try:
        read(message)
    except InputError:
        pass
    except Exception as error:
        raise RuntimeError(f"{type(error).__name__}: {error}") from error


def read_height_grid(data: bytes) -> None:
    (MAP / _HEIGHT_GRID).write_bytes(data)
    loaded = map_directory.load_in(MAP, 0.5, "map")
    assert np.isfinite([*loaded.geometry.origin, loaded.geometry.resolution]).all()


def read_layers(data: bytes) -> None:
    (MAP / _LAYERS).write_bytes(data)
    layers_file.load(MAP, map_directory.load_in(MAP, 0.5, "map"))


def read_parameters(data: bytes) -> None:
    path = DIRECTORY / "parameters.yaml"
    path.write_bytes(data)
    parameter_files.read_yaml(path, "mapping")


def read_trajectory(data: bytes) -> None:
    path = DIRECTORY / "trajectory.tum"
    path.write_bytes(data)
    assert np.isfinite(read_tum(path)).all()


def read_bag(data: bytes, suffix: str) -> None:
    path = DIRECTORY / f"bag{suffix}"
    path.write_bytes(data)
    with Bag(path) as bag:
        for _ in bag.events(list(bag.topics)):
            pass


def message_seeds() -> list[bytes]:
    """A message of each type, behind the byte that chooses it."""
    examples = {message.__msgtype__: message for _, _, message in drive()}
    examples |= {kind: sound(topic, 0) for topic, kind in OTHERS.items()}
    examples = {name: default(name) for name, _ in READ_AS} | examples
    return [
        bytes([index]) + bytes(STORE.serialize_cdr(examples[name], name))[4:]
        for index, (name, _) in enumerate(READ_AS)
    ]


def bag_seeds(suffix: str) -> list[bytes]:
    with tempfile.TemporaryDirectory() as scratch:
        bags = [write_sound_bag(Path(scratch, str(i)), *kinds) for i, kinds in enumerate(STORAGES)]
        return [file.read_bytes() for bag in bags for file in bag.glob(f"*{suffix}")]


def trajectory_seed() -> bytes:
    path = DIRECTORY / "seed.tum"
    write_tum(path, [(10**9 * second, np.eye(4)) for second in range(3)])
    return path.read_bytes()


def serialized_seeds(kind: str) -> list[bytes]:
    found = [message for _, _, message in drive() if message.__msgtype__ == kind]
    return [bytes(STORE.serialize_cdr(message, kind)) for message in found[:3]]


def parameter_seeds() -> list[bytes]:
    return [path.read_bytes()[:3000] for path in sorted((ROOT / "config").glob("*.yaml"))]


TARGETS: dict[str, tuple[Callable[[bytes], object], Callable[[], list[bytes]]]] = {
    "messages": (read_message, message_seeds),
    "transforms": (message_bytes.tf_message, lambda: serialized_seeds(TF_MESSAGE)),
    "scans": (
        lambda data: decode.scan(message_bytes.laser_scan(data)),
        lambda: serialized_seeds(LASER_SCAN),
    ),
    "odometry": (
        lambda data: decode.odometry(message_bytes.odometry(data)),
        lambda: serialized_seeds(ODOMETRY),
    ),
    "parameters": (read_parameters, parameter_seeds),
    "trajectories": (read_trajectory, lambda: [trajectory_seed()]),
    "maps": (read_height_grid, lambda: [(MAP / _HEIGHT_GRID).read_bytes()]),
    "layers": (read_layers, lambda: [(MAP / _LAYERS).read_bytes()]),
    "mcap": (lambda data: read_bag(data, ".mcap"), lambda: bag_seeds(".mcap")),
    "sqlite": (lambda data: read_bag(data, ".db3"), lambda: bag_seeds(".db3")),
}
"""What reads bytes, and sound ones to begin with."""


def seeds_of(target: str) -> list[bytes]:
    """Sound inputs of a target, whose files are set up."""
    sound_map_directory(MAP)
    return TARGETS[target][1]()
