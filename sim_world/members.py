"""Who takes part in a run: those on the roster that get sensor data and send answers. Pure.

A token alone does not count: a board, or a robot that the scenario does not name, takes part once it has sent something under
its token. Such a robot is waited for once it has answered a tick.
"""

import logging
from collections.abc import Iterator

from blackboard.config import TeamSection
from blackboard.errors import Refused
from blackboard.judge.instant import Instant
from blackboard.process.in_vain import InVain
from blackboard.process.roster import Roster
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Solo, Status
from blackboard.wire.names import VIA
from sim_world.sensor_source import SensorSource

log = logging.getLogger(__name__)

MAX_STRANGERS = 256  # that are remembered as logged


class Members:
    """Which processes of the team take part, and which are no longer waited for.

    Those are named `robot/<robot>` and `board/<sub-team>/<board>`.
    """

    def __init__(self, team: TeamSection, sensors: SensorSource, roster: Roster) -> None:
        self.team, self.sensors, self.roster = team, sensors, roster
        self.in_vain = InVain()  # who holds a token and sends nothing
        self.strangers: set[str] = set()  # robots that cannot take part
        self._newcomers: set[str] = set()  # robots that have not answered a tick yet
        self._heard: set[tuple[str, str]] = set()  # boards that have said something, as sub-team and name

    def hear_token(self, envelope: Envelope, now: float) -> bool:
        """A token appeared or vanished. True if its holder is back and may have missed something: the tick must be sent again."""
        return self.roster.hear_token(envelope, now)

    def hear_status(self, sub_team: str, status: Status) -> None:
        """A message came from a process; if it holds a token there, it takes part from the next tick on."""
        name, boards = status.process, self.roster.boards
        if status.kind == "board" and (sub_team, name) not in self._heard and name in boards.get(sub_team, []):
            self._heard = {(s, b) for s, b in self._heard if b in boards.get(s, [])} | {(sub_team, name)}
        elif status.kind == "robot" and name.startswith(VIA) and name not in self.sensors.robots:
            return  # it speaks for another team, so the world gives it no readings, and neither waits for it nor judges it
        elif status.kind == "robot" and self.team.guests == "none" and self.team.is_guest(name):
            self._warn_of_stranger(name, "the scenario does not name it, and [team] guests is none")
        elif status.kind == "robot" and name in self.roster.robots.get(sub_team, []):
            known = name in self.sensors.robots
            if not self.sensors.admit(name):
                self._warn_of_stranger(name, "there are no sensor data for it")
            elif not known:
                self._newcomers.add(name)

    @property
    def given_up(self) -> set[str]:
        """The processes that are no longer waited for."""
        return self.in_vain.names

    def hear_answer(self, sub_team: str, message: Solo | Consensus | Status, *, in_time: bool) -> None:
        """A robot or a board answers a tick that has begun: maybe it is waited for again.

        Refused: a board without a token, if it is in time.
        """
        if isinstance(message, Solo):
            self.in_vain.answered(f"robot/{message.robot}", message.tick)
            self._newcomers.discard(message.robot)
            return
        board = message.process if isinstance(message, Status) else message.board
        if in_time and board not in self.roster.boards.get(sub_team, []):
            raise Refused("unregistered", f"board {board} holds no liveliness token in sub-team {sub_team}")
        self.in_vain.answered(f"board/{sub_team}/{board}", message.tick)

    def teams(self) -> dict[str, list[str]]:
        """Who takes part: the sub-teams that have a board, with those of their robots that get readings and answer."""
        return {
            sub_team: [robot for robot in self.roster.robots.get(sub_team, []) if self._is_alive(robot, sub_team)]
            for sub_team in sorted(self.roster.boards)
            if self._boards(sub_team)
        }

    def enough(self) -> bool:
        """Whether the router is there, and some board with some robot."""
        robots = ((robot, s) for s in self.roster.boards if self._boards(s) for robot in self.roster.robots.get(s, []))
        return not self.roster.away and any(self._is_alive(*robot) for robot in robots)

    def absent(self) -> list[str]:
        """Which boards and robots of the scenario are not there."""
        robots = self.roster.robots
        absent = [f"the board of {sub_team}" for sub_team in self.team.sub_teams if not self._boards(sub_team)]
        for sub_team, names in self.team.sub_teams.items():
            absent += [f"{name} of {sub_team}" for name in names if name not in robots.get(sub_team, [])]
        return absent

    def missing(self, instant: Instant) -> Iterator[str]:
        """Who takes part in a tick, is alive, and has not sent everything; no newcomers. A robot of two sub-teams comes twice."""
        boards = {sub_team: boards for sub_team in instant.teams if (boards := self._boards(sub_team))}
        for sub_team in boards:
            for robot in instant.teams[sub_team]:
                if robot in instant.solos or robot in self._newcomers:  # most are, so this is asked first
                    continue
                if self._is_alive(robot, sub_team):
                    yield f"robot/{robot}"
        for sub_team, its in boards.items():
            for board in its:
                if not (instant.settled(sub_team, board) and instant.is_led(sub_team)):
                    yield f"board/{sub_team}/{board}"

    def names(self) -> set[str]:
        """Who takes part and is alive."""
        teams = self.teams()
        boards = {f"board/{sub_team}/{board}" for sub_team in teams for board in self._boards(sub_team)}
        return boards | {f"robot/{robot}" for robots in teams.values() for robot in robots}

    def give_up(self, instant: Instant) -> int:
        """Wait no longer for those who are missing in a tick that is over, newcomers too, until they answer; how many they are."""
        asked = {robot for robots in instant.teams.values() for robot in robots} & self._newcomers
        missing = {*self.missing(instant)} | {f"robot/{robot}" for robot in asked}
        if missing:
            names = ", ".join(sorted(missing))
            log.warning("tick %d: %s alive and silent; no longer waited for", instant.truth.tick, names)
        for name in missing:
            self.in_vain.add(name, instant.truth.tick)
        return len(missing)

    def _warn_of_stranger(self, robot: str, why: str) -> None:
        if robot in self.strangers or len(self.strangers) >= MAX_STRANGERS:
            return
        self.strangers.add(robot)
        log.warning("%s cannot take part: %s", robot, why)

    def _is_alive(self, robot: str, sub_team: str) -> bool:
        """Whether a robot is in a sub-team, gets readings and answers."""
        here = robot in self.roster.robots.get(sub_team, []) and robot in self.sensors.robots
        return here and f"robot/{robot}" not in self.in_vain

    def _boards(self, sub_team: str) -> list[str]:
        """The boards of a sub-team that take part."""
        here = [board for board in self.roster.boards.get(sub_team, []) if (sub_team, board) in self._heard]
        return [board for board in here if f"board/{sub_team}/{board}" not in self.in_vain]


def who(key: str) -> str:
    """The name of the process whose token has this key; empty where it is none of a robot or a board."""
    if member := keys.MEMBER.match(key):
        return f"robot/{member['robot']}"
    board = keys.BOARD.match(key)
    return f"board/{board['sub_team']}/{board['board']}" if board else ""
