"""What if a robot lied about where it is: its reports, moved. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from blackboard.errors import Refused, UserError
from blackboard.opinion.belief import Belief
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import PackedBelief, Report


def parse_lies(given: Sequence[str], robots: Sequence[str]) -> dict[str, float]:
    """ROBOT=DISTANCE, the distance in the grid's unit. UserError: another form, or no such robot."""
    lies = {}
    for one in given:
        robot, equals, distance = one.partition("=")
        try:
            lies[robot] = float(distance)
        except ValueError:
            equals = ""
        if not equals or abs(lies[robot]) > 1e6 or lies[robot] != lies[robot]:
            raise UserError(f"--lie {one}: say ROBOT=DISTANCE in the grid's unit, as r2=6")
        if robot not in robots:
            raise UserError(f"--lie {one}: no such robot; on the tape are {', '.join(robots)}")
    return lies


def lying(lies: Mapping[str, float]) -> Callable[[Envelope], Envelope]:
    """A change of envelopes: what these robots report is moved along x by so much, other envelopes stay as they are.

    Their first-hand and informed beliefs about everything move, as far as the grid goes, and so do state and reference of their
    evidence for a joint. What they saw relative to themselves is true: a robot that is lost, or says so, looks like this.
    """

    def change(envelope: Envelope) -> Envelope:
        parts = keys.REPORT.match(envelope.key)
        distance = lies.get(parts["source"], 0.0) if parts is not None else 0.0
        if envelope.kind is not Kind.PUT or not distance:
            return envelope
        try:
            report = open_envelope(envelope)[2]
        except Refused:
            return envelope
        return Envelope(envelope.key, encode(_moved(report, distance))) if isinstance(report, Report) else envelope

    return change


def _moved(report: Report, distance: float) -> Report:
    changes: dict[str, Any] = {"belief": _shifted(report.belief, distance)}
    if report.informed is not None:
        informed = _shifted(report.informed.belief, distance)
        changes["informed"] = report.informed.model_copy(update={"belief": informed})
    if report.evidence is not None:
        found: dict[str, Any] = {}
        if (state := report.evidence.state) is not None:
            found["state"] = state.model_copy(update={"mean": (state.mean[0] + distance, *state.mean[1:])})
        if (gain := report.evidence.increment) is not None:
            reference = (gain.reference[0] + distance, *gain.reference[1:])
            found["increment"] = gain.model_copy(update={"reference": reference})
        changes["evidence"] = report.evidence.model_copy(update=found)
    return report.model_copy(update=changes)


def _shifted(packed: PackedBelief, distance: float) -> PackedBelief:
    """A belief moved along x; what would leave the grid stays in its last cells. One that cannot be read stays as it is."""
    try:
        belief = unpack(packed)
    except Refused:
        return packed
    size = belief.grid.shape[0]
    to = np.clip(np.arange(size) + round(distance / belief.grid.cell), 0, size - 1)
    moved = np.zeros_like(belief.p)
    np.add.at(moved, to, belief.p)
    return pack(Belief(belief.grid, moved))
