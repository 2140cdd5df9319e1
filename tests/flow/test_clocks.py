"""Robots and boards whose clocks are seconds off, without a world: corrected and told, not refused in silence."""

from collections.abc import Mapping
from itertools import pairwise

import pytest

from blackboard.board.service import BoardService, board_of
from blackboard.config import Scenario
from blackboard.net.scheduler import Scheduler
from blackboard.process.service import Quiet, Service
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Fix, Odometry, Readings, Report, Status
from robot_agent.team import robot_of

BEGIN = 1_700_000_000.0
PERIOD = 0.2  # seconds between two readings
SUB_TEAMS = {"a": ["r1", "r2"], "b": ["r3"]}


class Driver(Quiet):
    """What sends a robot its readings, by the robot's clock (`blackboard.process.service.Service`)."""

    def __init__(self, robot: str, x: float) -> None:
        self.robot, self.x, self.tick, self.due = robot, x, 0, 0.0

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        raise AssertionError(envelope.key)

    def wake_at(self, now: float) -> float:
        return self.due

    def wake(self, now: float) -> list[Envelope]:
        self.tick, self.due = self.tick + 1, now + PERIOD
        readings = Readings(
            run="x",
            robot=self.robot,
            tick=self.tick,
            time=now,
            odometry=Odometry(distance=0.1, turn=0.0, dt=PERIOD),
            fix=Fix(position=(self.x, 10.0), sigma=1.0),
        )
        return [Envelope(keys.READING.key(team="t", robot=self.robot), encode(readings))]


class Free(Scheduler):
    """Boards and robots on a bus, each process with a clock of its own, and drivers that send readings by their robot's clock."""

    def __init__(self, off: Mapping[str, float], delay: float = 0.0, **settings: object) -> None:
        """`off`: process -> seconds that its clock is ahead; `delay`: seconds that every message takes."""
        scenario = Scenario(
            {"team": {"name": "t", "sub_teams": SUB_TEAMS}, "grid": {"shape": [24, 24]}, "board": settings}
        )
        super().__init__(BEGIN)
        self.off = off
        self.route = lambda sender, receiver, envelope: (delay,)
        self.scenario = scenario
        self.boards = {s: board_of(scenario, s) for s in SUB_TEAMS}
        self.robots = {name: robot_of(scenario, name) for name in scenario.team.robots}
        self.sent: list[tuple[float, Envelope]] = []  # and when
        self.bus.spies.append(lambda envelope: self.sent.append((self.now, envelope)))
        named: dict[str, Service] = {**{board.name: board for board in self.boards.values()}, **self.robots}
        for name, board in named.items():
            self.join(board, off.get(name, 0.0))
        for number, name in enumerate(self.robots):
            self.join(Driver(name, 8.0 + number), off.get(name, 0.0))

    def add_board(self, sub_team: str, name: str) -> BoardService:
        """One more board of a sub-team."""
        board = board_of(self.scenario, sub_team, name)
        self.join(board, self.off.get(name, 0.0))
        return board

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
    team.run_for(4.0)
    refused, began = team.boards["a"].refused.copy(), team.now
    team.run_for(3.0)
    assert team.boards["a"].refused == refused, "nothing is refused any more"
    assert team.status("board-a").clocks == {"r2": pytest.approx(off, abs=0.1)}
    assert [r.getMessage() for r in caplog.records if "the clock of" in r.getMessage()] == [
        f"the clock of r2 is {abs(off):.1f} s {'ahead' if off > 0 else 'behind'}; corrected, and not logged again for this source"
    ]
    for level in ("r1", "r2"):
        consensuses = team.agreed("a", f"robot/{level}", began)
        assert consensuses, level
        assert all(used.age < 0.5 for consensus in consensuses for used in consensus.used)
    last = team.agreed("a", "robot/r2", began)[-1]
    assert last.ahead == pytest.approx(off, abs=0.1)
    right = Free({}, fusion=fusion)
    right.run_for(7.0)
    assert last.entropy == pytest.approx(right.agreed("a", "robot/r2")[-1].entropy, abs=0.1)
    assert informed(team) == informed(right), "it takes back what is agreed, at the time of its own clock"


def informed(team: Free) -> set[str]:
    """Whose information r2 had in its last belief about itself."""
    report = [decode(Report, e.payload) for _, e in team.sent if "/report/r2/robot/r2" in e.key][-1]
    return set() if report.informed is None else set(report.informed.ancestors)


def test_a_robot_that_is_off_beyond_the_bound_is_refused_by_name(caplog: pytest.LogCaptureFixture) -> None:
    team = Free({"r2": -8.0}, skew=5.0)
    team.run_for(5.0)
    assert team.boards["a"].refused["past"] > 0
    assert any("the clock of r2 is 8.0 s behind; up to 5 s are corrected" in r.getMessage() for r in caplog.records)
    assert team.status("board-a").clocks == {"r2": pytest.approx(-8.0, abs=0.1)}


def test_boards_whose_clocks_differ_exchange_as_if_they_did_not() -> None:
    team = Free({"board-b": 4.0})
    team.run_for(3.0)
    began = team.now
    refused = {s: board.refused.copy() for s, board in team.boards.items()}
    team.run_for(3.0)
    assert {s: board.refused for s, board in team.boards.items()} == refused
    assert team.status("board-a").clocks == {"b/board-b": pytest.approx(4.0, abs=0.1)}
    assert team.status("board-b").clocks.keys() == {"a/board-a", "r3"}
    assert team.agreed("a", "robot/r3", began)
    assert team.agreed("b", "robot/r1", began)


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_clocks_that_are_right_are_left_alone_however_slow_the_network(delay: float) -> None:
    team = Free({"r2": 0.1, "r1": -0.1}, delay)
    team.run_for(5.0)
    assert team.status("board-a").clocks == team.status("board-b").clocks == {}
    assert not team.boards["a"].refused
    assert {consensus.ahead for consensus in team.agreed("a", "robot/r2")} == {0.0}


@pytest.mark.parametrize("fusion", ["opinions", "joint"])
def test_without_a_world_a_second_board_takes_over_within_a_second(fusion: str) -> None:
    """Also from a leader whose clock is ahead by half a second, and with what the leader had found of the robots' clocks."""
    team = Free({"board-a": 0.5, "r2": -3.0}, fusion=fusion)
    team.run_for(1.0)
    second = team.add_board("a", "board-a2")
    team.run_for(3.0)
    assert [board.lead.leads for board in (team.boards["a"], second)] == [True, False]
    assert {consensus.board for consensus in team.agreed("a", "robot/r1")} == {"board-a"}
    team.leave(team.boards["a"])
    died = team.now
    team.run_for(3.0)
    after = team.agreed("a", "robot/r1", died)
    assert {consensus.board for consensus in after} == {"board-a2"}
    first = next(at for at, e in team.sent if at > died and "/a/agreed/" in e.key)
    assert first - died < 1.0
    times = [consensus.time for consensus in team.agreed("a", "robot/r1")]
    assert times == sorted(times)
    assert max(later - before for before, later in pairwise(times)) < 1.0
    assert all(used.age < 0.5 for consensus in team.agreed("a", "robot/r2", died + 0.5) for used in consensus.used)
    assert second.counters["late"] == 0
