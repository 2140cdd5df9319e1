"""The joint: who breaks it, or speaks for others, is left out itself, and nobody else is."""

import pytest

from blackboard.errors import Degenerate, Refused
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.wire import keys
from blackboard.wire.evidence import Forward, Forwarded, PackedEvidence
from tests.board.joint.desks import MAKE, at, means, new_desk
from tests.hostile.attack import Attack
from tests.scenarios import JOINT

ROBOTS = [f"r{i}" for i in range(1, 8)]


def broken(epoch: int) -> PackedEvidence:
    """Evidence that is a message and breaks the joint of whoever takes it."""
    return at(10, 10).model_copy(update={"epoch": epoch})


@pytest.fixture(autouse=True)
def breaking(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a robot sends in an epoch of 13 ms breaks the joint after others were settled, and in one of 14 ms shows a fault of ours."""
    settle = TeamJoint.settle

    def breaks(self: TeamJoint, tick: int, dt: float, reports: list) -> list:  # type: ignore[type-arg]
        verdicts = settle(self, tick, dt, reports)
        if any(evidence.epoch == 13 for evidence in reports):
            raise Degenerate("", "overflow")
        if any(evidence.epoch == 14 for evidence in reports):
            raise KeyError("object/ball")
        if any(evidence.epoch == 15 for evidence in reports) or (self.tick == 3 and not reports):
            raise Degenerate("", "the state itself is broken")
        return verdicts

    monkeypatch.setattr(TeamJoint, "settle", breaks)


@pytest.mark.parametrize("liar", ["r1", "r4", "r7"])
def test_a_member_that_breaks_the_joint_every_tick_is_left_out_and_the_others_are_not(
    liar: str, caplog: pytest.LogCaptureFixture
) -> None:
    desk = new_desk()
    for tick in range(10):
        for i, robot in enumerate(ROBOTS):
            desk.take_evidence(robot, tick, float(tick), broken(13) if robot == liar else at(10 + i, 10), own=True)
        places = means(desk.settle(float(tick), MAKE))
        assert places.keys() == {f"robot/{robot}" for robot in ROBOTS if robot != liar}
    assert (desk.counters["joint_left_out"], desk.counters["joint_restarts"]) == (3, 0)
    assert f"robot/{liar} is left out of the joint for 60 s" in caplog.text


def test_who_was_left_out_may_return_and_is_left_out_at_once_if_it_breaks_the_joint_again() -> None:
    desk = new_desk()
    for tick in range(5):
        desk.take_evidence("r1", tick, float(tick), broken(13), own=True)
        desk.settle(float(tick), MAKE)
    desk.take_evidence("r1", 6, 70.0, at(10, 10).model_copy(update={"epoch": 100}), own=True)
    assert "robot/r1" in means(desk.settle(70.0, MAKE))
    assert desk.counters["joint_left_out"] == 3


def test_a_fault_of_ours_costs_a_robot_that_tick_and_is_logged_once_with_its_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    desk = new_desk()
    for tick in range(10):
        epoch = 14 if 2 <= tick < 7 else 3 * tick
        desk.take_evidence("r1", tick, float(tick), at(10, 10).model_copy(update={"epoch": epoch}), own=True)
        desk.take_evidence("r2", tick, float(tick), at(20, 10), own=True)
        places = means(desk.settle(float(tick), MAKE))
        assert places.keys() == {"robot/r1", "robot/r2"}
    assert +desk.counters == {"failed": 5}
    (error,) = (record for record in caplog.records if record.levelname == "ERROR")
    assert error.exc_info is not None
    assert error.exc_info[0] is KeyError


def test_where_no_robot_is_to_blame_the_joint_begins_anew() -> None:
    desk = new_desk()
    for tick in range(6):
        desk.take_evidence("r1", tick, float(tick), at(10, 10).model_copy(update={"epoch": 5 * tick}), own=True)
        places = means(desk.settle(float(tick), MAKE))
        assert places == ({} if tick == 3 else {"robot/r1": (10.0, 10.0)})
    assert +desk.counters == {"joint_restarts": 1}


def test_a_board_may_not_speak_for_a_robot_of_another_sub_team() -> None:
    desk = new_desk()
    desk.take_evidence("r1", 0, 0.0, at(10, 10), own=True)
    forged = at(40, 40).model_copy(update={"epoch": 900})
    evidence = [
        Forwarded(robot="r1", tick=2**53 - 1, evidence=forged),
        Forwarded(robot="r9", tick=0, evidence=at(20, 20)),
    ]
    with pytest.raises(Refused, match="unregistered"):
        desk.hear_forward(
            Forward(board="b", sub_team="b", tick=0, time=1.0, evidence=evidence), lambda robot: robot == "r9"
        )
    desk.take_evidence("r1", 1, 0.2, at(10, 10), own=True)
    assert means(desk.settle(0.2, MAKE)) == {"robot/r1": (10.0, 10.0), "robot/r9": (20.0, 20.0)}


def test_a_lying_board_does_not_shut_a_robot_out_of_a_running_team() -> None:
    attack = Attack(JOINT)

    def change(said: Forward) -> list[tuple[str, Forward]]:
        forged = [
            evidence.model_copy(update={"robot": "r1", "tick": evidence.tick + 1000}) for evidence in said.evidence
        ]
        return [(key, said.model_copy(update={"evidence": [*forged, *said.evidence]}))]

    key = keys.FORWARD.key(team="t", sub_team="b", board="board-b")
    attack.instead(key, change)
    attack.goes_on()
    board = attack.team.boards["a"]
    assert board.refused["unregistered"] > 0
    agreed = attack.message(keys.AGREED.key(team="t", sub_team="a", subject="robot/r1"))
    assert agreed.rule == "joint"
    assert agreed.ancestors["r1"] == agreed.time
