"""A robot whose beliefs another program makes: when it speaks, what it refuses, what it hears; without a network or a clock."""

from dataclasses import replace

import numpy as np
import pytest

from blackboard.board.service import BoardService
from blackboard.client.agreed import Agreed, Newest, TeamNews
from blackboard.client.member import STANDS, Member
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Refusal, Report, Solo, Status
from blackboard.wire.types import Message
from tests.board.desk import GRID, NOW, WORLD, board_of, clock
from tests.present import present
from tests.wire.envelopes import kinds, opened, put
from tests.wire.messages import AGREED

PLACE = gaussian(GRID, (10, 10), 1.0)


class One:
    """A member under test, and what it was told."""

    def __init__(self, *sub_teams: str, grid: Grid = GRID, raises: bool = False) -> None:
        """`raises`: its program fails at each agreed belief."""
        self.agreed: list[Agreed] = []
        self.raises = raises
        self.refused: list[Refusal] = []
        self.member = Member(
            team="t",
            sub_teams=sub_teams or ("a",),
            robot="r1",
            grid=grid,
            settings=BoardSection(),
            news=TeamNews(grid, self.hear, self.refused.append),
        )
        self.tell(board_of("a", name="board-a"))

    def hear(self, agreed: Agreed) -> None:
        self.agreed.append(agreed)
        if self.raises:
            raise KeyError("of the program's own")

    def tell(self, *envelopes: Envelope, now: float = NOW) -> list[Message]:
        answers = opened(answer for envelope in envelopes for answer in self.member.receive(envelope, now))
        self.member.check()
        return answers

    def report(
        self, subject: str = "robot/r1", belief: Belief = PLACE, now: float = NOW, **more: object
    ) -> list[Message]:
        return opened(self.member.report(subject, belief, now, **more))


def new_board() -> BoardService:
    """A real board that has seen its own token."""
    board = BoardService(team="t", sub_team="a", board="board-a", grid=GRID, settings=BoardSection())
    board.receive(board_of("a", name="board-a"), NOW)
    return board


def settled(board: BoardService, now: float) -> list[str]:
    """What a board has beliefs about at a time."""
    matches = (keys.CONSENSUS.match(envelope.key) for envelope in board.wake(now))
    return [parts["subject"] for parts in matches if parts is not None]


# --- speaking ----------------------------------------------------------------------------------------------------------


def test_without_a_world_a_report_goes_out_at_once_and_its_status_lists_all_that_stands() -> None:
    robot = One("a", "b")
    robot.report("object/ball", now=NOW - 1)
    said = robot.report()
    assert kinds(said) == ["Report", "Report", "Status", "Status"]
    report, status = said[0], said[-1]
    assert isinstance(report, Report)
    assert (report.source, report.subject, report.tick, report.time) == ("r1", "robot/r1", 1000 * NOW, NOW)
    assert isinstance(status, Status)
    assert (status.kind, status.phase, status.tick, status.subjects, status.sent) == (
        "robot", "reported", 1000 * NOW, ["object/ball", "robot/r1"], NOW,
    )  # fmt: skip


def test_in_lockstep_it_answers_every_tick_with_what_stands_until_that_is_old() -> None:
    robot = One()
    robot.tell(WORLD, clock(3, "r1"))
    assert kinds(robot.report()) == ["Report", "Status"]
    said = robot.tell(clock(4, "r1"))
    assert kinds(said) == ["Report", "Solo", "Status"]
    report, solo, status = said
    assert isinstance(report, Report)
    assert isinstance(solo, Solo)
    assert isinstance(status, Status)
    assert (report.tick, report.time, status.tick, status.subjects) == (4, pytest.approx(0.6), 4, ["robot/r1"])
    assert (solo.tick, list(solo.beliefs)) == (4, ["robot/r1"])
    assert kinds(robot.tell(clock(4, "r1"))) == ["Report", "Solo", "Status"]  # the world asks again
    for tick in range(5, 3 + round(STANDS / 0.2) + 2):
        said = robot.tell(clock(tick, "r1"))
    assert kinds(said) == ["Solo", "Status"]
    assert isinstance(said[1], Status)
    assert said[1].subjects == []


def test_what_was_stamped_by_another_clock_is_forgotten_with_it() -> None:
    robot = One()
    robot.report()
    assert kinds(robot.tell(WORLD)) == ["Status"]
    assert kinds(robot.tell(clock(3, "r1"))) == ["Solo", "Status"]
    robot.report()
    robot.tell(replace(WORLD, kind=Kind.GONE))
    (status,) = opened(robot.member.wake(NOW + 99))
    assert isinstance(status, Status)
    assert (status.phase, status.subjects) == ("idle", [])


def test_what_is_withdrawn_is_not_listed_any_more_and_boards_forget_it() -> None:
    robot = One()
    board = new_board()
    board.receive(Envelope(robot.member.tokens[0], kind=Kind.ALIVE), NOW)
    for subject in ("object/ball", "robot/r1"):
        for envelope in robot.member.report(subject, PLACE, NOW):
            board.receive(envelope, NOW)
    assert settled(board, NOW + 0.3) == ["object/ball", "robot/r1"]
    for envelope in robot.member.withdraw("object/ball", NOW):
        board.receive(envelope, NOW)
    assert settled(board, NOW + 0.6) == ["robot/r1"]
    assert robot.member.withdraw("object/ball", NOW) == []


def test_a_program_that_starts_again_withdraws_what_it_said_before() -> None:
    board = new_board()
    before, after = One(), One()
    for n, (robot, subject) in enumerate([(before, "object/ball"), (before, "object/ball"), (after, "robot/r1")]):
        board.receive(Envelope(robot.member.tokens[0], kind=Kind.ALIVE), NOW)
        for envelope in robot.member.report(subject, PLACE, NOW + 0.1 * n):
            board.receive(envelope, NOW + 0.1 * n)
    assert settled(board, NOW + 0.5) == ["robot/r1"]


# --- what is refused ---------------------------------------------------------------------------------------------------


def hole() -> Belief:
    p = PLACE.p.copy()
    p[0, 0] = np.nan
    return Belief(GRID, p)


@pytest.mark.parametrize(("reason", "given"), [
    ("grid", {"belief": uniform(Grid((9, 9)))}),
    ("frame", {"belief": uniform(replace(GRID, frame="odom"))}),
    ("mass", {"belief": hole()}),
    ("mass", {"belief": Belief(GRID, -PLACE.p)}),
    ("mass", {"belief": Belief(GRID, 2 * PLACE.p)}),
    ("mass", {"informed": (hole(), {"r2": NOW})}),
    ("future", {"time": NOW + 9}),
    ("past", {"time": NOW - 99}),
    ("fields", {"time": float("nan")}),
    ("fields", {"informed": (PLACE, {"no name!": NOW})}),
    ("wild-key", {"subject": "ball"}),
    ("wild-key", {"subject": "object/**"}),
])  # fmt: skip
def test_it_refuses_what_a_board_would_and_says_nothing(reason: str, given: dict[str, object]) -> None:
    robot = One(grid=replace(GRID, frame="map"))
    robot.report()
    with pytest.raises(Refused, match=f"^{reason}:"):
        robot.report(**given)
    (status,) = opened(robot.member.wake(NOW + 1))
    assert isinstance(status, Status)
    assert (status.tick, status.subjects) == (1000 * NOW, ["robot/r1"])  # of the report that was taken


def test_what_a_board_tells_of_refusals_is_passed_on() -> None:
    robot = One()
    said = [
        Refusal(board=board, sub_team="a", robot="r1", time=1.0, subject="object/ball", reason="grid", count=1)
        for board in ("board-a", "stranger")
    ]
    robot.tell(*map(put, said))
    assert robot.refused == said[:1]


# --- what is agreed ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("raises", [False, True])
def test_it_hears_what_a_real_board_agrees_on_also_where_a_callback_raises(raises: bool) -> None:
    robot = One(raises=raises)
    board = new_board()
    board.receive(Envelope(robot.member.tokens[0], kind=Kind.ALIVE), NOW)
    out = [e for said in robot.member.report("robot/r1", PLACE, NOW) for e in board.receive(said, NOW)]
    for n in range(1, 20):
        out += board.wake(NOW + 0.2 * n)
    for envelope in out:
        if keys.AGREED.match(envelope.key):
            robot.member.receive(envelope, NOW)
    assert robot.member.intake.counters["failed"] == (len(robot.agreed) if raises else 0)
    newest = robot.agreed[-1]
    assert newest.subject == "robot/r1"
    assert newest.belief.mean() == pytest.approx((10, 10), abs=0.05)
    assert newest.story.used[0].source == "a"
    ticks = [consensus.tick for consensus in robot.agreed]
    assert ticks == sorted(set(ticks))
    assert unpack(newest.story.belief, GRID).p == pytest.approx(newest.belief.p)
    assert newest.pose is None  # this board keeps no joint


def test_of_an_object_in_a_joint_it_hears_the_place_with_its_covariance() -> None:
    said = AGREED.model_copy(update={"belief": pack(PLACE)})
    agreed = present(Newest(GRID).hear_consensus(said, NOW))
    pose = present(agreed.pose)
    assert pose.mean.tolist() == [4.25, 3.5]
    assert pose.covariance.tolist() == [[0.04, 0.01], [0.01, 0.02]]
    older = present(Newest(GRID).hear_consensus(said.model_copy(update={"pose": None}), NOW))
    assert older.pose is None
