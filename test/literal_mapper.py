# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's update rules again, as slowly and literally as they are written.

Written from the paper and not from the package: a dictionary of cells, every crossing of a beam
with a grid line, one `if` per sentence. Eq. (4) has P(s|not O) in its second term, and a
probability is kept in 16 bits within its bounds, as the map stores it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field


@dataclass
class Cell:
    height: int = 0  # centimetres
    probability: float = 0.0
    candidate: tuple[int, float] | None = None  # height, belief


@dataclass
class LiteralMap:
    """Parameters carry the names that the package's parameters have."""

    resolution: float
    sensor: object
    rule: object
    cells: dict[tuple[int, int], Cell] = field(default_factory=dict)

    def keep(self, probability: float) -> float:
        low = math.floor(self.rule.probability_min * 65535 + 0.5)
        high = math.floor(self.rule.probability_max * 65535 + 0.5)
        return min(max(math.floor(probability * 65535 + 0.5), low), high) / 65535

    def likelihood(self, pair: tuple[float, float], distance: float) -> float:
        share = min(distance / self.sensor.max_range, 1.0)
        return pair[0] + share * (pair[1] - pair[0])

    def bayes(self, prior: float, given_object: float, given_empty: float) -> float:
        return self.keep(given_object * prior / (given_object * prior + given_empty * (1 - prior)))

    def is_known(self, probability: float) -> bool:
        threshold = math.floor(self.rule.probability_threshold * 65535 + 0.5)
        return round(probability * 65535) >= threshold

    def crossed(self, origin, end):
        """((iy, ix), t in the middle of the crossing) for each cell under the beam, in order."""
        crossings = {0.0, 1.0}
        for axis in (0, 1):
            a, b = origin[axis] / self.resolution, end[axis] / self.resolution
            for line in range(math.floor(min(a, b)), math.ceil(max(a, b)) + 1):
                if min(a, b) < line < max(a, b):
                    crossings.add((line - a) / (b - a))
        ordered = sorted(crossings)
        for t0, t1 in itertools.pairwise(ordered):
            middle = (t0 + t1) / 2
            x, y = (origin[k] + middle * (end[k] - origin[k]) for k in (0, 1))
            yield (math.floor(y / self.resolution), math.floor(x / self.resolution)), middle

    def beam(self, origin, end, is_hit: bool) -> None:
        length = math.dist(origin, end)
        first, last = (
            (math.floor(p[1] / self.resolution), math.floor(p[0] / self.resolution))
            for p in (origin, end)
        )
        for index, t in self.crossed(origin, end):
            if index not in (first, last) and index in self.cells:
                height = 100 * (origin[2] + t * (end[2] - origin[2]))
                self.passed(self.cells[index], height, t * length)
        if is_hit:
            self.hit(self.cells.setdefault(last, Cell()), math.floor(100 * end[2] + 0.5), length)

    def passed(self, cell: Cell, beam_height: float, distance: float) -> None:
        given_object = self.likelihood(self.sensor.miss_given_object, distance)
        given_empty = self.likelihood(self.sensor.miss_given_empty, distance)
        if self.rule.update_rule == "candidate":
            beam_height += 100 * self.rule.clearing_margin
            if cell.candidate is not None and cell.candidate[0] >= beam_height:
                belief = self.bayes(cell.candidate[1], given_object, given_empty)
                cell.candidate = (cell.candidate[0], belief) if self.is_known(belief) else None
        if self.is_known(cell.probability) and cell.height >= beam_height:
            cell.probability = self.bayes(cell.probability, given_object, given_empty)

    def hit(self, cell: Cell, height: int, distance: float) -> None:
        given_object = self.likelihood(self.sensor.hit_given_object, distance)
        given_empty = self.likelihood(self.sensor.hit_given_empty, distance)
        tolerance = round(100 * self.rule.height_tolerance)
        if not self.is_known(cell.probability):
            cell.height, cell.probability = height, self.keep(given_object)
            cell.candidate = None
        elif height > cell.height + tolerance:
            if given_object < self.rule.replace_belief:
                return
            if self.rule.update_rule == "paper":
                cell.height, cell.probability = height, self.keep(given_object)
            else:
                self.contradict(cell, height, given_object, given_empty, tolerance)
        elif height >= cell.height - tolerance:
            cell.height = max(cell.height, height)
            if cell.candidate is not None and cell.candidate[0] <= cell.height + tolerance:
                cell.candidate = None  # no longer a contradiction
            cell.probability = self.bayes(cell.probability, given_object, given_empty)

    def contradict(self, cell, height, given_object, given_empty, tolerance) -> None:
        if cell.candidate is None:
            cell.candidate = (height, self.keep(given_object))
            return
        held, belief = cell.candidate
        belief = self.bayes(belief, given_object, given_empty)
        agree = abs(height - held) <= tolerance
        supported = max(height, held) if agree else min(height, held)
        if round(belief * 65535) < math.floor(self.rule.candidate_belief * 65535 + 0.5):
            cell.candidate = (supported, belief)
            return
        cell.height, cell.probability = supported, belief
        cell.candidate = None if agree else (max(height, held), self.keep(given_object))
