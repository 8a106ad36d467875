# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coverage-guided fuzzing of the readers of files and messages, by atheris (libFuzzer).

``python test/attack/fuzz.py TARGET [libFuzzer's options]``, as ``-runs=100000``. Anything but
`InputError` is a find, and is written to a file ``crash-...``; ``fuzz.py TARGET crash-...`` repeats
it. The targets are at the end.
"""

from __future__ import annotations

import logging
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))

import atheris

# Kernels come first: numba cannot compile what is instrumented.
from heightmap25d_ros.localization import tracker as _tracker  # noqa: F401
from heightmap25d_ros.terrain import obstacle_grid as _obstacle_grid  # noqa: F401

with atheris.instrument_imports(include=["heightmap25d_ros", "rosbags"]):
    from heightmap25d_ros.io import decode, layers_file, map_directory, point_cloud, tf_bytes
    from heightmap25d_ros.io.bag import Bag
    from heightmap25d_ros.io.trajectory import read_tum, write_tum
    from heightmap25d_ros.params import files as parameter_files

import numpy as np
from bag_writer import STORE
from file_attack import STORAGES, sound_map_directory, write_sound_bag
from message_attack import OTHERS, drive, sound
from repository import ROOT
from rosbags.serde import SerdeError

from heightmap25d_ros.errors import InputError

DIRECTORY = Path(tempfile.mkdtemp(prefix="heightmap25d_fuzz_"))
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
    ("nav_msgs/msg/Path", decode.path),
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
    return [
        bytes([index]) + bytes(STORE.serialize_cdr(examples[name], name))[4:]
        for index, (name, _) in enumerate(READ_AS)
        if name in examples
    ]


def bag_seeds(suffix: str) -> list[bytes]:
    bags = [write_sound_bag(DIRECTORY / str(index), *kinds) for index, kinds in enumerate(STORAGES)]
    return [file.read_bytes() for bag in bags for file in bag.glob(f"*{suffix}")]


def trajectory_seed() -> bytes:
    path = DIRECTORY / "seed.tum"
    write_tum(path, [(10**9 * second, np.eye(4)) for second in range(3)])
    return path.read_bytes()


def transform_seeds() -> list[bytes]:
    found = [message for topic, _, message in drive() if topic.startswith("/tf")]
    return [bytes(STORE.serialize_cdr(m, "tf2_msgs/msg/TFMessage")) for m in found[:3]]


def parameter_seeds() -> list[bytes]:
    return [path.read_bytes()[:3000] for path in sorted((ROOT / "config").glob("*.yaml"))]


TARGETS: dict[str, tuple[Callable[[bytes], object], Callable[[], list[bytes]]]] = {
    "messages": (read_message, message_seeds),
    "transforms": (tf_bytes.tf_message, transform_seeds),
    "parameters": (read_parameters, parameter_seeds),
    "trajectories": (read_trajectory, lambda: [trajectory_seed()]),
    "maps": (read_height_grid, lambda: [(MAP / _HEIGHT_GRID).read_bytes()]),
    "layers": (read_layers, lambda: [(MAP / _LAYERS).read_bytes()]),
    "mcap": (lambda data: read_bag(data, ".mcap"), lambda: bag_seeds(".mcap")),
    "sqlite": (lambda data: read_bag(data, ".db3"), lambda: bag_seeds(".db3")),
}
"""What reads bytes, and sound ones to begin with."""


def main() -> None:
    read, seeds = TARGETS[sys.argv[1]]
    logging.disable()
    sound_map_directory(MAP)
    corpus = DIRECTORY / "corpus"
    corpus.mkdir()
    for index, data in enumerate(seeds()):
        (corpus / str(index)).write_bytes(data)

    def one_input(data: bytes) -> None:
        with suppress(InputError):
            read(data)

    is_repeated = any(Path(argument).is_file() for argument in sys.argv[2:])
    directories = [] if is_repeated else [str(corpus)]
    atheris.Setup([sys.argv[0], *sys.argv[2:], *directories], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
