"""A tick of a board process in lockstep: for whom it waits before it settles, and before it exchanges."""

import pytest

from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Report, Status
from tests.board.desk import (
    ANOTHER_WORLD,
    WORLD,
    Desk,
    ball,
    board_of,
    clock,
    exchanging,
    levels,
    report,
    reported,
    settled,
    theirs,
)
from tests.wire.envelopes import put, token, world


def test_a_tick_is_settled_once_everybody_named_has_spoken() -> None:
    desk = Desk("r1", "r2")
    desk.tell(clock(0, "r1", "r2"))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"), reported("r2", 0, "object/ball"))) == []
    said = desk.tell(report("r2", 0))
    assert levels(said) == ["consensus", "agreed"]
    consensus = decode(Consensus, said[0].payload)
    assert [u.source for u in consensus.used] == ["r1", "r2"]
    assert decode(Status, said[-1].payload).subjects == ["object/ball"]


def test_a_repeated_clock_is_answered_with_the_same_words() -> None:
    desk = Desk()
    desk.tell(clock(0, "r1"))
    said = desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))
    assert desk.tell(clock(0, "r1")) == said


def test_a_board_that_is_asked_tells_what_it_lacks_and_repeats_only_what_it_is_asked_for() -> None:
    desk = Desk("r1", "r2")

    def asked(**fields: list[str]) -> list[Envelope]:
        again = decode(Clock, clock(0, "r1", "r2").payload).model_copy(update=fields)
        return desk.tell(put(again))

    me = "board/a/a"
    desk.tell(clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    assert asked(asked=["robot/r2"]) == []
    (answer,) = asked(asked=[me])
    assert decode(Status, answer.payload).lacks == ["robot/r2"]
    said = desk.tell(report("r2", 0), reported("r2", 0, "object/ball"))
    (answer,) = asked(asked=[me])
    assert decode(Status, answer.payload).lacks == []
    assert asked(again=[me]) == said


def test_when_the_speed_of_a_robot_elsewhere_arrives_changes_no_bit() -> None:
    """A board does not wait for robots of other sub-teams, so what they say in a tick counts from the next one on."""
    payloads = []
    for order in (1, -1):
        desk = Desk(patience=2.0)
        message = decode(Report, report("r1", 0).payload).model_copy(update={"subject": "robot/r4"})
        desk.tell(clock(0, "r1", b=["r4"]), put(message), reported("r1", 0, "robot/r4"))
        for tick in (1, 2):
            desk.wait(2.5)
            said = [
                ("r1", "a", {"phase": "reported", "kept": ["robot/r4"]}),
                ("r4", "b", {"phase": "reported", "speed": 3.0 * tick}),
            ]
            statuses = [
                put(Status(process=robot, kind="robot", tick=tick, time=0.2 * tick, **fields), sub_team=sub_team)
                for robot, sub_team, fields in said[::order]
            ]
            answers = desk.tell(clock(tick, "r1", b=["r4"]), *statuses)
            payloads.append([envelope.payload for envelope in answers if "/consensus/robot/r4" in envelope.key])
    assert payloads[:2] == payloads[2:]
    assert payloads[0] != payloads[1]


def test_a_dead_robot_is_not_waited_for() -> None:
    desk = Desk("r1", "r2")
    desk.tell(clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    assert levels(desk.tell(token(keys.MEMBER, "r2", kind=Kind.GONE))) == []  # perhaps it was the router
    assert levels(desk.wait(0.4)) == []
    assert levels(desk.wait(0.2)) == ["consensus", "agreed"]


def test_the_exchange_waits_for_the_other_sub_team() -> None:
    desk = Desk()
    desk.tell(board_of("b"), clock(0, "r1", b=["r4"]))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))) == ["consensus"]
    assert levels(desk.tell(settled("b", 0, "object/ball"))) == []
    answers = desk.tell(theirs("b", 0))
    assert levels(answers) == ["agreed"]
    assert set(decode(Consensus, answers[0].payload).ancestors) == {"r1", "r4"}


def test_a_new_run_forgets_the_old_one() -> None:
    desk = Desk()
    desk.tell(clock(5, "r1"), report("r1", 5), reported("r1", 5, "object/ball"))
    desk.tell(*ANOTHER_WORLD)
    said = desk.tell(clock(0, "r1", run="two"), reported("r1", 0))
    assert levels(said) == []
    assert decode(Status, said[-1].payload).tick == 0


@pytest.mark.parametrize(
    ("kind", "phase", "tick"),
    [
        ("board", "agreed", 0),
        ("board", "idle", 0),
        ("robot", "reported", 0),
        ("robot", "consensus", 0),
        ("board", "consensus", 1),
    ],
)
def test_only_what_the_other_board_settled_in_this_tick_ends_the_wait_for_it(kind: str, phase: str, tick: int) -> None:
    desk = exchanging()
    said = Status(process="b", kind=kind, tick=tick, time=0.0, phase=phase, subjects=[])  # type: ignore[arg-type]
    assert levels(desk.tell(put(said, sub_team="b"))) == []
    assert levels(desk.tell(settled("b", 0))) == ["agreed"]


def test_a_sub_team_whose_boards_are_gone_is_not_waited_for() -> None:
    desk = exchanging()
    desk.tell(board_of("b", Kind.GONE))
    assert levels(desk.wait(0.4)) == []
    assert levels(desk.wait(0.2)) == ["agreed"]


def test_each_board_of_another_sub_team_is_waited_for_and_they_count_once() -> None:
    desk = exchanging()
    desk.tell(board_of("b", name="b2"), settled("b", 0, name="b2", phase="idle"), settled("b", 0, "object/ball"))
    assert levels(desk.tell(theirs("b", 0))) == []
    said = desk.tell(settled("b", 0, "object/ball", name="b2"), theirs("b", 0, name="b2", belief=pack(ball(20))))
    assert levels(said) == ["agreed"]
    agreed = decode(Consensus, said[0].payload)
    assert [u.source for u in agreed.used] == ["a", "b"]
    alone = exchanging()
    other = decode(Consensus, alone.tell(settled("b", 0, "object/ball"), theirs("b", 0))[0].payload)
    assert agreed.belief == other.belief


def test_a_board_that_holds_a_token_and_says_nothing_is_not_waited_for() -> None:
    desk = exchanging()
    desk.tell(board_of("b", name="a-first"), settled("b", 0, "object/ball"))
    assert levels(desk.tell(theirs("b", 0))) == ["agreed"]


def test_a_board_that_the_world_names_is_heard_before_its_token_arrives() -> None:
    desk, late = exchanging(), Desk()
    late.tell(clock(0, "r1", b=["r4"]), report("r1", 0), reported("r1", 0, "object/ball"))
    both = settled("b", 0, "object/ball"), theirs("b", 0)
    said = desk.tell(*both)
    assert levels(late.tell(*both)) == []
    assert [e.payload for e in late.tell(board_of("b")) if "/agreed/" in e.key] == [said[0].payload]
    assert late.status().refused == {}


def test_while_the_router_is_away_a_tick_is_not_settled_without_its_robots() -> None:
    desk = Desk("r1", "r2", patience=2.0)
    desk.tell(board_of("a"), clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    lost = [token(keys.MEMBER, robot, kind=Kind.GONE) for robot in ("r1", "r2")]
    for gone in (*lost, board_of("a", Kind.GONE), world(Kind.GONE)):
        desk.tell(gone)
    assert levels(desk.wait(1.0) + desk.wait(10.0) + desk.wait(10.0)) == []
    desk.tell(board_of("a"), WORLD)
    desk.wait(1.9)
    desk.register("r1", "r2")
    assert levels(desk.said) == []
    said = desk.tell(report("r2", 0), reported("r2", 0, "object/ball"))
    assert levels(said) == ["consensus", "agreed"]
    assert [u.source for u in decode(Consensus, said[0].payload).used] == ["r1", "r2"]


def test_the_status_shows_the_rules_in_force() -> None:
    desk = Desk(world=False, gamma=0.25, subjects={"object/ball": {"rule": "median-log"}, "robot/*": {"gamma": 0.5}})
    assert desk.status().settings == {
        "rule": "coalition",
        "k": 2.0,
        "gamma": 0.25,
        "independence": "learn",
        "feedback": "guarded",
        "fusion": "opinions",
        "object/ball.rule": "median-log",
        "robot/*.rule": "coalition",
        "robot/*.k": 2.0,
        "robot/*.gamma": 0.5,
        "robot/*.independence": "learn",
    }


# --- whose words it takes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sub_team", "kind", "phase", "withdrawn"),
    [
        ("a", "robot", "reported", True),
        ("b", "robot", "reported", False),
        ("a", "board", "reported", False),
        ("a", "robot", "agreed", False),
    ],
)
def test_only_a_robot_of_the_sub_team_that_has_reported_withdraws_what_it_does_not_list(
    sub_team: str, kind: str, phase: str, withdrawn: bool
) -> None:
    desk = Desk("r1", "r2", patience=2.0)
    desk.tell(clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    desk.tell(report("r2", 0), reported("r2", 0, "object/ball"))
    desk.tell(clock(1, "r1", "r2"))
    said = Status(process="r1", kind=kind, tick=1, time=0.2, phase=phase, subjects=[])  # type: ignore[arg-type]
    desk.tell(put(said, sub_team=sub_team))
    answers = desk.wait(2.1)
    assert levels(answers) == ["consensus", "agreed"]
    assert [used.source for used in decode(Consensus, answers[0].payload).used] == (
        ["r2"] if withdrawn else ["r1", "r2"]
    )


def test_a_clock_without_a_world_is_logged_once_and_counted_each_time(caplog: pytest.LogCaptureFixture) -> None:
    desk = Desk(world=False)
    for tick in range(3):
        desk.tell(clock(tick, "r1"))
        assert sum("is not followed" in record.message for record in caplog.records) == 1
    assert desk.status().counters["unannounced"] == 3


def test_only_a_phase_that_time_has_ended_counts_as_late() -> None:
    desk = Desk(patience=2.0)
    desk.tell(clock(0, "r1"))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))) == ["consensus", "agreed"]
    assert desk.status().counters.get("late", 0) == 0
    desk.tell(clock(1, "r1"))
    assert levels(desk.wait(1.9)) == []
    assert levels(desk.wait(0.2)) == ["consensus", "agreed"]
    assert desk.status().counters["late"] == 1
