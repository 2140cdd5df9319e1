"""A robot that does not tell what it believes: the [[fault]]s of a scenario in what it says. Honest robots do not load this.

What it believes, and what it tells the referee (`Solo`), stays as it is: its reports and statuses are changed just before they are
sent. Everything is computed from the message and the scenario's seed, so a message that is sent again is changed in the same way.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from blackboard.faults import AnyFault, Collude, Freeze, Lie, Lose, Overconfident, Skew
from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, wrap
from blackboard.opinion.grid import Grid
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import PackedEvidence, PackedRelative, PackedState
from blackboard.wire.messages import Informed, Report, Status
from robot_agent.service import AgentService


class FaultyRobot(AgentService):
    """An `AgentService` under some faults."""

    def __init__(self, faults: Sequence[AnyFault], seed: int, **arguments: Any) -> None:
        """`arguments` are those of `AgentService`; `seed` decides which reports are lost."""
        super().__init__(**arguments)
        self._faults = [fault for fault in faults if self.robot in fault.names]
        self._seed = seed

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        return self._said(super().receive(envelope, now))

    def wake(self, now: float) -> list[Envelope]:
        return self._said(super().wake(now))

    def _said(self, out: list[Envelope]) -> list[Envelope]:
        faults = [fault for fault in self._faults if fault.concerns(self.robot, self.time)]
        if not faults or self.tick < 0:
            return out
        if any(isinstance(fault, Freeze) for fault in faults):
            return []
        return [changed for envelope in out if (changed := self._changed(envelope, faults)) is not None]

    def _changed(self, envelope: Envelope, faults: Sequence[AnyFault]) -> Envelope | None:
        """What is sent instead of an envelope; None: nothing."""
        lose = [fault.share for fault in faults if isinstance(fault, Lose)]
        if keys.REPORT.match(envelope.key):
            report = decode(Report, envelope.payload)
            if any(is_lost(self._seed, report, share) for share in lose):
                return None
            for fault in faults:
                report = changed(report, fault, self.grid)
            return Envelope(envelope.key, encode(report))
        if keys.STATUS.match(envelope.key):
            status = decode(Status, envelope.payload)
            skew = sum(fault.seconds for fault in faults if isinstance(fault, Skew))
            subjects = status.subjects
            if self.clock.pace is Pace.LOCKSTEP:  # a board would wait in each tick for a report that is listed
                lost = {r.subject for r in self._reports if any(is_lost(self._seed, r, share) for share in lose)}
                subjects = [subject for subject in subjects if subject not in lost]
            return Envelope(
                envelope.key,
                encode(status.model_copy(update={"time": status.time + skew, "subjects": subjects})),
            )
        return envelope


def is_lost(seed: int, report: Report, share: float) -> bool:
    """Whether a report is among the share that is lost: always the same answer for the same report."""
    name = f"{seed} {report.source} {report.subject} {report.tick}"
    return zlib.crc32(name.encode()) < share * 2**32


def changed(report: Report, fault: AnyFault, grid: Grid) -> Report:
    """What a robot under a fault reports instead; belief and evidence are changed alike."""
    if isinstance(fault, Lie | Collude):
        return _with(
            report,
            lambda packed: pack(shifted(unpack(packed, grid), fault.offset)),
            lambda evidence: _lying(evidence, fault.offset),
        )
    if isinstance(fault, Overconfident):
        return _with(
            report,
            lambda packed: pack(narrowed(unpack(packed, grid), fault.factor)),
            lambda evidence: _narrowed_evidence(evidence, fault.factor),
        )
    if isinstance(fault, Skew):
        return report.model_copy(update={"time": report.time + fault.seconds})
    return report


def _with(report: Report, belief: Any, evidence: Any) -> Report:
    informed = report.informed
    return report.model_copy(
        update={
            "belief": belief(report.belief),
            "informed": None
            if informed is None
            else Informed(belief=belief(informed.belief), ancestors=informed.ancestors),
            "evidence": None if report.evidence is None else evidence(report.evidence),
        }
    )


# --- a lie ----------------------------------------------------------------------------------------------------------------


def shifted(belief: Belief, offset: Sequence[float]) -> Belief:
    """A belief moved by an offset (unit), in whole cells; what would leave the grid stays at its edge."""
    p = belief.p
    for axis, distance in enumerate(offset):
        cells = round(distance / belief.grid.cell)
        target = np.clip(np.arange(p.shape[axis]) + cells, 0, p.shape[axis] - 1)
        moved = np.zeros_like(p)
        np.add.at(np.moveaxis(moved, axis, 0), target, np.moveaxis(p, axis, 0))
        p = moved
    return Belief(belief.grid, p)


def _lying(evidence: PackedEvidence, offset: Sequence[float]) -> PackedEvidence:
    """Evidence whose place, and everything that is seen from the true place, is off by an offset (unit)."""
    state, increment = evidence.state, evidence.increment
    told = state.mean if state is not None else increment.reference if increment is not None else None
    return evidence.model_copy(
        update={
            "state": None if state is None else state.model_copy(update={"mean": _moved(state.mean, offset)}),
            "increment": None
            if increment is None
            else increment.model_copy(update={"reference": _moved(increment.reference, offset)}),
            "relatives": evidence.relatives
            if told is None
            else [_seen_elsewhere(it, told[HEADING], offset) for it in evidence.relatives],
        }
    )


def _moved(mean: Sequence[float], offset: Sequence[float]) -> tuple[float, ...]:
    told = np.array(mean)
    told[AXES] += np.array(offset)
    return tuple(float(x) for x in told)


def _seen_elsewhere(it: PackedRelative, heading: float, offset: Sequence[float]) -> PackedRelative:
    x = it.range * math.cos(heading + it.bearing) + offset[0]
    y = it.range * math.sin(heading + it.bearing) + offset[1]
    return it.model_copy(update={"range": math.hypot(x, y), "bearing": float(wrap(math.atan2(y, x) - heading))})


# --- over-confidence ------------------------------------------------------------------------------------------------------


def narrowed(belief: Belief, factor: float) -> Belief:
    """A belief to the power factor^2: a Gaussian with sigmas that are smaller by the factor."""
    p = (belief.p / belief.p.max()) ** factor**2
    return Belief(belief.grid, p / p.sum())


def _narrowed_evidence(evidence: PackedEvidence, factor: float) -> PackedEvidence:
    """Evidence with sigmas smaller by a factor, but for those of the motion: their sums may not shrink within an epoch."""
    state, increment, square = evidence.state, evidence.increment, factor**2
    return evidence.model_copy(
        update={
            "state": None
            if state is None
            else PackedState(mean=state.mean, covariance=tuple(it / square for it in state.covariance)),
            "increment": None
            if increment is None
            else increment.model_copy(
                update={
                    "information": tuple(it * square for it in increment.information),
                    "vector": tuple(it * square for it in increment.vector),
                }
            ),
            "relatives": [
                it.model_copy(
                    update={
                        "range_variance": it.range_variance / square,
                        "bearing_variance": it.bearing_variance / square,
                        "biases": [(sigma / factor, seconds) for sigma, seconds in it.biases],
                    }
                )
                for it in evidence.relatives
            ],
        }
    )
