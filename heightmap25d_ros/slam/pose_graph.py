# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A graph of poses (x, y, yaw, z) and of what was measured between them, optimised robustly.

Roll and pitch are not in it: the odometry knows them, and they do not drift. The sum of the squared
errors of all edges is minimised by Gauss-Newton steps on sparse normal equations. A loop that
contradicts the others must not bend the graph: loops have the Geman-McClure cost
c^2 chi^2 / (c^2 + chi^2), approached by graduated non-convexity (Yang, Antonante, Tzoumas and
Carlone 2020): it begins nearly quadratic and becomes steeper, so that the start does not decide
which loops count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph, linalg

from heightmap25d_ros.arrays import Array

_CHI2 = 13.28  # of four degrees of freedom, which 99 % of right loops stay below
_GRADUATION = 1.6  # by which the cost becomes steeper from one round to the next
_STEPS, _CONVERGED = 20, 1e-7  # Gauss-Newton steps of a round at most; [m], [rad] of the last one
_TOUCHING = 1e-6  # [m] between poses that are one place; csgraph takes 0 for no edge
KEPT = 0.5
"""Weight below which a loop counts as refused by the others."""


class Edge(NamedTuple):
    """A pose as measured from another one.

    Attributes
    ----------
    first, second : int
        The poses that it is between.
    measured : (4,) float64
        x, y [m], yaw [rad], z [m] of the second pose, seen from the first.
    information : (4, 4) float64
        Inverse of its covariance.
    distance : float [m]
        Travelled between them; 0 for a loop.
    is_loop : bool
    """

    first: int
    second: int
    measured: Array
    information: Array
    distance: float = 0.0
    is_loop: bool = False


def between(first: Array, second: Array) -> Array:
    """Poses (..., 4) as seen from others (..., 4).

    Examples
    --------
    >>> between(np.array([1.0, 2.0, np.pi / 2, 0.0]), np.array([1.0, 5.0, np.pi, 0.5])).round(3)
    array([3.   , 0.   , 1.571, 0.5  ])
    """
    apart = np.asarray(second - first)
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = apart[..., 0], apart[..., 1]
    yaw = _wrapped(apart[..., 2])
    return np.stack([cos * x + sin * y, cos * y - sin * x, yaw, apart[..., 3]], axis=-1)


def compose(first: Array, relative: Array) -> Array:
    """The poses (..., 4) that are seen as ``relative`` (..., 4) from others (..., 4)."""
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = relative[..., 0], relative[..., 1]
    moved = np.stack([cos * x - sin * y, sin * x + cos * y, relative[..., 2], relative[..., 3]], -1)
    composed = np.asarray(first + moved)
    composed[..., 2] = _wrapped(composed[..., 2])
    return composed


class PoseGraph:
    """Poses and edges; the first pose of each component stays where it is.

    Attributes
    ----------
    edges : list of Edge
    weights : list of float
        Of each edge after `optimise`: 1 for what was measured along the way; of a loop the share
        that the others leave it.

    Examples
    --------
    >>> graph = PoseGraph()
    >>> start, end = graph.add(np.zeros(4)), graph.add(np.array([1.2, 0.0, 0.0, 0.0]))
    >>> graph.join(Edge(start, end, np.array([1.0, 0.0, 0.0, 0.0]), np.eye(4)))
    >>> graph.optimise()
    >>> graph.poses[end].round(3)
    array([1., 0., 0., 0.])
    """

    def __init__(self) -> None:
        self.edges: list[Edge] = []
        self.weights: list[float] = []
        self._poses: list[Array] = []

    @property
    def poses(self) -> Array:
        """(N, 4) float64: x, y [m], yaw [rad], z [m]."""
        return np.array(self._poses).reshape(-1, 4)

    def add(self, pose: Array) -> int:
        """Add a pose (4,); its number."""
        self._poses.append(np.asarray(pose, np.float64))
        return len(self._poses) - 1

    def join(self, edge: Edge) -> None:
        """Add what was measured between two poses."""
        self.edges.append(edge)
        self.weights.append(1.0)

    def measure_again(self, poses: Mapping[int, Array]) -> None:
        """Put poses (4,) where they are known to be, and so what was measured along the way."""
        for number, pose in poses.items():
            self._poses[number] = np.asarray(pose, np.float64)
        for k, edge in enumerate(self.edges):
            if edge.distance > 0.0 and (edge.first in poses or edge.second in poses):
                measured = between(self._poses[edge.first], self._poses[edge.second])
                self.edges[k] = edge._replace(measured=measured)

    def distances(self, start: int, limit: float) -> Array:
        """(N,) [m]: how far the poses are along the edges; infinite beyond a limit [m]."""
        kept = [e for e, w in zip(self.edges, self.weights, strict=True) if w >= KEPT]
        count = len(self._poses)
        lengths = [e.distance + _TOUCHING for e in kept]
        ends = [e.first for e in kept], [e.second for e in kept]
        # Of several edges between two poses the shortest one counts, not their sum.
        shortest = sparse.dok_matrix((count, count))
        for first, second, length in zip(*ends, lengths, strict=True):
            before = shortest.get((first, second), np.inf)
            shortest[first, second] = min(before, length)
        found = csgraph.dijkstra(shortest.tocsr(), directed=False, indices=start, limit=limit)
        return np.asarray(found, np.float64)

    def covariance(self, fixed: int, of: int) -> Array:
        """(4, 4) of a pose as seen from another one, along the axes of the map; infinite apart."""
        return np.asarray(self.covariances(fixed, [of])[0])

    def covariances(self, fixed: int, of: Sequence[int]) -> Array:
        """(N, 4, 4) of poses as seen from one, which takes little longer than that of one."""
        is_joined = np.isfinite(self.distances(fixed, np.inf))
        found = np.zeros((len(of), 4, 4))
        found[~is_joined[list(of)]] = np.diag(np.full(4, np.inf))
        asked = [k for k, pose in enumerate(of) if is_joined[pose] and pose != fixed]
        if not asked:
            return found
        free = is_joined
        free[fixed] = False
        normal, _ = self._linearised(self.poses, np.array(self.weights))
        index = np.flatnonzero(np.repeat(free, 4))
        solve = linalg.splu(normal[index][:, index].tocsc()).solve
        row_of = 4 * (np.cumsum(free) - 1)
        for k in asked:
            rows = np.s_[row_of[of[k]] : row_of[of[k]] + 4]
            unit = np.zeros((len(index), 4))
            unit[rows] = np.eye(4)
            found[k] = solve(unit)[rows]
        return found

    def optimise(self) -> None:
        """Move the poses to where the edges agree best; sets `weights`."""
        if not self.edges:
            return
        poses, weights = self.poses, np.ones(len(self.edges))
        is_loop = np.array([edge.is_loop for edge in self.edges])
        poses = self._solved(poses, weights)
        if is_loop.any():
            squared = self._squared(poses)[is_loop]
            convexity = max(2.0 * squared.max() / _CHI2, 1.0)
            while True:
                wide = convexity * _CHI2
                weights[is_loop] = np.square(wide / (self._squared(poses)[is_loop] + wide))
                poses = self._solved(poses, weights)
                if convexity == 1.0:
                    break
                convexity = max(convexity / _GRADUATION, 1.0)
            weights[is_loop] = np.square(_CHI2 / (self._squared(poses)[is_loop] + _CHI2))
        self._poses = list(poses)
        self.weights = [float(weight) for weight in weights]

    def _solved(self, poses: Array, weights: Array) -> Array:
        free = np.flatnonzero(np.repeat(~self._anchors(), 4))
        poses = poses.copy()
        for _ in range(_STEPS if len(free) else 0):
            normal, gradient = self._linearised(poses, weights)
            step = linalg.spsolve(normal[free][:, free].tocsc(), -gradient[free])
            poses.reshape(-1)[free] += step
            if np.abs(step).max() < _CONVERGED:
                break
        poses[:, 2] = _wrapped(poses[:, 2])
        return poses

    def _anchors(self) -> NDArray[np.bool_]:
        """(N,) bool: the first pose of each component, which stays."""
        count = len(self._poses)
        ends = [e.first for e in self.edges], [e.second for e in self.edges]
        joined = sparse.coo_matrix((np.ones(len(self.edges)), ends), shape=(count, count))
        _, labels = csgraph.connected_components(joined, directed=False)
        is_anchor = np.zeros(count, bool)
        is_anchor[np.unique(labels, return_index=True)[1]] = True
        return is_anchor

    def _arrays(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
        return (
            np.array([edge.first for edge in self.edges]),
            np.array([edge.second for edge in self.edges]),
            np.array([edge.measured for edge in self.edges]),
            np.array([edge.information for edge in self.edges]),
        )

    def _errors(self, poses: Array) -> Array:
        first, second, measured, _ = self._arrays()
        errors = between(poses[first], poses[second]) - measured
        errors[:, 2] = _wrapped(errors[:, 2])
        return np.asarray(errors)

    def _squared(self, poses: Array) -> Array:
        """(E,) chi^2 of each edge."""
        errors = self._errors(poses)
        return np.asarray(np.einsum("ei,eij,ej->e", errors, self._arrays()[3], errors))

    def _linearised(self, poses: Array, weights: Array) -> tuple[sparse.csr_matrix, Array]:
        """Normal matrix (4N, 4N) and gradient (4N,) of half the sum of the squared errors."""
        first, second, _, information = self._arrays()
        weighted = information * weights[:, None, None]
        errors = self._errors(poses)
        apart = poses[second] - poses[first]
        cos, sin = np.cos(poses[first, 2]), np.sin(poses[first, 2])
        of_second = np.zeros((len(errors), 4, 4))
        of_second[:, 0, 0] = of_second[:, 1, 1] = cos
        of_second[:, 0, 1], of_second[:, 1, 0] = sin, -sin
        of_second[:, 2, 2] = of_second[:, 3, 3] = 1.0
        of_first = -of_second
        of_first[:, 0, 2] = -sin * apart[:, 0] + cos * apart[:, 1]
        of_first[:, 1, 2] = -cos * apart[:, 0] - sin * apart[:, 1]
        size = 4 * len(poses)
        gradient = np.zeros((len(poses), 4))
        rows, columns, values = [], [], []
        for a, of_a in ((first, of_first), (second, of_second)):
            np.add.at(gradient, a, np.einsum("eki,ekl,el->ei", of_a, weighted, errors))
            for b, of_b in ((first, of_first), (second, of_second)):
                block = np.einsum("eki,ekl,elj->eij", of_a, weighted, of_b)
                at = np.arange(4)
                rows.append(np.broadcast_to(4 * a[:, None, None] + at[:, None], block.shape))
                columns.append(np.broadcast_to(4 * b[:, None, None] + at, block.shape))
                values.append(block)
        flat = [np.concatenate([part.ravel() for part in parts]) for parts in (rows, columns)]
        entries = np.concatenate([value.ravel() for value in values]), tuple(flat)
        return sparse.coo_matrix(entries, shape=(size, size)).tocsr(), gradient.ravel()


def _wrapped(yaw: Array) -> Array:
    return np.asarray(np.angle(np.exp(1j * yaw)), np.float64)
