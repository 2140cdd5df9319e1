"""A robot's place in its team: what it hears there and the tokens that it holds, whatever makes its beliefs. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from blackboard.wire import keys


@dataclass(frozen=True)
class Membership:
    """The robot of a team, in one or several sub-teams; the properties are those of `blackboard.process.service.Service`."""

    team: str
    sub_teams: tuple[str, ...]
    robot: str

    @property
    def tokens(self) -> tuple[str, ...]:
        return tuple(keys.MEMBER.key(team=self.team, sub_team=s, robot=self.robot) for s in self.sub_teams)

    @property
    def listens(self) -> tuple[str, ...]:
        """The Clock, and of its sub-teams what was agreed on and what of this robot was refused.

        Also the robot's own statuses: what comes there is another process of the same name (`blackboard.process.namesakes`).
        """
        agreed = [keys.AGREED.key(team=self.team, sub_team=s, subject="**") for s in self.sub_teams]
        refused = [keys.REFUSED.key(team=self.team, sub_team=s, robot=self.robot) for s in self.sub_teams]
        statuses = [keys.STATUS.key(team=self.team, sub_team=s, process=self.robot) for s in self.sub_teams]
        return (keys.CLOCK.key(team=self.team), *agreed, *refused, *statuses)

    @property
    def watches(self) -> tuple[str, ...]:
        """The world's token, one of this robot's own (where that vanishes, the network is lost), and those of its boards."""
        boards = [keys.BOARD.key(team=self.team, sub_team=s, board="*") for s in self.sub_teams]
        return (keys.WORLD.key(team=self.team), self.tokens[0], *boards)
