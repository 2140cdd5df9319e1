"""The robot in Rust that sends evidence: as sharp in a joint as ours, and no late, repeated or lost message ends it."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import pytest

from blackboard.net.link import Link
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import packed_grid, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.evidence import Forward
from blackboard.wire.messages import Clock, Consensus, Fix, Odometry, Readings, Report, Sighting, Status
from blackboard.wire.types import Message
from tests.files import ROOT
from tests.processes import Letters, Program, command, program, wait_until

pytestmark = [pytest.mark.rust, pytest.mark.timeout(1800)]  # seconds: the first build takes minutes

CRATE = ROOT / "examples" / "robot_rust"

FIELD = """
[team]
name = "t"
sub_teams = { a = ["r1", "r2", "r3"] }

[grid]
shape = [24, 20]

[time]
seconds = 20

[board]
fusion = "joint"
sharpest = 0.5
objects_drift = 0.3

[world.objects]
ball = { drift = 0.3 }

[world.odometry]
along = 0.5
fix = 1.5

[robot.odometry]
along = 0.5
turn = 0.0
turning = 0.01
compass = 0.01
"""


@pytest.fixture
def joint(built: Callable[[Path], str]) -> str:
    """The path of the program."""
    return str(Path(built(CRATE)).with_name("joint_robot"))


@contextmanager
def team(endpoint: str, scenario: Path, robot: list[str]) -> Iterator[list[Program]]:
    """A board and three robots, of which `robot` is the command of r1; the board comes first."""
    with ExitStack() as running:
        board = program("-m", "blackboard", "serve", "--scenario", str(scenario), "--sub-team", "a", "-e", endpoint)
        ours = [
            program("-m", "robot_agent", "--scenario", str(scenario), "--id", r, "-e", endpoint) for r in ("r2", "r3")
        ]
        yield [running.enter_context(it) for it in (board, *ours, command(*robot))]


def run(endpoint: str, scenario: Path) -> dict[str, Any]:
    """The scorecard of a run in lockstep."""
    with program("-m", "sim_world", str(scenario), "-e", endpoint, "--json") as world:
        world.ends()
        card: dict[str, Any] = json.loads(world.out)
    return card


def test_it_is_as_sharp_in_a_joint_as_our_robot_and_begins_anew_with_a_new_run(
    joint: str, endpoint: str, connect: Callable[[str], Link], tmp_path: Path
) -> None:
    scenario = tmp_path / "field.toml"
    scenario.write_text(FIELD)
    ours = [sys.executable, "-m", "robot_agent", "--scenario", str(scenario), "--id", "r1", "-e", endpoint]
    with team(endpoint, scenario, ours):
        reference = run(endpoint, scenario)
    link = connect("watcher")
    for topic in ("forward/*", "agreed/robot/r1", "refused/*"):
        link.subscribe(f"cop/t/a/{topic}")
    heard: list[Envelope] = []
    with team(endpoint, scenario, [joint, "t", "a", "r1", endpoint]) as (board, *_):
        card = run(endpoint, scenario)
        while letters := link.receive(0.2):
            heard += letters
        again = run(endpoint, scenario)
    assert [envelope for envelope in heard if "refused" in envelope.key] == []
    assert "refused" not in board.err
    assert card["messages"]["refused"] == {}
    forwarded = [decode(Forward, e.payload) for e in heard if "forward" in e.key]
    told = [one for forward in forwarded for one in forward.evidence if one.robot == "r1"]
    assert set(range(1, 100)) - {one.tick for one in told} == set()
    assert any(one.evidence.increment for one in told)
    agreed = [decode(Consensus, e.payload) for e in heard if "agreed" in e.key]
    counted = [any(one.source == "r1" and one.how == "independent" for one in it.used) for it in agreed]
    assert sum(counted) > 0.9 * len(counted), "but for where it began, and where it was gated"
    for group, factor in (("robots", 1.05), ("objects", 1.05)):
        mine, theirs = (one["scores"][group]["agreed"] for one in (card, reference))
        assert mine["rmse"] < factor * theirs["rmse"]
        assert mine["coverage"]["95"] > theirs["coverage"]["95"] - 0.03
    mine, theirs = (one["scores"]["robots"]["by_name"]["r1"]["agreed"] for one in (card, reference))
    assert mine["n"] == theirs["n"]
    assert mine["rmse"] < 1.1 * theirs["rmse"]
    assert again["hash"] == card["hash"]


def test_killed_and_started_again_it_is_back_in_the_joint(
    joint: str, endpoint: str, connect: Callable[[str], Link], tmp_path: Path
) -> None:
    scenario = tmp_path / "field.toml"
    scenario.write_text(FIELD.replace("seconds = 20", "seconds = inf"))
    robot = [joint, "t", "a", "r1", endpoint]
    link = connect("watcher")
    link.subscribe("cop/t/a/forward/*")
    epochs: list[int] = []

    def tells() -> list[int]:
        forwarded = [decode(Forward, e.payload) for e in link.receive(0.05)]
        epochs.extend(one.evidence.epoch for it in forwarded for one in it.evidence if one.robot == "r1")
        return epochs

    with team(endpoint, scenario, robot) as (board, *_, rust), ExitStack() as running:
        world = running.enter_context(program("-m", "sim_world", str(scenario), "-e", endpoint))
        wait_until(lambda: len(tells()) > 20, lambda: f"its evidence is passed on: {epochs} {rust.err}")
        rust.running.kill()
        wait_until(lambda: rust.running.poll() is not None, "it is dead")
        first = set(epochs)
        anew = running.enter_context(command(*robot))
        wait_until(lambda: set(tells()) > first, lambda: f"it is back with a greater epoch: {epochs} {anew.err}")
        wait_until(lambda: anew.out.count("\n") > 10, lambda: f"it prints where the team has it: {anew.out}")
        assert "refused" not in board.err + world.err
    assert max(epochs) > max(first)


class Stage:
    """A world and a board played by hand, for a robot that is alone on them."""

    def __init__(self, link: Link) -> None:
        self.link, self.letters = link, Letters(link)
        for token in ("cop/t/world/alive", "cop/t/a/board/b"):
            link.token(token)
        for key in ("cop/t/a/report/**", "cop/t/a/status/r1", "cop/t/score/**"):
            link.subscribe(key)
        link.watch("cop/t/a/member/r1")

    def begin(self) -> None:
        """Tell the grid until the robot has registered."""
        status = Status(process="b", kind="board", tick=0, time=0.0, grid=packed_grid(Grid((20, 20))))

        def registered() -> bool:
            self.put("cop/t/a/status/b", status)
            return Envelope("cop/t/a/member/r1", kind=Kind.ALIVE) in self.letters.take()

        wait_until(registered, "it holds its token")

    def put(self, key: str, message: Message) -> None:
        self.link.send(Envelope(key, encode(message)))

    def clock(self, tick: int, run: str = "x", mode: Literal["lockstep", "realtime"] = "lockstep") -> None:
        robots = {"a": ["r1"]} if mode == "lockstep" else {}
        self.put("cop/t/world/clock", Clock(run=run, tick=tick, time=0.2 * tick, mode=mode, robots=robots))

    def readings(
        self, tick: int, run: str = "x", fix: tuple[float, float] | None = None, post: tuple[float, float] | None = None
    ) -> None:
        """`post`: a landmark that is there, and is seen 5 cells ahead."""
        seen = [Sighting(subject="object/ball", range=7.0, bearing=0.0)]
        if post is not None:
            seen.append(Sighting(subject="landmark/post", range=5.0, bearing=0.0, landmark=post, range_sigma=0.1))
        its = Readings(
            run=run,
            robot="r1",
            tick=tick,
            time=0.2 * tick,
            odometry=Odometry(distance=0.2, turn=0.0, dt=0.2),
            compass=0.0,
            fix=None if fix is None else Fix(position=fix, sigma=0.5),
            sightings=seen,
        )
        self.put("cop/t/world/reading/r1", its)

    def answers(self, tick: int) -> Report:
        """Wait until it has reported a tick; the report about itself."""
        reports: list[Report] = []
        done: list[Status] = []

        def is_done() -> bool:
            heard = self.link.receive(0.05)
            told = [decode(Report, e.payload) for e in heard if e.key == "cop/t/a/report/r1/robot/r1"]
            reports.extend(report for report in told if report.tick == tick)
            statuses = [decode(Status, e.payload) for e in heard if e.key == "cop/t/a/status/r1"]
            done.extend(it for it in statuses if it.tick == tick and it.phase == "reported")
            return bool(reports and done)

        wait_until(is_done, f"tick {tick} is reported")
        return reports[-1]


def test_late_repeated_lost_and_broken_clocks_end_nothing(
    joint: str, endpoint: str, connect: Callable[[str], Link]
) -> None:
    stage = Stage(connect("stage"))
    with command(joint, "t", "a", "r1", endpoint) as rust:
        stage.begin()
        stage.readings(1, fix=(5.0, 6.0))
        stage.clock(1)
        first = stage.answers(1)
        assert first.evidence is not None
        assert first.evidence.state is not None
        assert first.evidence.state.mean[:5] == (5.0, 6.0, 0.0, 1.0, 1.0)
        assert [it.subject for it in first.evidence.relatives] == ["object/ball"]
        stage.clock(1)
        assert stage.answers(1) == first, "a Clock that comes again"
        stage.readings(2)
        stage.clock(2)
        second = stage.answers(2).evidence
        stage.clock(1)  # late
        stage.link.send(Envelope("cop/t/world/clock", b"nonsense"))
        stage.readings(2)  # repeated
        stage.readings(5)  # those of two ticks are lost
        stage.clock(5)
        fifth = stage.answers(5).evidence
        assert second is not None
        assert fifth is not None
        assert second.travelled.distance == pytest.approx(0.2)
        assert fifth.travelled.distance == pytest.approx(0.4)
        assert fifth.travelled.time == pytest.approx(0.8)
        assert fifth.travelled.along > 2.5 * second.travelled.along, "it may have driven anywhere"
        assert fifth.epoch == second.epoch == first.evidence.epoch

        stage.readings(1, "y", fix=(9.0, 9.0))  # another run
        stage.clock(1, "y")
        anew = stage.answers(1)
        assert anew.evidence is not None
        assert anew.evidence.travelled.distance == 0.0
        assert unpack(anew.belief).mean() == pytest.approx([9.0, 9.0], abs=0.1)

        stage.clock(2, "y", "realtime")
        stage.readings(2, "y")
        stage.answers(2)
        stage.readings(3, "y")  # its Clock is lost
        stage.answers(3)
        assert rust.running.poll() is None


def test_a_robot_that_was_carried_away_doubts_itself_and_finds_itself_by_a_landmark(
    joint: str, endpoint: str, connect: Callable[[str], Link]
) -> None:
    stage = Stage(connect("stage"))
    with command(joint, "t", "a", "r1", endpoint):
        stage.begin()
        stage.readings(1, fix=(5.0, 6.0))
        stage.clock(1)
        first = stage.answers(1)
        for tick in range(2, 12):
            stage.readings(tick, post=(17.0, 14.0))  # so it is at (12, 14)
            stage.clock(tick)
            found = stage.answers(tick)
        assert unpack(found.belief).mean() == pytest.approx([12.0, 14.0], abs=0.5)
        assert first.evidence is not None
        assert found.evidence is not None
        assert found.evidence.epoch > first.evidence.epoch


def test_it_answers_queries_and_goes_on_without_a_world(
    joint: str, endpoint: str, connect: Callable[[str], Link]
) -> None:
    link = connect("driver")
    with (
        program("-m", "blackboard", "serve", "--team", "t", "--sub-team", "a", "-e", endpoint) as board,
        ExitStack() as running,
    ):
        rust = running.enter_context(command(joint, "t", "a", "r1", endpoint))
        link.subscribe("cop/t/a/agreed/robot/r1")
        running.enter_context(program(str(ROOT / "examples" / "feed_robot.py"), "t", "r1", endpoint))
        heard: list[Envelope] = []
        wait_until(lambda: heard.extend(link.receive(0.05)) or len(heard) > 3, lambda: f"it is agreed on: {rust.err}")
        (answer,) = link.get("cop/t/*/report/r1/robot/r1")
        assert decode(Report, answer.payload).evidence is not None
        (answer,) = link.get("cop/t/*/status/r1")
        assert set(decode(Status, answer.payload).subjects) == {"robot/r1", "object/ball"}
        assert "refused" not in board.err + rust.err


@pytest.mark.parametrize(
    "arguments", [(), ("t", "a", "r1", "tcp/127.0.0.1:9", "along=far"), ("t", "a", "r1", "tcp/127.0.0.1:9", "lang=1")]
)
def test_a_mistake_on_its_command_line_is_one_line(joint: str, arguments: tuple[str, ...]) -> None:
    with command(joint, *arguments) as rust:
        assert rust.ends() == 1
        assert len(rust.err.splitlines()) == 1
        assert rust.err.startswith("Error: ")
