"""Reports that say something else than their robot believes: displaced, or too sure. Beliefs and evidence are changed alike. Pure."""

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from blackboard.opinion.belief import Belief, shift
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, wrap
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.evidence import PackedEvidence, PackedRelative, PackedState, Seen
from blackboard.wire.messages import Informed, Report

AnySighting = TypeVar("AnySighting", PackedRelative, Seen)


def displaced(report: Report, offset: Sequence[float]) -> Report:
    """A report in which all places are off by an offset (unit). Refused: a belief that cannot be read.

    Its beliefs move by whole cells. In its evidence its own place is off, and what it sees from there.
    """
    return _changed(report, lambda belief: moved(belief, offset), lambda evidence: _displaced(evidence, offset))


def overconfident(report: Report, factor: float) -> Report:
    """A report whose sigmas are smaller by a factor. Refused: a belief that cannot be read."""
    return _changed(report, lambda belief: narrowed(belief, factor), lambda evidence: _narrowed(evidence, factor))


def moved(belief: Belief, offset: Sequence[float]) -> Belief:
    """A belief moved by an offset (unit), in whole cells; what would leave the grid stays at its edge."""
    return Belief(belief.grid, shift(belief.p, [round(distance / belief.grid.cell) for distance in offset]))


def narrowed(belief: Belief, factor: float) -> Belief:
    """A belief to the power factor^2: a Gaussian with sigmas that are smaller by the factor."""
    p = (belief.p / belief.p.max()) ** factor**2
    return Belief(belief.grid, p / p.sum())


def _changed(
    report: Report, of_belief: Callable[[Belief], Belief], of_evidence: Callable[[PackedEvidence], PackedEvidence]
) -> Report:
    informed = report.informed
    if informed is not None:
        informed = Informed(belief=pack(of_belief(unpack(informed.belief))), ancestors=informed.ancestors)
    evidence = None if report.evidence is None else of_evidence(report.evidence)
    belief = pack(of_belief(unpack(report.belief)))
    return report.model_copy(update={"belief": belief, "informed": informed, "evidence": evidence})


def _displaced(evidence: PackedEvidence, offset: Sequence[float]) -> PackedEvidence:
    """Evidence whose place, and everything that is seen from the true place, is off by an offset (unit)."""
    state, increment = evidence.state, evidence.increment
    mean = state.mean if state is not None else increment.reference if increment is not None else None
    if state is not None:
        state = state.model_copy(update={"mean": _off(state.mean, offset)})
    if increment is not None:
        increment = increment.model_copy(update={"reference": _off(increment.reference, offset)})
    relatives, seen = evidence.relatives, evidence.seen
    if mean is not None:
        relatives = [_seen_elsewhere(sighting, mean[HEADING], offset) for sighting in relatives]
        seen = [_further_elsewhere(sighting, mean[HEADING], offset) for sighting in seen]
    return evidence.model_copy(update={"state": state, "increment": increment, "relatives": relatives, "seen": seen})


def _off(mean: Sequence[float], offset: Sequence[float]) -> tuple[float, ...]:
    states = np.array(mean)
    states[AXES] += np.array(offset)
    return tuple(float(x) for x in states)


def _seen_elsewhere(sighting: PackedRelative, heading: float, offset: Sequence[float]) -> PackedRelative:
    x = sighting.range * math.cos(heading + sighting.bearing) + offset[0]
    y = sighting.range * math.sin(heading + sighting.bearing) + offset[1]
    return sighting.model_copy(update={"range": math.hypot(x, y), "bearing": float(wrap(math.atan2(y, x) - heading))})


def _further_elsewhere(sighting: Seen, heading: float, offset: Sequence[float]) -> Seen:
    """A sighting of a further kind; a range alone grows by the whole offset. A bearing alone stays: its distance is not known."""
    if sighting.kind == "range":
        return sighting.model_copy(update={"values": (sighting.values[0] + math.hypot(*offset),)})
    if sighting.kind not in ("position", "pose"):
        return sighting
    c, s = math.cos(heading), math.sin(heading)
    x, y = c * offset[0] + s * offset[1], c * offset[1] - s * offset[0]
    return sighting.model_copy(
        update={"values": (sighting.values[0] + x, sighting.values[1] + y, *sighting.values[2:])}
    )


def _narrowed(evidence: PackedEvidence, factor: float) -> PackedEvidence:
    """Evidence with sigmas smaller by a factor, but for those of the motion: their sums may not shrink within an epoch."""
    state, increment, square = evidence.state, evidence.increment, factor**2
    if state is not None:
        state = PackedState(mean=state.mean, covariance=tuple(number / square for number in state.covariance))
    if increment is not None:
        increment = increment.model_copy(
            update={
                "information": tuple(number * square for number in increment.information),
                "vector": tuple(number * square for number in increment.vector),
            }
        )

    def surer(sighting: AnySighting, **variances: object) -> AnySighting:
        biases = [(sigma / factor, seconds) for sigma, seconds in sighting.biases]
        return sighting.model_copy(update={**variances, "biases": biases})

    relatives = [
        surer(s, range_variance=s.range_variance / square, bearing_variance=s.bearing_variance / square)
        for s in evidence.relatives
    ]
    seen = [surer(s, covariance=tuple(number / square for number in s.covariance)) for s in evidence.seen]
    return evidence.model_copy(update={"state": state, "increment": increment, "relatives": relatives, "seen": seen})
