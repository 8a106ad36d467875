# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of all squares of four cells at once: where `branch_and_bound` begins to divide.

Few larger squares could be dropped: some cell in the window of nearly each point fits. Squares of
four cells are bounded side by side, a point at a time: the windows of the next square along a row
are four cells farther, and so the windows of each fourth cell are kept beside one another. What
the processor then does in one instruction for several squares takes a tenth of the time.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.localization.branch_and_bound import ROOT, Ground, Turned, caps_of
from heightmap25d_ros.localization.height_pyramid import ANYWHERE, LEVELS, NOTHING, Phases

_LANES = 32  # squares that are bounded side by side
_LOOK = 8  # points from one look whether all these are above the limit to the next
_STRIP = 65_536  # squares of a strip, about: some milliseconds


class Sweep:
    """Finds the squares of four cells that can hold a pose within a limit, strip by strip.

    Parameters
    ----------
    seen : Turned
    phases : Phases
        Of the map.
    ground : Ground
    within : (row, column, radius) [cells]
        A circle outside of which no square is wanted.

    Attributes
    ----------
    strips : list of (int, int)
        Yaw, and first row of squares.
    """

    def __init__(
        self, seen: Turned, phases: Phases, ground: Ground, within: tuple[float, float, float]
    ) -> None:
        self._seen, self._phases, self._ground, self._within = seen, phases, ground, within
        rows, columns = ground.levels[-1].shape[:2]
        self._rows = max(_STRIP // columns, 1)
        self._caps = np.empty(0, np.float32)
        self._limit = np.nan
        row, column, radius = within
        first = int(max(row - radius, 0.0) // ROOT)
        end = int(min(row + radius, ROOT * rows - 1.0) // ROOT) + 1
        if column + radius < 0.0 or column - radius >= ROOT * columns:
            end = 0
        # All yaws of the same rows, one after the other, read the same part of the map.
        starts = range(first, end, self._rows)
        self.strips = [(yaw, start) for start, yaw in product(starts, range(len(seen.rows)))]

    def roots(self, strip: tuple[int, int], limit: float) -> NDArray[np.int32]:
        """Nodes (K, 4) of a strip whose bound is within a limit [cm]."""
        yaw, start = strip
        phases, ground = self._phases, self._ground
        if limit != self._limit:
            self._caps, self._limit = self._caps_at(limit), limit
        there = ground.levels[-1]
        end = min(start + self._rows, there.shape[0])
        found = np.empty(((end - start) * there.shape[1], 4), np.int32)
        count = _sweep(
            *self._seen, phases.low, phases.high, self._caps, there, ground.slack, ground.pad, yaw,
            (start, end), self._within, limit, ground.unknown - limit, found,
        )  # fmt: skip
        return found[:count]

    def _caps_at(self, limit: float) -> NDArray[np.float32]:
        """(2, 4, 4, rows, columns) [cm]: as `_sweep` takes them."""
        caps, is_uncounted = caps_of(self._ground.clip, self._ground.unknown, limit)
        signed = np.where(is_uncounted > 0.0, -caps, caps)
        return np.stack([signed[:16][self._phases.flags], signed[16:][self._phases.flags]])


@kernel
def _sweep(  # noqa: PLR0913
    rows, columns, heights, kind, weight, low, high, caps, there, slack, pad, w, band, within,
    limit, excess, found,
):  # fmt: skip
    """Squares at a yaw whose bound is within a limit; returns how many.

    Parameters
    ----------
    rows, columns, heights, kind, weight
        Of `branch_and_bound.Turned`.
    low, high
        Of `height_pyramid.Phases`.
    caps : (2, 4, 4, rows, columns) float32 [cm]
        Highest cost of points that are no edges, and of edges; negative where they do not count.
    there : (rows, columns, 2) int16 [cm]
        Ground of the squares (`HeightPyramid.ground`).
    slack, limit, excess : float [cm]
        Excess: cost of a point that is missing at half of all, above the limit.
    pad : int [cells]
    w : int
        The yaw.
    band : (int, int)
        First row of squares, and that after the last one.
    within : (row, column, radius) [cells]
    found : (K, 4) int32
        Filled in; room for all squares of the band.
    """
    middle_y, middle_x, radius = within
    limit, excess = np.float32(limit), np.float32(excess)
    total, missing = np.empty(_LANES, np.float32), np.empty(_LANES, np.float32)
    lowest, highest = np.empty(_LANES, np.float32), np.empty(_LANES, np.float32)
    count = 0
    for y in range(band[0], band[1]):
        off = max(abs((y + 0.5) * ROOT - middle_y) - 0.5 * ROOT, 0.0)
        if off > radius:
            continue
        reach = np.sqrt(radius * radius - off * off) if radius < np.inf else np.inf
        first = int(max((middle_x - reach) / ROOT, 0.0))
        end = int(min((middle_x + reach) / ROOT + 1.0, there.shape[1] * 1.0))
        for begin in range(first, end, _LANES):
            lanes = min(_LANES, end - begin)
            if not _stand(there[y, begin : begin + lanes], slack, total, lowest, highest):
                continue
            missing[:] = 0.0
            _sum(
                rows[w], columns[w], heights, kind, weight, low, high, caps, pad, y, begin,
                total[:lanes], missing[:lanes], lowest, highest, limit,
            )  # fmt: skip
            for k in range(lanes):
                bound = total[k] + max(missing[k] - np.float32(0.5), np.float32(0.0)) * excess
                if bound <= limit:
                    found[count, 0], found[count, 1] = w, LEVELS - 1
                    found[count, 2], found[count, 3] = y * ROOT, (begin + k) * ROOT
                    count += 1
    return count


@kernel
def _stand(there, slack, total, lowest, highest):
    """Heights of the ground of squares; whether the robot can stand in any of them."""
    can_stand = False
    for k in range(len(there)):
        lowest[k], highest[k] = there[k, 0] - slack, there[k, 1] + slack
        is_ground = there[k, 0] != NOTHING
        total[k] = 0.0 if is_ground or slack == np.inf else np.inf
        if slack == np.inf:
            lowest[k], highest[k] = -ANYWHERE, ANYWHERE
        can_stand |= total[k] == 0.0
    return can_stand


@kernel
def _sum(  # noqa: PLR0913
    rows, columns, heights, kind, weight, low, high, caps, pad, y, begin, total, missing, lowest,
    highest, limit,
):  # fmt: skip
    """Add up the least costs of points in squares side by side."""
    lanes = len(total)
    for i in range(len(heights)):
        row, column = pad + rows[i], pad + columns[i]
        py, px = row % ROOT, column % ROOT
        iy, ix = y + row // ROOT, begin + column // ROOT
        part = weight[i]
        first, end = min(max(-ix, 0), lanes), min(max(low.shape[3] - ix, 0), lanes)
        if not 0 <= iy < low.shape[2]:
            first = end = lanes
        for k in range(first):
            total[k] += part * limit
            missing[k] += part
        for k in range(end, lanes):
            total[k] += part * limit
            missing[k] += part
        if first < end:
            _add(
                total[first:end], missing[first:end], lowest[first:end], highest[first:end],
                low[py, px, iy, ix + first : ix + end], high[py, px, iy, ix + first : ix + end],
                caps[kind[i] // 16, py, px, iy, ix + first : ix + end], heights[i], part,
            )  # fmt: skip
        if i % _LOOK == _LOOK - 1:
            least = np.float32(np.inf)
            for k in range(lanes):
                least = min(least, total[k])
            if least > limit:
                break


@kernel
def _add(  # noqa: PLR0913
    total, missing, lowest, highest, low, high, caps, height, part,
):  # fmt: skip
    """Add the cost of a point."""
    for k in range(len(total)):
        above = np.float32(low[k]) - (height + highest[k])
        below = (height + lowest[k]) - np.float32(high[k])
        off = max(above, below, np.float32(0.0))
        total[k] += part * min(off, abs(caps[k]))
        missing[k] += part if caps[k] < np.float32(0.0) else np.float32(0.0)
