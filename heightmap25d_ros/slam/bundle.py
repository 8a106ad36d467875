# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All poses of a stretch of a drive together, with the surface that they have seen: a bundle.

Localization on one's own map takes the map for known, as far as it goes: what a pose errs is in all
that is seen later, and an error of the heading confirms itself. Here neither poses nor surface are
known. Poses are joined by what returns tell (`patches`, `edges`), by the ground that the wheels
stand on (`contacts`) and by the odometry, whose slip, scales and heading bias are unknowns as well,
as in the scan filter. Gauss-Newton steps; what is on one patch is found anew before each. What
counts as one patch is thick at first, since much that poses err is to be found, and slip may be
heavy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.odometry_errors import TILT_LENGTH
from heightmap25d_ros.params.sections import ScanFilterParams
from heightmap25d_ros.slam.contacts import contacts_of
from heightmap25d_ros.slam.edges import add_edges
from heightmap25d_ros.slam.patches import STATES, NormalEquations, Returns, add_patches

WINDOW, _OVERLAP = 400, 120
"""Keyframes that are refined together at most."""

_SPARSE = 3  # of so many keyframes one is refined first, which costs a tenth
NARROW = 0.04
"""[m] Tolerance from a patch in the end."""

_WIDE, _NEAR = 1.0, 0.12  # [m] at first, and when all keyframes take part
_NARROWING = 0.5, 0.9  # at least and at most, from one step to the next; between these the
_FOLLOWS = 5.0  # tolerance is so many times as long as the last step: soon narrow if little moves
_STEPS = 20  # with the last tolerance at most; long corridors take most of them
_CONVERGED = 3e-3  # [m] by which the last step bends the drive
_SETTLED = 0.1  # [m] by which a stretch is bent that need not be refined again
_FIRST_SLIP = 0.2  # standard deviation per distance, until it is known how much wheels have slipped
_REACH = 30.0  # [m] in the plane, from the robot to returns that are used
_START = (1e-3, 1e-3, 1e-3, 1e-3)  # [m], [m], [rad], [m] deviation of the first pose
_RADIAN = 0.5  # [m] of distance that turning by a radian drifts like
_LEAST_VARIANCE = 1e-9
_HEIGHT_NOISE = 0.05  # [m] of the robot above the ground, from what is thought at first
_X, _Y, _YAW, _Z, _ROLL, _PITCH, _SLIP = range(STATES)
_MOVED = [_X, _Y, _Z]
_HEIGHT, _SCALE, _TURN_SCALE, _BIAS = range(4)  # what all poses have in common; the others: unused
_POSE = np.array([_X, _Y, _YAW, _Z])


_Parts = Sequence[NDArray[np.float32]]


class Keyframe(NamedTuple):
    """A moment of the drive.

    Attributes
    ----------
    scan : int
        Number of the last scan up to it.
    submap : int
    T_submap_odom, T_odom_base : (4, 4) float64
        As localization on the own map has found it.
    T_map_odom : (4, 4) float64
        Where scan after scan has led, without what refinements and loops have moved since the drive
        began.
    returns, origins : (N, 3) float32 [m, odom]
        And where the lasers were.
    edges : (E, 3) float32 [m, odom]
        Upright ones that were seen, see `edges`.
    """

    scan: int
    submap: int
    T_submap_odom: se3.Matrix
    T_odom_base: se3.Matrix
    T_map_odom: se3.Matrix
    returns: NDArray[np.float32]
    origins: NDArray[np.float32]
    edges: NDArray[np.float32]


class Refined(NamedTuple):
    """What a bundle tells of keyframes.

    Attributes
    ----------
    T_map_odom : (K, 4, 4) float64
        Of the odometry's frame: shifted, and turned by a yaw.
    tilts : (K, 2) float64 [rad]
        About the axes x and y of the map, to be added to roll and pitch of the robot.
    covariances : (M - 1, 4, 4) float64
        Of x, y, yaw, z of each of M marked keyframes, as seen from the one before.
    """

    T_map_odom: se3.Matrix
    tilts: Array
    covariances: Array


def refined(
    keyframes: Sequence[Keyframe],
    T_map_odom: se3.Matrix,
    params: ScanFilterParams,
    marks: Sequence[int] = (),
    known: Refined | None = None,
) -> Refined:
    """Refine all keyframes together.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        Of one drive, in order.
    T_map_odom : (K, 4, 4) float64
        Where the odometry's frame is thought to be; the first one stays.
    params : ScanFilterParams
    marks : sequence of int, optional
        Numbers of keyframes, in order, for `Refined.covariances`; no two far apart.
    known : Refined, optional
        Of the same keyframes and marks: a stretch that is not bent against it is not refined again.
    """
    found, tilts = T_map_odom.copy(), np.zeros((len(keyframes), 2))
    pairs = np.column_stack([marks[:-1], marks[1:]]).astype(np.int64)
    covariances = np.zeros((len(pairs), 4, 4))
    for begin in range(0, max(len(keyframes) - _OVERLAP, 1), WINDOW - _OVERLAP):
        part = np.s_[begin : begin + WINDOW]
        skipped = _OVERLAP // 2 if begin else 0
        inside = (pairs[:, 1] >= begin + skipped) & (pairs[:, 1] < begin + WINDOW)
        if known is not None and _is_settled(
            keyframes[part], T_map_odom[part], known.T_map_odom[part]
        ):
            moved = Refined(T_map_odom[part], known.tilts[part], known.covariances[inside])
        else:
            between = np.maximum(pairs[inside] - begin, 0)
            moved = _solved(keyframes[part], T_map_odom[part], params, between)
        kept = np.s_[begin + skipped : begin + WINDOW]
        joint = found[begin + skipped] @ se3.inverse(moved.T_map_odom[skipped])
        found[kept], tilts[kept] = joint @ moved.T_map_odom[skipped:], moved.tilts[skipped:]
        covariances[inside] = moved.covariances
    return Refined(found, tilts, covariances)


def _solved(
    keyframes: Sequence[Keyframe],
    T_map_odom: se3.Matrix,
    params: ScanFilterParams,
    pairs: NDArray[np.int64],
) -> Refined:
    """Refine a stretch, with covariances for pairs (P, 2) of its keyframes."""
    some = Stretch(keyframes[::_SPARSE], T_map_odom[::_SPARSE], params)
    for _ in some.solve(_WIDE, _NEAR):
        pass
    moved = some.T_map_odom()[np.arange(len(keyframes)) // _SPARSE]  # others as the one before
    stretch = Stretch(keyframes, moved, params)
    for _ in stretch.solve(_NEAR, NARROW):
        pass
    return Refined(stretch.T_map_odom(), stretch.tilts(), stretch.covariances(pairs))


def _is_settled(keyframes: Sequence[Keyframe], now: se3.Matrix, before: se3.Matrix) -> bool:
    """Whether poses (K, 4, 4) of the odometry's frame have not bent the drive."""
    T_odom_base = np.array([keyframe.T_odom_base for keyframe in keyframes])
    at = (before @ T_odom_base)[:, :2, 3]
    return _bend((now @ T_odom_base)[:, :2, 3] - at, at) < _SETTLED


def _bend(moves: Array, at: Array) -> float:
    """Moves (K, 2) of places (K, 2) [m]: the largest that is left if all turn and move as one."""
    at, moves = at - at.mean(axis=0), moves - moves.mean(axis=0)
    aside = np.column_stack([-at[:, 1], at[:, 0]])
    moves -= (aside * moves).sum() / max(np.square(at).sum(), _LEAST_VARIANCE) * aside
    return float(np.hypot(*moves.T).max())


class _Steps(NamedTuple):
    """What odometry tells from one pose to the next: (K,) each, seen from the first of the two."""

    forward: Array
    aside: Array
    climb: Array
    turn: Array

    @property
    def distance(self) -> Array:
        return np.hypot(self.forward, self.aside)

    @classmethod
    def of(cls, T_odom_base: se3.Matrix) -> _Steps:
        x, y, z, _, _, yaw = se3.to_xyz_rpy(T_odom_base).T
        dx, dy, cos, sin = np.diff(x), np.diff(y), np.cos(yaw[:-1]), np.sin(yaw[:-1])
        turn = np.angle(np.exp(1j * np.diff(yaw)))
        return cls(cos * dx + sin * dy, cos * dy - sin * dx, np.diff(z), turn)


def _returns_of(
    points: _Parts,
    origins: _Parts,
    T_map_odom: se3.Matrix,
    T_map_base: se3.Matrix,
) -> Returns:
    """What was seen within reach, from the robot: points of each keyframe, and their lasers."""
    pose_of = np.repeat(np.arange(len(points)), [len(part) for part in points])
    seen, origins_seen = (
        np.concatenate([
            se3.transform_points(T, part.astype(np.float64)) - T_base[:3, 3]
            for T, part, T_base in zip(T_map_odom, of_keyframes, T_map_base, strict=True)
        ])
        for of_keyframes in (points, origins)
    )  # fmt: skip
    beams = seen - origins_seen
    beams /= np.maximum(np.linalg.norm(beams, axis=1), 1e-6)[:, None]
    is_near = np.hypot(seen[:, 0], seen[:, 1]) < _REACH
    is_contact = np.zeros(len(seen), np.bool_)
    return Returns(*(part[is_near] for part in (seen, beams, pose_of, is_contact)))


class Stretch:
    """Keyframes that are refined together.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        Of one drive, in order.
    T_map_odom : (K, 4, 4) float64
        Where the odometry's frame is thought to be; the first one stays.
    params : ScanFilterParams
    """

    def __init__(
        self, keyframes: Sequence[Keyframe], T_map_odom: se3.Matrix, params: ScanFilterParams
    ) -> None:
        self._params, self._T_map_odom = params, T_map_odom
        self._slip = max(params.slip, _FIRST_SLIP)
        T_odom_base = np.array([keyframe.T_odom_base for keyframe in keyframes])
        self._T_map_base = T_map_odom @ T_odom_base
        self._steps = _Steps.of(T_odom_base)
        edges = [keyframe.edges for keyframe in keyframes]
        self._edges = _returns_of(edges, edges, T_map_odom, self._T_map_base)
        returns = _returns_of(
            [keyframe.returns for keyframe in keyframes],
            [keyframe.origins for keyframe in keyframes],
            T_map_odom, self._T_map_base,
        )  # fmt: skip
        at = returns.seen + self._T_map_base[returns.pose_of, :3, 3]
        parts = returns, contacts_of(at, self._T_map_base)
        self._returns = Returns(*(np.concatenate(part) for part in zip(*parts, strict=True)))
        self._errors = np.zeros((len(keyframes), STATES))
        self._constants = np.zeros(STATES)

    def solve(self, tolerance: float, last: float, most: int = _STEPS) -> Iterator[None]:
        """Take steps with a tolerance that narrows, and with the last one until they are short.

        With that one at most so many; there is time for others after each.
        """
        steps = 0
        while steps < most:
            moved = _bend(self._step(tolerance)[:, :2], self._T_map_base[:, :2, 3])
            yield
            if tolerance == last:
                steps += 1
                if moved < _CONVERGED:
                    break
            tolerance *= float(np.clip(_FOLLOWS * moved / tolerance, *_NARROWING))
            tolerance = max(tolerance, last)
            if tolerance == NARROW:
                slipped = float(np.sqrt(np.mean(np.square(self._errors[:, _SLIP]))))
                self._slip = max(self._params.slip, slipped)

    def motions(self) -> se3.Matrix:
        """(K, 4, 4): what has moved each pose, a shift and a turn by a yaw."""
        return np.array([
            se3.correction_about(pose, error[_MOVED], error[_YAW])
            for pose, error in zip(self._T_map_base, self._errors, strict=True)
        ])  # fmt: skip

    def T_map_odom(self) -> se3.Matrix:
        """(K, 4, 4) of the odometry's frame."""
        return np.asarray(self.motions() @ self._T_map_odom)

    @property
    def heading_bias(self) -> float:
        """Turn of the heading [rad/m] to be added to what the odometry tells."""
        return float(self._constants[_BIAS])

    def tilts(self) -> Array:
        """(K, 2), see `Refined`."""
        return self._errors[:, [_ROLL, _PITCH]]

    def covariances(self, pairs: NDArray[np.int64]) -> Array:
        """(P, 4, 4) of x, y, yaw, z of the second of each pair (P, 2), as seen from the first."""
        found = np.zeros((len(pairs), 4, 4))
        if not len(pairs):
            return found
        matrix = self._equations(NARROW).matrix
        factor = linalg.cho_factor(matrix, overwrite_a=True, check_finite=False)
        yaw = se3.to_xyz_rpy(self._T_map_base)[:, 5] + self._errors[:, _YAW]
        xy = self._T_map_base[:, :2, 3] + self._errors[:, :2]
        for k, (first, second) in enumerate(pairs):
            cos, sin = np.cos(yaw[first]), np.sin(yaw[first])
            turn = np.eye(4)
            turn[:2, :2] = [[cos, sin], [-sin, cos]]
            lever = np.zeros((4, 4))
            lever[:2, _YAW] = np.array([[-sin, cos], [-cos, -sin]]) @ (xy[second] - xy[first])
            of_states = np.zeros((len(matrix), 4))
            of_states[STATES * first + _POSE] += (lever - turn).T
            of_states[STATES * second + _POSE] += turn.T
            found[k] = of_states.T @ linalg.cho_solve(factor, of_states, check_finite=False)
        return found

    def _step(self, tolerance: float) -> Array:
        """Take one step; what was added to the states (K, 7)."""
        equations = self._equations(tolerance)
        factor = linalg.cho_factor(equations.matrix, overwrite_a=True, check_finite=False)
        step = -linalg.cho_solve(factor, equations.gradient)
        of_poses, of_constants = np.split(step, [self._errors.size])
        self._constants += of_constants
        self._errors += of_poses.reshape(self._errors.shape)
        return np.asarray(of_poses.reshape(self._errors.shape))

    def _equations(self, tolerance: float) -> NormalEquations:
        """Of the states and the constants of the odometry."""
        size = self._errors.size + len(self._constants)
        equations = NormalEquations.zero(size)
        share = 1.0 / self._params.returns_per_information
        positions = self._T_map_base[:, :3, 3] + self._errors[:, _MOVED]
        add_patches(self._seen(self._returns), positions, share, tolerance, equations)
        add_edges(self._seen(self._edges), positions, share, tolerance, equations)
        self._add_odometry(positions, equations)
        self._add_priors(equations)
        return equations

    def _seen(self, returns: Returns) -> Returns:
        """Returns as the robot sees them from poses as they are now."""
        error = self._errors[returns.pose_of]
        cos, sin = np.cos(error[:, _YAW]), np.sin(error[:, _YAW])
        lower = self._constants[_HEIGHT] * returns.is_contact
        (x, y, z), (u, v, w) = (
            (cos * part[:, 0] - sin * part[:, 1], sin * part[:, 0] + cos * part[:, 1], part[:, 2])
            for part in (returns.seen, returns.beams)
        )
        tilted = z + error[:, _ROLL] * y - error[:, _PITCH] * x
        return returns._replace(
            seen=np.column_stack([x + lower * u, y + lower * v, tilted + lower * w]),
            beams=np.column_stack([u, v, w]),
        )

    def _add_odometry(self, positions: Array, equations: NormalEquations) -> None:
        """Add what the odometry tells from each pose to the next."""
        params, (forward, aside, climb, turn) = self._params, self._steps
        count, distance = len(turn), self._steps.distance
        _, scale, turn_scale, bias = self._constants[:4]
        yaw = se3.to_xyz_rpy(self._T_map_base)[:, 5] + self._errors[:, _YAW]
        cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
        dx, dy = cos * forward - sin * aside, sin * forward + cos * aside
        slip = self._errors[:, _SLIP]
        told, kept = 1.0 + slip[:-1] + scale, np.exp(-distance / params.slip_length)
        moved = np.diff(positions, axis=0)
        turned = np.diff(yaw) - turn * (1.0 + turn_scale) - bias * forward
        roll, pitch = self._errors[:, _ROLL], self._errors[:, _PITCH]
        stays = np.exp(-distance / TILT_LENGTH)
        residual = np.column_stack([
            moved[:, 0] - told * dx, moved[:, 1] - told * dy,
            np.angle(np.exp(1j * turned)), moved[:, 2] - told * climb, slip[1:] - kept * slip[:-1],
            roll[1:] - stays * roll[:-1], pitch[1:] - stays * pitch[:-1],
        ])  # fmt: skip
        rows = np.zeros((count, STATES, 3 * STATES))
        for k, state in enumerate((_X, _Y, _YAW, _Z, _SLIP, _ROLL, _PITCH)):
            rows[:, k, state], rows[:, k, STATES + state] = -1.0, 1.0
        rows[:, 5, _ROLL] = rows[:, 6, _PITCH] = -stays
        rows[:, 0, _YAW], rows[:, 1, _YAW] = told * dy, -told * dx
        for k, step in ((0, dx), (1, dy), (3, climb)):
            rows[:, k, _SLIP] = rows[:, k, 2 * STATES + _SCALE] = -step
        rows[:, 2, 2 * STATES + _TURN_SCALE], rows[:, 2, 2 * STATES + _BIAS] = -turn, -forward
        rows[:, 4, _SLIP] = -kept
        drift = distance + _RADIAN * np.abs(turn)
        variance = _LEAST_VARIANCE + np.column_stack([
            params.position_drift**2 * drift, params.position_drift**2 * drift,
            params.yaw_drift**2 * distance + params.turn_noise**2 * np.abs(turn),
            params.z_drift**2 * distance, (1.0 - kept**2) * self._slip**2,
            *2 * [(1.0 - stays**2) * params.tilt_noise**2 + _LEAST_VARIANCE],
        ])  # fmt: skip
        constants = self._errors.size + np.arange(STATES)
        for k in range(count):
            index = np.concatenate([STATES * k + np.arange(2 * STATES), constants])
            weighted = rows[k] / variance[k, :, None]
            equations.matrix[np.ix_(index, index)] += rows[k].T @ weighted
            equations.gradient[index] += weighted.T @ residual[k]

    def _add_priors(self, equations: NormalEquations) -> None:
        """Add what is known before: where the drive begins, tilts and constants of the odometry."""
        params = self._params
        deviation = np.full(self._errors.shape, np.inf)
        deviation[0, [_ROLL, _PITCH]] = params.tilt_noise
        deviation[0, :4] = _START
        deviation[0, _SLIP] = self._slip
        constants = np.ones(STATES)
        constants[[_HEIGHT, _SCALE, _TURN_SCALE, _BIAS]] = (
            _HEIGHT_NOISE, params.distance_scale, params.turn_scale, params.heading_bias
        )  # fmt: skip
        values = np.concatenate([self._errors.ravel(), self._constants])
        deviations = np.maximum(np.concatenate([deviation.ravel(), constants]), _LEAST_VARIANCE)
        precision = deviations**-2
        equations.matrix[np.diag_indices(len(values))] += precision
        equations.gradient[:] += precision * values


def compile_kernels(params: ScanFilterParams) -> None:
    """Compile, or load from numba's cache."""
    y = np.linspace(-1.0, 1.0, 100)
    wall = np.column_stack([np.full(100, 2.0), y, np.full(100, 0.5)]).astype(np.float32)
    T_odom_base = (np.eye(4), se3.from_xyz_rpy([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
    keyframes = [
        Keyframe(k, 0, np.eye(4), T, np.eye(4), wall, np.zeros_like(wall), wall[:1])
        for k, T in enumerate(T_odom_base)
    ]
    refined(keyframes, np.stack([np.eye(4)] * 2), params, marks=(0, 1))
