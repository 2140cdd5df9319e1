"""A robot that does not tell what it believes: the [[fault]]s of a scenario in what it says. Honest robots do not load this.

What it believes, and what it sends to the referee (`Solo`), stays as it is: its reports and statuses are changed just before
they are sent. Everything is computed from the message and the scenario's seed, so a message that is sent again is changed in
the same way.
"""

import zlib
from collections.abc import Sequence
from typing import Any

from blackboard.faults import AnyFault, Collude, Freeze, LieFault, Lose, Overconfident, Skew
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.falsified import displaced, overconfident
from blackboard.wire.messages import Report, Status
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
        faults = [fault for fault in self._faults if fault.concerns(self.robot, self.peer.answers.time)]
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
                report = changed(report, fault)
            return Envelope(envelope.key, encode(report))
        if keys.STATUS.match(envelope.key):
            status = decode(Status, envelope.payload)
            skew = sum(fault.seconds for fault in faults if isinstance(fault, Skew))
            subjects = status.subjects
            if self.clock.pace is Pace.LOCKSTEP:  # a board would wait in each tick for a report that is listed
                lost = {
                    r.subject for r in self.peer.answers.reports if any(is_lost(self._seed, r, share) for share in lose)
                }
                subjects = [subject for subject in subjects if subject not in lost]
            return Envelope(
                envelope.key, encode(status.model_copy(update={"time": status.time + skew, "subjects": subjects}))
            )
        return envelope


def is_lost(seed: int, report: Report, share: float) -> bool:
    """Whether a report is among the share that is lost: always the same answer for the same report."""
    name = f"{seed} {report.source} {report.subject} {report.tick}"
    return zlib.crc32(name.encode()) < share * 2**32


def changed(report: Report, fault: AnyFault) -> Report:
    """What a robot under a fault reports instead."""
    if isinstance(fault, LieFault | Collude):
        return displaced(report, fault.offset)
    if isinstance(fault, Overconfident):
        return overconfident(report, fault.factor)
    if isinstance(fault, Skew):
        return report.model_copy(update={"time": report.time + fault.seconds})
    return report
