"""The board process: envelopes to messages around a Board, and what it publishes at the end of each phase of a tick.

It only routes: `Reception` judges what arrives, the table `blackboard.process.rounds.BOARD` says when a phase is over (docs/ticks.md,
"A tick in lockstep"), and the `Publisher` lets the `Board` settle. So a report is here three times until it is pooled: `receive`,
`_take` and `_turn`.
"""

import logging
from collections import Counter

from blackboard.board.board import Board
from blackboard.board.clocks import Clocks
from blackboard.board.guests import Guests
from blackboard.board.handover import Handover
from blackboard.board.lead import Lead
from blackboard.board.participants import Participants
from blackboard.board.publisher import Publisher
from blackboard.board.reception import Reception
from blackboard.config import BoardSection, Scenario, TeamSection
from blackboard.opinion.gaussian.once import Settle, settle_alone
from blackboard.opinion.grid import Grid
from blackboard.process.intake import Intake
from blackboard.process.roster import Roster
from blackboard.process.rounds import BOARD, Rounds
from blackboard.process.team_clock import WORLD_SILENT, News, Pace, TeamClock
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock
from blackboard.wire.types import Message

log = logging.getLogger(__name__)

FACTS = {"reports": "reports", "exchange": "consensuses"}  # what a phase of a tick waits for
LONGER = 1.25  # times the patience: another board, which waits for a robot to the end, is not late itself
SILENT = 5.0  # seconds that a leader may publish nothing of what this board has settled; another one then has all that it lacks


def board_of(
    scenario: Scenario, sub_team: str, board: str | None = None, settle: Settle = settle_alone
) -> "BoardService":
    """The board of a sub-team as a scenario asks for it, under the name that `blackboard up` gives to its first one."""
    return BoardService(
        team=scenario.team.name,
        sub_team=sub_team,
        board=board or f"board-{sub_team}",
        grid=scenario.grid,
        settings=scenario.board,
        members=scenario.team,
        settle=settle,
    )


class BoardService:
    """The board process of one sub-team (`blackboard.process.service.Service`)."""

    def __init__(
        self,
        *,
        team: str,
        sub_team: str,
        board: str,
        grid: Grid,
        settings: BoardSection,
        members: TeamSection | None = None,
        settle: Settle = settle_alone,
    ) -> None:
        """`members`: the robots that a scenario names, and what others may do; by default everybody may report. `settle`: a joint."""
        self.team, self.sub_team, self.name = team, sub_team, board
        self.grid, self.settings, self._settle = grid, settings, settle
        self.intake = Intake()
        self.roster = Roster(*self.tokens)
        self.clock = TeamClock(self.roster, settings.period)
        waits = {"patience": settings.patience, "patience with boards": LONGER * settings.patience}
        self.rounds = Rounds(BOARD, {**waits, "half a period": settings.period / 2}, "settled")
        self.lead = Lead(self.roster, sub_team, board, silent=SILENT)
        self.clocks = Clocks(f"{sub_team}/{board}", settings.skew, self.clock)
        self.guests = Guests(members)
        self.participants = Participants(self.roster, self.clock, team, sub_team, self.guests)
        self.reception = Reception(board, self.participants, self.clocks, self.lead, self.intake)
        self.publisher = Publisher(self.participants, grid, settings, self.lead, self.clocks, self.intake)
        self._went_by = self.clock.pace, self.clock.run  # the pace and run at which early messages were retried last
        self._is_wake_due = False  # in real time: whether a message came since the board was woken
        self._begin()

    def _begin(self) -> None:
        """Forget all messages: a new run begins, or stamps have another time base from now on."""
        survive = self.intake.failures.survive
        self.guests.forget(())
        self.board = Board(
            self.sub_team, self.name, self.grid, self.settings, survive, self.counters, self.guests, self._settle
        )
        self.handover = Handover(self.board)
        self.reception.begin(self.board, self.handover)
        self.publisher.begin(self.board, self.handover)
        self.rounds.enter("settled", 0.0)

    # --- what the loop needs ----------------------------------------------------------------------------------------------

    @property
    def counters(self) -> Counter[str]:
        return self.intake.counters

    @property
    def refused(self) -> Counter[str]:
        return self.intake.refused

    @property
    def tokens(self) -> tuple[str, ...]:
        return (keys.BOARD.key(team=self.team, sub_team=self.sub_team, board=self.name),)

    @property
    def listens(self) -> tuple[str, ...]:
        team, mine = self.team, self.sub_team
        return (
            keys.CLOCK.key(team=team),
            keys.REPORT.key(team=team, sub_team=mine, source="*", subject="**"),
            keys.CONSENSUS.key(team=team, sub_team="*", subject="**"),
            *([] if self.settings.fusion == "opinions" else [keys.FORWARD.key(team=team, sub_team="*", board="*")]),
            keys.STATUS.key(team=team, sub_team="*", process="*"),
            *([keys.MEMORY.key(team=team, sub_team=mine, board="*")] if self.settings.learns else []),
        )

    @property
    def watches(self) -> tuple[str, ...]:
        return (
            keys.MEMBER.key(team=self.team, sub_team="*", robot="*"),
            keys.BOARD.key(team=self.team, sub_team="*", board="*"),
            keys.WORLD.key(team=self.team),
        )

    @property
    def done(self) -> bool:
        return False

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.intake.record_link_counters(counters)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        out = self.publisher.look(now) + self._turn("before", now)
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self._hold(now)
            self.roster.hear_token(envelope, now)
            out += self._retry(now) if envelope.kind is Kind.ALIVE else []
            out += [self.publisher.status(now)] if _is_world(envelope) else []
        else:
            out += self.intake.on_envelope(envelope, lambda parts, message: self._take(parts, message, now), now)
        out += self._look("message", now) + self._turn("message", now)
        self._is_wake_due = self.clock.pace is Pace.REALTIME
        return out + self.publisher.aside(now)

    def wake(self, now: float) -> list[Envelope]:
        self._is_wake_due = False
        out = self._look("batch", now) + self._turn("batch", now) + self.publisher.aside(now)
        return [*out, self.publisher.status(now)] if now >= self.intake.status_due else out

    def wake_at(self, now: float) -> float | None:
        if self._is_wake_due:
            return now
        rounds_end = self.rounds.ends_at(self.clock.pace)
        early = self.reception.steps.are_told
        changes_at = min(self.clock.changes_at(early=early), self.roster.changes_at(), self.lead.changes_at())
        return min(self.intake.status_due, rounds_end, changes_at)

    def check(self) -> None:
        """AssertionError: an invariant of one of its machines does not hold."""
        for machine in (self.clock, self.rounds, self.lead, self.reception, self.board):
            machine.check()
        assert self.handover.agreed_at is None or self.handover.agreed_at[0] <= self.clock.tick

    # --- receiving --------------------------------------------------------------------------------------------------------

    def _take(self, parts: dict[str, str], message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock):
            return self._on_clock(message, now)
        return [self.publisher.status(now)] if self.reception.on_message(parts, message, now) else []

    def _retry(self, now: float) -> list[Envelope]:
        return self.intake.retry(lambda parts, message: self._take(parts, message, now))

    def _on_clock(self, clock: Clock, now: float) -> list[Envelope]:
        if not self.roster.world:
            self.counters["unannounced"] += 1
            if self.counters["unannounced"] == 1:
                log.warning(
                    "a Clock without %s is not followed before that token is there", keys.WORLD.key(team=self.team)
                )
        news = self.clock.hear_clock(clock, now)
        if news is not News.REPEATED:
            self._follow(news, now)
            return []
        self.counters["repeated"] += 1
        wanted = clock.wants(f"board/{self.sub_team}/{self.name}")
        if wanted == "answers":
            return self.publisher.repeat(now)
        lacks = self.reception.lacks(FACTS.get(self.rounds.phase, ""))
        return [self.publisher.status(now, list(lacks))] if wanted == "status" else []

    # --- when to settle ---------------------------------------------------------------------------------------------------

    def _follow(self, news: News, now: float) -> None:
        """A tick begins, or everything does."""
        if news is News.NOTHING:
            return
        if news is not News.TICK:
            self._begin()
            self.lead.begin(None if news is News.FREE else self.clock.time(now))
        if news is News.FREE:
            log.warning(
                "the world is gone, its last Clock is %g s old: going by Unix time, starting afresh", WORLD_SILENT
            )
            return
        if self.lead.since is None:
            self.lead.since = self.clock.time(now)
        self.counters["skipped"] += self.rounds.phase != "settled"
        self.rounds.enter("reports", now)
        self.reception.begin_tick(now)
        self.publisher.begin_tick()

    def _look(self, moment: str, now: float) -> list[Envelope]:
        """See what time has changed (`blackboard.process.rounds.MOMENTS`); without a world a tick begins after a batch only."""
        self._hold(now)
        self.roster.forget(now)
        out: list[Envelope] = []
        ticks, steps = moment == "batch", self.reception.steps
        while (news := self.clock.look(now, ticks=ticks, early=steps.are_told)) is not News.NOTHING:
            self._follow(news, now)
        goes_by = self.clock.pace, self.clock.run
        if goes_by != self._went_by:
            self._went_by = goes_by
            out += self._retry(now)
        return out + self.publisher.look(now)

    def _turn(self, moment: str, now: float) -> list[Envelope]:
        """End each phase of the tick that is over, and return what is published at its end."""
        out: list[Envelope] = []
        while (ended := self.rounds.turn(self.clock.pace, now, self.reception.has, moment)) is not None:
            phase, late = ended
            if late:
                self.counters["late"] += 1
                if self.clock.pace is Pace.LOCKSTEP:
                    self.reception.give_up(FACTS[phase])
            out += self.publisher.settle("consensus" if phase == "reports" else "agreed", now)
        return out

    def _hold(self, now: float) -> None:
        """In lockstep let the phase, and its patience, begin anew while the router is away, because nothing can arrive then."""
        if self.roster.away and self.clock.pace is Pace.LOCKSTEP:
            self.rounds.enter(self.rounds.phase, now)


def _is_world(envelope: Envelope) -> bool:
    """Whether a world has come. It asks who is there, because a token alone does not count."""
    return envelope.kind is Kind.ALIVE and keys.WORLD.match(envelope.key) is not None
