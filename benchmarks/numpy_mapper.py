# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapper as vectorised numpy, behind the interface of `heightmap25d_ros.mapper.Mapper`.

A scan at a time: all beams are sampled twice a cell, the samples become cells, and eq. (1) to
(4) and the free space are array expressions over them. Readings of a scan that share a cell are
merged first (their highest counts), so the map is close to the mapper's, not equal to it.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import MapperParams, SensorParams

SAMPLES_PER_CELL = 2
SIDE = 1024  # of the dense arrays, around the middle of the grid's extent [cells]


class NumpyMapper:
    """As `Mapper` with the rule ``paper``, on dense arrays."""

    def __init__(self, grid: HeightGrid, sensor: SensorParams, params: MapperParams) -> None:
        self.resolution = grid.geometry.resolution
        self.sensor, self.params = sensor, params
        self.height = np.zeros((SIDE, SIDE), np.int16)
        self.probability = np.zeros((SIDE, SIDE))

    def integrate(self, beams: Beams) -> None:
        """Merge the beams of a scan."""
        self._clear(beams)
        self._hit(beams)

    def _likelihoods(self, distance, given_object, given_empty):
        far = np.minimum(distance / self.sensor.max_range, 1.0)
        return (
            given_object[0] + far * (given_object[1] - given_object[0]),
            given_empty[0] + far * (given_empty[1] - given_empty[0]),
        )

    def _bayes(self, prior, given_object, given_empty):
        for_object = given_object * prior
        belief = for_object / (for_object + given_empty * (1.0 - prior))
        return np.clip(belief, self.params.probability_min, self.params.probability_max)

    def _cells(self, points):
        return np.floor(points[..., :2] / self.resolution).astype(np.int64) + SIDE // 2

    def _clear(self, beams: Beams) -> None:
        way = beams.ends - beams.origins
        length = np.linalg.norm(way, axis=1)
        count = np.ceil(length / self.resolution * SAMPLES_PER_CELL).astype(np.int64)
        beam = np.repeat(np.arange(len(count)), count)
        sample = np.arange(len(beam)) - np.repeat(np.cumsum(count) - count, count)
        t = (sample + 0.5) / count[beam]
        points = beams.origins[beam] + t[:, None] * way[beam]
        cells = self._cells(points)
        ix, iy = cells[:, 0], cells[:, 1]
        last = self._cells(beams.ends)[beam]
        stands = (
            (self.height[iy, ix] * HEIGHT_RESOLUTION >= points[:, 2])
            & (self.probability[iy, ix] >= self.params.probability_threshold)
            & (cells != last).any(axis=1)
        )
        flat, first = np.unique(iy[stands] * SIDE + ix[stands], return_index=True)
        if not len(flat):
            return
        given = self._likelihoods(
            (t * length[beam])[stands][first],
            self.sensor.miss_given_object,
            self.sensor.miss_given_empty,
        )
        self.probability.flat[flat] = self._bayes(self.probability.flat[flat], *given)

    def _hit(self, beams: Beams) -> None:
        ends = beams.ends[beams.is_hit]
        distance = np.linalg.norm(ends - beams.origins[beams.is_hit], axis=1)
        cells = self._cells(ends)
        order = np.lexsort((-ends[:, 2], cells[:, 1] * SIDE + cells[:, 0]))
        flat, first = np.unique((cells[:, 1] * SIDE + cells[:, 0])[order], return_index=True)
        chosen = order[first]
        z = np.floor(ends[chosen, 2] / HEIGHT_RESOLUTION + 0.5)
        given = self._likelihoods(
            distance[chosen], self.sensor.hit_given_object, self.sensor.hit_given_empty
        )
        height, probability = self.height.flat[flat], self.probability.flat[flat]
        tolerance = self.params.height_tolerance / HEIGHT_RESOLUTION
        starts = (probability < self.params.probability_threshold) | (
            (z > height + tolerance) & (given[0] >= self.params.replace_belief)
        )
        agrees = ~starts & (np.abs(z - height) <= tolerance)
        self.height.flat[flat] = np.where(
            starts, z, np.where(agrees, np.maximum(z, height), height)
        )
        self.probability.flat[flat] = np.where(
            starts, given[0], np.where(agrees, self._bayes(probability, *given), probability)
        )
