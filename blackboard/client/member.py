"""A robot whose beliefs another program makes, as a service: what it reports when. Pure.

Where no world gives the clock, a report is sent at once, stamped with Unix time. Where a world does, a report is sent again at
each of its ticks with the stamp that it had, until it is `STANDS` seconds old. A world that waits for everybody waits for this
robot, too.
"""

from blackboard.client.agreed import TeamNews
from blackboard.config import BoardSection
from blackboard.errors import OpinionError, Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.believed import MAX_SUBJECTS
from blackboard.opinion.grid import Grid
from blackboard.process.peer import Answers, Peer
from blackboard.process.reactions import Cue
from blackboard.process.service import Around
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Informed, PackedBelief, Report, Solo
from blackboard.wire.opinions import check_stamp, reported
from blackboard.wire.types import Message

STANDS = 5.0  # seconds of team time that a report is sent again for, at each tick of a world
SUM = 1e-6  # by which the mass of a belief may miss 1


class Member(Around):
    """The process of one robot (`blackboard.process.service.Service`), whose owner calls `report`."""

    def __init__(
        self,
        *,
        team: str,
        sub_teams: tuple[str, ...],
        robot: str,
        grid: Grid,
        settings: BoardSection,
        news: TeamNews | None = None,
        judged: bool = True,
    ) -> None:
        """`settings` are those of the team's boards. `judged`: whether a world's referee gets what it reports."""
        self.peer = Peer(team, sub_teams, robot, self._hear, settings={"client": "python"})
        super().__init__(self.peer)
        self.intake, self.clock = self.peer.intake, self.peer.clock
        self.grid, self._settings, self._judged = grid, settings, judged
        self._news = news or TeamNews(grid)
        self._reports: dict[str, Report] = {}  # subject -> the newest

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        super().check()
        self._news.check()
        assert all(report.subject == subject for subject, report in self._reports.items())
        assert len(self._reports) <= MAX_SUBJECTS

    # --- the robot's own beliefs --------------------------------------------------------------------------------------

    def report(
        self,
        subject: str,
        belief: Belief,
        now: float,
        *,
        time: float | None = None,
        informed: tuple[Belief, dict[str, float]] | None = None,
    ) -> list[Envelope]:
        """Report a first-hand belief; return what is to be sent. `time`: team time of the belief [default: now].

        `informed` is what the robot believes with its team's beliefs folded in, and whose information that is. Refused: what a
        board would refuse, with the reason that it would give.
        """
        stamp = self.clock.time(now) if time is None else time
        report = self._checked(subject, belief, self._next_tick(now), stamp, self.clock.time(now), informed)
        self._reports[subject] = report
        if self.clock.pace is Pace.WAITING:
            return []
        return self.peer.say(self._answers(report.tick, now), now, [report])

    def withdraw(self, subject: str, now: float) -> list[Envelope]:
        """Believe nothing any more about a subject; what a board had of it is left out at once."""
        if self._reports.pop(subject, None) is None:
            return []
        # boards drop what is older than this tick
        return self.peer.say(self._answers(self._next_tick(now), now), now, [])

    def _next_tick(self, now: float) -> int:
        """The world's tick; where no world gives one, milliseconds of Unix time, which also grow when the program starts again."""
        return self.clock.tick if self.clock.followed is not None else max(self.peer.answers.tick + 1, int(1000 * now))

    def _answers(self, tick: int, now: float) -> Answers:
        time, reports = self.clock.time(now), [self._reports[subject] for subject in sorted(self._reports)]
        solo = None
        if self._judged and self.clock.followed is not None:
            beliefs = {report.subject: report.belief for report in reports}
            solo = Solo(robot=self.peer.robot, tick=tick, time=time, beliefs=beliefs)
        return Answers(tick, time, reports, solo)

    def _checked(
        self,
        subject: str,
        belief: Belief,
        tick: int,
        stamp: float,
        time: float,
        informed: tuple[Belief, dict[str, float]] | None,
    ) -> Report:
        """A report, opened and admitted as a board does at team time `time`. Refused: as there."""
        message = Report.model_construct(
            source=self.peer.robot,
            subject=subject,
            tick=max(0, tick),
            time=stamp,
            belief=_packed(belief),
            informed=None
            if informed is None
            else Informed.model_construct(belief=_packed(informed[0]), ancestors=informed[1]),
        )
        parts = {"team": self.peer.team, "sub_team": self.peer.sub_teams[0], "source": self.peer.robot}
        _, _, opened = open_envelope(Envelope(keys.REPORT.key(**parts, subject=subject), encode(message)))
        assert isinstance(opened, Report)
        check_stamp(opened.time, time, future=self._settings.future, max_age=self._settings.max_age)
        reported(opened, self.grid)
        if subject not in self._reports and len(self._reports) >= MAX_SUBJECTS:
            raise Refused("too-many", f"{subject} would be one more than {MAX_SUBJECTS} subjects")
        return opened

    # --- what is new --------------------------------------------------------------------------------------------------

    def _hear(self, heard: Cue | Message, now: float) -> list[Envelope]:
        if heard is Cue.BEGIN:
            self._reports = {}
        elif heard is Cue.FREE:
            self.peer.begin("")
            self._reports = {}
        elif heard is Cue.TICK:
            return self._stand(now)
        self._news.on_news(heard, now)
        return []

    def _stand(self, now: float) -> list[Envelope]:
        """At a tick of a world say again what still stands."""
        oldest, tick = self.clock.time(now) - STANDS, self.clock.tick
        standing = {subject: report for subject, report in self._reports.items() if report.time >= oldest}
        self._reports = {subject: report.model_copy(update={"tick": tick}) for subject, report in standing.items()}
        return self.peer.say(self._answers(tick, now), now)


def _packed(belief: Belief) -> PackedBelief:
    """Refused "mass": no probability grid."""
    try:
        packed = pack(belief)
    except OpinionError as error:
        raise Refused("mass", str(error)) from None
    total = float(belief.p.sum())
    if abs(total - 1.0) > SUM:
        raise Refused("mass", f"the cells sum to {total:g}, not to 1")
    return packed
