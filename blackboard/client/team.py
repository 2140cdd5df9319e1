"""Team: a robot that reports beliefs of its own making (docs/client.md)."""

from collections.abc import Mapping

from blackboard.client.agreed import TeamNews
from blackboard.client.arguments import Call
from blackboard.client.member import Member
from blackboard.client.membership import Membership
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid


class Team(Membership):
    """A robot's place in its team, for a program that makes its beliefs: `report` them."""

    def _made(self, grid: Grid, news: TeamNews) -> Member:
        self._member = Member(
            team=self.name, sub_teams=self.sub_teams, robot=self.robot, grid=grid, settings=self._settings, news=news
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
        refuse, with the reason that it would give; with `strict` also what a board has refused. ValueError: what no board could
        be told, as a belief that is none.
        """
        _check(subject, belief, time, informed)
        self._raise_refused()
        self._desk.call(lambda now: (None, self._member.report(subject, belief, now, time=time, informed=informed)))

    def withdraw(self, subject: str) -> None:
        """Believe nothing any more about a subject."""
        self._desk.call(lambda now: (None, self._member.withdraw(subject, now)))


def _check(subject: object, belief: object, time: object, informed: object) -> None:
    """ValueError: an argument of a report is of a kind that cannot be."""
    known = Call("report")
    if not isinstance(subject, str):
        raise known.wrong("subject", subject, "give robot/NAME, object/NAME, ...")
    if not isinstance(belief, Belief):
        raise known.wrong("belief", belief, "give a Belief")
    if time is not None:
        known.number("time", time)
    if informed is not None:
        both = informed if isinstance(informed, tuple) and len(informed) == 2 else (None, None)
        if not isinstance(both[0], Belief) or not isinstance(both[1], Mapping):
            raise known.wrong(
                "informed", informed, "give a Belief, and a time for each robot whose information it holds"
            )
