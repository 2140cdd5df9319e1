"""What the oracles of ages, clocks, intakes, gains and waits notice. That a team at work breaks nothing, `test_nights.py` shows."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from blackboard.board.board import Board
from blackboard.board.joint.desk import JointDesk
from blackboard.board.joint.others import OtherBoards
from blackboard.board.lead import Lead
from blackboard.opinion.ageing import Ageing
from blackboard.process.intake import Intake
from blackboard.process.offsets import ClockOffsets
from blackboard.process.roll_call import RollCall
from blackboard.wire.messages import Consensus
from robot_agent.gaussian.unsent import Unsent
from robot_agent.inputs import Gathered
from tests.nights.ages import AgesAreTrue, NothingIsFromLater
from tests.nights.clocks import ClocksAreKnown, RunsAreNew, TracksAreNumberedOn
from tests.nights.events import Said
from tests.nights.faults import Killed, Late, OneWay
from tests.nights.gains import GainsAddUp
from tests.nights.intakes import EarlyIsKept
from tests.nights.night import RATE, Night, Team
from tests.nights.oracles import Oracle
from tests.nights.parts import LeadersSpeak
from tests.nights.receipts import HeardIsSettled
from tests.nights.run import judged, opened_once, played
from tests.nights.stage import Stage
from tests.nights.waits import BoardsWaitForForwards, BoardsWaitForReports, LockstepIsWhole, RobotsWaitForTheAgreed

REALTIME = Team({"a": ("r1", "r2"), "b": ("r3",)}, "realtime", tick=1.0, latency=0.02, fusion="joint")
LOCKSTEP = replace(REALTIME, mode="lockstep", latency=0.2)
OPINIONS = replace(REALTIME, fusion="opinions")
FREE = replace(REALTIME, mode="free")
WALKERS = replace(REALTIME, sub_teams={"a": ("r1", "r2", "r3")}, tick=0.5, unnamed="person")
FOUR = replace(REALTIME, sub_teams={"a": ("r1", "r2"), "b": ("r3", "r4")})


def noticed(oracle: type[Oracle], night: Night, until: float) -> str:
    """What an oracle notices in the first seconds of a night, while that goes on: it looks into the processes."""
    judge = oracle(night)
    with opened_once():
        Stage(night, lambda event: judge.see(event) if isinstance(event, judge.sees) else None).play(until)
    return str(judge.verdict() or "")


def always(value: object) -> Callable[..., object]:
    return lambda *arguments, **options: value


def of_now(ageing: Ageing, opinions: Any, subject: str, age: float) -> Any:
    return AGED(ageing, opinions, subject, 0.0)


def forgets(intake: Intake, handle: object) -> list[object]:
    intake.kept.clear()
    return []


def raises_at_once(desk: JointDesk, forward: Any, has_robot: Callable[[str], bool], skew: float) -> None:
    desk.others.hear_forward(forward)
    for one in forward.evidence:
        HEAR(desk, forward.model_copy(update={"evidence": [one]}), has_robot, skew)


def before_alone(unsent: Unsent, prediction: Any) -> None:
    unsent.before, unsent.joint = prediction, None


HEAR = JointDesk.hear_forward
AGED = Ageing.aged

CASES: dict[type[Oracle], tuple[type, str, Any, Night, float, str]] = {
    EarlyIsKept: (Intake, "retry", forgets, Night(FREE, (Killed(3.0, 6.0, "robot/r1", unseen=2.0),)), 6.5, "nor keeps"),
    ClocksAreKnown: (ClockOffsets, "ahead", always(3.0), Night(FREE), 9.0, "for 3.00 s ahead, and it is 0.00 s"),
    GainsAddUp: (
        Unsent,
        "predict",
        before_alone,
        Night(replace(REALTIME, tick=0.5, rate=RATE)),
        6.0,
        "times the variance",
    ),
    RobotsWaitForTheAgreed: (
        *(Gathered, "arrived", always(True)),
        *(Night(LOCKSTEP, (OneWay(2.0, 8.5, "board/a/board-a", "robot/r1"),)), 4.0, "before it has what a agreed on"),
    ),
    BoardsWaitForForwards: (
        *(OtherBoards, "has_heard", always(True)),
        *(Night(LOCKSTEP, (Late(2.0, 8.5, "board/b/board-b", 0.3),)), 8.5, "before it has what board-"),
    ),
    BoardsWaitForReports: (
        *(RollCall, "arrived", always(True)),
        *(
            Night(replace(LOCKSTEP, latency=0.1), (Late(1.0, 8.5, "robot/r1", 0.3),)),
            8.5,
            "before it has what r1 reports",
        ),
    ),
    LeadersSpeak: (Lead, "may_say", always(False), Night(OPINIONS), 6.0, "publishes nothing of what it settled"),
    TracksAreNumberedOn: (
        *(Board, "remember_tracks", always(None)),
        *(Night(WALKERS, (Killed(8.0, 8.5, "board/a/board-a"),), seed=2), 11.0, "gives the name person/1 again"),
    ),
    LockstepIsWhole: (JointDesk, "forward", always([]), Night(LOCKSTEP), 6.0, "is done with tick"),
    HeardIsSettled: (
        *(JointDesk, "hear_forward", raises_at_once),
        *(Night(FOUR, (Late(2.0, 8.0, "board/b/board-b", 3.0), Killed(3.1, 8.0, "robot/r3")), seed=2), 8.0),
        "settles without ('robot/r4'",
    ),
}


@pytest.mark.parametrize("oracle", CASES)
def test_what_is_broken_is_noticed(oracle: type[Oracle], monkeypatch: pytest.MonkeyPatch) -> None:
    owner, name, instead, night, until, why = CASES[oracle]
    assert not noticed(oracle, night, until)
    monkeypatch.setattr(owner, name, instead)
    assert why in noticed(oracle, night, until)


def test_an_opinion_that_is_older_than_a_board_says_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not noticed(AgesAreTrue, Night(OPINIONS), 3.0)
    monkeypatch.setattr(Ageing, "aged", of_now)
    assert "it said nothing then" in noticed(AgesAreTrue, Night(OPINIONS), 3.0)


def test_what_rests_on_what_is_old_or_of_another_run_is_noticed_and_so_is_a_run_that_is_named_again() -> None:
    night = Night(REALTIME)
    events = played(night, until=4.0)
    last = next(e for e in reversed(events) if isinstance(e, Said) and isinstance(e.message, Consensus))
    assert isinstance(last.message, Consensus)
    later = replace(last, message=last.message.model_copy(update={"ancestors": {"r1": 9.0}}))
    robot = last.message.subject.removeprefix("robot/")
    older = replace(last, message=last.message.model_copy(update={"ancestors": {robot: last.message.time - 10.5}}))
    assert not judged(AgesAreTrue(night), events)
    assert f"rests on what {robot} said 10.5 s ago" in judged(AgesAreTrue(night), [*events, older])
    assert not judged(NothingIsFromLater(night), events)
    assert "rests on r1 at 9.0 s" in judged(NothingIsFromLater(night), [*events, later])
    assert not judged(RunsAreNew(night), events)
    assert "of an earlier one" in judged(RunsAreNew(night), [*events, *events])
