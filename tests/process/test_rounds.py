"""Rounds: the tables are walked; each phase ends as its row says, and none is a dead end."""

import math

import pytest

from blackboard.process.rounds import TABLES, Rounds, Row
from blackboard.process.team_clock import Pace

NOW = 1_000_000.0
WAITS = {
    "patience": 2.0,
    "patience with boards": 2.5,
    "half a period": 0.1,
    "gather": 60.0,
    "give_up": 20.0,
    "tick": 0.2,
    "linger": 1.0,
}
ROWS = [(process, pace, phase, row) for process, table in TABLES.items() for (pace, phase), row in table.items()]
NAMES = [f"{process}-{pace.value}-{phase}" for process, pace, phase, _ in ROWS]
every_row = pytest.mark.parametrize(("process", "pace", "phase", "row"), ROWS, ids=NAMES)


def new_rounds(process: str, phase: str) -> Rounds:
    rounds = Rounds(TABLES[process], WAITS, phase)
    rounds.enter(phase, NOW)
    return rounds


@every_row
def test_each_phase_leads_to_one_that_its_pace_has(process: str, pace: Pace, phase: str, row: Row) -> None:
    assert (pace, row.then) in TABLES[process]


@pytest.mark.parametrize(("process", "pace", "phase", "row"), [row for row in ROWS if row[3].until])
def test_a_phase_ends_with_its_fact_at_once_and_in_time(process: str, pace: Pace, phase: str, row: Row) -> None:
    rounds = new_rounds(process, phase)
    asked: list[str] = []
    assert rounds.turn(pace, NOW, lambda fact: bool(asked.append(fact)) or fact == row.until) == (phase, False)
    assert asked == [row.until]
    assert (rounds.phase, rounds.began) == (row.then, NOW)


@every_row
def test_a_phase_ends_by_time_when_its_wait_is_over(process: str, pace: Pace, phase: str, row: Row) -> None:
    rounds = new_rounds(process, phase)
    wait = {"never": math.inf, "at once": 0.0, **WAITS}[row.at_most]
    assert rounds.ends_at(pace) == NOW + wait
    if wait == math.inf:
        assert rounds.turn(pace, NOW + 1e9, lambda fact: False) is None
        assert rounds.phase == phase
        return
    if wait > 0:
        assert rounds.turn(pace, NOW + 0.99 * wait, lambda fact: False) is None
    assert rounds.turn(pace, NOW + 1.01 * wait, lambda fact: False) == (phase, row.late)
    assert rounds.phase == row.then


@every_row
def test_only_phases_with_a_fact_can_be_late(process: str, pace: Pace, phase: str, row: Row) -> None:
    assert bool(row.until) or not row.late


@pytest.mark.parametrize("pace", [Pace.FREE, Pace.REALTIME, Pace.LOCKSTEP])
def test_a_board_settles_before_it_agrees_at_every_pace(pace: Pace) -> None:
    rounds = new_rounds("board", "reports")
    ended = [rounds.turn(pace, NOW, lambda fact: True), rounds.turn(pace, NOW, lambda fact: True)]
    assert ended == [("reports", False), ("exchange", False)]
    assert rounds.turn(pace, NOW, lambda fact: True) is None
    assert rounds.phase == "settled"


def test_a_board_without_a_world_waits_for_no_fact() -> None:
    rounds = new_rounds("board", "reports")
    ended = [rounds.turn(Pace.FREE, NOW, pytest.fail), rounds.turn(Pace.FREE, NOW, pytest.fail)]
    assert ended == [("reports", False), ("exchange", False)]


def test_a_phase_that_the_pace_does_not_have_lasts() -> None:
    rounds = new_rounds("board", "reports")
    assert rounds.turn(Pace.WAITING, NOW + 1e9, lambda fact: True) is None
    assert rounds.ends_at(Pace.WAITING) == math.inf


def test_a_phase_counts_as_late_where_time_ends_what_an_answer_should_have_ended() -> None:
    late = {
        (name, pace.value, phase) for name, table in TABLES.items() for (pace, phase), row in table.items() if row.late
    }
    assert late == {
        ("board", "realtime", "reports"),
        ("board", "realtime", "exchange"),
        ("board", "lockstep", "reports"),
        ("board", "lockstep", "exchange"),
        ("robot", "lockstep", "agreed"),
        ("world", "lockstep", "tick"),
    }
