"""The rule part of [board]: what a person may write, what is in force then, and what a mistake is told."""

import re
from typing import Any

import pytest

from blackboard.config import BoardSection, Scenario, load
from blackboard.errors import UserError
from blackboard.opinion.pools import POOLS
from blackboard.opinion.rules import read_rule


def new_board(**table: Any) -> BoardSection:
    return Scenario({"board": table}, "team.toml").board


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"rule": "linear", "gate": 1, "xi": 9}, "board.gate: rule 'linear' has no such key; it has k, reference_cell"),
        (
            {"gats": 1},
            "board.gats: rule 'coalition' has no such key; it has gamma, gate, independence, k, reference_cell",
        ),
        (
            {"patiance": 3},
            "board.patiance: rule 'coalition' has no such key; it has gamma, gate, independence, k, reference_cell; "
            "a board has coding, drift, feedback, fusion, future, max_age, objects_drift, objects_drifts, objects_motion, objects_motions, patience, period, rule, sharpest, skew, subjects; did you mean patience?",
        ),
        ({"rule": "best"}, "board.rule: 'best' is none of calibrated, channel-filter"),
        ({"k": -1}, "board.k: give a finite value of at least 0 and at most 10 (got -1)"),
        (
            {"independence": 7},
            'board.independence: give a finite value of at least 0 and at most 1, or "learn" (got 7)',
        ),
        (
            {"subjects": {"object/*": {"rule": "linear", "gate": 3}}},
            "board.subjects.object/*.gate: rule 'linear' has no",
        ),
        (
            {"subjects": {"object/*": {"gate": 3}, "*/ball": {"rule": "linear"}}},
            "board.subjects.object/*.gate: rule 'lin",
        ),
        (
            {"subjects": {"object/ball": {"patience": 3}}},
            "board.subjects.object/ball.patience: rule 'coalition' has no",
        ),
        (
            {"subjects": {"ball": {}}},
            'board.subjects.ball: give a subject as "robot/r1" (robot, object, landmark, person), or with * as "object/*" (got \'ball\')',
        ),
        ({"objects_drifts": {"can": 1e200}}, "board.objects_drifts.can: give a number from 0 to 1000 (got 1e+200)"),
        ({"objects_drift": float("inf")}, "board.objects_drift: give a number from 0 to 1000 (got inf)"),
        ({"objects_drifts": {"object/can": 0}}, "board.objects_drifts.object/can: give a name of up to 64 letters"),
        ({"feedback": "all"}, 'board.feedback: give "paper", "guarded" or "off" (got \'all\')'),
        ({"feedback": "gaurded"}, 'board.feedback: give "paper", "guarded" or "off"; did you mean guarded? (got'),
        ({"max_age": 0}, "board.max_age: give a number above 0 (got 0)"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(table: dict[str, Any], text: str) -> None:
    """Fault 6: a parameter of another rule was taken silently."""
    with pytest.raises(UserError, match=f"^team.toml: {re.escape(text)}") as error:
        new_board(**table)
    assert "\\n" not in str(error.value)


@pytest.mark.parametrize("rule", POOLS)
def test_what_is_in_force_is_read_as_the_same(rule: str) -> None:
    in_force = new_board(rule=rule).in_force()
    assert in_force["rule"] == rule
    assert new_board(**in_force).in_force() == in_force
    assert read_rule(in_force).in_force() == in_force


def test_a_subject_keeps_what_it_does_not_set_unless_it_names_another_rule() -> None:
    section = new_board(k=1, gate=3, subjects={
        "object/*": {"independence": 1},
        "object/ball": {"gamma": 0.4},
        "robot/*": {"rule": "cooperative"},
        "robot/r1": {"reference_cell": 2},
        "landmark/*": {"rule": "clique", "inner": "cooperative", "gamma": 0.3},
        "landmark/l1": {"inner": "linear"},
    })  # fmt: skip
    expected = {
        "object/can": {"rule": "coalition", "k": 1.0, "gate": 3.0, "independence": 1.0},
        "object/ball": {"rule": "coalition", "k": 1.0, "gamma": 0.4, "independence": 1.0},  # instead of the gate
        "robot/r2": {"rule": "cooperative", "k": 2.0, "gamma": 0.5},
        "robot/r1": {"rule": "cooperative", "k": 2.0, "gamma": 0.5, "reference_cell": 2.0},
        "landmark/l2": {"rule": "clique", "inner": "cooperative", "xi": 2.0, "k": 2.0, "gamma": 0.3},
        "landmark/l1": {"rule": "clique", "inner": "linear", "xi": 2.0, "k": 2.0},
    }
    assert {subject: section.of(subject).in_force() for subject in expected} == expected
    assert section.in_force()["rule"] == "coalition"
    assert section.in_force()["robot/r1.reference_cell"] == 2.0


def test_another_rule_leaves_the_parameters_of_the_old_one_behind() -> None:
    demo = load("demo")
    assert demo.with_rule("linear").board.in_force() == {"rule": "linear", "k": 2.0}
    assert demo.with_rule("coalition") is demo
    assert demo.with_rule(None) is demo
    with pytest.raises(UserError, match=r"^demo \(shipped\): board\.rule: 'best' is none of"):
        demo.with_rule("best")
    own = {"patience": 3.0, "gate": 3, "subjects": {
        "robot/*": {"independence": 1, "k": 1},
        "object/*": {"rule": "clique", "inner": "cooperative"},
        "object/ball": {"gamma": 0.4},
    }}  # fmt: skip
    changed = Scenario({"board": own}).with_rule("linear")
    assert changed.board.patience == 3.0
    assert changed.board.of("robot/r1").in_force() == {"rule": "linear", "k": 1.0}
    assert changed.board.of("object/ball").in_force()["gamma"] == 0.4
    assert Scenario({"board": own}).with_rule("median-log").board.of("robot/r1").in_force() == {"rule": "median-log"}
    assert own["subjects"]["robot/*"] == {"independence": 1, "k": 1}  # type: ignore[index]  # the scenario itself stays


def test_every_rule_can_be_asked_of_every_scenario_that_comes_with_the_package() -> None:
    for name in ("demo", "paper", "mrclam"):
        for rule in POOLS:
            assert load(name).with_rule(rule).board.rule == rule


def test_a_run_without_an_end_has_no_number_of_ticks() -> None:
    """Only a world process runs until it is stopped; whoever must know the length before says so in one line."""
    assert Scenario({"time": {"seconds": 0.01}}).time.ticks == 1
    with pytest.raises(UserError, match=r"time.seconds is inf"):
        _ = Scenario({"time": {"seconds": float("inf")}}).time.ticks
    with pytest.raises(UserError, match=r"time.seconds"):
        _ = Scenario({"time": {"seconds": float("nan")}}).time
