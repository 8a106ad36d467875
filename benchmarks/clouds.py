# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of 131,072 points: a 128-beam lidar over the terrain of `stream`, as a driver sends them.

    python benchmarks/clouds.py

Points have x, y, z, intensity, ring and a time of their own in 32 bytes; those without return are
zero, as Ouster's driver has them. Each cloud is decoded, placed and merged as the mapping node
does it, on one core, by CPU time; for comparison OctoMap inserts the same returns, each cloud in
one go from where the sensor was in the middle of it.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import stream
from rosbags.typesys import Stores, get_typestore

from heightmap25d_ros import se3
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pose_interpolation import interpolate

RINGS, COLUMNS = 128, 1024
POINTS = RINGS * COLUMNS
CLOUDS = 60
PERIOD = 0.1  # [s]
ELEVATIONS = np.radians(np.linspace(22.5, -22.5, RINGS))
MOUNT = (0.0, 0.0, 0.8, 0.0, 0.0, 0.0)  # x, y, z, roll, pitch, yaw in base_link
POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "t", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2"],
        "offsets": [0, 4, 8, 16, 20, 24],
        "itemsize": 32,
    }
)
_DATATYPES = {"<f4": 7, "<u4": 6, "<u2": 4}
START_NS = 1_700_000_000 * 10**9
STORE = get_typestore(Stores.ROS2_JAZZY)


def settings(**values: Any) -> Params:
    """The parameters of the stream: one lidar, its mount by parameter."""
    named = {"intake.cloud_topics": ["points"], "intake.cloud_mounts": list(MOUNT)}
    return with_values(Params(), named | values)


def poses(count: int = CLOUDS) -> tuple[np.ndarray, se3.Matrix]:
    """Stamps (M,) [ns] and poses (M, 4, 4) of the robot at 50 Hz, over so many clouds."""
    rate = 5
    drive = stream._drive(np.random.default_rng(stream.SEED))
    stamps = START_NS + np.arange(count * rate + 2) * round(PERIOD / rate * 1e9)
    return stamps, drive[: len(stamps)]


def clouds(count: int = CLOUDS) -> list[np.ndarray]:
    """Points (128, 1024) of so many sweeps, each column from its own pose."""
    rng = np.random.default_rng(stream.SEED)
    boxes = stream._boxes(rng)
    stamps, T_map_base = poses(count)
    azimuth = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)
    mount = se3.from_xyz_rpy(MOUNT)
    offsets = np.rint(azimuth / (2 * np.pi) * PERIOD * 1e9).astype(np.int64)
    made = []
    for index in range(count):
        start = START_NS + round(index * PERIOD * 1e9)
        T_map_sensor = interpolate(stamps, T_map_base, start + offsets) @ mount
        points = np.zeros((RINGS, COLUMNS), POINT)
        points["ring"] = np.arange(RINGS)[:, None]
        points["t"] = offsets
        for column, T in enumerate(T_map_sensor):
            fan = np.stack(
                [
                    np.cos(ELEVATIONS) * np.cos(azimuth[column]),
                    np.cos(ELEVATIONS) * np.sin(azimuth[column]),
                    np.sin(ELEVATIONS),
                ],
                axis=1,
            )
            ranges = stream._cast(T[:3, 3].copy(), fan @ T[:3, :3].T, boxes)
            ranges += rng.normal(0.0, stream.RANGE_NOISE, RINGS)
            xyz = np.where(np.isfinite(ranges), ranges, 0.0)[:, None] * fan
            for axis, name in enumerate("xyz"):
                points[name][:, column] = xyz[:, axis]
        made.append(points)
    return made


def message(points: np.ndarray, index: int, of: Any = None) -> Any:
    """A PointCloud2 of rosbags, or of another module with such classes."""
    types = STORE.types if of is None else of
    sec, nanosec = divmod(START_NS + round(index * PERIOD * 1e9), 10**9)
    fields = [
        types["sensor_msgs/msg/PointField"](
            name=name, offset=offset, datatype=_DATATYPES[kind.str], count=1
        )
        for name, (kind, offset) in points.dtype.fields.items()
    ]
    return types["sensor_msgs/msg/PointCloud2"](
        header=types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id="lidar"
        ),
        height=points.shape[0],
        width=points.shape[1],
        fields=fields,
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * points.shape[1],
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def measure() -> dict[str, float]:
    """Milliseconds a cloud and points a second, by CPU time; the first cloud does not count."""
    made = clouds()
    figures: dict[str, float] = {"points of a cloud": POINTS, "clouds": len(made)}
    for name, values in (
        ("default", {}),
        ("without layers", {"mapping.localization_layers": False}),
        ("voxels of 0.1 m", {"cloud.voxel_size": 0.1}),
    ):
        times = _times(made, settings(**values))
        p50, p99 = np.percentile(times, [50, 99])
        figures |= {
            f"{name}: decode + merge p50 [ms]": p50,
            f"{name}: decode + merge p99 [ms]": p99,
            f"{name}: points/s": 1e3 * POINTS / float(np.mean(times)),
        }
    figures["OctoMap, the same returns: points/s"] = _octomap_rate(made[1:4])
    return figures


def _times(made: list[np.ndarray], params: Params) -> list[float]:
    mapping = Mapping(params)
    for stamp, T in zip(*poses(len(made)), strict=True):
        mapping.take_odometry(
            Odometry(stamp_ns=int(stamp), frame_id="odom", child_frame_id="base_link", T=T)
        )
    times = []
    for index, points in enumerate(made):
        cloud = message(points, index)
        began = time.process_time()
        readings = mapping.take_cloud("points", cloud)
        times.append(1e3 * (time.process_time() - began))
        assert len(readings) == 1, mapping.dropped
    return times[1:]


def _octomap_rate(made: list[np.ndarray]) -> float:
    import octomap  # noqa: PLC0415 - only here

    tree = octomap.OcTree(Params().grid.resolution)
    stamps, T_map_base = poses()
    seconds = 0.0
    for index, points in enumerate(made, 1):
        middle = START_NS + round((index + 0.5) * PERIOD * 1e9)
        T = interpolate(stamps, T_map_base, np.array([middle]))[0] @ se3.from_xyz_rpy(MOUNT)
        xyz = np.stack([points[name].ravel() for name in "xyz"], axis=1).astype(np.float64)
        ends = xyz[xyz.any(axis=1)] @ T[:3, :3].T + T[:3, 3]
        began = time.process_time()
        tree.insertPointCloud(ends, T[:3, 3].copy(), lazy_eval=True)
        seconds += time.process_time() - began
    return len(made) * POINTS / seconds


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:45} {value:,.4g}")
