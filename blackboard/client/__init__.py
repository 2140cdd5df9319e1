"""Join a team from a program of one's own: `from blackboard.client import Robot` (docs/robots.md), or `Team` (docs/client.md)."""

from blackboard.client.agreed import Agreed
from blackboard.client.robot import Robot
from blackboard.client.team import Team
from blackboard.errors import Refused, UserError

__all__ = ["Agreed", "Refused", "Robot", "Team", "UserError"]
