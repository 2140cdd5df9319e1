"""A night: a team and the faults that it meets, drawn from a seed and a number. Pure.

A night is data, and its `repr` is the Python that makes it again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np

from blackboard import POOLS
from blackboard.chaos.lies.catalogue import CATALOGUE
from blackboard.config import Scenario
from tests.nights import faults
from tests.nights.faults import Fault, Frozen, SecondWorld, Slow, WorldKilled

T = TypeVar("T")

CELLS = 20  # of the grid along each axis
#: A simulated world goes straight on after it has turned, which is a curve only where a tick's turn is small.
SPEED, TURN_RATE = 0.5, 0.3  # units and rad a second
#: What robots believe of their odometry: the physics of such a world, because regions are judged.
ODOMETRY = {"along": 0.3 * SPEED**0.5, "turn": 0.0, "turning": 0.01, "compass": 0.01}
FIRST = 2.0  # seconds: no fault begins earlier, so that the team has met
LAST = 8.5  # seconds: every fault has ended
#: The lies of the catalogue for so many robots of the scenario, and those for guests.
LIES = {liars: sorted(name for name, lie in CATALOGUE.items() if lie.liars == liars) for liars in (0, 1, 2)}
#: The rules, and how often each is drawn.
RULES = {"coalition": 0.6} | {name: 0.4 / (len(POOLS) - 1) for name in sorted(set(POOLS) - {"coalition"})}
UNNAMED: tuple[Literal["", "person", "robot"], ...] = ("", "person", "robot")
RATE = 0.7  # messages a second: one that is in two sub-teams speaks once in 4 s in each, which is the least
MAX_AGES = (10.0, 3.0)  # seconds; in the shorter one a process is frozen, or cut off, for longer
DETECTOR = {"missed": 0.1, "clutter": 0.1}
TOGETHER = 0.3  # of the nights all faults begin at once in such a share
OFF_AT_FIRST = 0.4  # of the nights clocks that are off are so from the beginning, so that what they stamp is taken
CROWD = 1100  # strangers, more than any process keeps anything of
CALM = 4.0  # seconds in which it is watched whether the team is well again


@dataclass(frozen=True)
class Team:
    """Who is in a team, and how it works."""

    sub_teams: dict[str, tuple[str, ...]]  # with their robots; a robot may be in several
    mode: Literal["lockstep", "realtime", "free"]  # free: there is no world
    boards: int = 1  # of each sub-team
    patience: float = 2.0  # seconds that a board waits in each phase of a tick
    tick: float = 0.5  # seconds
    latency: float = 0.01  # seconds that each message takes
    fusion: Literal["opinions", "joint"] = "opinions"
    rule: str = "coalition"
    learns: bool = True  # where the rule can
    feedback: Literal["paper", "guarded", "off"] = "guarded"
    budget: float | None = None  # bytes a second of each robot
    rate: float | None = None  # messages a second of each robot, where these are counted
    guest: bool = False  # a program that reports an object
    unnamed: Literal["", "person", "robot"] = ""  # what detectors do not name: people walk about, or mates look alike
    max_age: float = 10.0  # seconds after which boards do not use what was said
    rolls: float = 0.0  # units a second: how fast the ball rolls
    driven: tuple[str, ...] = ()  # robots whose programs give readings by calls; where there is no world

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(robot for robots in self.sub_teams.values() for robot in robots))

    @property
    def is_poor(self) -> bool:
        """Whether its robots cannot say everything."""
        return self.budget is not None or self.rate is not None

    @property
    def is_learning(self) -> bool:
        """Whether its boards learn whom to believe how far, each by what it has heard."""
        return self.learns and self.rule == "coalition"

    @property
    def processes(self) -> tuple[str, ...]:
        """The names of all processes, as faults use them."""
        boards = [f"board/{s}/board-{s}{n if n > 1 else ''}" for s in self.sub_teams for n in range(1, self.boards + 1)]
        world = [] if self.mode == "free" else ["world"]
        return (*boards, *(f"robot/{robot}" for robot in self.robots), *["guest/g1"] * self.guest, *world)

    def scenario(self, seed: int) -> Scenario:
        """The scenario of such a team in a world of a seed."""
        board: dict[str, Any] = {"fusion": self.fusion, "rule": self.rule, "feedback": self.feedback}
        board |= {"patience": self.patience, "max_age": self.max_age}
        board |= {"objects_motion": "roll"} if self.rolls else {}
        if self.rule == "coalition" and not self.is_learning:
            board["independence"] = 0.5
        send = {"budget": self.budget} if self.budget else {"rate": self.rate * len(self.robots)} if self.rate else {}
        unnamed = {
            "people": {"count": 2 if self.unnamed == "person" else 0, "speed": SPEED},
            "detector": DETECTOR | {"anonymous": [self.unnamed]},
        }
        sub_teams = {s: list(robots) for s, robots in self.sub_teams.items()}
        mode = "realtime" if self.mode == "free" else self.mode
        return Scenario(
            {
                "name": "night",
                "team": {"guests": "vote", "name": "t", "sub_teams": sub_teams, "boards": self.boards},
                "grid": {"shape": [CELLS, CELLS]},
                "time": {"tick": self.tick, "seconds": float("inf"), "mode": mode},
                "board": {**board, "period": self.tick},
                "robot": {"patience": self.patience, "odometry": ODOMETRY, "send": send},
                "world": {
                    "seed": seed,
                    "speed": SPEED,
                    "turn_rate": TURN_RATE,
                    "objects": {"ball": {"drift": 0.2, "rolls": self.rolls}},
                    "gather": 30.0,
                    **(unnamed if self.unnamed else {}),
                },
            },
            "a night",
        )


@dataclass(frozen=True)
class Night:
    """A team, its faults, and the seed of the world that it is in."""

    team: Team
    faults: tuple[Fault, ...] = ()
    seed: int = 1
    name: str = field(default="", compare=False)

    @property
    def healed(self) -> float:
        """Seconds after which every fault has ended."""
        return max((fault.end for fault in self.faults), default=FIRST)

    @property
    def well(self) -> float:
        """Seconds after which the team must be well again."""
        return max((self._noticed(fault) + fault.recovery for fault in self.faults), default=FIRST)

    def _noticed(self, fault: Fault) -> float:
        """When every process can know that a fault has ended: a frozen one hears of a new world only when it goes on."""
        is_another = isinstance(fault, WorldKilled | SecondWorld) or fault.renews("world")
        frozen = [other.end for other in self.faults if isinstance(other, Frozen | Slow) and other.begin <= fault.end]
        return max([fault.end, *frozen]) if is_another else fault.end

    @property
    def end(self) -> float:
        """Seconds that the night lasts."""
        return round(self.well + CALM, 6)

    @property
    def liars(self) -> frozenset[str]:
        """The processes that lie."""
        return frozenset(name for fault in self.faults for name in fault.lies())

    @property
    def is_honest(self) -> bool:
        """Whether nobody lies."""
        return not self.liars

    def without(self, fault: Fault) -> "Night":
        return replace(self, faults=tuple(other for other in self.faults if other is not fault))


class Draw:
    """Choices by a random generator, in the words of a night."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def one(self, options: Sequence[T], shares: Sequence[float] | None = None) -> T:
        p = None if shares is None else np.array(shares) / sum(shares)
        return options[int(self.rng.choice(len(options), p=p))]

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def between(self, low: float, high: float) -> float:
        """A number between two, rounded so that a person can read it."""
        return float(round(self.rng.uniform(low, high), 2))

    def some(self, options: Sequence[T], least: int = 1) -> list[T]:
        """A random part of some options, in random order."""
        count = int(self.rng.integers(least, max(least, len(options)) + 1))
        return [options[i] for i in self.rng.permutation(len(options))[:count]]


def draw_night(seed: int, number: int) -> Night:
    """The night of a seed and a number: always the same."""
    draw = Draw(np.random.default_rng(np.random.SeedSequence((seed, number))))
    team = draw_team(draw)
    count = draw.one([0, 1, 2, 3, 4, 5, 6], [0.04, 0.2, 0.24, 0.22, 0.15, 0.1, 0.05])
    drawn = [draw_fault(draw, team) for _ in range(count)]
    lying = [fault for fault in drawn if fault.lies()]
    drawn = [fault for fault in drawn if fault not in lying[1:]]  # one lie at most
    if draw.chance(TOGETHER):
        drawn = [at_once(fault, drawn[0]) for fault in drawn]
    world = int(draw.rng.integers(1, 1 << 31))
    unnamed, rate = draw.one(UNNAMED, [0.7, 0.15, 0.15]), draw.one([None, RATE], [0.85, 0.15])
    max_age = draw.one(MAX_AGES, [0.8, 0.2])
    team = replace(team, unnamed=unnamed, rate=None if team.budget else rate)
    team = team if team.is_poor else replace(team, max_age=max_age)  # else a robot is rightly left out that says little
    if draw.chance(OFF_AT_FIRST):
        drawn = [replace(fault, begin=0.0) if isinstance(fault, faults.ClockOff) else fault for fault in drawn]
    team = replace(team, rolls=draw.one([0.0, 1.0], [0.7, 0.3]))
    if team.mode == "free" and draw.chance(0.5):
        team = replace(team, driven=tuple(sorted(draw.some(team.robots))))
        if draw.chance(0.5):
            drawn.append(silent(draw, team))
    return Night(team, tuple(drawn), world, f"{seed}/{number}")


def at_once(fault: Fault, first: Fault) -> Fault:
    """A fault that begins with the first one."""
    begin = max(FIRST, first.begin)
    return replace(fault, begin=begin, end=round(min(begin + fault.end - fault.begin, LAST), 2))


def draw_team(draw: Draw) -> Team:
    count = draw.one([2, 3, 4, 5, 6, 7, 8], [0.28, 0.34, 0.2, 0.08, 0.05, 0.03, 0.02])
    robots = [f"r{n}" for n in range(1, count + 1)]
    most = min(count, 4)
    names = "abcd"[: draw.one(range(1, most + 1), [0.3, 0.45, 0.15, 0.1][:most])]
    members: dict[str, list[str]] = {name: [] for name in names}
    for number, robot in enumerate(robots):
        members[names[number % len(names)]].append(robot)
        if len(names) > 1 and draw.chance(0.08):
            members[names[(number + 1) % len(names)]].append(robot)
    mode: Literal["lockstep", "realtime", "free"] = draw.one(("lockstep", "realtime", "free"), [0.4, 0.35, 0.25])
    tick = draw.one([0.5, 1.0], [0.35, 0.65] if count < 5 else [0.1, 0.9])
    rule = draw.one(list(RULES), list(RULES.values()))
    return Team(
        sub_teams={name: tuple(robots) for name, robots in members.items()},
        mode=mode,
        boards=draw.one([1, 2], [0.6, 0.4]),
        patience=draw.one([1.0, 2.0]),
        tick=tick,
        latency=round(tick / 5, 4) if mode == "lockstep" else draw.one([0.001, 0.02, 0.05]),
        fusion=draw.one(("opinions", "joint")),
        rule=rule,
        learns=draw.chance(0.7),
        feedback=draw.one(("guarded", "off", "paper"), [0.7, 0.15, 0.15]),
        budget=draw.one([None, 2000.0, 600.0], [0.85, 0.1, 0.05]),
        guest=draw.chance(0.15),
    )


# --- faults ------------------------------------------------------------------------------------------------------------


def draw_fault(draw: Draw, team: Team) -> Fault:
    """A fault that this team may meet."""
    makers = [maker for fits, some in MAKERS if fits(team) for maker in some]
    return draw.one(makers)(draw, team)


SHORT = (0.05, 0.3)  # seconds: less than a tick


def span(draw: Draw, longest: float = 5.0, short: Sequence[float] = SHORT) -> tuple[float, float]:
    """Beginning and end of a fault: many are short."""
    length = draw.one([*short, 1.0, 2.5, longest])
    begin = draw.between(FIRST, LAST - length)
    return begin, round(begin + length, 2)


def anybody(draw: Draw, team: Team) -> str:
    return draw.one(["*", *team.processes], [0.3, *[0.7 / len(team.processes)] * len(team.processes)])


def boards_of(team: Team) -> list[str]:
    return [process for process in team.processes if process.startswith("board/")]


def robots_of(team: Team) -> list[str]:
    return [process for process in team.processes if process.startswith("robot/")]


def doubled(draw: Draw, team: Team) -> Fault:
    return faults.Doubled(*span(draw), anybody(draw, team), draw.one([0.1, 0.5, 1.0]), draw.one([0.0, 0.2, 2.0]))


def stale(draw: Draw, team: Team) -> Fault:
    return faults.Stale(*span(draw), anybody(draw, team), draw.one([0.1, 0.5]), draw.one([0.5, 2.0]))


def one_way(draw: Draw, team: Team) -> Fault:
    """Half of them are between boards, or a board and the world."""
    few = [process for process in team.processes if not process.startswith(("robot/", "guest/"))]
    return faults.OneWay(*span(draw), *draw.some(few if len(few) > 1 and draw.chance(0.5) else team.processes, 2)[:2])


def parted(draw: Draw, team: Team) -> Fault:
    everybody = draw.some(team.processes, len(team.processes))
    count = draw.one([2, 2, 3])
    cuts = sorted(int(draw.rng.integers(1, len(everybody))) for _ in range(count - 1))
    parts = [everybody[a:b] for a, b in zip([0, *cuts], [*cuts, len(everybody)], strict=True)]
    return faults.Parted(*span(draw), tuple(tuple(sorted(part)) for part in parts if part))


def killed(draw: Draw, team: Team) -> Fault:
    begin, end = span(draw)
    unseen = draw.one([0.0, round((end - begin) / 2, 2)])
    return faults.Killed(begin, end, draw.one([process for process in team.processes if process != "world"]), unseen)


def hung(draw: Draw, team: Team) -> Fault:
    begin = draw.between(FIRST, FIRST + 0.5)
    return faults.Frozen(begin, LAST, draw.one(boards_of(team)))


def clock_off(draw: Draw, team: Team) -> Fault:
    rate = draw.one([0.0, -0.05, 0.02, 0.3], [0.6, 0.1, 0.2, 0.1])
    return faults.ClockOff(*span(draw), draw.one(team.processes), draw.one([-20.0, -2.0, -0.3, 0.5, 3.0, 40.0]), rate)


def another_board(draw: Draw, team: Team) -> Fault:
    sub_team, name = draw.one(list(team.sub_teams)), draw.one(["a-first", "z-last"])
    if draw.chance(0.3):
        return faults.AnotherBoard(draw.one([0.0, FIRST]), LAST, sub_team, name, hangs=True)
    return faults.AnotherBoard(*span(draw), sub_team, name)


def silent(draw: Draw, team: Team) -> Fault:
    """A sensor of a robot whose program gives readings by calls measures nothing for a while.

    Its odometry is there at first, because a robot that has never told any odometry is taken to stand.
    """
    return faults.Silent(*span(draw), f"robot/{draw.one(team.driven)}", draw.one([*faults.PARTS]))


def lies(draw: Draw, team: Team) -> Fault:
    """One liar; where three others are honest, sometimes two."""
    who, other = draw.some(robots_of(team), 2)[:2]
    if len(team.robots) >= 5 and draw.chance(0.5):
        return faults.Lies(*span(draw, short=()), who, draw.one(LIES[2]), other)
    return faults.Lies(*span(draw, short=()), who, draw.one(LIES[1]))


def lying_guest(draw: Draw, team: Team) -> Fault:
    return faults.LyingGuest(*span(draw, short=()), draw.one(list(team.sub_teams)), "g9", draw.one(LIES[0]))


Maker = Callable[[Draw, Team], Fault]

#: What can go wrong, by the teams to which it can happen.
MAKERS: tuple[tuple[Callable[[Team], bool], tuple[Maker, ...]], ...] = (
    (
        lambda team: True,
        (
            lambda draw, team: faults.Lost(*span(draw), anybody(draw, team), draw.one([0.05, 0.3, 0.7, 1.0])),
            lambda draw, team: faults.Late(*span(draw), anybody(draw, team), draw.one([0.05, 0.3, 1.0, 3.0])),
            doubled,
            stale,
            lambda draw, team: faults.TooLarge(*span(draw), anybody(draw, team), draw.one([300, 800, 2000])),
            one_way,
            parted,
            lambda draw, team: faults.Parted(*span(draw), ((), (draw.one(team.processes),))),  # one is cut off
            lambda draw, team: faults.Routerless(*span(draw)),
            lambda draw, team: faults.Flapping(*span(draw), draw.one(team.processes), draw.one([0.2, 0.6, 1.5, 3.0])),
            killed,
            lambda draw, team: faults.Frozen(*span(draw, 6.0), draw.one(team.processes)),
            lambda draw, team: faults.Slow(*span(draw), draw.one(team.processes), draw.one([0.3, 1.0])),
            clock_off,
            lambda draw, team: faults.Suspended(*span(draw), draw.one(team.processes)),
            another_board,
            lambda draw, team: faults.FullDisk(*span(draw)),
        ),
    ),
    (
        lambda team: team.mode != "free",
        (lambda draw, team: faults.WorldKilled(*span(draw, 6.0)), lambda draw, team: faults.SecondWorld(*span(draw))),
    ),
    (lambda team: team.boards > 1, (hung,)),
    (lambda team: len(team.robots) >= 3, (lies,)),
    (
        lambda team: len(team.robots) < 5,
        (lambda draw, team: faults.Crowd(*span(draw), draw.one(list(team.sub_teams)), CROWD),),
    ),
    (lambda team: len(team.robots) >= 3 and team.mode != "free", (lying_guest,)),
)
