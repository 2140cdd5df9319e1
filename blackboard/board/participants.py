"""Who takes part in a tick, for one board: from whom it takes messages, and for whom it waits. Pure.

Without a world a message may come before the token of its sender, or before the world that names its sender: it is
refused, and tried again when more is known.
"""

from blackboard.board.guests import Guests
from blackboard.errors import Refused
from blackboard.process.intake import TooEarly
from blackboard.process.roster import Roster
from blackboard.process.team_clock import Pace, TeamClock
from blackboard.wire import keys
from blackboard.wire.names import VIA

MAX_ROBOTS = 1024  # whose sub-teams are remembered


class Participants:
    """In lockstep the world's Clock names the robots, and those that have gone are not waited for; else who speaks under a token."""

    def __init__(self, roster: Roster, clock: TeamClock, team: str, sub_team: str, guests: Guests) -> None:
        self.roster, self.clock, self.guests = roster, clock, guests
        self.team, self.sub_team = team, sub_team
        self._members: dict[str, tuple[str, ...]] = {}  # robot -> its sub-teams, as they were known last
        self._heard: set[str] = set()  # robots of this sub-team that have said something
        #: boards of other sub-teams that have said something, and whether they publish their status alone
        self._follows: dict[tuple[str, str], bool] = {}

    def has_robot(self, robot: str, sub_team: str) -> bool:
        """Whether a robot holds a token in a sub-team, or the world names it there."""
        named = self.clock.named or {}
        return robot in self.roster.robots.get(sub_team, []) or robot in named.get(sub_team, [])

    def has_board(self, sub_team: str, board: str) -> bool:
        """Whether a board holds a token in a sub-team."""
        return board in self.roster.boards.get(sub_team, [])

    def check_robot(self, robot: str) -> None:
        """Refused: a guest that may only listen, or a robot without a token in the sub-team that the world does not name.

        TooEarly: its token may be on its way.
        """
        self.guests.check(robot)
        if self.has_robot(robot, self.sub_team):
            return
        raise self.doubted(Refused("unregistered", f"{robot} holds no liveliness token in sub-team {self.sub_team}"))

    def check_board(self, sub_team: str, board: str) -> None:
        """Refused: a board of another sub-team that holds no token. TooEarly: the token may be on its way."""
        if self.has_board(sub_team, board):
            return
        if self._is_expected(sub_team):
            raise TooEarly
        raise self.doubted(Refused("unregistered", f"board {board} holds no liveliness token in sub-team {sub_team}"))

    def check_twin(self, board: str) -> None:
        """TooEarly: a board of this sub-team that holds no token, which may be on its way."""
        if not self.has_board(self.sub_team, board):
            raise TooEarly

    def doubted(self, refusal: Refused) -> Refused | TooEarly:
        """A refusal that counts; it may turn out wrong once a token, or the Clock of a world or of a new run, has come."""
        may_change = self.clock.pace is Pace.FREE or self.clock.may_begin
        return TooEarly(refusal) if may_change else refusal

    def hear_robot(self, robot: str) -> None:
        """A robot of this sub-team says something: where no world names the robots, it is waited for, but not another team."""
        here = self.roster.robots.get(self.sub_team, [])
        if self.guests.may_report(robot) and robot in here and robot not in self._heard and not robot.startswith(VIA):
            self._heard = {*self._heard.intersection(here), robot}

    def hear_role(self, sub_team: str, board: str, *, follows: bool) -> None:
        """Whether a board of another sub-team follows another one there, as its status says."""
        if (sub_team, board) not in self._follows:
            self._follows = {
                (s, b): follows for (s, b), follows in self._follows.items() if b in self.roster.boards.get(s, [])
            }
        self._follows[sub_team, board] = follows

    def note_members(self) -> None:
        """Remember of each robot that is there in which sub-teams it is."""
        robots = self.roster.robots if self.clock.named is None else self.clock.named
        members: dict[str, tuple[str, ...]] = {}
        for sub_team, here in robots.items():
            for robot in here:
                members[robot] = (*members.get(robot, ()), sub_team)
        gone = [robot for robot in self._members if robot not in members]
        kept = gone[max(0, len(gone) + len(members) - MAX_ROBOTS) :]
        self._members = {**{robot: self._members[robot] for robot in kept}, **members}

    def counts(self, robot: str) -> bool:
        """Whether a robot's evidence counts in the exchange through this sub-team.

        It does through the first, by name, of its sub-teams that have a board. One that is no longer there counts where it did.
        """
        boards = self.roster.boards if self.clock.named is None else self.clock.named
        homes = [sub_team for sub_team in self._members.get(robot, ()) if sub_team in boards]
        return self.sub_team == min(homes, default=self.sub_team)

    def robots(self) -> list[str]:
        """The robots of the sub-team that are waited for."""
        return [robot for robot in self.candidates() if self.awaits(robot)]

    def candidates(self) -> list[str]:
        """The robots of the sub-team that may be waited for."""
        return (self.roster.robots if self.clock.named is None else self.clock.named).get(self.sub_team, [])

    def awaits(self, robot: str) -> bool:
        """Whether one of the candidates is waited for."""
        if self.clock.named is None:
            return robot in self._heard
        gone = self.roster.has_gone(keys.MEMBER.key(team=self.team, sub_team=self.sub_team, robot=robot))
        return not gone and self.guests.may_report(robot)

    def boards(self) -> list[tuple[str, str]] | None:
        """The boards of the other sub-teams that are waited for, as (sub-team, board); None while a token is still to come.

        Boards that follow, or have said nothing yet, are waited for only where no other one is left: one of them will lead.
        """
        named = self.roster.boards if self.clock.named is None else self.clock.named
        others = [sub_team for sub_team in named if sub_team != self.sub_team]
        if any(self._is_expected(sub_team) for sub_team in others):
            return None
        return [(sub_team, board) for sub_team in others for board in self._speaking(sub_team)]

    def _speaking(self, sub_team: str) -> list[str]:
        boards = self.roster.boards.get(sub_team, [])
        heard = [board for board in boards if (sub_team, board) in self._follows] or boards
        return [board for board in heard if not self._follows.get((sub_team, board))] or heard

    def _is_expected(self, sub_team: str) -> bool:
        """Whether the world names a sub-team of which no board was ever seen: the token of its board is on its way."""
        seen = sub_team in self.roster.boards or self.roster.has_lost_boards(sub_team)
        return sub_team in (self.clock.named or {}) and not seen
