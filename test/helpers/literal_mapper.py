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

    def scan(self, origins, ends, is_hit, is_lone) -> None:
        """The beams of a scan. By the candidate rule a return that stands alone is no beam, the
        cells that the scan hits lose no belief in it, and no cell loses belief twice.
        """
        careful = self.rule.update_rule == "candidate"
        judged: set[tuple[int, int]] = set()
        if careful:
            judged = {
                self.cell_of(end)
                for end, hit, lone in zip(ends, is_hit, is_lone, strict=True)
                if hit and not lone
            }
        for origin, end, hit, lone in zip(origins, ends, is_hit, is_lone, strict=True):
            if not (careful and lone):
                self.beam(origin, end, hit, judged)

    def cell_of(self, point) -> tuple[int, int]:
        return math.floor(point[1] / self.resolution), math.floor(point[0] / self.resolution)

    def beam(self, origin, end, is_hit: bool, judged: set[tuple[int, int]]) -> None:
        length = math.dist(origin, end)
        first, last = self.cell_of(origin), self.cell_of(end)
        for index, t in self.crossed(origin, end):
            if index not in (first, last) and index in self.cells:
                height = 100 * (origin[2] + t * (end[2] - origin[2]))
                if self.rule.update_rule == "paper":
                    self.passed(self.cells[index], height, t * length)
                    continue
                height += self.margin(origin, end, (1 - t) * length)
                if self.stands_in(self.cells[index], height) and self.is_central(
                    index, origin, end
                ):
                    if index not in judged:
                        self.passed(self.cells[index], height, t * length)
                    judged.add(index)
        if is_hit:
            self.hit(self.cells.setdefault(last, Cell()), math.floor(100 * end[2] + 0.5), length)

    def margin(self, origin, end, to_end: float) -> float:
        """[cm] by which a height must exceed that of the beam: all of it for a beam that falls or
        rises enough, or on its last metre, and one centimetre less than nothing for a level one;
        between, in proportion.
        """
        fall = abs(end[2] - origin[2])
        if fall >= self.rule.clearing_fall or to_end < 1.0:
            return 100 * self.rule.clearing_margin
        steepness = fall / self.rule.clearing_fall
        return steepness * 100 * self.rule.clearing_margin - (1 - steepness)

    def stands_in(self, cell: Cell, beam_height: float) -> bool:
        stored = self.is_known(cell.probability) and cell.height >= beam_height
        return stored or (cell.candidate is not None and cell.candidate[0] >= beam_height)

    def is_central(self, index, origin, end) -> bool:
        """Whether the cell's centre is within half the width of the line, seen from above."""
        center = [(i + 0.5) * self.resolution for i in (index[1], index[0])]
        dx, dy = end[0] - origin[0], end[1] - origin[1]
        across = (center[0] - origin[0]) * dy - (center[1] - origin[1]) * dx
        width = self.rule.clearing_width * self.resolution
        return abs(across) <= width / 2 * math.hypot(dx, dy)

    def passed(self, cell: Cell, beam_height: float, distance: float) -> None:
        given_object = self.likelihood(self.sensor.miss_given_object, distance)
        given_empty = self.likelihood(self.sensor.miss_given_empty, distance)
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
            allowance = 0 if self.rule.update_rule == "paper" else self.rule.height_allowance
            cell.height = max(cell.height, height - round(100 * allowance))
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
