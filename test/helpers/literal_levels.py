# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of cells with several surfaces again, as slowly and literally as they are written.

A cell is the lowest surface, as in `literal_mapper`, a list of decks above it, and what is hidden
below it as long as it does not hang in the air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from literal_mapper import Cell, LiteralMap


@dataclass
class Deck(Cell):
    bottom: int = 0


@dataclass
class LiteralLevels(LiteralMap):
    levels: object = None
    decks: dict[tuple[int, int], list[Deck]] = field(default_factory=dict)
    hidden: dict[tuple[int, int], Cell] = field(default_factory=dict)
    surplus: int = 0

    @property
    def clear(self) -> int:
        return round(100 * self.levels.clear_height)

    @property
    def tolerance(self) -> int:
        return round(100 * self.rule.height_tolerance)

    def above(self, index) -> list[Deck]:
        return self.decks.setdefault(index, [])

    def has_room(self, index) -> bool:
        return len(self.above(index)) < self.levels.max_surfaces - 1

    # What a beam passes.

    def beam(self, origin, end, is_hit, judged) -> None:
        length = math.dist(origin, end)
        first, last = self.cell_of(origin), self.cell_of(end)
        careful = self.rule.update_rule == "candidate"
        for index, t in self.crossed(origin, end):
            if index in (first, last) or index not in self.cells:
                continue
            height = 100 * (origin[2] + t * (end[2] - origin[2]))
            margin = self.margin(origin, end, (1 - t) * length) if careful else 0.0
            entry = height + margin - (100 * self.rule.clearing_margin if careful else 0.0)
            entry += self.half_fall(index, origin, end)
            if not self.contradicts(index, height + margin, entry):
                continue
            if careful and not self.is_central(index, origin, end):
                continue
            if not careful or index not in judged:
                self.pass_cell(index, height + margin, entry, t * length, 100 * origin[2])
            judged.add(index)
        if is_hit:
            self.read(last, math.floor(100 * end[2] + 0.5), length)

    def half_fall(self, index, origin, end) -> float:
        """[cm] half of what a beam falls, from its upper end on, within a cell."""
        lines = [
            sorted(
                (line * self.resolution - origin[axis]) / (end[axis] - origin[axis])
                for line in (i, i + 1)
            )
            for axis, i in ((0, index[1]), (1, index[0]))
            if end[axis] != origin[axis]
        ]
        enter, leave = max(a for a, _ in lines), min(b for _, b in lines)
        return 50 * (leave - enter) * abs(end[2] - origin[2])

    def is_over_bottom(self, deck: Deck, entry: float) -> bool:
        return entry >= min(deck.bottom, deck.height - self.tolerance)

    def waits(self, surface: Cell, beam_height: float) -> bool:
        candidate = surface.candidate
        return candidate is not None and 0 <= candidate[0] - beam_height < self.clear

    def contradicts(self, index, beam_height, entry) -> bool:
        lowest = self.cells[index]
        if self.is_known(lowest.probability) and lowest.height >= beam_height:
            return True
        return self.waits(lowest, beam_height) or any(
            deck.height >= beam_height or self.waits(deck, beam_height)
            for deck in self.above(index)
            if self.is_over_bottom(deck, entry)
        )

    def pass_cell(self, index, beam_height, entry, distance, sensor) -> None:
        lowest, decks = self.cells[index], self.above(index)
        for deck in [deck for deck in decks if self.is_over_bottom(deck, entry)]:
            self.weaken(deck, beam_height, distance, deck.height >= beam_height)
            if not self.is_known(deck.probability):
                decks.remove(deck)
        before = Deck(lowest.height, lowest.probability, lowest.candidate, bottom=lowest.height)
        is_known = self.is_known(lowest.probability)
        self.weaken(lowest, beam_height, distance, is_known and lowest.height >= beam_height)
        if is_known and not self.is_known(lowest.probability):
            hidden = self.hidden.pop(index, Cell())
            if self.is_overhead(lowest.height, beam_height, sensor) and self.has_room(index):
                decks.append(before)
                self.cells[index] = hidden

    def is_overhead(self, height, beam_height, sensor) -> bool:
        if height - beam_height >= self.clear:
            return True
        return height - beam_height >= 2 * self.tolerance and height - sensor >= self.clear

    def weaken(self, surface, beam_height, distance, is_contradicted) -> None:
        given_object = self.likelihood(self.sensor.miss_given_object, distance)
        given_empty = self.likelihood(self.sensor.miss_given_empty, distance)
        if self.waits(surface, beam_height):
            belief = self.bayes(surface.candidate[1], given_object, given_empty)
            surface.candidate = (surface.candidate[0], belief) if self.is_known(belief) else None
        if is_contradicted:
            surface.probability = self.bayes(surface.probability, given_object, given_empty)

    # What a beam meets.

    def read(self, index, z, distance) -> None:
        lowest = self.cells.setdefault(index, Cell())
        decks = sorted(self.above(index), key=lambda deck: deck.bottom)
        is_ground = self.is_known(lowest.probability)
        over = [deck for deck in decks if deck.bottom - self.tolerance > z]
        under = [deck for deck in decks if deck.bottom - self.tolerance <= z]
        upper = over[0] if over else None
        if under:
            surface = under[-1]
            if z <= surface.height + self.tolerance:
                self.hit(surface, max(z, surface.height - self.tolerance), distance)
                surface.bottom = min(surface.bottom, z)
                return
        elif is_ground and z < lowest.height - self.tolerance:
            if lowest.height - z >= self.clear:
                self.hit(self.hidden.setdefault(index, Cell()), z, distance)
            return
        else:
            surface = lowest
        is_on_something = bool(under) or is_ground
        is_clear = not is_on_something or z - surface.height >= self.clear
        if is_clear and upper is not None and upper.bottom - z < self.clear:
            upper.bottom = z
            return
        self.place(index, surface, upper, z, distance, is_on_something)

    def place(self, index, surface, upper, z, distance, is_on_something) -> None:
        before = (surface.height, surface.probability, surface.candidate)
        is_higher = is_on_something and z > surface.height + self.tolerance
        if is_higher and surface.candidate and abs(surface.candidate[0] - z) >= self.clear:
            given = self.likelihood(self.sensor.hit_given_object, distance)
            if given >= self.rule.replace_belief:
                surface.candidate = None
        held = surface.candidate
        self.hit(surface, z, distance)
        rise = surface.height - before[0]
        if not is_on_something:
            return
        if rise >= self.clear:
            raised = Deck(surface.height, surface.probability, surface.candidate)
            raised.bottom = min(z, held[0]) if held else z
            surface.height, surface.probability, surface.candidate = before
            if not self.has_room(index):
                self.surplus += 1
                return
            surface.candidate = None
            self.above(index).append(raised)
        elif rise > self.tolerance and upper and upper.bottom - surface.height < self.clear:
            surface.height, surface.probability = upper.height, upper.probability
            surface.candidate = upper.candidate
            self.above(index).remove(upper)
