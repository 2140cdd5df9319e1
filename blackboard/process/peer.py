"""A robot among the boards of its team, whatever makes its beliefs: its tokens, its clock, and what it said last. Pure.

The owner of a peer gets the cues of the team clock (`reactions`) and the messages that a robot may believe, and gives `Answers`. A
world that has not received them asks again.
"""

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from blackboard.errors import Refused
from blackboard.process.listener import ClockNews, Listener
from blackboard.process.offsets import StampEchoes
from blackboard.process.reactions import REACTIONS, Cue, Place
from blackboard.process.refusals import in_words
from blackboard.process.service import Around
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.codec import encode, enveloped
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus, Refusal, Report, Solo, Status
from blackboard.wire.types import Message

log = logging.getLogger(__name__)

MAX_LOGGED = 256  # boards and reasons of refusals that are remembered as logged
MAX_BEGINNINGS = 64  # of the names of tracks whose last number is remembered, as `person/`
WHOLE = 10.0  # seconds of team time between two statuses with counters and settings on a poor link


@dataclass(frozen=True)
class Answers:
    """What a robot said in its newest tick. `time` is team time in seconds, `speed` at most in units per second."""

    tick: int = -1  # none yet
    time: float = 0.0
    reports: Sequence[Report] = ()
    solo: Solo | None = None
    kept: Sequence[str] = ()  # subjects on which the boards keep what was reported before
    speed: float | None = None
    found: Mapping[str, float] = field(default_factory=dict)  # what it has found out of its sensors, by name


class Peer(Around):
    """A service (`blackboard.process.service.Service`) that speaks for a robot as its owner says."""

    def __init__(
        self,
        team: str,
        sub_teams: Sequence[str],
        robot: str,
        hear: Callable[[Cue | Message, float], list[Envelope]],
        *,
        settings: Mapping[str, str],
        listens: tuple[str, ...] = (),
        brief: bool = False,
        rare: bool = False,
    ) -> None:
        """`hear` takes what is new at a Unix time, and returns what is to be sent; it may raise Refused.

        `settings` are shown in the status, `listens` are keys that it hears besides; `brief`: in as few bytes as there are. `rare`:
        where no world gives the time, and nobody waits for a status, one in `WHOLE` s.
        """
        self.team, self.sub_teams, self.robot = team, tuple(sub_teams), robot
        self.listener = Listener(team, self._hear, sub_teams=self.sub_teams, own=self.tokens[0])
        super().__init__(self.listener)
        self.intake, self.roster, self.clock = self.listener.intake, self.listener.roster, self.listener.clock
        self._owner_hears, self._settings, self._listens, self._brief = hear, dict(settings), listens, brief
        self._rare, self._rare_due = rare, -math.inf  # Unix seconds
        self._echoes = StampEchoes()  # of the boards' stamps, where each process goes by its own clock
        self._ahead: dict[str, float] = {}  # sub-team -> seconds that this robot's clock is ahead of its board's
        self._logged: set[tuple[str, str]] = set()  # boards and reasons of refusals
        self.begin("")

    def begin(self, run: str) -> None:
        """Forget what was said: it was in another run."""
        self.run, self.answers = run, Answers()
        self._tracks: dict[str, int] = {}  # how their names begin -> the last number that was heard
        #: team time of the newest status that had everything, and what had been refused then
        self._whole: tuple[float, dict[str, int]] | None = None

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return tuple(keys.MEMBER.key(team=self.team, sub_team=s, robot=self.robot) for s in self.sub_teams)

    @property
    def listens(self) -> tuple[str, ...]:
        """Also what boards refused of this robot, and its own statuses.

        What comes on these is another process of the same name (`blackboard.process.namesakes`).
        """
        refused = (keys.REFUSED.key(team=self.team, sub_team=s, robot=self.robot) for s in self.sub_teams)
        return (*self._listens, *self.listener.listens, *refused, *self._status_keys)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        out = super().receive(envelope, now)
        came = envelope.kind is Kind.ALIVE and keys.WORLD.match(envelope.key) is not None
        return out + (self.statuses(now) if came else [])  # the world asks who is there: a token alone is not enough

    def wake(self, now: float) -> list[Envelope]:
        out = self.look(now)
        return out + (self.statuses(now) if now >= self._status_due else [])

    def wake_at(self, now: float) -> float:
        return min(self._status_due, self.listener.wake_at(now))

    def look(self, now: float) -> list[Envelope]:
        """See what time has changed; no status is due by that."""
        return self.listener.wake(now)

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        super().check()
        followed, answers = self.clock.followed, self.answers
        assert followed is None or self.run == followed.run, (self.run, followed)
        assert all(report.source == self.robot and report.tick <= answers.tick for report in answers.reports), answers
        assert answers.solo is None or answers.solo.tick == answers.tick, answers
        assert len(self._logged) <= MAX_LOGGED
        assert set(self._ahead) <= set(self.sub_teams)
        assert len(self._tracks) <= MAX_BEGINNINGS

    # --- speaking -----------------------------------------------------------------------------------------------------

    def say(self, answers: Answers, now: float, new: Sequence[Report] | None = None) -> list[Envelope]:
        """Answer a tick: what is to be sent. `new`: only these reports, because the others of the answers have been."""
        self.answers = answers
        return self._repeat(now) if new is None else [*self._sent(new), *self.statuses(now)]

    def statuses(self, now: float) -> list[Envelope]:
        """A status in every sub-team: what was reported last, with the counters as they stand; none where they are rare."""
        if self._is_rare and now < self._status_due:
            return []
        self._rare_due = now + WHOLE
        said = self.answers
        status = Status(
            process=self.robot,
            kind="robot",
            tick=max(0, said.tick),
            time=said.time,
            phase="idle" if said.tick < 0 or self.clock.pace is Pace.WAITING else "reported",
            subjects=[report.subject for report in said.reports],
            settings={**self._settings, **said.found, "pace": self.clock.pace.value},
            kept=list(said.kept),
            speed=said.speed,
            tracks=dict(self._tracks),
        )
        if self.clock.pace is Pace.FREE:
            status = status.model_copy(update={"sent": now, "echo": self._echoes.held(now)})
        status = self._shortened(self.intake.counted(status, now))
        payload = encode(status, shortest=self._brief)
        return [Envelope.written(key, payload, status) for key in self._status_keys]

    def size(self, report: Report) -> int:
        """Bytes of a report on the wire, keys included, over all sub-teams."""
        return sum(len(envelope.key) + len(envelope.payload) for envelope in self._sent([report]))

    def _repeat(self, now: float) -> list[Envelope]:
        """The reports of the newest tick, the solo beliefs where a world is there, whose referee reads them, and the statuses."""
        out = self._sent(self.answers.reports)
        if self.answers.solo is not None and self.roster.world:
            out.append(enveloped(keys.SOLO.key(team=self.team, robot=self.robot), self.answers.solo))
        return out + self.statuses(now)

    def _sent(self, reports: Sequence[Report]) -> list[Envelope]:
        encoded = [(report, encode(report, shortest=self._brief)) for report in reports]
        parts = {"team": self.team, "source": self.robot}
        return [
            Envelope.written(keys.REPORT.key(**parts, sub_team=sub_team, subject=report.subject), payload, report)
            for sub_team in self.sub_teams
            for report, payload in encoded
        ]

    @property
    def _is_rare(self) -> bool:
        return self._rare and self.clock.pace is Pace.FREE

    @property
    def _status_due(self) -> float:
        return self._rare_due if self._is_rare else self.intake.status_due

    @property
    def _status_keys(self) -> tuple[str, ...]:
        return tuple(keys.STATUS.key(team=self.team, sub_team=s, process=self.robot) for s in self.sub_teams)

    def _shortened(self, status: Status) -> Status:
        """On a poor link most statuses leave out what only operators read, where nothing new was refused: they keep that."""
        if not self._brief:
            return status
        since, refused = self._whole or (-math.inf, None)
        if status.phase == "idle" or status.time - since >= WHOLE or refused != status.refused:
            self._whole = status.time, dict(status.refused)
            return status
        return status.model_copy(update={"counters": {}, "refused": {}, "ages": {}, "settings": {}})

    # --- hearing ------------------------------------------------------------------------------------------------------

    def _hear(self, heard: ClockNews | Message, now: float) -> list[Envelope]:
        if isinstance(heard, ClockNews):
            return self._react(heard, now)
        if isinstance(heard, Consensus):
            heard = self._on_time(heard, now)
            self._note_number(heard)
        if isinstance(heard, Refusal):
            self._count(heard)
        return self._owner_hears(heard, now)

    def _note_number(self, consensus: Consensus) -> None:
        """Remember the number of a track, so that no board gives it to something else."""
        begins, number = consensus.number
        if number and (begins in self._tracks or len(self._tracks) < MAX_BEGINNINGS):
            self._tracks[begins] = max(number, self._tracks.get(begins, 0))

    def _react(self, news: ClockNews, now: float) -> list[Envelope]:
        out: list[Envelope] = []
        for cue in REACTIONS[news.news, self.place]:
            if cue is Cue.BEGIN and self.clock.followed is not None:
                self.begin(self.clock.followed.run)
            out += self._asked(news, now) if cue is Cue.REPEAT else self._owner_hears(cue, now)
        return out

    @property
    def place(self) -> Place:
        """Where this robot stands in the run and the tick of the Clock that is followed."""
        followed = self.clock.followed
        if followed is None or followed.run != self.run:
            return Place.ELSEWHERE
        return Place.DONE if followed.tick == self.answers.tick else Place.BEHIND

    def _asked(self, news: ClockNews, now: float) -> list[Envelope]:
        """The Clock is repeated, or the first one came after its tick was done: say what it asks for."""
        self.intake.counters["repeated"] += 1
        wanted = "answers" if news.clock is None else news.clock.wants(f"robot/{self.robot}")
        return self._repeat(now) if wanted == "answers" else self.statuses(now) if wanted == "status" else []

    def _on_time(self, consensus: Consensus, now: float) -> Consensus:
        """A consensus with its stamp by this robot's clock. Refused: of a tick that has not begun.

        Where each process goes by its own clock, the board tells with the robot's own place how far the two are apart.
        """
        newest = max(self.clock.tick, self.answers.tick + 1)  # who joins a run late has done none of its ticks
        if self.clock.followed is not None and consensus.tick > newest:
            raise Refused("future", f"agreed in tick {consensus.tick}, and the newest is {newest}")
        if self.clock.pace is not Pace.FREE:
            return consensus
        self._echoes.hear_stamp(f"{consensus.sub_team}/{consensus.board}", consensus.time, now)
        if consensus.subject == f"robot/{self.robot}":
            self._ahead[consensus.sub_team] = consensus.ahead
        ahead = self._ahead.get(consensus.sub_team, 0.0)
        return consensus.model_copy(update={"time": consensus.time + ahead}) if ahead else consensus

    def _count(self, refusal: Refusal) -> None:
        """A board refused what this robot said: counted, and logged once for each board and reason."""
        self.intake.counters["told_refused"] += 1
        seen = refusal.board, refusal.reason
        if seen not in self._logged and len(self._logged) < MAX_LOGGED:
            self._logged.add(seen)
            log.warning("%s; not logged again for this board and reason", in_words(refusal))
