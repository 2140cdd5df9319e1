"""Robots and boards whose clocks are seconds off, without a world: corrected and told, not refused in silence."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import pytest

from blackboard.board.service import BoardService
from blackboard.config import BoardSection, Scenario
from blackboard.lab.team import robot
from blackboard.net.bus import Bus, BusLink
from blackboard.process.service import connect
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Fix, Odometry, Readings, Report, Status
from robot_agent.service import AgentService

BEGIN = 1_700_000_000.0
STEP, PERIOD = 0.05, 0.2  # seconds between two looks at all processes, and between two readings
SUB_TEAMS = {"a": ["r1", "r2"], "b": ["r3"]}


class Free:
    """Boards and robots on a bus, each process with a clock of its own, and drivers that send readings by their robot's clock."""

    def __init__(self, off: Mapping[str, float], delay: float = 0.0, **settings: object) -> None:
        """`off`: process -> seconds that its clock is ahead; `delay`: seconds that every message takes."""
        scenario = Scenario(
            {"team": {"name": "t", "sub_teams": SUB_TEAMS}, "grid": {"shape": [24, 24]}, "board": settings}
        )
        self.bus, self.now, self.off, self.delay = Bus(), BEGIN, off, delay
        self.boards = {
            s: BoardService(
                team="t",
                sub_team=s,
                board=f"board-{s}",
                grid=scenario.grid,
                settings=BoardSection.model_validate(settings),
            )
            for s in SUB_TEAMS
        }
        self.robots = {name: robot(scenario, name) for name in scenario.team.robots}
        self._drivers, self._ticks = self.bus.connect(), 0
        self._links: dict[str, tuple[BoardService | AgentService, BusLink]] = {}
        self._travelling: list[tuple[float, BusLink, Envelope]] = []
        self.sent: list[tuple[float, Envelope]] = []  # and when
        self.bus.spies.append(lambda envelope: self.sent.append((self.now, envelope)))
        for name, it in {**{it.name: it for it in self.boards.values()}, **self.robots}.items():
            self._join(name, it)

    def add_board(self, sub_team: str, name: str, **settings: object) -> BoardService:
        """One more board of a sub-team."""
        it = BoardService(
            team="t",
            sub_team=sub_team,
            board=name,
            grid=self.boards[sub_team].grid,
            settings=BoardSection.model_validate(settings),
        )
        self._join(name, it)
        return it

    def kill(self, name: str) -> None:
        _, link = self._links.pop(name)
        link.close()

    def _join(self, name: str, it: BoardService | AgentService) -> None:
        link = self.bus.connect()
        self._links[name] = it, link
        connect(it, link)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now += STEP
            if self.now >= BEGIN + self._ticks * PERIOD:
                self._read()
            self._travelling += [(self.now + self.delay, *waiting) for waiting in self.bus.waiting]
            self.bus.waiting = []
            arrived = [(link, envelope) for at, link, envelope in self._travelling if at <= self.now]
            self._travelling = [it for it in self._travelling if it[0] > self.now]
            for name, (it, link) in self._links.items():
                now = self.now + self.off.get(name, 0.0)
                out = [e for to, envelope in arrived if to is link for e in it.receive(envelope, now)]
                due = it.wake_at(now)
                for envelope in out + (it.wake(now) if due is not None and due <= now else []):
                    link.send(envelope)

    def _read(self) -> None:
        self._ticks += 1
        for number, name in enumerate(self.robots):
            readings = Readings(
                run="x",
                robot=name,
                tick=self._ticks,
                time=self.now + self.off.get(name, 0.0),
                odometry=Odometry(distance=0.1, turn=0.0, dt=PERIOD),
                fix=Fix(position=(8.0 + number, 10.0), sigma=1.0),
            )
            self._drivers.send(Envelope(keys.READING.key(team="t", robot=name), encode(readings)))

    def agreed(self, sub_team: str, subject: str, since: float = 0.0) -> list[Consensus]:
        key = keys.AGREED.key(team="t", sub_team=sub_team, subject=subject)
        return [decode(Consensus, e.payload) for at, e in self.sent if e.key == key and at >= since]

    def status(self, process: str) -> Status:
        return [decode(Status, e.payload) for _, e in self.sent if e.key.endswith(f"/status/{process}")][-1]


@pytest.mark.parametrize(
    ("off", "fusion"),
    [
        (3.0, "opinions"),
        (12.0, "joint"),
        pytest.param(-3.0, "joint", marks=pytest.mark.long),
        pytest.param(-25.0, "opinions", marks=pytest.mark.long),
    ],
)
def test_a_robot_whose_clock_is_seconds_off_counts_as_one_whose_clock_is_right(
    off: float, fusion: str, caplog: pytest.LogCaptureFixture
) -> None:
    team = Free({"r2": off}, fusion=fusion)
    team.run(4.0)
    refused, began = team.boards["a"].refused.copy(), team.now
    team.run(3.0)
    assert team.boards["a"].refused == refused, "nothing is refused any more"
    assert team.status("board-a").clocks == {"r2": pytest.approx(off, abs=0.1)}
    assert [r.getMessage() for r in caplog.records if "the clock of" in r.getMessage()] == [
        f"the clock of r2 is {abs(off):.1f} s {'ahead' if off > 0 else 'behind'}; corrected, and not logged again for this source"
    ]
    for level in ("r1", "r2"):
        found = team.agreed("a", f"robot/{level}", began)
        assert found, level
        assert all(used.age < 0.5 for it in found for used in it.used)
    told = team.agreed("a", "robot/r2", began)[-1]
    assert told.ahead == pytest.approx(off, abs=0.1)
    right = Free({}, fusion=fusion)
    right.run(7.0)
    assert told.entropy == pytest.approx(right.agreed("a", "robot/r2")[-1].entropy, abs=0.1)
    assert informed(team) == informed(right), "it takes back what is agreed, at the time of its own clock"


def informed(team: Free) -> set[str]:
    """Whose information r2 had in its last belief about itself."""
    it = [decode(Report, e.payload) for _, e in team.sent if "/report/r2/robot/r2" in e.key][-1]
    return set() if it.informed is None else set(it.informed.ancestors)


def test_a_robot_that_is_off_beyond_the_bound_is_refused_by_name(caplog: pytest.LogCaptureFixture) -> None:
    team = Free({"r2": -8.0}, skew=5.0)
    team.run(3.0)
    assert team.boards["a"].refused["past"] > 0
    assert any("the clock of r2 is 8.0 s behind; up to 5 s are corrected" in r.getMessage() for r in caplog.records)
    assert team.status("board-a").clocks == {"r2": pytest.approx(-8.0, abs=0.1)}


def test_boards_whose_clocks_differ_exchange_as_if_they_did_not() -> None:
    team = Free({"board-b": 4.0})
    team.run(3.0)
    began = team.now
    refused = {s: it.refused.copy() for s, it in team.boards.items()}
    team.run(3.0)
    assert {s: it.refused for s, it in team.boards.items()} == refused
    assert team.status("board-a").clocks == {"b/board-b": pytest.approx(4.0, abs=0.1)}
    assert team.status("board-b").clocks.keys() == {"a/board-a", "r3"}
    assert team.agreed("a", "robot/r3", began)
    assert team.agreed("b", "robot/r1", began)


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_clocks_that_are_right_are_left_alone_however_slow_the_network(delay: float) -> None:
    team = Free({"r2": 0.1, "r1": -0.1}, delay)
    team.run(5.0)
    assert team.status("board-a").clocks == team.status("board-b").clocks == {}
    assert not team.boards["a"].refused
    assert {it.ahead for it in team.agreed("a", "robot/r2")} == {0.0}


@pytest.mark.parametrize("fusion", ["opinions", "joint"])
def test_without_a_world_a_second_board_takes_over_within_a_second(fusion: str) -> None:
    """Also from a leader whose clock is ahead by half a second, and with what the leader had found of the robots' clocks."""
    team = Free({"board-a": 0.5, "r2": -3.0}, fusion=fusion)
    team.run(1.0)
    second = team.add_board("a", "board-a2", fusion=fusion)
    team.run(3.0)
    assert [it.lead.leads for it in (team.boards["a"], second)] == [True, False]
    assert {it.board for it in team.agreed("a", "robot/r1")} == {"board-a"}
    team.kill("board-a")
    died = team.now
    team.run(3.0)
    after = team.agreed("a", "robot/r1", died)
    assert {it.board for it in after} == {"board-a2"}
    first = next(at for at, e in team.sent if at > died and "/a/agreed/" in e.key)
    assert first - died < 1.0
    times = [it.time for it in team.agreed("a", "robot/r1")]
    assert times == sorted(times)
    assert max(later - before for before, later in pairwise(times)) < 1.0
    assert all(used.age < 0.5 for it in team.agreed("a", "robot/r2", died + 0.5) for used in it.used)
    assert second.counters["late"] == 0
