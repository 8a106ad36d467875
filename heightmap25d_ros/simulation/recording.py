# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive through a world, recorded as a rosbag2 with its ground truth beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.simulation import indoor, messages, outdoor, plain, repeats, truth
from heightmap25d_ros.simulation.cloud_sensors import (
    FEWEST_RINGS,
    MOST_RINGS,
    DepthCamera,
    Lidar,
)
from heightmap25d_ros.simulation.lasers import DOWN, LEVEL, NODDING, SCAN_DURATION
from heightmap25d_ros.simulation.odometry import EXACT_ODOMETRY
from heightmap25d_ros.simulation.pure_pursuit import Driver
from heightmap25d_ros.simulation.robot import MAX_SPEED
from heightmap25d_ros.simulation.simulation import (
    NOISE_FREE,
    Noise,
    Sensor,
    Simulation,
    TimedMessage,
)
from heightmap25d_ros.simulation.worlds import World, weaving

BUILDERS = {**outdoor.BUILDERS, **indoor.BUILDERS, **plain.BUILDERS, **repeats.BUILDERS}
MIN_SPEED = 0.1
"""Slowest drive of a recording [m/s]."""

MAX_SEED = 2**63 - 1
"""What the truth's files and a ROS parameter can hold."""

_POSES = ("/odom", "/ground_truth")
_REST = 0.4
_TIME_LIMIT = 600.0


def world_of(name: str, seed: int) -> World:
    """A world; its details vary with the seed.

    Raises
    ------
    InputError
        For an unknown name or a seed that is not within 0 .. `MAX_SEED`.
    """
    if name not in BUILDERS:
        raise InputError(f"world {name!r} is not one of {', '.join(BUILDERS)}")
    if not 0 <= seed <= MAX_SEED:
        raise InputError(f"seed: is not within 0 .. {MAX_SEED}")
    return BUILDERS[name](np.random.default_rng([seed, len(name)]))


def another_drive(world: World, seed: int, drive: int) -> World:
    """The world with another path through it; drive 0 is the world's own path.

    Raises
    ------
    InputError
        For a negative number.
    """
    if drive < 0:
        raise InputError(f"drive {drive}: is negative")
    if drive == 0:
        return world
    return replace(world, way=weaving(world.way, np.random.default_rng([seed, drive])))


def at_speed(world: World, speed: float | None) -> World:
    """The world with its drive at another speed [m/s]; None: the world's own.

    What moves in it keeps its own times.

    Raises
    ------
    InputError
        If the speed is not one that is driven.
    """
    if speed is None:
        return world
    if not MIN_SPEED <= speed <= MAX_SPEED:
        raise InputError(f"speed {speed:g}: is not within {MIN_SPEED:g} .. {MAX_SPEED:g}")
    return replace(world, speed=speed)


def simulate(
    name: str,
    seed: int,
    directory: Path,
    *,
    drive: int = 0,
    speed: float | None = None,
    mounted: Sequence[Sensor] = (LEVEL, DOWN),
    noise: Noise | None = None,
) -> dict[str, Any]:
    """Drive through a world once; write a bag and its truth, the same bytes every time.

    Parameters
    ----------
    name : str
        Of the world.
    seed : int
        Of the world's details and of the noise.
    directory : Path
        Of the bag; it must not exist.
    drive : int
        Drives other than 0 take another path through the same world, with other noise.
    speed : float [m/s], optional
        Of the drive; the world's own otherwise.
    mounted : sequence of Laser, Lidar and DepthCamera
        See `mounted_sensors`.
    noise : Noise, optional

    Returns
    -------
    dict
        Figures about the recording.

    Raises
    ------
    InputError
        If the directory exists, or for an unknown world, a negative drive, a seed or a speed out
        of range, and where the robot cannot follow the drive.
    """
    if directory.exists():
        raise InputError(f"{directory}: exists already")
    world = at_speed(another_drive(world_of(name, seed), seed, drive), speed)
    simulation = Simulation(world, [seed, drive] if drive else seed, noise, mounted)
    surface = truth.Surface(world)
    events = [*simulation.begin(), *_drive(simulation, world, surface)]
    directory.parent.mkdir(parents=True, exist_ok=True)
    _write(directory, events, mounted)
    surface.write(directory / "truth", seed, simulation.seconds)
    return {
        "bag": str(directory),
        "world": name,
        "seed": seed,
        "drive": drive,
        "speed [m/s]": world.speed,
        "distance [m]": round(path_length(world.way), 3),
        "odometry error [m]": round(_odometry_error(events), 3),
        "duration_s": round(simulation.seconds, 3),
        "messages": len(events),
    }


def mounted_sensors(
    scan_rate: float = LEVEL.rate,
    *,
    has_nodding: bool = False,
    lidar_rings: int = 0,
    has_depth_camera: bool = False,
) -> tuple[Sensor, ...]:
    """The level laser, the downward one, and optionally a nodding one; or others in their place.

    Parameters
    ----------
    scan_rate : float [Hz]
        Of the lasers.
    has_nodding : bool
    lidar_rings : int
        Of a 3-D lidar in place of the lasers; 0: none.
    has_depth_camera : bool
        In place of the lasers, besides the lidar.

    Raises
    ------
    InputError
        If the rate or the number of rings is out of range, or a nodding laser shall be beside
        what takes the place of the lasers.
    """
    if lidar_rings and not FEWEST_RINGS <= lidar_rings <= MOST_RINGS:
        raise InputError(
            f"lidar: {lidar_rings} rings are not within {FEWEST_RINGS} .. {MOST_RINGS}"
        )
    others: list[Sensor] = [Lidar(rings=lidar_rings)] if lidar_rings else []
    others += [DepthCamera()] if has_depth_camera else []
    if others:
        if has_nodding:
            raise InputError("nodding: there are no lasers beside a lidar or a depth camera")
        return tuple(others)
    if not 0.1 <= scan_rate <= 1.0 / SCAN_DURATION:
        raise InputError(f"scan rate {scan_rate:g}: is not within 0.1 .. {1 / SCAN_DURATION:g}")
    mounted = (LEVEL, DOWN, NODDING) if has_nodding else (LEVEL, DOWN)
    return tuple(replace(laser, rate=scan_rate) for laser in mounted)


def noise_of(*, noise_free: bool, true_odometry: bool, slip: float | None = None) -> Noise:
    """The noise that options ask for.

    Parameters
    ----------
    noise_free, true_odometry : bool
        Nothing errs; the odometry does not.
    slip : float, optional
        `OdometryNoise.slip`, error of the distance per distance (standard deviation).

    Raises
    ------
    InputError
        If the slip is not within 0 .. 1, or odometry that slips shall be without errors.
    """
    noise = NOISE_FREE if noise_free else Noise()
    if true_odometry:
        noise = replace(noise, odometry=EXACT_ODOMETRY)
    if slip is None:
        return noise
    if not 0.0 <= slip <= 1.0:
        raise InputError(f"slip {slip:g}: is not within 0 .. 1")
    if noise_free or true_odometry:
        raise InputError("slip: odometry is without errors or slips, not both")
    return replace(noise, odometry=replace(noise.odometry, slip=slip))


def path_length(path: Array) -> float:
    """Length [m] of a path through points (N, 2) [m]."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _odometry_error(events: Sequence[TimedMessage]) -> float:
    """Distance [m] of the last pose of /odom from that of /ground_truth."""
    last = {event.topic: event.message for event in events if event.topic in _POSES}
    known, true = (last[topic].pose.pose.position for topic in _POSES)
    return float(np.linalg.norm([known.x - true.x, known.y - true.y, known.z - true.z]))


def _drive(simulation: Simulation, world: World, surface: truth.Surface) -> list[TimedMessage]:
    """Drive from standstill to standstill; ends with a pose, so that poses bracket every scan."""
    driver = Driver(world.way, world.speed)
    time_limit = max(_TIME_LIMIT, 2.0 * path_length(world.way) / world.speed)
    events: list[TimedMessage] = []
    stopped: float | None = None
    while stopped is None or simulation.seconds < stopped + _REST or not simulation.is_at_pose:
        is_resting = simulation.seconds < _REST
        command = (0.0, 0.0) if is_resting else driver.command(simulation.robot.T)
        events += simulation.step(*command)
        surface.add(simulation)
        if simulation.robot.is_blocked or simulation.seconds > time_limit:
            x, y = simulation.robot.T[:2, 3]
            raise InputError(f"{world.name}: the drive is blocked at ({x:.2f}, {y:.2f})")
        if driver.is_done and stopped is None:
            stopped = simulation.seconds
    return events


def _write(directory: Path, events: list[TimedMessage], mounted: Sequence[Sensor]) -> None:
    writer = Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    topics = messages.topics(mounted)
    with writer:
        connections = {
            topic: writer.add_connection(
                topic, message_type, typestore=messages.STORE, offered_qos_profiles=[qos]
            )
            for topic, (message_type, qos) in topics.items()
        }
        for seconds, topic, message in sorted(events, key=lambda event: event.seconds):
            data = messages.STORE.serialize_cdr(message, topics[topic][0])
            writer.write(connections[topic], messages.stamp_ns(seconds), data)
