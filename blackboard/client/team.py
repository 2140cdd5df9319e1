"""Team: a robot that reports beliefs of its own making (docs/client.md)."""

from __future__ import annotations

from blackboard.client.agreed import TeamNews
from blackboard.client.member import Member
from blackboard.client.membership import Membership
from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid


class Team(Membership):
    """A robot's place in its team, for a program that makes its beliefs: `report` them."""

    def _made(self, grid: Grid, news: TeamNews) -> Member:
        self._member = Member(
            team=self.name,
            sub_teams=self.sub_teams,
            robot=self.robot,
            grid=grid,
            settings=BoardSection() if self._scenario is None else self._scenario.board,
            news=news,
        )
        return self._member

    def report(
        self,
        subject: str,
        belief: Belief,
        *,
        time: float | None = None,
        informed: tuple[Belief, dict[str, float]] | None = None,
    ) -> None:
        """Say what the robot believes about a subject (`robot/r1`, `object/ball`) from its own sensors alone.

        `time` is team time in seconds [default: now]. `informed` is the same with the team's beliefs folded in, and whose information
        that is (docs/wire.md). It stands until the next one, at most until the boards find it too old. Refused: what a board would
        refuse, with the reason that it would give; with `strict` also what a board has refused.
        """
        self._raise_refused()
        self._desk.call(lambda now: (None, self._member.report(subject, belief, now, time=time, informed=informed)))

    def withdraw(self, subject: str) -> None:
        """Believe nothing any more about a subject."""
        self._desk.call(lambda now: (None, self._member.withdraw(subject, now)))
