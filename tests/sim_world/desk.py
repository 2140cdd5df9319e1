"""A world process under test without a network, and a team that answers it."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, Literal

import numpy as np

from blackboard.config import Scenario
from blackboard.config.world import WorldSection
from blackboard.judge.card import scorecard
from blackboard.judge.referee import Referee
from blackboard.opinion.belief import gaussian
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Solo, Status, Truth
from sim_world.service import WorldService
from sim_world.world import World
from tests.wire.envelopes import consensus, put, token

NOW = 1_000_000.0
WAITS = {"gather": 30.0, "patience": 2.0, "give_up": 10.0, "grace": 0.5, "comeback": 5.0}
OWN = keys.WORLD.key(team="demo")
Lost = Callable[[Envelope], bool]


def new_service(
    sub_teams: Mapping[str, list[str]], time: Mapping[str, object], world: Mapping[str, object], guests: str = "watch"
) -> WorldService:
    scenario = Scenario(
        {
            "team": {"sub_teams": dict(sub_teams), "guests": guests},
            "grid": {"shape": [20, 20]},
            "time": {"tick": 0.5, "seconds": 2.0, **time},
            "world": {"speed": 0.5, "objects": {}, **WAITS, **world},
        }
    )
    settings, robots = scenario.section("world", WorldSection), scenario.team.robots
    simulated = World(
        settings, scenario.grid, robots, scenario.time.tick, lambda n: np.random.default_rng([1, *n.encode()])
    )
    return WorldService(scenario, simulated, Referee(scenario.grid, settings.check, robots))


def begun(*arguments: Any, silent: Collection[str] = (), lose: Lost = lambda envelope: False, **named: Any) -> "Desk":
    """A desk whose whole team has come; who is silent says nothing, and what is lost does not arrive."""
    desk = Desk(*arguments, **named)
    desk.silent, desk.lose = set(silent), lose
    desk.tokens(Kind.ALIVE)
    return desk


class Desk:
    """A world under test, the team that answers it, and everything it said. Beliefs are sharper together than alone."""

    def __init__(
        self,
        sub_teams: Mapping[str, list[str]] | None = None,
        time: Mapping[str, object] | None = None,
        guests: str = "watch",
        **world: object,
    ) -> None:
        self.teams = {"a": ["r1", "r2"]} if sub_teams is None else dict(sub_teams)
        self.world = new_service(self.teams, time or {}, world, guests)
        self.grid = self.world.referee.grid
        self.now = NOW
        self.said: list[Envelope] = []
        self.silent: set[str] = set()  # "r1", or "a" for its board
        self.lose: Lost = lambda envelope: False
        self.truth: Truth | None = None

    # --- what happens -----------------------------------------------------------------------------------------------

    def tell(self, *envelopes: Envelope) -> None:
        """Deliver some envelopes, and the answers to what they cause, until it is quiet."""
        waiting = list(envelopes)
        while waiting and not self.world.done:
            out = self.world.receive(waiting.pop(0), self.now)
            waiting += self.heard(out)

    def wait(self, seconds: float) -> None:
        """Let time pass, waking the world when it asks for it."""
        end = self.now + seconds
        while not self.world.done and (due := self.world.wake_at(self.now)) is not None and due <= end:
            self.now = max(self.now, due)
            self.tell(*self.heard(self.world.wake(self.now)))
            self.now += 1e-4  # whoever asks to be woken at once for ever is found out by the time limit
        self.now = max(self.now, end)

    def tokens(
        self, kind: Kind, robots: Mapping[str, list[str]] | None = None, boards: list[str] | None = None
    ) -> None:
        """Tokens come, each with the first status of its holder, or go."""
        here = kind is Kind.ALIVE
        for sub_team, names in (self.teams if robots is None else robots).items():
            for r in names:
                self.tell(token(keys.MEMBER, r, team="demo", sub_team=sub_team, kind=kind))
                self.tell(*([self.idle("robot", sub_team, r)] if here else []))
        for sub_team in list(self.teams) if boards is None else boards:
            self.tell(token(keys.BOARD, sub_team, team="demo", sub_team=sub_team, kind=kind))
            self.tell(*([self.idle("board", sub_team, sub_team)] if here else []))

    def heard(self, out: list[Envelope]) -> list[Envelope]:
        """The team's answers to what the world sent."""
        self.said += out
        answers: list[Envelope] = []
        for envelope in out:
            if envelope.key.endswith("/truth"):
                self.truth = decode(Truth, envelope.payload)
            if envelope.key.endswith("/clock"):
                answers += self.answers(decode(Clock, envelope.payload))
        return [answer for answer in answers if not self.lose(answer)]

    def answers(self, clock: Clock) -> list[Envelope]:
        teams = clock.robots if clock.mode == "lockstep" else self.teams
        robots = sorted({r for names in teams.values() for r in names} - self.silent)
        envelopes = [] if clock.end else [self.solo(robot, clock.tick) for robot in robots]
        for sub_team in sorted(set(teams) - self.silent) if not clock.end else []:
            for level in ("consensus", "agreed"):
                subjects = [f"robot/{robot}" for robot in teams[sub_team]]
                envelopes += [self.consensus(sub_team, level, subject, clock.tick) for subject in subjects]
                envelopes.append(self.status(sub_team, level, subjects, clock.tick))
        return envelopes

    # --- what the team says -----------------------------------------------------------------------------------------

    def solo(self, robot: str, tick: int) -> Envelope:
        said = Solo(robot=robot, tick=tick, time=0, beliefs={f"robot/{robot}": self.belief(f"robot/{robot}", 3.0)})
        return put(said, team="demo")

    def belief(self, subject: str, off: float) -> Any:
        assert self.truth is not None
        x, y = self.truth.positions[subject]
        return pack(gaussian(self.grid, (x + off / 2, y), off))

    def consensus(self, sub_team: str, level: str, subject: str, tick: int) -> Envelope:
        belief, board = self.belief(subject, 1.0), {"board": sub_team, "sub_team": sub_team}
        return put(consensus(belief, subject, level=level, tick=tick, **board), team="demo")

    def status(self, sub_team: str, phase: str, subjects: list[str], tick: int) -> Envelope:
        said = Status(process=sub_team, kind="board", tick=tick, time=0, phase=phase, subjects=subjects)  # type: ignore[arg-type]
        return put(said, team="demo", sub_team=sub_team)

    def idle(self, kind: Literal["robot", "board"], sub_team: str, process: str) -> Envelope:
        """What a process says before its first tick."""
        said = Status(process=process, kind=kind, tick=0, time=0, phase="idle", subjects=[])
        return put(said, team="demo", sub_team=sub_team)

    # --- what was seen ----------------------------------------------------------------------------------------------

    @property
    def clocks(self) -> list[Clock]:
        return [decode(Clock, e.payload) for e in self.said if e.key.endswith("/clock")]

    @property
    def ticks(self) -> list[int]:
        return [clock.tick for clock in self.clocks if not clock.end]

    @property
    def card(self) -> dict[str, Any]:
        return scorecard(self.world.result())
