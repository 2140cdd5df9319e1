"""How many teams, boards and levels a fleet needs, by measured costs: `blackboard plan`."""

import math
import re
from dataclasses import asdict, dataclass
from typing import Any, Literal

from blackboard.errors import UserError
from blackboard.run.flags import OutputFlags

MOST = 0.5  # of a core and of a link that is planned for: robots speak all at once, and TCP repeats what is lost
SOURCES = 63  # robots of a team: a board keeps 64 sources of a subject, and one is the share from above
BELOW = 8  # teams that share with one team above them: what benchmarks/fleet.py measures
UNITS = {"bit": 1.0, "kbit": 1e3, "Mbit": 1e6, "Gbit": 1e9}
LIMITS = {  # what may bind
    "board": "a board's core",
    "link": "a team's link",
    "robot_link": "a robot's link",
    "sources": "a board's places for sources",
}
Fusion = Literal["opinions", "joint"]


@dataclass(frozen=True)
class Growth:
    """What n robots in one team make in a tick: a n + b n^2, neither negative."""

    a: float
    b: float

    def __call__(self, robots: int) -> float:
        return self.a * robots + self.b * robots**2


@dataclass(frozen=True)
class Costs:
    """Of one team in a tick, on 50 x 50 cells in the demo's arena, with two objects."""

    board: Growth  # processor milliseconds of its board, Zenoh included
    out: Growth  # bytes of all its robots, keys included
    into: Growth  # bytes into one robot, the same


#: Fitted by `python benchmarks/costs.py 4 8 16 32 48`, and `4 8 16 24 --fusion joint`, on two cores that
#: others used, too; boards that left ticks out are not in the fit (from 48 and 24 robots on).
COSTS: dict[Fusion, Costs] = {
    "opinions": Costs(Growth(2.6, 0.18), Growth(570, 238), Growth(800, 2.4)),
    "joint": Costs(Growth(5.4, 0.2), Growth(3280, 136), Growth(1460, 31)),
}


@dataclass(frozen=True)
class Plan:
    """A tree of teams, and what one of them uses."""

    robots: int  # of each team, at most
    teams: int  # with robots
    above: tuple[int, ...]  # teams without robots, level by level up to the root
    binds: str | None  # the limit by which a team is no larger; None: all are one team
    used: dict[str, float]  # by the limit's name, the share of it that a team uses; `MOST` is planned for

    @property
    def boards(self) -> int:
        """One for each team."""
        return self.teams + sum(self.above)

    @property
    def shares(self) -> int:
        """Two between each team and the one above it."""
        return 2 * (self.boards - 1)

    @property
    def later(self) -> float:
        """Seconds by which shares, each once a second, delay what goes from one end of the tree to the other."""
        return 2.0 * len(self.above)


def planned(robots: int, hertz: float, link: float, robot_link: float, costs: Costs) -> Plan:
    """The fewest teams of one board each; links in bits a second: that of a team, and that of a robot.

    UserError: one robot alone takes more than is planned for.
    """

    def used(team: int) -> dict[str, float]:
        out, into = 8 * hertz * costs.out(team), 8 * hertz * costs.into(team)
        return {
            "board": hertz * costs.board(team) / 1e3,
            "link": (out + team * into) / link,
            "robot_link": (out / team + into) / robot_link,
            "sources": team / SOURCES * MOST,
        }

    def fits(team: int) -> bool:
        return max(used(team).values()) <= MOST

    largest = next((team for team in range(min(robots, SOURCES), 0, -1) if fits(team)), 0)
    binds = None
    if largest < robots:
        beyond = used(largest + 1)
        binds = max(beyond, key=lambda limit: beyond[limit])
        if largest == 0:
            raise UserError(
                f"--hz {hertz:g}: one robot alone takes {100 * beyond[binds]:.0f} % of {LIMITS[binds]}, "
                f"and {100 * MOST:g} % is planned for; give fewer reports a second, or a larger link"
            )
    teams = math.ceil(robots / largest)
    above, level = list[int](), teams
    while level > 1:
        level = math.ceil(level / BELOW)
        above.append(level)
    size = math.ceil(robots / teams)
    return Plan(size, teams, tuple(above), binds, used(size))


def plan(
    *,
    robots: int,
    hz: float,
    link: str,
    robot_link: str | None = None,
    fusion: Fusion = "opinions",
    output: OutputFlags = OutputFlags(),
) -> int:
    """Say how many teams, boards and levels a fleet needs, and what binds: a board, the team's link, or a robot's.

    Costs were measured with the demo's robots and two objects on 50 x 50 cells. Half of a core and of each link is planned for.

    Parameters
    ----------
    robots
        How many there are.
    hz
        How often each of them reports in a second.
    link
        What the network of one team carries, all robots together, as 250kbit, 20Mbit or 1Gbit, in a second.
    robot_link
        What the link of one robot carries [default: as --link].
    fusion
        How boards put beliefs together ([board] fusion).
    """
    if robots < 1:
        raise UserError(f"--robots {robots}: give at least 1")
    if not 0.0 < hz < math.inf:
        raise UserError(f"--hz {hz:g}: give reports a second, more than 0")
    of_team = bits("--link", link)
    of_robot = of_team if robot_link is None else bits("--robot-link", robot_link)
    table = planned(robots, hz, of_team, of_robot, COSTS[fusion])
    output.show({"boards": table.boards, "shares": table.shares, "later": table.later, **asdict(table)}, _text)
    return 0


def bits(flag: str, text: str) -> float:
    """Bits a second, as `20Mbit`. UserError: no such number."""
    number = re.fullmatch(rf"(\d+(?:\.\d+)?) ?({'|'.join(UNITS)})(?:/s)?", text)
    if number is None or float(number[1]) == 0.0:
        raise UserError(f"{flag} {text}: give bits a second as 250kbit, 20Mbit or 1Gbit")
    return float(number[1]) * UNITS[number[2]]


def _text(plan: dict[str, Any]) -> str:
    above = f"; above them {' + '.join(str(level) for level in plan['above'])} without robots" if plan["above"] else ""
    lines = [
        f"teams: {plan['teams']} of at most {plan['robots']} robots, one board each{above}",
        f"boards: {plan['boards']}, shares: {plan['shares']}",
        f"what one team tells another is about {plan['later']:g} s older there",
        f"binds: {LIMITS.get(plan['binds'], 'nothing, all are one team')}",
        *(f"used of {LIMITS[limit]}: {100 * share:.0f} %" for limit, share in plan["used"].items()),
    ]
    return "\n".join(lines)
