"""What a board publishes: where it leads, all that it settled; where it follows, its status alone. Pure."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import asdict

from blackboard.board.clocks import Clocks
from blackboard.board.lead import Lead, Publication
from blackboard.config import BoardSection
from blackboard.opinion.grid import Grid
from blackboard.process.intake import Intake
from blackboard.wire import keys
from blackboard.wire.arrays import packed_grid
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import PackedAnchor, Status

log = logging.getLogger(__name__)


class Publisher:
    """Envelopes of what was settled, and of the status of one board. `now` is Unix time in seconds."""

    def __init__(
        self, team: str, grid: Grid, settings: BoardSection, lead: Lead, clocks: Clocks, intake: Intake
    ) -> None:
        self.lead, self.clocks, self.intake = lead, clocks, intake
        self._key = keys.STATUS.key(team=team, sub_team=lead.sub_team, process=lead.board)
        self._blank = Status(
            process=lead.board,
            kind="board",
            tick=0,
            time=0.0,
            settings=settings_in_force(settings),
            grid=packed_grid(grid),
            anchor=None if grid.anchor is None else PackedAnchor(**asdict(grid.anchor)),
        )
        self._led: int | None = None  # the term in which it was logged that this board leads
        self.begin()

    def begin(self) -> None:
        """Forget what was settled."""
        self.begin_tick()
        self._settled: Status | None = None  # the status after the newest settlement

    def begin_tick(self) -> None:
        self._said: list[Publication] = []  # in this tick, or kept, where another board leads
        self._sent: list[Envelope] = []  # in this tick; sent again when the world repeats its Clock

    def blank(self, tick: int, time: float) -> Status:
        """A status of a tick in which nothing is settled yet, at a team time in seconds."""
        return self._blank.model_copy(update={"tick": max(0, tick), "time": time})

    def settle(self, status: Status) -> None:
        """Nothing was settled that others wait for: the next status shows it."""
        self._settled = status

    def publish(self, said: Publication, now: float) -> list[Envelope]:
        """A phase of a tick is over: all that was settled in it where this board leads, else the status alone."""
        self._said.append(said)
        if not self.lead.may_say(said.time):
            self.lead.keep(said, now)
            return [self._followed(said, now)]
        self._settled = said.status
        sent = self._in_full([said], now)
        self._sent += sent
        return sent

    def repeat(self, now: float) -> list[Envelope]:
        """What was published in this tick, again."""
        return list(self._sent) if self.lead.leads else [self._followed(said, now) for said in self._said]

    def look(self, now: float) -> list[Envelope]:
        """Where this board's part changes, tell the others; where it leads now, publish all that the one before did not."""
        if not self.lead.look(now):
            return []
        if not self.lead.leads:
            return [self.status(now)]
        self._sent = self._in_full(self._said, now)
        released = self.lead.release()
        if released:
            self._settled = released[-1].status
        return self._in_full(released, now) or [self.status(now)]

    def status(self, now: float, lacks: Sequence[str] = ()) -> Envelope:
        """What was settled last, at the time of that tick, with the counters as they stand; "idle" before the first tick."""
        clock = self.clocks.clock
        return self._shown(self._settled or self.blank(clock.tick, clock.time(now)), now, lacks)

    def _in_full(self, all_said: Iterable[Publication], now: float) -> list[Envelope]:
        found = list[Envelope]()
        for said in all_said:
            if said.envelopes and self._led != self.lead.term:
                self._led = self.lead.term
                where = self.lead.board, self.lead.sub_team, said.tick, self._led
                log.info("%s speaks for sub-team %s from tick %d on (term %d)", *where)
            found += [*said.envelopes, self._shown(said.status, now)]
        return found

    def _followed(self, said: Publication, now: float) -> Envelope:
        """The status of a board that follows: the phase is over here, too."""
        self._settled = said.status.model_copy(update={"subjects": []})
        return self.status(now)

    def _shown(self, status: Status, now: float, lacks: Sequence[str] = ()) -> Envelope:
        part = {"follows": not self.lead.leads, "term": self.lead.term, "since": self.lead.since, "lacks": list(lacks)}
        status = self.clocks.shown(status.model_copy(update=part), now)
        return Envelope(self._key, encode(self.intake.counted(status, now)))


def settings_in_force(settings: BoardSection) -> dict[str, str | float]:
    """What a status shows: the rule and its parameters, and those of each table of `subjects`, as `object/ball.rule`."""
    return {**settings.in_force(), "feedback": settings.feedback, "fusion": settings.fusion}
