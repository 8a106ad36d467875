# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The truth files of a simulated world: its surface, its ground, and pairs of start and goal.

The only reader of these files; whatever is wrong with one is an `InputError` that names it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry, require_plausible
from heightmap25d_ros.input_files import require_file


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The surface of a world.

    Attributes
    ----------
    geometry : Geometry
    top : (rows, columns) float64 [m]
        Highest point over each cell's square; not finite without a surface.
    seen : (rows, columns) float64 [m]
        Highest point in each cell that a noise-free laser measured; NaN: none. Lower than ``top``
        on walls that end above the lasers.
    """

    geometry: Geometry
    top: NDArray[np.float64]
    seen: NDArray[np.float64]


@contextmanager
def truth_file(path: Path, fault: str) -> Iterator[Any]:
    """An open npz file of the truth; errors while reading from it become `InputError`.

    Raises
    ------
    InputError
        If the file cannot be read, or has other content (described by ``fault``).
    """
    if path.is_dir():
        raise InputError(f"{path}: {fault}: it is a directory")
    require_file(path)
    try:
        if path.exists() and not is_zipfile(path):
            raise InputError(f"{path}: {fault}: it is no npz file")
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            yield archive
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except Exception as error:  # zipfile, zlib and numpy raise a dozen types on damaged bytes
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: {fault}: {reason}") from None


def read_truth(path: Path) -> Truth:
    """The truth from a file with ``top``, ``seen``, ``resolution`` and ``origin``.

    Raises
    ------
    InputError
        If the file cannot be read or has other content.
    """
    with truth_file(path, "is not a true surface") as archive:
        top, seen = (np.asarray(archive[name], np.float64) for name in ("top", "seen"))
        geometry = _geometry(path, archive, top)
    if top.shape != seen.shape:
        raise InputError(f"{path}: top and seen are not two grids of one shape")
    return Truth(geometry=geometry, top=top, seen=seen)


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelTruth:
    """The two levels of a world with decks, each as a robot on it has it around itself.

    Attributes
    ----------
    geometry : Geometry
    top : (2, rows, columns) float64 [m]
        Where a cell has but one surface, it is the same on both.
    seen : (2, rows, columns) float64 [m]
        Highest point of each that a noise-free laser measured; NaN: none.
    clearance : (2, rows, columns) float64 [m]
        Headroom.
    """

    geometry: Geometry
    top: NDArray[np.float64]
    seen: NDArray[np.float64]
    clearance: NDArray[np.float64]

    def ground(self, level: int) -> TrueGround:
        """What a robot on a level drives on."""
        return TrueGround(
            geometry=self.geometry, height=self.top[level], clearance=self.clearance[level]
        )


def read_levels(path: Path) -> LevelTruth | None:
    """The levels of a ``surface.npz``; None in a world of one level.

    Raises
    ------
    InputError
        If the file cannot be read or has other content.
    """
    with truth_file(path, "is not a true surface") as archive:
        if "level_top" not in archive:
            return None
        names = ("level_top", "level_seen", "level_clearance")
        top, seen, clearance = (np.asarray(archive[name], np.float64) for name in names)
        if not (top.ndim == 3 and len(top) == 2 and top.shape == seen.shape == clearance.shape):
            raise InputError(f"{path}: {', '.join(names)} are not grids of two levels")
        geometry = _geometry(path, archive, top[0])
    return LevelTruth(geometry=geometry, top=top, seen=seen, clearance=clearance)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueGround:
    """The ground that a robot drives on.

    Attributes
    ----------
    geometry : Geometry
    height : (rows, columns) float64 [m]
        Not finite without ground.
    clearance : (rows, columns) float64 [m]
        Headroom above it.
    """

    geometry: Geometry
    height: NDArray[np.float64]
    clearance: NDArray[np.float64]


def read_ground(path: Path) -> TrueGround:
    """The ground of a ``surface.npz``; its top if it does not distinguish the two.

    Raises
    ------
    InputError
        If the file cannot be read or has other content.
    """
    with truth_file(path, "is not a true surface") as archive:
        name = "ground" if "ground" in archive else "top"
        height = np.asarray(archive[name], np.float64)
        clearance = np.full(height.shape, np.inf)
        if "clearance" in archive:
            clearance = np.asarray(archive["clearance"], np.float64)
        geometry = _geometry(path, archive, height)
    return TrueGround(geometry=geometry, height=height, clearance=clearance)


def _geometry(path: Path, archive: Any, values: NDArray[np.float64]) -> Geometry:
    """The cells of a grid of the truth."""
    (rows, columns), (x, y) = values.shape, archive["origin"]
    geometry = Geometry(
        resolution=float(archive["resolution"]), origin=(float(x), float(y)), shape=(rows, columns)
    )
    try:
        require_plausible(geometry)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return geometry


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalPairs:
    """Starts and goals, and whether true paths connect them.

    Attributes
    ----------
    start, goal : (N, 3) float64 [m], map
    reachable : (N,) bool
        Whether the robot can drive from start to goal in the true world.
    observed : (N,) bool
        Whether it can on cells that the lasers measured.
    """

    start: NDArray[np.float64]
    goal: NDArray[np.float64]
    reachable: NDArray[np.bool_]
    observed: NDArray[np.bool_]


def read_goals(path: Path) -> GoalPairs:
    """The pairs of a ``goals.npz``.

    Raises
    ------
    InputError
        If the file cannot be read or has other content.
    """
    with truth_file(path, "holds no goals") as archive:
        start, goal = (np.asarray(archive[name], np.float64) for name in ("start", "goal"))
        reachable, observed = (
            np.asarray(archive[name], bool) for name in ("reachable", "observed")
        )
    is_pairs = start.ndim == 2 and start.shape == goal.shape == (len(start), 3)
    if not (is_pairs and np.isfinite([start, goal]).all()):
        raise InputError(f"{path}: start and goal are not pairs of places")
    if {reachable.shape, observed.shape} != {(len(start),)}:
        raise InputError(f"{path}: reachable and observed are not one for each pair")
    return GoalPairs(start=start, goal=goal, reachable=reachable, observed=observed)
