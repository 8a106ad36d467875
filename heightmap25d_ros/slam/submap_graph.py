# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The submaps of a drive, and what is known of where they are to one another.

Scans are held against those that are *active*: near along the drive and its loops, so that all of
them agree. Where the drive goes on from a saved map, this is the first submap, and it stays: as
long as scans are held against it, each submap that begins on it is joined with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.drift import carried, turned
from heightmap25d_ros.slam.loop_closure import Found
from heightmap25d_ros.slam.own_map import STOREY
from heightmap25d_ros.slam.pose_graph import Edge, PoseGraph, between
from heightmap25d_ros.slam.saved_map import SavedMap
from heightmap25d_ros.slam.submaps import MappedCells, Submap
from heightmap25d_ros.slam.trimming import needless

_LEAST_EDGE = np.diag(np.square([0.01, 0.01, 0.002, 0.01]))  # covariance of a submap's length
_Z_ON_MAP = 0.05  # [m] standard deviation of z on a saved map
_SIGMAS, _LEAST_RADIUS = 3.0, 1.0  # of a search for the robot; [m]
_LEAST_TURN = 0.2  # [rad] likewise


class Candidate(NamedTuple):
    """Older submaps in which the robot may be.

    Attributes
    ----------
    number : int
        The nearest one.
    radius, turn : float [m], [rad]
        How far the robot may be from where it is expected in it.
    cells : list of MappedCells
        It, and those that agree with it.
    """

    number: int
    radius: float
    turn: float
    cells: list[MappedCells]


class SubmapGraph:
    """The submaps of a drive.

    Parameters
    ----------
    params : Params
    saved : SavedMap, optional
        From which the drive goes on.

    Attributes
    ----------
    submaps : list of Submap
        The last one is growing. The first one stands for the saved map, if there is one.
    graph : PoseGraph
        Of the beginnings of the submaps.
    covariance : (4, 4) float64
        Of x, y [m], yaw [rad], z [m] of the beginning of the newest one, seen from that of the
        first.
    """

    def __init__(self, params: Params, saved: SavedMap | None = None) -> None:
        self.submaps: list[Submap] = []
        self.graph = PoseGraph()
        self.covariance = np.zeros((4, 4))
        self._params, self._saved = params, saved
        self._active: frozenset[int] = frozenset()
        self._lengths: list[float] = []  # [m] of all submaps but the newest

    def begin(self, T_map_base: se3.Matrix, covariance: Array) -> None:
        """The first submap begins at a pose (4, 4); covariance (3, 3) of it on the saved map."""
        if self._saved is not None:
            self._add(T_map_base)
            self.submaps[0].finish()
        self._add(T_map_base)
        if self._saved is not None:
            self._join_saved(covariance)
        self._choose()

    def follow(self, T_map_base: se3.Matrix, covariance: Array, travelled: float) -> None:
        """The next submap begins at a pose (4, 4), a distance [m] after the newest one.

        Covariance (4, 4) of x, y, yaw, z, seen from that beginning, along the axes of the map.
        """
        before = self.submaps[-1].pose
        self.submaps[-1].finish()
        self._trim()
        self._add(T_map_base)
        self._lengths.append(travelled)
        number = len(self.submaps) - 1
        of_edge = turned(covariance + _LEAST_EDGE, -before[2])
        self.graph.join(Edge(
            number - 1, number, between(before, self.submaps[-1].pose),
            np.asarray(np.linalg.inv(of_edge)), distance=travelled,
        ))  # fmt: skip
        self._choose()

    def anchor(self, covariance: Array) -> None:
        """The newest submap begins where scans agree with the saved map, if it is there.

        Covariance (3, 3) of x, y, yaw of the robot to the active submaps.
        """
        begun = self.submaps[-1].T_map_submap @ self.submaps[-1].start
        if self._saved is not None and 0 in self._active and self._saved.covers(begun):
            self._join_saved(covariance)
            self._choose()

    def _join_saved(self, covariance: Array) -> None:
        start = self.submaps[0].pose
        whole = np.diag([0.0, 0.0, 0.0, _Z_ON_MAP**2])
        whole[:3, :3] = covariance
        of_edge = turned(whole + _LEAST_EDGE, -start[2])
        self.graph.join(Edge(
            0, len(self.submaps) - 1, between(start, self.submaps[-1].pose),
            np.asarray(np.linalg.inv(of_edge)),
        ))  # fmt: skip

    def _add(self, T_map_base: se3.Matrix) -> None:
        submap = Submap(T_map_base, self._params)
        self.submaps.append(submap)
        self.graph.add(submap.pose)

    def _trim(self) -> None:
        """Forget what the newest finished submap has made needless of older ones."""
        slam = self._params.slam
        low, high = self.submaps[-1].bounds()
        around = [submap for submap in self.submaps if _meet(submap.bounds(), (low, high))]
        newest = math.ceil(slam.active_distance / slam.submap_length)  # more where they are short
        dropped = needless(
            [submap.squares() for submap in around],
            [submap.T_map_submap for submap in around],
            max(newest, len(self.recent(slam.active_distance - slam.submap_length))),
        )
        for submap, is_dropped in zip(around, dropped, strict=True):
            if is_dropped.any():
                submap.drop(is_dropped)

    def _choose(self) -> None:
        newest = len(self.submaps) - 1
        self._active = frozenset(self._reached(newest, self._params.slam.active_distance))
        self.covariance = self.graph.covariance(0, newest)

    def _reached(self, number: int, distance: float) -> list[int]:
        """The submaps within a distance [m] along the drive and its loops."""
        return np.flatnonzero(np.isfinite(self.graph.distances(number, distance))).tolist()

    def saved_landmarks(self, T_map_base: se3.Matrix) -> Landmarks | None:
        """Those of the saved map, where a robot at a pose (4, 4) is on it and knows where."""
        if self._saved is None or 0 not in self._active:
            return None
        return self._saved.landmarks_at(T_map_base)

    def active(self, T_map_base: se3.Matrix) -> list[MappedCells]:
        """What scans of a robot at a pose (4, 4) are held against."""
        return self._cells(self._active, T_map_base)

    def _cells(self, numbers: Iterable[int], T_map_base: se3.Matrix) -> list[MappedCells]:
        """Of submaps in their order; of the saved map the level that a pose (4, 4) is on."""
        cells: list[MappedCells] = []
        for number in sorted(numbers):
            is_saved = number == 0 and self._saved is not None
            cells += (
                self._saved.parts_at(T_map_base)
                if is_saved and self._saved
                else [self.submaps[number]]
            )
        return cells

    def recent(self, distance: float) -> list[MappedCells]:
        """The newest submaps, as far as the drive between them is no longer than a distance [m]."""
        back = np.cumsum([0.0, *reversed(self._lengths)])
        count = max(int(np.count_nonzero(back <= distance)), 1)
        return list(self.submaps[-count:])

    def candidate(self, T_map_base: se3.Matrix) -> Candidate | None:
        """The nearest of the submaps that are not active, in which a robot at a pose may be."""
        position = T_map_base[:3, 3]
        slam, newest = self._params.slam, len(self.submaps) - 1
        near = [
            (away, number) for number in range(len(self.submaps))
            if number not in self._active
            and (away := self._away(number, position)) < slam.max_drift + slam.submap_length
        ]  # fmt: skip
        near.sort()
        seen_back = self.graph.covariances(newest, [number for _, number in near])[:, :3, :3]
        for (away, number), of_older in zip(near, seen_back, strict=True):
            apart = self.submaps[newest].pose[:2] - self.submaps[number].pose[:2]
            covariance = carried(of_older, apart)
            deviation = float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
            radius = _SIGMAS * deviation + _LEAST_RADIUS
            if away <= radius + slam.submap_length:
                turn = _SIGMAS * float(np.sqrt(covariance[2, 2])) + _LEAST_TURN
                older = set(self._reached(number, slam.active_distance)) - self._active
                return Candidate(
                    number, min(radius, slam.max_drift), min(turn, np.pi),
                    self._cells(older, T_map_base),
                )  # fmt: skip
        return None

    def _away(self, number: int, position: Array) -> float:
        """How far [m] a place (3,) is from where a submap was begun, or from the saved map."""
        xy = position[:2]
        if number == 0 and self._saved is not None:
            return self._saved.away(xy)
        submap = self.submaps[number]
        if not len(submap.cells().places) or abs(submap.pose[3] - position[2]) > STOREY:
            return np.inf
        low, high = submap.bounds()
        if np.linalg.norm(np.clip(xy, low, high) - xy) >= self._params.slam.max_drift:
            return np.inf
        return float(np.linalg.norm(submap.pose[:2] - xy))

    def loop(self, first: int, second: int, T_map_base: se3.Matrix, found: Found) -> Edge:
        """What a search has measured: the robot was at a pose (4, 4) where the second begins."""
        x, y, z, _, _, yaw = se3.to_xyz_rpy(found.drift @ T_map_base)
        old = self.submaps[first].pose
        measured = between(old, np.array([x, y, yaw, z]))
        information = np.asarray(np.linalg.inv(turned(found.covariance, -old[2])))
        return Edge(first, second, measured, information, is_loop=True)

    def move(self, motions: Mapping[int, se3.Matrix], newest: se3.Matrix) -> se3.Matrix:
        """Move submaps along the drive, and then all of them to where loops have them.

        Parameters
        ----------
        motions : mapping of int to (4, 4) float64
            Of submaps, by their number.
        newest : (4, 4) float64
            Of all that are newer than these.

        Returns
        -------
        (4, 4) float64
            What moved the newest one.
        """
        newer = range(max(motions) + 1, len(self.submaps))
        moved = {**motions, **dict.fromkeys(newer, newest)}
        for number, motion in moved.items():
            submap = self.submaps[number]
            submap.T_map_submap = np.asarray(motion @ submap.T_map_submap)
        self.graph.measure_again({number: self.submaps[number].pose for number in moved})
        of_newest = moved[len(self.submaps) - 1]
        if any(edge.distance == 0.0 for edge in self.graph.edges):
            return np.asarray(self._settle() @ of_newest)
        return of_newest

    def _settle(self) -> se3.Matrix:
        """Move all submaps to where they agree; what moved the newest (4, 4).

        It is told by where the submap is, and not by the robot's pose in it: that comes of all
        motions before, and what it is off from a rigid one would grow threefold with each.
        """
        newest = self.submaps[-1]
        before = newest.T_map_submap
        self.graph.optimise()
        for submap, pose in zip(self.submaps, self.graph.poses, strict=True):
            submap.move_to(pose)
        return np.asarray(newest.T_map_submap @ se3.inverse(before))

    def close(self, loops: list[Edge]) -> se3.Matrix:
        """Join submaps, and move all of them to where they agree; what moved the newest (4, 4)."""
        for loop in loops:
            self.graph.join(loop)
        moved = self._settle()
        self._choose()
        return moved


def _meet(one: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Whether two rectangles, lowest and highest x, y (2,) each, have something in common."""
    return bool((one[0] <= other[1]).all() and (other[0] <= one[1]).all())
