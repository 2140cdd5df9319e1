"""A robot that lies: the service around an honest one, which changes what that sends. Pure.

What it sends in a tick is made once, so what is sent again is the same lie.
"""

from collections.abc import Sequence

from blackboard.chaos.lies.catalogue import Lie
from blackboard.chaos.lies.changes import WrongClock
from blackboard.chaos.lies.scene import Reports, Scene
from blackboard.process.service import Around, Service
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, Report, Status
from blackboard.wire.types import MAX_OPINIONS

MAX_PAST = 256  # ticks whose honest reports it remembers


class Liar(Around):
    """A service of a robot that tells a lie from a team time until another one, in seconds."""

    def __init__(self, inner: Service, scene: Scene, lie: Lie, begin: float, end: float) -> None:
        super().__init__(inner)
        self.scene, self.lie, self.begin, self.end = scene, lie, begin, end
        self._told: dict[str, tuple[int, Reports]] = {}  # sub-team -> the tick, and what was sent in it instead

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind is Kind.PUT and keys.AGREED.match(envelope.key) is not None:
            consensus = decode(Consensus, envelope.payload)
            self.scene.agreed[consensus.subject] = consensus
        return self.said(self.inner.receive(envelope, now))

    def wake(self, now: float) -> list[Envelope]:
        return self.said(self.inner.wake(now))

    def said(self, out: Sequence[Envelope]) -> list[Envelope]:
        """What is sent instead: first all reports of each sub-team, then the rest in its order."""
        honest: dict[str, Reports] = {}
        rest, team = [], ""
        for envelope in out:
            parts = keys.REPORT.match(envelope.key)
            if parts is None:
                rest.append(envelope)
            else:
                report, team = decode(Report, envelope.payload), parts["team"]
                honest.setdefault(parts["sub_team"], {})[report.subject] = report
        said = []
        for sub_team, reports in honest.items():
            for subject, report in self._changed(sub_team, reports).items():
                key = keys.REPORT.key(team=team, sub_team=sub_team, source=self.scene.robot, subject=subject)
                said.append(Envelope(key, encode(report)))
        return said + [self._status(envelope) for envelope in rest]

    def _changed(self, sub_team: str, reports: Reports) -> Reports:
        scene, newest = self.scene, max(reports.values(), key=lambda report: report.tick)
        tick, told = self._told.get(sub_team, (-1, reports))
        if newest.tick == tick:
            return told
        scene.tick, scene.time, scene.since = newest.tick, newest.time, newest.time - self.begin
        if 0 <= scene.since < self.end - self.begin:
            scene.past = [*scene.past[1 - MAX_PAST :], reports]
            if self.lie.is_told(scene.since):
                for change in self.lie.changes:
                    reports = change.apply(reports, scene)
        self._told[sub_team] = newest.tick, reports
        return reports

    def _status(self, envelope: Envelope) -> Envelope:
        """A status that lists what was reported, with the stamp of a clock that is off."""
        parts = keys.STATUS.match(envelope.key)
        tick, reports = self._told.get(parts["sub_team"], (-1, {})) if parts else (-1, {})
        status = decode(Status, envelope.payload) if parts else None
        if status is None or status.tick != tick or not reports:
            return envelope
        listed = [*status.subjects, *sorted(reports.keys() - set(status.subjects))]
        ahead = 0.0
        if self.begin <= status.time < self.end and self.lie.is_told(status.time - self.begin):
            clocks = [change for change in self.lie.changes if isinstance(change, WrongClock)]
            ahead = sum(clock.seconds + clock.rate * (status.time - self.begin) for clock in clocks)
        changed = status.model_copy(update={"subjects": listed[:MAX_OPINIONS], "time": status.time + ahead})
        return envelope if changed == status else Envelope(envelope.key, encode(changed))
