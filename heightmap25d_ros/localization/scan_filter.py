# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of odom in the map from scans: an iterated extended Kalman filter.

Besides x, y, yaw and z of the robot it estimates how its odometry errs: slip, which comes and goes
(Gauss-Markov over distance), and what stays: a scale of distances, a scale of turns, a turn of the
heading per distance. How much the wheels slip is learned as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.pose_filter import correction_about
from heightmap25d_ros.localization.registration import Reason, Registration, rejected
from heightmap25d_ros.localization.scan_update import Update, update_by_returns
from heightmap25d_ros.params.sections import Params, ScanFilterParams

_X, _Y, _YAW, _Z, _SLIP, _SCALE, _TURN, _BIAS = range(8)
_POSE = np.s_[:4]
_PLANAR = np.ix_((_X, _Y, _YAW), (_X, _Y, _YAW))
_RADIAN = 0.5  # [m] of distance that turning by a radian drifts like
_FORGETTING = 1e-4  # share of a constant's prior variance that a metre adds to its variance
_Z_VARIANCE = 0.05**2  # [m^2] of a pose from elsewhere
_SLIP_LENGTH = 20.0  # [m] over which the variance of the slip is learned
_LEAST_SLIP = 0.01
_TURN_LENGTH = 6.0  # [rad] of turning over which the noise of turns is learned
_MOST_TURN_NOISE = 0.2  # [rad] that a radian of turning adds to the yaw at most
_NEAR, _NEAR_YAW = 0.08, 0.03  # [m], [rad] deviation of a pose near which scans search
_SAME_PLACE, _SAME_YAW = 0.12, 0.05  # [m], [rad] between a registration and what scans found
_YAW_STARTS = 0.035 * np.array([s * k for k in range(1, 9) for s in (1, -1)])
"""[rad] Between two of these an update finds its way to a wall some metres away."""

_CLEAR = 0.8  # of what agreed a moment before, for which no other yaw needs to be tried
_TAIL = 4.0  # degrees of freedom of what odometry may be off, as of Student's distribution
_GROWING = 2.0  # times the returns per information in a map that grows: it errs as the pose does
_LEAST_GROWING = 0.5  # of ``min_returns`` that must be over known cells of a map that grows
_MOST_RESIDUAL = 0.05  # [m] mean distance from the map, of at most 0.1 m a return
_LEAST_INFORMATION = 1.0 / 0.3**2  # [1/m^2] that some direction must have


@dataclass(eq=False, slots=True, kw_only=True)
class OdometryErrors:
    """How a robot's odometry errs, as learned so far.

    Attributes
    ----------
    mean : (4,) float64
        Slip, scale of distances, scale of turns, turn of the heading per distance [rad/m]: all to
        be added to what odometry tells.
    covariance : (4, 4) float64
    slip_variance : float
        About which the slip comes and goes.
    turn_variance : float [rad]
        That turning by a radian adds to the yaw [rad^2], besides these.
    """

    mean: Array
    covariance: Array
    slip_variance: float
    turn_variance: float


def unknown_errors(params: Params) -> OdometryErrors:
    """Nothing has been learned yet."""
    prior = params.scan_filter
    spread = (prior.slip, prior.distance_scale, prior.turn_scale, prior.heading_bias)
    return OdometryErrors(
        mean=np.zeros(4),
        covariance=np.diag(np.square(spread)),
        slip_variance=prior.slip**2,
        turn_variance=prior.turn_noise**2,
    )


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
    """

    def __init__(
        self, params: Params, T_map_odom: se3.Matrix, covariance: Array, errors: OdometryErrors
    ) -> None:
        self._params = params
        self.T_map_odom = T_map_odom
        self._covariance = np.zeros((8, 8))
        self._covariance[_PLANAR] = covariance
        self._covariance[_Z, _Z] = _Z_VARIANCE
        self._covariance[4:, 4:] = errors.covariance
        self._mean = errors.mean.copy()
        self._slip_variance = errors.slip_variance
        self._turn_variance = errors.turn_variance
        self._turned = 0.0  # [rad] since the last update
        self._is_settling = False
        self._agreeing, self._residual = 0.0, _MOST_RESIDUAL  # of what was accepted lately

    @property
    def covariance(self) -> Array:
        """(3, 3) float64: of x, y [m] and yaw [rad] of the robot in the map."""
        return np.asarray(self._covariance[_PLANAR])

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
        dx, dy, dz = (self.T_map_odom @ (T_odom_base - T_odom_before))[:3, 3]
        turn = float(_yaw(T_odom_base @ se3.inverse(T_odom_before)))
        heading = _yaw(self.T_map_odom @ T_odom_before)
        forward = float(dx * np.cos(heading) + dy * np.sin(heading))
        slip, scale, turn_scale, bias = self._mean
        change = np.eye(8)
        change[_X, _YAW], change[_Y, _YAW] = -dy, dx
        for state in (_SLIP, _SCALE):
            change[[_X, _Y, _Z], state] = dx, dy, dz
        change[_YAW, _TURN], change[_YAW, _BIAS] = turn, forward
        kept = np.exp(-np.hypot(dx, dy) / self._params.scan_filter.slip_length)
        change[_SLIP, _SLIP] = kept
        shift = (slip + scale) * np.array([dx, dy, dz])
        more = turn_scale * turn + bias * forward
        self._mean[0] *= kept
        self._covariance = change @ self._covariance @ change.T
        self._grow(float(np.hypot(dx, dy)), abs(turn), kept)
        self._move(T_odom_base, (shift[0], shift[1], shift[2]), more)

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
        self.T_map_odom = correction_about(T_map_base, shift, yaw) @ self.T_map_odom

    def update(
        self,
        returns: Array,
        T_odom_base: se3.Matrix,
        landmarks: Landmarks,
        *,
        is_map_growing: bool = False,
    ) -> Registration:
        """Take returns (N, 3) [m, odom] in, with the robot at a pose (4, 4) of the odometry.

        What a map in the making does not know yet, also close to what it knows, does not speak
        against the pose.
        """
        params = self._params.scan_filter
        if is_map_growing:
            share = _GROWING * params.returns_per_information
            params = replace(params, returns_per_information=share)
        if len(returns) < params.min_returns:
            return rejected(Reason.FEW_POINTS, len(returns))
        position = (self.T_map_odom @ T_odom_base)[:3, 3]
        seen = se3.transform_points(self.T_map_odom, returns) - position
        precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
        seen, position = np.ascontiguousarray(seen), np.ascontiguousarray(position)
        found = update_by_returns(seen, position, precision, landmarks, params)
        if is_map_growing and not self._is_clear(found, len(returns)):
            found = self._likeliest(found, seen, position, precision, landmarks, params)
        reason = self._judged(found, is_map_growing=is_map_growing)
        if reason in (Reason.ACCEPTED, Reason.UNOBSERVED):
            self._learn_turns(found, precision)
            self._remember(found, len(returns))
            self._correct(found.error[_POSE], found.information, precision, T_odom_base)
        return Registration(
            reason=reason,
            offset=found.error[[_X, _Y, _YAW]],
            z=float(found.error[_Z]),
            information=found.information[_PLANAR],
            known=found.over_known / len(returns),
            overlap=found.over_known / max(found.near_known, 1),
            residual=found.residual,
            ratio=0.0,
            points=len(returns),
        )

    def _likeliest(
        self,
        found: Update,
        seen: Array,
        position: Array,
        precision: Array,
        landmarks: Landmarks,
        params: ScanFilterParams,
    ) -> Update:
        """The likeliest of updates that begin at other yaws as well.

        Odometry errs by more than its deviation where its stamps are not those of the scans.
        """

        def likelihood(update: Update) -> float:
            error = update.error[:4]
            unexpected = np.log1p(error @ precision @ error / _TAIL)
            return float(
                update.agreeing / params.returns_per_information - 0.5 * _TAIL * unexpected
            )

        for start in _YAW_STARTS:
            error = np.zeros(6)
            error[_YAW] = start
            other = update_by_returns(seen, position, precision, landmarks, params, error)
            found = max(found, other, key=likelihood)  # the first of two equal ones
            if self._is_clear(found, len(seen)):
                break
        return found

    def _is_clear(self, found: Update, returns: int) -> bool:
        """Whether about as many returns agree, and as closely, as a moment before."""
        return (
            found.agreeing >= _CLEAR * self._agreeing * returns
            and found.residual <= self._residual / _CLEAR
        )

    def _remember(self, found: Update, returns: int) -> None:
        """What an update that was accepted is like, for the next one."""
        self._agreeing += 0.5 * (found.agreeing / returns - self._agreeing)
        self._residual += 0.5 * (found.residual - self._residual)

    def _learn_turns(self, found: Update, precision: Array) -> None:
        """Learn the noise of turns from what an update tells of the yaw since the one before.

        One step of expectation maximisation, forgetting over some radians: of the yaw that noise
        added, the update gives mean and variance.
        """
        if self._turned == 0.0:
            return
        added = self._turn_variance * self._turned
        prior = self._covariance[_YAW, _YAW]
        share = min(added / prior, 1.0)
        after = np.linalg.inv(precision + found.information)[_YAW, _YAW]
        squared = (share * found.error[_YAW]) ** 2 + added - share**2 * max(prior - after, 0.0)
        part = min(self._turned / _TURN_LENGTH, 1.0)
        self._turn_variance += part * (squared / self._turned - self._turn_variance)
        least = self._params.scan_filter.yaw_drift**2
        self._turn_variance = float(np.clip(self._turn_variance, least, _MOST_TURN_NOISE**2))
        self._turned = 0.0

    def settle(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> None:
        """As `update`, but the pose stays as uncertain as it is: this may be another place."""
        covariance, mean = self._covariance, self._mean.copy()
        found, _ = self._look_near(returns, T_odom_base, landmarks)
        self._covariance, self._mean = covariance, mean
        self._is_settling |= found.is_accepted

    def prove(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> Registration:
        """As `update` at a pose that was proposed: scans look nearer than it is uncertain.

        What they tell is added to the covariance from before.
        """
        before, mean = self._covariance, self._mean.copy()
        found, information = self._look_near(returns, T_odom_base, landmarks)
        precision = np.asarray(np.linalg.inv(before[_POSE, _POSE]))
        self._covariance, self._mean = before, mean
        self._correct(np.zeros(4), information, precision, T_odom_base)
        return found

    def _look_near(
        self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks
    ) -> tuple[Registration, Array]:
        """Update with a narrow prior; and the information (4, 4) without that."""
        narrow = np.zeros((8, 8))
        narrow[_POSE, _POSE] = np.diag(np.square([_NEAR, _NEAR, _NEAR_YAW, _NEAR]))
        narrow[4:, 4:] = self._covariance[4:, 4:]
        self._covariance = narrow
        found = self.update(returns, T_odom_base, landmarks)
        after = np.linalg.inv(self._covariance[_POSE, _POSE])
        return found, np.asarray(after - np.linalg.inv(narrow[_POSE, _POSE]))

    def has_settled_near(self, registration: Registration) -> bool:
        """Whether scans led to the same place as the first registration of a short-term map."""
        was_settling, self._is_settling = self._is_settling, False
        x, y, yaw = registration.offset
        return was_settling and np.hypot(x, y) < _SAME_PLACE and abs(yaw) < _SAME_YAW

    def _judged(self, found: Update, *, is_map_growing: bool) -> Reason:
        params = self._params
        # A laser that sees farther than the map reaches is no sign of a wrong place.
        least = max(
            params.registration.min_overlap * found.near_known, params.scan_filter.min_returns
        )
        if is_map_growing:
            least = _LEAST_GROWING * params.scan_filter.min_returns
        if found.over_known < least:
            return Reason.LITTLE_OVERLAP
        if found.residual > _MOST_RESIDUAL:
            return Reason.HIGH_RESIDUAL
        if np.linalg.eigvalsh(found.information[:2, :2])[-1] < _LEAST_INFORMATION:
            return Reason.UNOBSERVED
        return Reason.ACCEPTED

    def _correct(
        self, error: Array, information: Array, precision: Array, T_odom_base: se3.Matrix
    ) -> None:
        """Move the pose by its error (4,); the other states follow what they go with."""
        before = self._covariance
        of_pose = np.asarray(np.linalg.inv(precision + information))
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
        information[_Z, _Z] = 1.0 / _Z_VARIANCE
        precision = np.asarray(np.linalg.inv(self._covariance[_POSE, _POSE]))
        x, y, yaw = registration.offset
        weighted = information @ (x, y, yaw, registration.z)
        error = np.asarray(np.linalg.inv(precision + information)) @ weighted
        error[_Z] = registration.z
        self._correct(error, information, precision, T_odom_base)


def _yaw(T: se3.Matrix) -> float:
    return float(np.arctan2(T[1, 0], T[0, 0]))
