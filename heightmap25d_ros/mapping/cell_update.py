# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's update of one cell, by eq. (1) to (4) of Fong et al. (2003).

`hit` updates the cell in which a beam ends, `miss` a cell that a beam passes over; both take and
return the four numbers of a cell. Heights are in centimetres, probabilities in stored units.
`mapper` calls them for the cells of each beam.

Both are inlined into the kernels of `mapper`: there numba would otherwise count references to the
arrays for every beam, which costs more than the update.
"""

from __future__ import annotations

from typing import NamedTuple

from heightmap25d_ros.grid.height_map import PROBABILITY_SCALE
from heightmap25d_ros.kernels import inlined_kernel


class Likelihoods(NamedTuple):
    """P(.|O) and P(.|not O) of a reading, each at range 0 and at ``max_range`` [m].

    In between they go with the range, or with its square.
    """

    given_object: tuple[float, ...]
    given_empty: tuple[float, ...]
    max_range: float
    is_quadratic: bool


class Rule(NamedTuple):
    """`MapperParams` and `LevelsParams` in the units of the stored cells.

    ``layers`` are those above the lowest surface; without any ``clear`` is higher than any height.
    """

    candidate: bool
    tolerance: int
    allowance: int
    clearing_width: float
    clearing_margin: float
    clearing_fall: float
    known: int
    lowest: int
    highest: int
    replace_belief: float
    candidate_belief: int
    layers: int
    clear: int


@inlined_kernel
def _likelihoods(distance, model):
    """P(.|O) and P(.|not O) of a reading at a distance [m]."""
    far = min(distance / model.max_range, 1.0)
    if model.is_quadratic:
        far *= far
    near_object, far_object = model.given_object
    near_empty, far_empty = model.given_empty
    return near_object + far * (far_object - near_object), near_empty + far * (
        far_empty - near_empty
    )


@inlined_kernel
def _stored(probability, rule):
    """The stored value of a probability, clamped so that the cell can still change."""
    return min(max(int(probability * PROBABILITY_SCALE + 0.5), rule.lowest), rule.highest)


@inlined_kernel
def _bayes(stored, given_object, given_empty, rule):
    """Eq. (4), with P(s|not O) in the second term, as the text under it has it."""
    for_object = given_object * stored
    for_empty = given_empty * (PROBABILITY_SCALE - stored)
    return _stored(for_object / (for_object + for_empty), rule)


@inlined_kernel
def hit(cell, z, distance, model, rule):
    """A cell after a return at height z [cm].

    A cell is (height, probability, candidate height, candidate probability).
    """
    height, probability, candidate_height, candidate = cell
    given_object, given_empty = _likelihoods(distance, model)
    if probability < rule.known:
        return z, _stored(given_object, rule), 0, 0  # eq. (1), (2)
    if z > height + rule.tolerance:
        if given_object < rule.replace_belief:
            return cell
        if rule.candidate:
            return _propose(cell, z, given_object, given_empty, rule)
        return z, _stored(given_object, rule), 0, 0  # eq. (1), (2)
    if z >= height - rule.tolerance:
        belief = _bayes(probability, given_object, given_empty, rule)
        height = max(z - rule.allowance, height)
        if candidate_height <= height + rule.tolerance:
            candidate = 0  # the height has reached it
        return height, belief, candidate_height, candidate  # eq. (3), (4)
    return cell


@inlined_kernel
def _propose(cell, z, given_object, given_empty, rule):
    """A cell after a reading far above its height: the paper's candidate.

    Two such readings support the lower one of them, because objects are complete from the
    ground up: what is seen at 2 m is also there at 1 m. The higher one remains a candidate,
    unless the two are the same height within the tolerance.
    """
    height, probability, candidate_height, candidate = cell
    if candidate == 0:
        return height, probability, z, _stored(given_object, rule)
    lower, higher = min(z, candidate_height), max(z, candidate_height)
    is_same = higher - lower <= rule.tolerance
    supported = higher if is_same else lower
    belief = _bayes(candidate, given_object, given_empty, rule)
    if belief < rule.candidate_belief:
        return height, probability, supported, belief
    return supported, belief, higher, 0 if is_same else _stored(given_object, rule)


@inlined_kernel
def miss(cell, beam_height, distance, model, rule):
    """A cell after a beam passed over it: heights at or above the beam lose probability.

    A candidate so high above the beam that the robot fits in between does not: it may hang there.
    """
    height, probability, candidate_height, candidate = cell
    given_object, given_empty = _likelihoods(distance, model)
    if candidate > 0 and 0 <= candidate_height - beam_height < rule.clear:
        candidate = _bayes(candidate, given_object, given_empty, rule)
        candidate = candidate if candidate >= rule.known else 0
    if probability >= rule.known and height >= beam_height:
        probability = _bayes(probability, given_object, given_empty, rule)
    return height, probability, candidate_height, candidate


@inlined_kernel
def is_contradicted(cell, beam_height, rule):
    """Whether `miss` changes a cell."""
    height, probability, candidate_height, candidate = cell
    stands = height >= beam_height and probability >= rule.known
    return stands or (candidate > 0 and 0 <= candidate_height - beam_height < rule.clear)
