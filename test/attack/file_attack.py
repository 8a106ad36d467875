# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged maps, bags and YAML files to who reads them."""

from __future__ import annotations

import re
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from bag_writer import write_bag
from damaged_files import damaged, damaged_arrays, damaged_yaml
from message_attack import PARAMS, SCANS, drive
from repository import ROOT
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from tally import Tally, random_of

from heightmap25d_ros.grid.height_map import POSITION_LIMIT, HeightMap
from heightmap25d_ros.io import layers_file, map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.io.trajectory import read_tum, write_tum
from heightmap25d_ros.params import files as parameter_files
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed, replayed

STORAGES = [
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.FILE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    (StoragePlugin.MCAP, CompressionMode.NONE),
    (StoragePlugin.MCAP, CompressionMode.STORAGE),
    (StoragePlugin.MCAP, CompressionMode.MESSAGE),
]
BAG_MESSAGES = 60
"""Messages of the bags that are damaged: all that is in a bag, and read at once."""

TOPICS = {*SCANS, "/odom", "/tf", "/tf_static"}


@cache
def mapped() -> Mapping:
    """A map of a few metres."""
    mapping = Mapping(PARAMS)
    for topic, _, message in drive()[:BAG_MESSAGES]:
        feed(mapping, topic, message)
    mapping.flush()
    return mapping


def sound_map_directory(path: Path) -> Path:
    """That map, with localization layers, in a map directory."""
    maps = mapped().maps()
    map_directory.save(path, *maps, "map", layers=mapped().layers(maps[0].geometry))
    return path


def attack_maps(seed: int, count: int, directory: Path) -> Tally:
    """Damaged files of a map directory; what is not refused is finite, and can be localized in."""
    tally = Tally("damaged map files")
    sound = sound_map_directory(directory / "sound")
    contents = {path.name: path.read_bytes() for path in sound.glob("*.npz")}
    heights = mapped().maps()[0].height
    for number in range(count):
        random = random_of(seed, number)
        name = list(contents)[random.integers(len(contents))]
        damage = damaged if random.random() < 0.5 else damaged_arrays
        (sound / name).write_bytes(damage(random, contents[name]))
        with tally.case(number):
            loaded = map_directory.load_in(sound, 0.5, "map")
            layers = layers_file.load(sound, loaded)
            _require_sound(loaded)
            if damage is damaged and not np.array_equal(loaded.height, heights):
                raise AssertionError("other heights than those that were saved")
            if number % 20 == 0:
                Mapping(PARAMS).load(sound)
                Localizer(PARAMS).set_long_term(loaded, layers)
        (sound / name).write_bytes(contents[name])
    return tally


def _require_sound(height_map: HeightMap) -> None:
    geometry = height_map.geometry
    numbers = *geometry.origin, geometry.resolution, geometry.ground_zero
    if not (np.isfinite(numbers).all() and 0.01 <= geometry.resolution <= 10.0):
        raise AssertionError(f"a geometry of {numbers}")
    if np.abs(geometry.origin).max() > POSITION_LIMIT:
        raise AssertionError(f"an origin at {geometry.origin}")
    if height_map.height.shape != geometry.shape:
        raise AssertionError(f"{height_map.height.shape} heights in {geometry.shape} cells")


def attack_yaml(seed: int, count: int, directory: Path) -> Tally:
    """Damaged parameter files: refused, or all that they set is within its range."""
    tally = Tally("damaged parameter files")
    text = (ROOT / "config" / "heightmap25d.yaml").read_text()
    head, *bodies = re.split(r"^(?=    \w+:$)", text, flags=re.MULTILINE)
    sections = [head + body for body in bodies]
    path = directory / "params.yaml"
    for number in range(count):
        random = random_of(seed, number)
        path.write_text(damaged_yaml(random, sections[random.integers(len(sections))]))
        with tally.case(number):
            parameter_files.read_yaml(path, "mapping")
    return tally


def attack_trajectories(seed: int, count: int, directory: Path) -> Tally:
    """Damaged TUM files: refused, or all numbers are finite."""
    tally = Tally("damaged trajectories")
    path = directory / "trajectory.tum"
    write_tum(path, [(10**9 * second, np.eye(4)) for second in range(20)])
    sound = path.read_bytes()
    for number in range(count):
        random = random_of(seed, number)
        path.write_bytes(damaged(random, sound))
        with tally.case(number):
            if not np.isfinite(read_tum(path)).all():
                raise AssertionError("numbers that are not finite")
    return tally


def attack_bags(seed: int, count: int, directory: Path) -> Tally:
    """Damaged bags, mapped as far as they go: never more than was in them."""
    tally = Tally("damaged bags, mapped")
    sound = [
        write_sound_bag(directory / str(index), *kinds) for index, kinds in enumerate(STORAGES)
    ]
    for number in range(count):
        random = random_of(seed, number)
        bag = directory / "damaged"
        shutil.copytree(sound[random.integers(len(sound))], bag)
        files = sorted(bag.iterdir())
        file = files[random.integers(len(files))]
        if file.name == "metadata.yaml" and random.random() < 0.7:
            file.write_text(damaged_yaml(random, file.read_text()))
        else:
            file.write_bytes(damaged(random, file.read_bytes()))
        with tally.case(number):
            _map_bag(bag)
        shutil.rmtree(bag)
    return tally


def write_sound_bag(path: Path, storage: StoragePlugin, compression: CompressionMode) -> Path:
    """A short bag of a recorded drive."""
    return write_bag(path, drive()[:BAG_MESSAGES], storage=storage, compression=compression)


def _map_bag(path: Path) -> None:
    with Bag(path) as bag:
        mapping = Mapping(PARAMS)
        topic = bag.odometry_topic()
        known = [t for t in SCANS if t in bag.topics]
        fed = sum(1 for _ in replayed(bag, _Known(mapping, known), topic, PARAMS.intake)) - 1
        if fed > BAG_MESSAGES:
            raise AssertionError(f"{fed} messages of {BAG_MESSAGES}")
        mapping.maps()


class _Known:
    """A pipeline that knows only the lasers that are left in a damaged bag."""

    def __init__(self, mapping: Mapping, topics: list[str]) -> None:
        self._mapping = mapping
        self.scan_topics = tuple(topics)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._mapping, name)
