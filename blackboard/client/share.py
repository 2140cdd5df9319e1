"""A process that joins two teams: it reports in one team what the other one agrees on, as if it were a robot there. Pure.

So large fleets become a tree of teams that are small enough for everybody to hear everybody, and sites share what both see.

Nothing is counted twice, whatever the teams tell each other in a circle: what is shared is an informed belief beside a uniform
first-hand one. A board pools such beliefs by Chernoff's rule, for which the same information again adds nothing, and leaves
uniform ones out. Whose information a belief contains goes with it, each robot under the name of its team (`north..r1`), until
when it was gathered too. What holds nothing newer than the other team has is not sent, and what holds nothing newer than
`max_age` ends. So a belief without new evidence ends in all teams.
"""

import logging
import math
import re
from collections.abc import Mapping, Sequence

from blackboard.client.agreed import Agreed, Newest, TeamNews
from blackboard.client.member import Member
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Grid
from blackboard.process.listener import ClockNews, Listener
from blackboard.process.printable import quoted
from blackboard.process.service import Around
from blackboard.process.team_clock import News, TeamClock
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus
from blackboard.wire.names import NAME, OF_TEAM, VIA
from blackboard.wire.types import Message

log = logging.getLogger(__name__)

MAX_SUBJECTS = 256  # that are reported at most, which is as many as a board keeps
OBJECTS = ("object/*",)


class Share(Around):
    """A service (`blackboard.process.service.Service`) that hears one team and reports in another one."""

    def __init__(
        self,
        source: str,
        team: str,
        *,
        sub_team: str,
        grid: Grid,
        settings: BoardSection,
        subjects: Sequence[str] = OBJECTS,
        every: float = 1.0,
    ) -> None:
        """Hear team `source`, and report in `sub_team` of `team`, on the grid of both; `settings` are those of its boards.

        Of `subjects`, each as `object/ball` or `object/*`, one report is sent in `every` seconds of Unix time at most. What robots
        have gathered counts for `max_age` of the settings.
        """
        self.tells = Member(
            team=team,
            sub_teams=(sub_team,),
            robot=VIA + source,
            grid=grid,
            settings=settings,
            news=TeamNews(grid, self._learn),
            judged=False,
        )
        super().__init__(self.tells)
        self._team = team
        self.hears = Listener(source, self._hear)  # in all sub-teams
        self._agreed = Newest(grid)  # in the team that is heard
        self.subjects, self.every, self.max_age = tuple(subjects), every, settings.max_age
        #: subject -> the newest agreed belief that is not reported yet, and its arrival in Unix seconds
        self._newest: dict[str, tuple[Agreed, float]] = {}
        self._runs = "", ""  # of the team that is heard, and of the one that is reported to
        self._due: dict[str, float] = {}  # subject -> Unix seconds from which on it may be reported again
        #: subject -> the ancestors of what the team that is reported to agreed on last
        self._known: dict[str, Mapping[str, float]] = {}
        self._logged: set[str] = set()  # reasons

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def listens(self) -> tuple[str, ...]:
        return (*self.tells.listens, *self.hears.listens)

    @property
    def watches(self) -> tuple[str, ...]:
        return (*self.tells.watches, *self.hears.watches)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.key.startswith(f"cop/{self.hears.team}/"):
            self.hears.receive(envelope, now)
            return self._tell(now)
        return _newest(self.tells.receive(envelope, now) + self._tell(now))

    def wake(self, now: float) -> list[Envelope]:
        self.hears.wake(now)
        return [*self._tell(now), *self.tells.wake(now)]

    def wake_at(self, now: float) -> float | None:
        # Subjects that have ended are found at the latest with the status of each second.
        due = [self._due[subject] for subject in self._newest]
        return min(at for at in (self.hears.wake_at(now), self.tells.wake_at(now), *due) if at is not None)

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        super().check()
        self.hears.check()
        self._agreed.check()
        assert self._newest.keys() <= self._due.keys()
        assert len(self._due) <= MAX_SUBJECTS >= len(self._known)

    # --- from one team to the other -----------------------------------------------------------------------------------

    def _learn(self, agreed: Agreed) -> None:
        """Note what the receiving team agrees on, so that its own knowledge is not sent back to it."""
        self._known.pop(agreed.subject, None)
        self._known[agreed.subject] = agreed.story.ancestors
        if len(self._known) > MAX_SUBJECTS:
            del self._known[next(iter(self._known))]

    def _hear(self, heard: ClockNews | Message, now: float) -> list[Envelope]:
        if isinstance(heard, ClockNews) and heard.news in (News.RUN, News.FREE):
            self._agreed.forget()
        elif isinstance(heard, Consensus) and (agreed := self._agreed.hear_consensus(heard, now)) is not None:
            self._keep(agreed, now)
        return []

    def _keep(self, agreed: Agreed, now: float) -> None:
        subject = _renamed(agreed.subject, self.hears.team)
        kind, _, name = agreed.subject.partition("/")
        if not any(wanted in (agreed.subject, f"{kind}/*") for wanted in self.subjects):
            return
        if kind == "robot" and (name.startswith(VIA) or _at_home(subject, f"robot/{self._team}")[1]):
            return  # the place of a share, which has none, or of a robot of the team that is reported to
        if not re.fullmatch(NAME, subject.partition("/")[2]):
            return  # the robot's name with its team's before it is longer than a name may be
        if subject in self._due or len(self._due) < MAX_SUBJECTS:
            self._newest[subject] = agreed, now
            self._due.setdefault(subject, -math.inf)

    def _tell(self, now: float) -> list[Envelope]:
        runs = _run(self.hears.clock), _run(self.tells.clock)
        if runs != self._runs:  # stamps of another run mean nothing any more
            self._runs, self._newest, self._due, self._known = runs, {}, {}, {}
        out: list[Envelope] = []
        for subject, due in list(self._due.items()):
            if subject in self._newest and due <= now:
                self._due[subject] = now + self.every
                out += self._forwarded(subject, *self._newest.pop(subject), now)
            elif due < now - self.max_age:  # the team that is heard agrees on nothing about it any more
                del self._due[subject]
                out += self.tells.withdraw(subject, now)
        return _newest(out)

    def _forwarded(self, subject: str, agreed: Agreed, came: float, now: float) -> list[Envelope]:
        """A report, if some ancestor is newer than the other team knows; its withdrawal, if all ancestors are older than `max_age`.

        Whose information it is, and until when, is given by the names and in the time of the other team. Its age is the age in
        the source team plus the seconds since it came here, so the clock of the source team plays no part.
        """
        stamp = self.tells.clock.time(now) - max(0.0, now - came)
        gathered, news = dict[str, float](), list[tuple[str, float]]()
        for own_name, until in sorted(agreed.story.ancestors.items()):
            name, home = _at_home(_named(own_name, self.hears.team), self._team)
            if not own_name.startswith(VIA) and re.fullmatch(NAME, name):
                gathered[name] = at = stamp - max(0.0, agreed.time - until)
                news += [] if home else [(name, at)]
        known = self._known.get(subject, {})
        if not any(stamp - at <= self.max_age for _, at in news):
            self.tells.intake.counters["not_shared"] += 1
            return self.tells.withdraw(subject, now)
        if not any(at > known.get(name, -math.inf) + self.every / 2 for name, at in news):
            self.tells.intake.counters["not_shared"] += 1
            return []
        try:
            informed = agreed.belief, gathered
            out = self.tells.report(subject, uniform(self.tells.grid), now, time=stamp, informed=informed)
        except Refused as refusal:
            self.tells.intake.refused[refusal.reason] += 1
            if refusal.reason not in self._logged:
                self._logged.add(refusal.reason)
                log.warning("%s: %s; not logged again for this reason", subject, quoted(str(refusal)))
            return []
        self.tells.intake.counters["shared"] += 1
        return out


def _run(clock: TeamClock) -> str:
    return "" if clock.followed is None else clock.followed.run


def _newest(out: list[Envelope]) -> list[Envelope]:
    newest: dict[str, Envelope] = {}
    for envelope in out:
        newest.pop(envelope.key, None)
        newest[envelope.key] = envelope
    return list(newest.values())


def _at_home(name: str, team: str) -> tuple[str, bool]:
    """A robot's name as `team` says it, and whether it is one of that team's own."""
    return name.removeprefix(team + OF_TEAM), name.startswith(team + OF_TEAM)


def _named(name: str, team: str) -> str:
    """A robot's name among those of other teams: `r1` of team `north` is `north..r1`, and so is one that has come to it as that."""
    return name if OF_TEAM in name else team + OF_TEAM + name


def _renamed(subject: str, team: str) -> str:
    """A subject in another team: robots carry their team's name, objects are the same everywhere."""
    kind, _, name = subject.partition("/")
    return f"robot/{_named(name, team)}" if kind == "robot" else subject
