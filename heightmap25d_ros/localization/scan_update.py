# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One iterated update of the pose by returns, held against walls and ground of the map.

A return well above the lowest ground around it is compared with the line of the nearest wall, any
other with the plane of its cell. The errors of x, y, yaw, z, roll and pitch are found by
Gauss-Newton steps with robust weights; roll and pitch, which the odometry knows to a fraction of a
degree, are new each time and are marginalised.

**Errors in variables.** Normals of walls and slopes of the ground are noisy themselves, and noise
looks like information along directions of which nothing is known. Each carries its variance ``v``,
so that the information which noise alone would fake is known too: F = sum of w v D D^T, with D the
change of a residual's gradient by that noise. In each direction only that share of the
information A counts which F does not explain (`_discounted`); no threshold decides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.localization.landmarks import ELEVATED, Landmarks, sample_landmarks
from heightmap25d_ros.params.sections import ScanFilterParams

FIT = 0.1
"""Distance [m] from the map within which a return agrees with it; others count as this one."""

_ITERATIONS = 6
_WIDE_ITERATIONS = 2  # in which the robust weights allow for what the prior may be off
_CONVERGED = 2e-4  # [m]
_REACH = 1.6  # [cells] from a return to the mean place of a wall
_HEIGHT_REACH = 0.3  # [m] from a return to the ground
_ABOVE_TOP = 0.12  # [m] that a return may be above the top of its wall
_FIRST_TOLERANCE, _TOLERANCE = 4.0, 3.0  # [standard deviations] of the robust weights
_UNSURE = 0.12  # [m] that the prior may be off across a wall for its returns to count
_SLOPE_UNSURE = 0.25  # [m] the same along the gradient of the ground
_REGULAR = 1e-3  # added to the information, so that it has an inverse
_NO_GROUND = 1e5  # [m] lowest ground that stands for none
_NOTHING = -1
_CONTRADICTED = -2  # something is where the map has nothing
_STANDING = 0.3  # [m] from the ground; less of it is what rough ground looks like from elsewhere


class Update(NamedTuple):
    """What an update tells.

    Attributes
    ----------
    error : (6,) float64 [m, m, rad, m, rad, rad]
        To be added to x, y, yaw, z, roll and pitch of the prior, all along the axes of the map.
    information : (4, 4) float64
        Of x, y, yaw, z; the prior's is not in it.
    near_known : int
        Returns at places that the map covers (`Landmarks.is_near`).
    over_known : int
        Returns of which the map can tell whether they agree.
    agreeing : int
        Of these, the ones within 0.1 m of wall or ground.
    contradicted : int
        Of these, the ones of something that stands 0.3 m high or more where the map has nothing.
    residual : float [m]
        Their mean distance from these, at most 0.1 m each.
    """

    error: Array
    information: Array
    near_known: int
    over_known: int
    agreeing: int
    contradicted: int
    residual: float


def update_by_returns(
    returns: Array,
    position: Array,
    precision: Array,
    landmarks: Landmarks,
    params: ScanFilterParams,
    start: Array | None = None,
) -> Update:
    """Hold returns against the map.

    Parameters
    ----------
    returns : (N, 3) float64 [m]
        Seen from the robot, along the axes of the map.
    position : (3,) float64 [m], map
        Of the robot.
    precision : (4, 4) float64
        Inverse of the prior covariance of x, y, yaw, z.
    landmarks : Landmarks
    params : ScanFilterParams
    start : (6,) float64, optional
        The error to begin with; zeros by default.
    """
    error = np.zeros(6) if start is None else start.copy()
    information = np.zeros((4, 4))
    covariance = np.asarray(np.linalg.inv(precision), np.float64)
    settings = (
        params.wall_noise**2, params.ground_noise**2, 1.0 / params.tilt_noise**2,
        1.0 / params.returns_per_information, params.noise_weight, params.noise_caution,
    )  # fmt: skip
    counts = _update(
        returns, position, covariance, precision, landmarks.arrays(), settings, error, information
    )
    return Update(error, information, *counts)


@kernel
def _update(
    returns, position, covariance, precision, cells, settings, error, information,
):  # fmt: skip
    """Fill in error (6,) and information (4, 4); returns the counts of `Update`."""
    wall_variance, ground_variance, tilt_precision, share, weight, caution = settings
    codes = np.empty(len(returns), np.int64)
    at = np.empty((len(returns), 3))
    normal, fake, gradient = np.empty((6, 6)), np.empty((4, 4)), np.empty(6)
    row = np.empty(6)
    for iteration in range(_ITERATIONS):
        _place(returns, position, error, at)
        for i in range(len(returns)):
            codes[i] = _associated(position[0] + at[i, 0], position[1] + at[i, 1], at[i, 2], cells)
        normal[:], fake[:], gradient[:] = 0.0, 0.0, 0.0
        tolerance = _TOLERANCE if iteration else _FIRST_TOLERANCE
        unsure = 1.0 if iteration < _WIDE_ITERATIONS else 0.0
        for i in range(len(returns)):
            if codes[i] >= 0:
                _add_return(
                    codes[i], at[i], position, cells, wall_variance, ground_variance,
                    share, tolerance**2, unsure, covariance, row, normal, fake, gradient,
                )  # fmt: skip
        step = _step(
            normal, fake, gradient, error, precision, tilt_precision, weight, caution, information
        )
        error -= step
        if iteration > 0 and abs(step[0]) + abs(step[1]) < _CONVERGED:
            break
    return _agreement(at, codes, position, cells)


@inlined_kernel
def _place(returns, position, error, at):
    """Where returns are for an error: x and y from the prior position, z in the map."""
    cos, sin = np.cos(error[2]), np.sin(error[2])
    for i in range(len(returns)):
        x = cos * returns[i, 0] - sin * returns[i, 1]
        y = sin * returns[i, 0] + cos * returns[i, 1]
        at[i, 0], at[i, 1] = error[0] + x, error[1] + y
        at[i, 2] = position[2] + returns[i, 2] + error[3] + error[4] * y - error[5] * x


@inlined_kernel
def _associated(x, y, z, cells):
    """Code of the wall (even) or plane (odd) that a return is compared with, or why of none."""
    lowest, corner_x, corner_y, per_metre = cells[0], cells[5], cells[6], cells[7]
    u, v = (x - corner_x) * per_metre, (y - corner_y) * per_metre
    rows, columns = lowest.shape
    if not (2.0 <= u < columns - 2.0 and 2.0 <= v < rows - 2.0):
        return _NOTHING
    ix, iy = int(u), int(v)
    ground = lowest[iy, ix]
    if ground > _NO_GROUND or z > ground + ELEVATED:
        return _wall_near(x, y, z, ix, iy, cells)
    k = cells[2][iy, ix]
    if k < 0:
        return _NOTHING
    is_near = abs(_above_plane(k, u - ix, v - iy, z, cells)) < _HEIGHT_REACH
    return 2 * k + 1 if is_near else _CONTRADICTED


@inlined_kernel
def _wall_near(x, y, z, ix, iy, cells):
    """Code of the wall whose mean place is the nearest one to a return."""
    wall_of, walls, per_metre = cells[1], cells[3], cells[7]
    nearest, best = -1, (_REACH / per_metre) ** 2
    for j in range(iy - 2, iy + 3):
        for i in range(ix - 2, ix + 3):
            k = wall_of[j, i]
            if k >= 0:
                squared = (walls[k, 0] - x) ** 2 + (walls[k, 1] - y) ** 2
                if squared < best:
                    nearest, best = k, squared
    if nearest < 0:
        return _CONTRADICTED if cells[9][iy, ix] else _NOTHING
    is_line = walls[nearest, 2] == walls[nearest, 2]
    return 2 * nearest if is_line and z < walls[nearest, 8] + _ABOVE_TOP else _NOTHING


@inlined_kernel
def _above_plane(k, u, v, z, cells):
    """Height [m] above a plane, at a place (u, v) [cells] in its middle cell."""
    planes, per_metre = cells[4], cells[7]
    x, y = (u - 0.5) / per_metre, (v - 0.5) / per_metre
    return z - (planes[k, 0] + planes[k, 1] * x + planes[k, 2] * y)


@inlined_kernel
def _plane_residual(k, x, y, z, cells):
    """The same, at a place (x, y) [m, map] whose cell is the plane's middle one."""
    u, v = (x - cells[5]) * cells[7], (y - cells[6]) * cells[7]
    return _above_plane(k, u - np.floor(u), v - np.floor(v), z, cells)


@inlined_kernel
def _add_return(  # noqa: PLR0913
    code, at, position, cells, wall_variance, ground_variance, share, tolerance, unsure,
    covariance, row, normal, fake, gradient,
):  # fmt: skip
    """Add a return's part to the normal equations and to the information that noise fakes."""
    walls, planes = cells[3], cells[4]
    k = code // 2
    x, y = at[0], at[1]
    row[3:] = 0.0
    if code % 2 == 0:
        nx, ny = walls[k, 2], walls[k, 3]
        residual = nx * (position[0] + x - walls[k, 4]) + ny * (position[1] + y - walls[k, 5])
        variance = wall_variance + walls[k, 7]
        row[0], row[1], row[2] = nx, ny, -nx * y + ny * x
        noise = walls[k, 6]
    else:
        residual = -_plane_residual(k, position[0] + x, position[1] + y, at[2], cells)
        variance = ground_variance + planes[k, 3] ** 2
        row[0], row[1] = planes[k, 1], planes[k, 2]
        row[2] = -row[0] * y + row[1] * x
        row[3], row[4], row[5] = -1.0, -y, x
        noise = planes[k, 4]
        unknown = _across(row[0], row[1], covariance)
        if unknown > (row[0] ** 2 + row[1] ** 2) * _SLOPE_UNSURE**2:
            # Which slope this is cannot be told: the return tells z and tilt alone.
            variance += unknown
            row[0] = row[1] = row[2] = noise = 0.0
    prior = _square(row, covariance)
    if code % 2 == 0 and prior > _UNSURE**2:
        return
    wide = variance * tolerance + unsure * prior
    weight = share / variance / (1.0 + residual**2 / wide) ** 2
    for a in range(6):
        gradient[a] += weight * row[a] * residual
        for b in range(6):
            normal[a, b] += weight * row[a] * row[b]
    noise *= weight
    if code % 2 == 0:
        # The normal turns: its change is along the wall.
        _add_square(-row[1], row[0], row[1] * y + row[0] * x, noise, fake)
    else:
        _add_square(1.0, 0.0, -y, noise, fake)
        _add_square(0.0, 1.0, x, noise, fake)


@inlined_kernel
def _across(x, y, covariance):
    """Variance that the prior gives a shift along (x, y), times the square of its length."""
    return x * (x * covariance[0, 0] + 2.0 * y * covariance[0, 1]) + y * y * covariance[1, 1]


@inlined_kernel
def _square(row, covariance):
    """Variance that the prior gives a residual."""
    total = 0.0
    for a in range(4):
        for b in range(4):
            total += row[a] * row[b] * covariance[a, b]
    return total


@inlined_kernel
def _add_square(x, y, yaw, factor, matrix):
    """Add the outer product of (x, y, yaw, 0) with itself."""
    row = (x, y, yaw)
    for a in range(3):
        for b in range(3):
            matrix[a, b] += factor * row[a] * row[b]


@kernel
def _step(  # noqa: PLR0913
    normal, fake, gradient, error, precision, tilt_precision, weight, caution, information,
):  # fmt: skip
    """What is to be taken from the error (6,) next; fills in the information (4, 4)."""
    tilt = normal[4:, 4:].copy()
    tilt[0, 0] += tilt_precision
    tilt[1, 1] += tilt_precision
    of_tilt = gradient[4:] + tilt_precision * error[4:]
    between = normal[:4, 4:].copy()
    reduced = normal[:4, :4] - between @ np.linalg.solve(tilt, between.T.copy())
    reduced_gradient = gradient[:4] - between @ np.linalg.solve(tilt, of_tilt)
    kept, kept_gradient = _discounted(reduced, reduced_gradient, fake, weight, caution)
    information[:, :] = kept
    step = np.empty(6)
    step[:4] = np.linalg.solve(kept + precision, kept_gradient + precision @ error[:4])
    step[4:] = np.linalg.solve(tilt, of_tilt - between.T.copy() @ step[:4])
    return step


@kernel
def _discounted(information, gradient, fake, weight, caution):
    """Information (4, 4) and gradient (4,) without what noise of the map explains.

    With A + eps I = C C^T and C^-1 F C^-T = U diag(f) U^T, the share rho = max(1 - weight f, 0) of
    a direction counts, and s = rho / (1 + caution f) of what is to be corrected along it.
    """
    root = np.linalg.cholesky(information + _REGULAR * np.eye(4))
    half = np.linalg.solve(root, fake)
    faked = np.linalg.solve(root, half.T.copy())
    values, axes = np.linalg.eigh(0.5 * (faked + faked.T))
    values = np.maximum(values, 0.0)
    counted = np.maximum(1.0 - weight * values, 0.0)
    kept = counted / (1.0 + caution * values)
    across = root @ axes
    along = axes.T.copy() @ np.linalg.solve(root, gradient)
    return (across * (counted * kept)) @ across.T.copy(), across @ (kept * along)


@inlined_kernel
def _agreement(at, codes, position, cells):
    """The counts of `Update`, and the mean distance [m]."""
    corner_x, corner_y, per_metre, is_near = cells[5], cells[6], cells[7], cells[8]
    rows, columns = is_near.shape
    near = known = agreeing = contradicted = 0
    total = 0.0
    for i in range(len(codes)):
        u = (position[0] + at[i, 0] - corner_x) * per_metre
        v = (position[1] + at[i, 1] - corner_y) * per_metre
        near += 0.0 <= u < columns and 0.0 <= v < rows and is_near[int(v), int(u)]
        if codes[i] == _NOTHING:
            continue
        known += 1
        distance = FIT
        if codes[i] >= 0:
            distance = abs(_distance(codes[i], at[i], position, cells))
        else:
            contradicted += abs(at[i, 2] - cells[0][int(v), int(u)]) >= _STANDING
        agreeing += distance < FIT
        total += min(distance, FIT)
    return near, known, agreeing, contradicted, total / max(known, 1)


@inlined_kernel
def _distance(code, at, position, cells):
    """Of a return from its wall or plane [m]."""
    walls, k = cells[3], code // 2
    x, y = position[0] + at[0], position[1] + at[1]
    if code % 2:
        return _plane_residual(k, x, y, at[2], cells)
    return walls[k, 2] * (x - walls[k, 4]) + walls[k, 3] * (y - walls[k, 5])


def compile_kernels(params: ScanFilterParams) -> None:
    """Compile, or load from numba's cache."""
    landmarks = sample_landmarks()
    update_by_returns(np.zeros((1, 3)), np.zeros(3), np.eye(4), landmarks, params)
