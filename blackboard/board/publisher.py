"""What a board settles, and publishes: where it leads, all that it settled; where it follows, its status alone. Pure."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import asdict

from blackboard.board.board import Board
from blackboard.board.clocks import Clocks
from blackboard.board.handover import Handover
from blackboard.board.lead import BoardRole, Lead, Publication
from blackboard.board.participants import Participants
from blackboard.config import BoardSection
from blackboard.opinion.grid import Grid
from blackboard.process.intake import Intake
from blackboard.wire import keys
from blackboard.wire.arrays import packed_grid
from blackboard.wire.codec import enveloped
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import Forward
from blackboard.wire.messages import Consensus, PackedAnchor, Refusal, Status
from blackboard.wire.raw import MAX_BYTES
from blackboard.wire.types import Message

log = logging.getLogger(__name__)


class Publisher:
    """Envelopes of what a board settles, and of its status. `now` is Unix time in seconds."""

    def __init__(
        self, participants: Participants, grid: Grid, settings: BoardSection, lead: Lead, clocks: Clocks, intake: Intake
    ) -> None:
        self.participants, self.lead, self.clocks, self.intake = participants, lead, clocks, intake
        self._learns = settings.learns
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

    def begin(self, board: Board, handover: Handover) -> None:
        """Forget what was settled: from now on this board settles."""
        self.board, self.handover = board, handover
        self.begin_tick()
        self._settled: Status | None = None  # the status after the newest settlement

    def begin_tick(self) -> None:
        self._said: list[Publication] = []  # in this tick, or kept, where another board leads
        self._sent: list[Envelope] = []  # in this tick; sent again when the world repeats its Clock

    def settle(self, level: str, now: float) -> list[Envelope]:
        """A phase of the tick is over: what is published of it. level: "consensus", or "agreed" of the exchange."""
        tick, time = self.clocks.clock.tick, self.clocks.clock.time(now)
        survive = self.intake.failures.survive
        settled = list[Consensus]()
        with survive(f"the {level} of a tick"):
            if level == "consensus":
                self.participants.note_members()
                settled = self.board.settle(tick, time, self.participants.counts)
                self.intake.counters.update({} if self.board.clusters is None else self.board.clusters.tally)
            else:
                settled = self.board.exchange(tick, time, self.participants.robots())
                settled = [self.clocks.addressed(consensus) for consensus in settled]
        topic = keys.CONSENSUS if level == "consensus" else keys.AGREED
        out = [self._told(topic, c, subject=c.subject) for c in settled]
        if level == "consensus":
            with survive("what is forwarded"):
                out += self._forward(tick, time)
        else:
            self.handover.agreed_at = tick, time
        self.intake.counters["settled"] += len(settled)
        update = {"phase": level, "subjects": [c.subject for c in settled], **self.board.believed()}
        status = self._of_tick(tick, time).model_copy(update=update)
        if not out and self.clocks.differ:
            # Without a world no process waits for the status of a phase, so an empty one is left to the status of each second.
            self._settled = status
            return []
        return self._publish(Publication(tick, level, time, tuple(out), status), now)

    def aside(self, now: float) -> list[Envelope]:
        """What is sent beside the ticks: to robots what was refused of them, to boards that follow what this one remembers."""
        refusals = self.intake.refusals.due(now)
        out = list[Envelope]()
        if refusals and self.lead.role is not BoardRole.FOLLOWS:
            board, sub_team, time = self.lead.board, self.lead.sub_team, self.clocks.clock.time(now)
            mine = [refusal for theirs, refusal in refusals if theirs == sub_team]
            told = [Refusal(board=board, sub_team=sub_team, time=time, **asdict(refusal)) for refusal in mine]
            out += [self._told(keys.REFUSED, refusal, robot=refusal.robot) for refusal in told]
        memory = self.handover.give(self.clocks.clock.run) if self._learns and self.lead.leads else None
        if memory is None:
            return out
        handed = self._told(keys.MEMORY, memory, board=self.lead.board)
        if len(handed.payload) <= MAX_BYTES:
            return [*out, handed]
        self.intake.counters["memory_too_large"] += 1  # no message may be larger; who follows learns by itself then
        return out

    def _publish(self, said: Publication, now: float) -> list[Envelope]:
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
        """Publish again what was published in this tick."""
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
        return self._shown(self._settled or self._of_tick(clock.tick, clock.time(now)), now, lacks)

    def _in_full(self, all_said: Iterable[Publication], now: float) -> list[Envelope]:
        envelopes = list[Envelope]()
        for said in all_said:
            if said.envelopes and self._led != self.lead.term:
                self._led = self.lead.term
                where = self.lead.board, self.lead.sub_team, said.tick, self._led
                log.info("%s speaks for sub-team %s from tick %d on (term %d)", *where)
            envelopes += [*said.envelopes, self._shown(said.status, now)]
        return envelopes

    def _followed(self, said: Publication, now: float) -> Envelope:
        """The status of a board that follows: the phase is over here, too."""
        self._settled = said.status.model_copy(update={"subjects": []})
        return self.status(now)

    def _shown(self, status: Status, now: float, lacks: Sequence[str] = ()) -> Envelope:
        part = {"follows": not self.lead.leads, "term": self.lead.term, "since": self.lead.since, "lacks": list(lacks)}
        status = self.clocks.shown(status.model_copy(update=part), now)
        return self._told(keys.STATUS, self.intake.counted(status, now), process=self.lead.board)

    def _of_tick(self, tick: int, time: float) -> Status:
        """A status of a tick in which nothing is settled yet, at a team time in seconds."""
        return self._blank.model_copy(update={"tick": max(0, tick), "time": time})

    def _forward(self, tick: int, time: float) -> list[Envelope]:
        evidence, joint = self.board.forward(time), self.board.joint
        if joint is None or (not evidence and self.clocks.differ):
            return []
        board, sub_team = self.lead.board, self.lead.sub_team
        forward = Forward(
            board=board,
            sub_team=sub_team,
            tick=max(0, tick),
            time=time,
            evidence=evidence,
            since=joint.since,
            tracks=joint.tracks(),
        )
        return [self._told(keys.FORWARD, forward, board=board)]

    def _told(self, topic: keys.Topic, message: Message, **parts: str) -> Envelope:
        return enveloped(topic.key(team=self.participants.team, sub_team=self.lead.sub_team, **parts), message)


def settings_in_force(settings: BoardSection) -> dict[str, str | float]:
    """What a status shows: the rule and its parameters, and those of each table of `subjects`, as `object/ball.rule`."""
    return {**settings.in_force(), "feedback": settings.feedback, "fusion": settings.fusion}
