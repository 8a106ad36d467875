# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of odom in the map from scans: an iterated extended Kalman filter.

Besides x, y, yaw and z of the robot it estimates how its odometry errs: slip, which comes and goes
(Gauss-Markov over distance), and what stays: a scale of distances, a scale of turns, a turn of the
heading per distance. How much the wheels slip is learned as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.growing_map import LEAST_KNOWN, GrowingMapUpdate
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.odometry_errors import TILT_LENGTH, Motion, OdometryErrors
from heightmap25d_ros.localization.pose_filter import Z_VARIANCE
from heightmap25d_ros.localization.registration import Reason, Registration, rejected
from heightmap25d_ros.localization.scan_update import FIT, Update, update_by_returns
from heightmap25d_ros.params.sections import Params

_X, _Y, _YAW, _Z, _SLIP, _SCALE, _TURN, _BIAS = range(8)
_POSE = np.s_[:4]
_TILT = np.s_[4:6]  # of the error of an update
_PLANAR = np.ix_((_X, _Y, _YAW), (_X, _Y, _YAW))
_RADIAN = 0.5  # [m] of distance that turning by a radian drifts like
_FORGETTING = 1e-4  # share of a constant's prior variance that a metre adds to its variance
_SLIP_LENGTH = 20.0  # [m] over which the variance of the slip is learned
_LEAST_SLIP = 0.01
_TURN_LENGTH = 6.0  # [rad] of turning over which the noise of turns is learned
_MOST_TURN_NOISE = 0.2  # [rad] that a radian of turning adds to the yaw at most
_NEAR, _NEAR_YAW = 0.08, 0.03  # [m], [rad] deviation of a pose near which scans search
_BESIDE = (0.0, -0.1, 0.1)  # [m] from a place that a search has found, in x and in y
_NEARBY: Array = np.diag(np.square([1 / _NEAR, 1 / _NEAR, 1 / _NEAR_YAW, 1 / _NEAR]))
_BESIDE_OWN_MAP: Array = np.diag([1 / 0.05**2, 1 / 0.05**2, 0.0, 0.0])  # [1/m^2] of x and y
_SAME_PLACE, _SAME_YAW = 0.12, 0.05  # [m], [rad] between a registration and what scans found
_MOST_RESIDUAL = 0.05  # [m] mean distance from the map, of at most 0.1 m a return: as by chance
_SHARP_RESIDUAL = 0.03  # [m] so small only at the right place
_MISSED_TURNS = -0.24, -0.16, -0.08, 0.08, 0.16, 0.24  # [rad] that are tried
_LEAST_STEP = 0.03  # [m] that odometry tells, to be doubted
_TOLD_APART = 3.0  # standard deviations between two motions that returns tell apart
_MISSED_GAIN = 1.3  # of the fit, to believe that odometry is wrong
_LEAST_SHARP_OVERLAP = 0.2  # with such a residual: doors are open now, furniture has moved
_USABLE = (Reason.ACCEPTED, Reason.UNOBSERVED)
_LEAST_INFORMATION = 1.0 / 0.3**2  # [1/m^2] that some direction must have


class ScanFilter:
    """The estimate; takes the place of a `PoseFilter` where the map has landmarks.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m] and yaw [rad] of the robot in the map.
    errors : OdometryErrors

    Attributes
    ----------
    T_map_odom
    tilt : (2,) float64 [rad]
        To be added to roll and pitch of the odometry, about the axes x and y of the map, as the
        last update told; it fades with the way.
    """

    def __init__(
        self, params: Params, T_map_odom: se3.Matrix, covariance: Array, errors: OdometryErrors
    ) -> None:
        self._params = params
        self.T_map_odom = T_map_odom
        self._covariance = np.zeros((8, 8))
        self._covariance[_PLANAR] = covariance
        self._covariance[_Z, _Z] = Z_VARIANCE
        self._covariance[4:, 4:] = errors.covariance
        self._mean = errors.mean.copy()
        self._slip_variance = errors.slip_variance
        self._turn_variance = errors.turn_variance
        self._turned = 0.0  # [rad] since the last update
        self._T_odom_used: se3.Matrix | None = None  # at the last update that moved the pose
        self.tilt = np.zeros(2)
        self._is_settling = False
        self._growing = GrowingMapUpdate()

    @property
    def covariance(self) -> Array:
        """(3, 3) float64: of x, y [m] and yaw [rad] of the robot in the map."""
        return np.asarray(self._covariance[_PLANAR])

    @property
    def z_variance(self) -> float:
        """Of the robot in the map [m^2]."""
        return float(self._covariance[_Z, _Z])

    @property
    def deviation(self) -> tuple[float, float]:
        """Standard deviations: of the position along its less certain direction [m], yaw [rad]."""
        position = np.linalg.eigvalsh(self._covariance[:2, :2])[-1]
        return float(np.sqrt(position)), float(np.sqrt(self._covariance[_YAW, _YAW]))

    @property
    def errors(self) -> OdometryErrors:
        """Of the odometry, as learned so far."""
        return OdometryErrors(
            mean=self._mean.copy(),
            covariance=self._covariance[4:, 4:].copy(),
            slip_variance=self._slip_variance,
            turn_variance=self._turn_variance,
        )

    def predict(self, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, _: float = 0.0) -> None:
        """The robot moved by odometry; poses (4, 4) of it before and after."""
        if np.array_equal(T_odom_before, T_odom_base):
            return
        motion = Motion.between(self.T_map_odom, T_odom_before, T_odom_base)
        dx, dy, _dz = motion.step
        change = np.eye(8)
        change[_X, _YAW], change[_Y, _YAW] = -dy, dx
        for state in (_SLIP, _SCALE):
            change[[_X, _Y, _Z], state] = motion.step
        change[_YAW, _TURN], change[_YAW, _BIAS] = motion.turn, motion.forward
        distance = float(np.hypot(dx, dy))
        kept = np.exp(-distance / self._params.scan_filter.slip_length)
        change[_SLIP, _SLIP] = kept
        self.tilt = self.tilt * np.exp(-(distance + _RADIAN * abs(motion.turn)) / TILT_LENGTH)
        shift, yaw = motion.error(self._mean)
        self._mean[0] *= kept
        self._covariance = change @ self._covariance @ change.T
        self._grow(distance, abs(motion.turn), kept)
        self._move(T_odom_base, shift, yaw)

    def _grow(self, distance: float, turn: float, kept: float) -> None:
        """Process noise of a distance [m] and a turn [rad]."""
        params, diagonal = self._params.scan_filter, np.zeros(8)
        drift = distance + _RADIAN * turn
        diagonal[[_X, _Y]] = params.position_drift**2 * drift
        diagonal[_YAW] = params.yaw_drift**2 * distance + self._turn_variance * turn
        self._turned += turn
        diagonal[_Z] = params.z_drift**2 * distance
        diagonal[_SLIP] = (1.0 - kept**2) * self._slip_variance
        prior = np.square([params.distance_scale, params.turn_scale, params.heading_bias])
        diagonal[_SCALE:] = _FORGETTING * drift * prior
        self._covariance[np.diag_indices(8)] += diagonal
        seen = self._mean[0] ** 2 + self._covariance[_SLIP, _SLIP]
        self._slip_variance += min(distance / _SLIP_LENGTH, 1.0) * (seen - self._slip_variance)
        self._slip_variance = max(self._slip_variance, min(_LEAST_SLIP, params.slip) ** 2)

    def _move(self, T_odom_base: se3.Matrix, shift: tuple[float, float, float], yaw: float) -> None:
        T_map_base = self.T_map_odom @ T_odom_base
        self.T_map_odom = se3.correction_about(T_map_base, shift, yaw) @ self.T_map_odom

    def update(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> Registration:
        """Take returns (N, 3) [m, odom] in, with the robot at a pose (4, 4) of the odometry."""
        precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
        found, usable = self._look(returns, T_odom_base, landmarks, precision)
        if not self._is_sharp(found) and self._moved_otherwise(
            returns, T_odom_base, landmarks, _MISSED_GAIN * fit_of(found)
        ):
            precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
            found, usable = self._look(returns, T_odom_base, landmarks, precision)
        if usable is not None:
            self._use(usable, precision, T_odom_base)
        return found

    def update_growing(
        self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks, *, has_ground: bool
    ) -> Registration:
        """As `update`, on a map that the robot is making, see `growing_map`.

        What it has mapped a moment ago errs as it does: beside that it is not as uncertain as
        beside the beginning of a long ramp. If it were, noise of the ground would lead it astray,
        by 0.2 m in one turn on the spot.

        Parameters
        ----------
        returns : (N, 3) float64 [m], odom
        T_odom_base : (4, 4) float64
        landmarks : Landmarks
        has_ground : bool
            Whether lasers see the ground.
        """
        params = self._params.scan_filter
        if len(returns) < params.min_returns:
            return rejected(Reason.FEW_POINTS, len(returns))
        precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
        seen, position = self._seen(returns, T_odom_base)
        assumed = precision + _BESIDE_OWN_MAP if has_ground else precision
        found = self._growing.hold(seen, position, assumed, landmarks, params)
        reason = self._judged(found, LEAST_KNOWN * params.min_returns)
        if reason in _USABLE:
            self._growing.remember(found, len(returns))
            self._use(found, precision, T_odom_base)
        return _registration(found, reason, len(returns))

    def _use(self, found: Update, precision: Array, T_odom_base: se3.Matrix) -> None:
        """Correct the pose by an update that was made with a precision (4, 4) of it."""
        of_pose = np.asarray(np.linalg.inv(precision + found.information))
        self._learn_turns(found.error[_YAW], of_pose[_YAW, _YAW])
        self._correct(found.error[_POSE], of_pose, precision, T_odom_base)
        self._T_odom_used, self.tilt = T_odom_base, found.error[_TILT]

    def _moved_otherwise(
        self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks, least_fit: float
    ) -> bool:
        """Whether returns fit better if the robot moved otherwise than its odometry tells.

        The pose is then moved there, and is as uncertain as the two are apart.
        """
        before, best = self.T_map_odom, None
        for start in self._other_motions(T_odom_base):
            self._move(T_odom_base, (start[_X], start[_Y], 0.0), start[_YAW])
            found, usable = self._look(returns, T_odom_base, landmarks, _NEARBY)
            self.T_map_odom = before
            if usable is None or not self._is_sharp(found):
                continue
            is_told_apart = start @ usable.information @ start > _TOLD_APART**2
            if is_told_apart and fit_of(found) > least_fit:
                least_fit, best = fit_of(found), start + usable.error[_POSE]
        if best is None:
            return False
        self._move(T_odom_base, (best[_X], best[_Y], best[_Z]), best[_YAW])
        self._covariance[_POSE, _POSE] += np.outer(best, best)
        return True

    def _other_motions(self, T_odom_base: se3.Matrix) -> Iterator[Array]:
        """What to add to x, y, yaw, z (4,) of the robot if its odometry is wrong since last used.

        It missed a turn; the wheels spun; or it tells the way without its sign, as encoders with
        one channel do.
        """
        for turn in _MISSED_TURNS:
            yield np.array([0.0, 0.0, turn, 0.0])
        if self._T_odom_used is None:
            return
        dx, dy, dz = (self.T_map_odom @ (T_odom_base - self._T_odom_used))[:3, 3]
        if np.hypot(dx, dy) > _LEAST_STEP:
            for times in (1.0, 2.0):
                yield -times * np.array([dx, dy, 0.0, dz])

    def _look(
        self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks, precision: Array
    ) -> tuple[Registration, Update | None]:
        """Hold returns to the map, with a prior of a precision (4, 4); what may be used of it."""
        params = self._params.scan_filter
        if len(returns) < params.min_returns:
            return rejected(Reason.FEW_POINTS, len(returns)), None
        seen, position = self._seen(returns, T_odom_base)
        found = update_by_returns(seen, position, precision, landmarks, params)
        is_sharp = found.residual <= _SHARP_RESIDUAL
        least = _LEAST_SHARP_OVERLAP if is_sharp else self._params.registration.min_overlap
        # A laser that sees farther than the map reaches is no sign of a wrong place.
        reason = self._judged(found, max(least * found.near_known, params.min_returns))
        is_usable = reason in _USABLE
        return _registration(found, reason, len(returns)), found if is_usable else None

    def _seen(self, returns: Array, T_odom_base: se3.Matrix) -> tuple[Array, Array]:
        """Returns (N, 3) [m] as seen from the robot, along the axes of the map, and its place."""
        position = (self.T_map_odom @ T_odom_base)[:3, 3]
        seen = se3.transform_points(self.T_map_odom, returns) - position
        return np.ascontiguousarray(seen), np.ascontiguousarray(position)

    def _learn_turns(self, error: float, after: float) -> None:
        """Learn the noise of turns from the error of the yaw [rad] and its variance after it.

        One step of expectation maximisation, forgetting over some radians: of the yaw that noise
        added since the update before, this one gives mean and variance.
        """
        if self._turned == 0.0:
            return
        added = self._turn_variance * self._turned
        prior = self._covariance[_YAW, _YAW]
        share = min(added / prior, 1.0)
        squared = (share * error) ** 2 + added - share**2 * max(prior - after, 0.0)
        part = min(self._turned / _TURN_LENGTH, 1.0)
        self._turn_variance += part * (squared / self._turned - self._turn_variance)
        least = self._params.scan_filter.yaw_drift**2
        self._turn_variance = float(np.clip(self._turn_variance, least, _MOST_TURN_NOISE**2))
        self._turned = 0.0

    def learn_heading_bias(self, bias: float) -> None:
        """Take what others have found of the turn of the heading per distance [rad/m]."""
        self._mean[_BIAS - _SLIP] = bias

    def settle(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> None:
        """Follow the map near the pose, which stays as uncertain as it is: it may be elsewhere."""
        found, _ = self._look_near(returns, T_odom_base, landmarks)
        self._is_settling |= found.is_accepted

    def begin_at_best(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> None:
        """Move to where returns fit best, of the places within a cell of a search.

        Each wall has two sides: from between them scans can lead to the wrong one.
        """
        before, best, least = self.T_map_odom, self.T_map_odom, np.inf
        for x, y in product(_BESIDE, _BESIDE):
            self._move(T_odom_base, (x, y, 0.0), 0.0)
            found, usable = self._look(returns, T_odom_base, landmarks, _NEARBY)
            if usable is not None and found.residual < least:
                best, least = self.T_map_odom, found.residual
            self.T_map_odom = before
        self.T_map_odom = best

    def prove(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> Registration:
        """As `update` at a pose that was proposed: scans look nearer than it is uncertain."""
        found, information = self._look_near(returns, T_odom_base, landmarks)
        precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
        of_pose = np.asarray(np.linalg.inv(precision + information))
        self._correct(np.zeros(4), of_pose, precision, T_odom_base)
        return found

    def _look_near(
        self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks
    ) -> tuple[Registration, Array]:
        """Move to where returns fit near the pose; and the information (4, 4) of that."""
        found, usable = self._look(returns, T_odom_base, landmarks, _NEARBY)
        if usable is None:
            return found, np.zeros((4, 4))
        x, y, yaw, z = usable.error[_POSE]
        self._move(T_odom_base, (x, y, z), float(yaw))
        return found, usable.information

    def has_settled_near(self, registration: Registration) -> bool:
        """Whether scans led to the same place as the first registration of a short-term map."""
        was_settling, self._is_settling = self._is_settling, False
        x, y, yaw = registration.offset
        return was_settling and np.hypot(x, y) < _SAME_PLACE and abs(yaw) < _SAME_YAW

    def _is_sharp(self, found: Registration) -> bool:
        least = self._params.registration.min_overlap
        return found.overlap >= least and found.residual <= _SHARP_RESIDUAL

    @staticmethod
    def _judged(found: Update, least_known: float) -> Reason:
        if found.over_known < least_known:
            return Reason.LITTLE_OVERLAP
        if found.residual > _MOST_RESIDUAL:
            return Reason.HIGH_RESIDUAL
        if np.linalg.eigvalsh(found.information[:2, :2])[-1] < _LEAST_INFORMATION:
            return Reason.UNOBSERVED
        return Reason.ACCEPTED

    def _correct(
        self, error: Array, of_pose: Array, precision: Array, T_odom_base: se3.Matrix
    ) -> None:
        """Move the pose by its error (4,); the other states follow what they go with.

        Covariance (4, 4) of the pose after that, and its inverse before.
        """
        before = self._covariance
        follow = before[4:, _POSE] @ precision
        after = np.empty((8, 8))
        after[_POSE, _POSE] = of_pose
        after[4:, _POSE] = follow @ of_pose
        after[_POSE, 4:] = after[4:, _POSE].T
        after[4:, 4:] = before[4:, 4:] - follow @ (before[_POSE, _POSE] - of_pose) @ follow.T
        self._covariance = 0.5 * (after + after.T)
        self._mean += follow @ error
        self._move(T_odom_base, (error[_X], error[_Y], error[_Z]), float(error[_YAW]))

    def correct(self, registration: Registration, T_odom_base: se3.Matrix) -> None:
        """Take a registration of a short-term map in that was made with this estimate as prior."""
        information = np.zeros((4, 4))
        information[_PLANAR] = registration.information
        information[_Z, _Z] = 1.0 / Z_VARIANCE
        precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
        of_pose = np.asarray(np.linalg.inv(precision + information))
        x, y, yaw = registration.offset
        error = of_pose @ information @ (x, y, yaw, registration.z)
        error[_Z] = registration.z
        self._correct(error, of_pose, precision, T_odom_base)


def _registration(found: Update, reason: Reason, returns: int) -> Registration:
    """What an update by a number of returns tells others."""
    return Registration(
        reason=reason,
        offset=found.error[[_X, _Y, _YAW]],
        z=float(found.error[_Z]),
        information=found.information[_PLANAR],
        known=found.over_known / returns,
        overlap=found.over_known / max(found.near_known, 1),
        residual=found.residual,
        ratio=0.0,
        points=returns,
    )


def fit_of(found: Registration) -> float:
    """Share of the returns of an update that fit, by how closely they do."""
    return found.overlap * max(1.0 - found.residual / FIT, 0.0)
