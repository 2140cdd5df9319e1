"""A robot among its boards: what it does on each news of the clock, what it says when, whom it believes; whatever its beliefs."""

from typing import Any

import pytest

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.process.peer import WHOLE, Answers, Peer
from blackboard.process.reactions import REACTIONS, Cue, Place
from blackboard.process.team_clock import WORLD_SILENT, News
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Refusal, Report, Solo, Status
from blackboard.wire.types import Message
from tests.wire.envelopes import consensus, kinds, opened, put, token, world

NOW = 1_000_000.0
PLACE = gaussian(Grid((10, 10)), (5, 5), 1.0)


class Robot:
    """A peer under test, whose owner answers no tick by itself, and all that its owner heard."""

    def __init__(self, *sub_teams: str, **more: Any) -> None:
        self.heard: list[Cue | Message] = []
        self.peer = Peer("t", sub_teams or ("a",), "r1", self.hear, settings={"client": "test"}, **more)
        self.tell(token(keys.BOARD, "board-a"))

    def hear(self, event: Cue | Message, now: float) -> list[Envelope]:
        self.heard.append(event)
        return []

    def tell(self, *envelopes: Envelope, now: float = NOW) -> list[Message]:
        answers = [answer for envelope in envelopes for answer in self.peer.receive(envelope, now)]
        self.peer.check()
        return opened(answers)

    def say(self, tick: int, run: str = "x", now: float = NOW) -> list[Message]:
        """Do a tick of a run on readings."""
        if self.peer.run != run:
            self.peer.begin(run)
        time = 0.2 * tick
        report = Report(source="r1", subject="robot/r1", tick=tick, time=time, belief=pack(PLACE))
        solo = Solo(robot="r1", tick=tick, time=time, beliefs={})
        return opened(self.peer.say(Answers(tick, time, [report], solo), now))

    def status(self, now: float = NOW) -> Status:
        said = opened(self.peer.statuses(now))[0]
        assert isinstance(said, Status)
        return said


def clock(tick: int, run: str = "x", **more: Any) -> Envelope:
    return put(Clock(run=run, tick=tick, time=0.2 * tick, mode="lockstep", **more))


# --- the clock ---------------------------------------------------------------------------------------------------------


def in_place(news: News, place: Place) -> Robot:
    """A robot that stands somewhere, and the clock has this news for it."""
    robot = Robot()
    robot.tell(world())
    robot.say(7, "another" if place is Place.ELSEWHERE else "x")
    if news is not News.RUN:
        robot.tell(clock(6))
    if news is News.REPEATED:
        robot.tell(clock(7))
    if place is Place.BEHIND:
        robot.say(5)
    robot.heard.clear()
    if news is News.FREE:
        robot.tell(world(Kind.GONE))
        robot.peer.wake(NOW + WORLD_SILENT + 1.0)
    return robot


@pytest.mark.parametrize(("news", "place"), REACTIONS, ids=lambda event: event.value)
def test_each_news_is_followed_by_what_the_table_says(news: News, place: Place) -> None:
    robot = in_place(news, place)
    said = robot.tell(clock(7)) if news is not News.FREE else []
    cues = REACTIONS[news, place]
    assert robot.heard == [cue for cue in cues if cue is not Cue.REPEAT]
    assert kinds(said) == (["Report", "Solo", "Status"] if Cue.REPEAT in cues else [])
    assert robot.peer.intake.counters["repeated"] == (Cue.REPEAT in cues)
    assert robot.peer.intake.counters["failed"] == 0
    assert robot.peer.run == "x"


def test_another_run_forgets_what_was_said() -> None:
    robot = Robot()
    robot.tell(world())
    robot.say(7)
    robot.tell(clock(0, "y"))
    assert (robot.status().tick, robot.status().phase, robot.status().subjects) == (0, "idle", [])


def test_a_world_that_asks_gets_what_it_asks_for_and_nothing_where_others_are_asked() -> None:
    robot = Robot()
    robot.tell(world())
    robot.say(0)
    robot.tell(clock(0))
    assert robot.tell(clock(0, asked=["robot/r2"], again=["board/a/x"])) == []
    assert kinds(robot.tell(clock(0, asked=["robot/r1"]))) == ["Status"]
    assert kinds(robot.tell(clock(0, again=["robot/r1"]))) == ["Report", "Solo", "Status"]


def test_the_last_clock_of_a_run_begins_no_tick_and_asks_for_nothing() -> None:
    robot = Robot()
    robot.tell(world())
    robot.say(0)
    robot.tell(clock(0))
    robot.heard.clear()
    assert robot.tell(clock(0, end=True)) == []
    assert robot.tell(clock(1, end=True)) == []
    assert robot.heard == []


# --- what it says ------------------------------------------------------------------------------------------------------


def test_it_says_all_in_each_sub_team_and_what_it_holds() -> None:
    robot = Robot("a", "b")
    assert robot.peer.tokens == ("cop/t/a/member/r1", "cop/t/b/member/r1")
    assert kinds(robot.say(0)) == ["Report", "Report", "Status", "Status"]  # a solo belief only where a world reads it
    robot.tell(world())
    assert kinds(robot.say(1)) == ["Report", "Report", "Solo", "Status", "Status"]


def test_the_token_of_a_world_is_answered_with_a_status_which_is_idle_until_its_clock_is_known() -> None:
    robot = Robot()
    robot.say(3)
    assert robot.status().phase == "reported"
    (status,) = robot.tell(world())
    assert isinstance(status, Status)
    assert (status.phase, status.settings) == ("idle", {"client": "test", "pace": "waiting"})


def test_a_status_comes_once_a_second() -> None:
    robot = Robot()
    robot.say(0)
    assert robot.peer.wake(NOW + 0.5) == []
    assert robot.peer.wake_at(NOW) == pytest.approx(NOW + 1.0)
    assert kinds(opened(robot.peer.wake(NOW + 1.0))) == ["Status"]


def test_the_size_of_a_report_is_what_it_takes_on_the_wire() -> None:
    robot = Robot("a", "b", brief=True)
    robot.say(0)
    report = robot.peer.answers.reports[0]
    sent = [envelope for envelope in robot.peer.say(robot.peer.answers, NOW) if keys.REPORT.match(envelope.key)]
    assert robot.peer.size(report) == sum(len(envelope.key) + len(envelope.payload) for envelope in sent)
    plain = Robot("a", "b")
    plain.say(0)
    assert robot.peer.size(report) < plain.peer.size(report)


def test_on_a_poor_link_only_some_statuses_have_counters() -> None:
    robot = Robot(brief=True)
    assert not robot.status().is_brief  # idle
    brief = []
    for tick in range(0, round(WHOLE / 0.2) + 10, 10):  # every two seconds of team time
        robot.say(tick)
        brief.append(robot.status().is_brief)
    assert brief == [True] * len(brief)  # the first one of a tick, which `say` sent, may be whole
    robot.tell(Envelope(keys.AGREED.key(team="t", sub_team="a", subject="robot/r1"), b"\xc1"))
    assert [robot.status().is_brief for _ in range(2)] == [False, True]  # something was refused


# --- whom it believes --------------------------------------------------------------------------------------------------


def agreed(tick: int = 0, time: float = 0.0, subject: str = "robot/r1", **more: Any) -> Envelope:
    return put(consensus(PLACE, subject, **{"board": "board-a", **more}, tick=tick, time=time))


def refusal(reason: str, board: str = "board-a") -> Envelope:
    said = Refusal(
        board=board, sub_team="a", robot="r1", time=1.0, subject="object/ball", reason=reason, text="no\nlines", count=1
    )
    return put(said)


def test_a_board_is_believed_once_its_token_is_there() -> None:
    robot = Robot()
    robot.tell(agreed(board="late"), refusal("grid", board="late"))
    assert robot.heard == []
    assert robot.peer.intake.refused == {"unregistered": 2}
    robot.tell(token(keys.BOARD, "late"))
    assert kinds([event for event in robot.heard if isinstance(event, Message)]) == ["Consensus", "Refusal"]


def test_each_reason_of_a_refusal_is_logged_once_in_one_line(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot()
    robot.tell(*(refusal(reason) for reason in ("grid", "grid", "past")))
    assert [record.getMessage().split(";")[0] for record in caplog.records] == [
        f"board-a refused the report about object/ball of r1 ({reason}: no\\nlines)" for reason in ("grid", "past")
    ]
    assert robot.peer.intake.counters["told_refused"] == len(robot.heard) == 3


def test_what_was_agreed_in_a_tick_that_has_not_begun_is_refused() -> None:
    robot = Robot()
    robot.tell(world(), clock(20))
    robot.tell(agreed(20), agreed(21))
    assert robot.peer.intake.refused == {"future": 1}
    robot.say(20)  # ahead of the next Clock
    robot.tell(agreed(21))
    assert robot.peer.intake.refused == {"future": 1}


def test_a_status_says_the_last_numbers_of_the_tracks_that_were_agreed_on_in_this_run() -> None:
    robot = Robot()
    robot.tell(world(), clock(20))
    names = ("person/9", "person/12", "person/a-3", "person/p", "person/" + "9" * 10)
    robot.tell(*(agreed(20, subject=name, existence=0.9) for name in names), agreed(20, subject="object/ball1"))
    assert robot.status().tracks == {"person/": 12, "person/a-": 3}
    robot.say(0, run="y")
    assert robot.status().tracks == {}


def test_without_a_world_stamps_are_those_of_its_own_clock_and_echoed() -> None:
    """The board tells with the robot's own place how far its clock is ahead."""
    robot = Robot()
    robot.tell(agreed(time=NOW - 4.0, ahead=4.0), agreed(time=NOW - 3.0, subject="object/ball"))
    assert [event.time for event in robot.heard if isinstance(event, Consensus)] == [NOW, NOW + 1.0]
    status = robot.status(NOW + 0.5)
    assert (status.sent, status.echo) == (NOW + 0.5, {"a/board-a": (NOW - 3.0, 0.5)})
    robot.tell(world(), clock(0), agreed(time=0.0))
    assert [event.time for event in robot.heard if isinstance(event, Consensus)][2:] == [0.0]
    assert (robot.status().sent, robot.status().echo) == (None, {})
