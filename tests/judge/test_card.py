"""A scorecard is made from a value: no service, no network, no clock."""

import json
from dataclasses import replace

import pytest

from blackboard.judge.card import scorecard, text
from tests.judge.results import JUDGEMENT, RESULT, SCORES


def test_it_is_the_agreed_json() -> None:
    card = scorecard(RESULT)
    assert card == {
        "verdict": "PASS",
        "reasons": ["robots: fine"],
        "hash": "abc",
        "seed": 7,
        "rule": "coalition",
        "ticks": 7,
        "simulated_s": 0.7,
        "wall_s": 1.235,
        "messages": {"sent": 10, "received": 9, "dropped": 1, "late": 0, "refused": {"shape": 1, "version": 2}},
        "bytes": 1000,
        "scores": SCORES,
        "unit": "m",
        "protocol": "C_blind12",
        "fusion": "joint",
        "mode": "lockstep",
        "team_rmse": {"solo": 1.25, "consensus": 0.75, "agreed": 0.5},
        "missing": {"robot/r2": {"solo": 3}},
        "counters": {"late": 1, "sent": 5},
        "honesty": JUDGEMENT.honesty,
        "motion": JUDGEMENT.motion,
        "lost": JUDGEMENT.lost,
        "tracks": JUDGEMENT.tracks,
        "identities": JUDGEMENT.identities,
        "causes": ["r3 is off"],
    }
    assert json.loads(json.dumps(card)) == card
    assert list(card["messages"]["refused"]) == ["shape", "version"]


@pytest.mark.parametrize(
    ("passed", "stopped", "verdict", "reasons"),
    [
        (True, "", "PASS", ["why"]),
        (False, "", "FAIL", ["why"]),
        (True, "stopped in tick 3 of 7", "FAIL", ["stopped in tick 3 of 7"]),
        (False, "stopped in tick 3 of 7", "FAIL", ["stopped in tick 3 of 7", "why"]),
    ],
)
def test_a_run_that_was_stopped_fails_and_says_why(
    passed: bool, stopped: str, verdict: str, reasons: list[str]
) -> None:
    result = replace(RESULT, stopped=stopped, judgement=replace(JUDGEMENT, passed=passed, reasons=["why"]))
    card = scorecard(result)
    assert (card["verdict"], card["reasons"]) == (verdict, reasons)


def test_a_pass_says_whose_regions_were_judged_in_too_few_blocks() -> None:
    """However long the run was: a robot may be found at its end."""
    few = {"word": "too short", "coverage": {}}
    card = scorecard(replace(RESULT, ticks=300, judgement=replace(JUDGEMENT, honesty={"robots": {"agreed": few}})))
    line = "PASS, but too short to judge the regions of robots agreed: judged in fewer than 3 blocks of 10 s"
    assert line in text(card).splitlines()


def test_a_pass_says_nothing_of_those_of_whom_there_are_none() -> None:
    none = {"objects": {"agreed": {"word": "too short", "coverage": {}}}}
    card = scorecard(replace(RESULT, judgement=replace(JUDGEMENT, honesty=none)))
    assert card["scores"]["objects"]["agreed"]["n"] == 0
    assert "PASS" in text(card).splitlines()


def test_a_pass_says_whose_interval_is_too_wide_to_judge() -> None:
    wide = {"word": "consistent", "coverage": {"50": {"share": 0.3, "low": 0.03, "high": 0.81}}}
    few = {"word": "too short", "coverage": {}}
    honesty = {"robots": {"agreed": wide, "consensus": few}}
    card = scorecard(replace(RESULT, judgement=replace(JUDGEMENT, honesty=honesty)))
    line = (
        "PASS, but too short to judge the regions of robots consensus: judged in fewer than 3 blocks of 10 s; "
        "and of robots agreed: the 95 % interval of their 50 % regions is wider than 50 points"
    )
    assert line in text(card).splitlines()
    assert "too short to judge" not in text({**card, "verdict": "FAIL"})


def test_the_text_has_units_and_directions_and_a_row_for_each_level_that_was_judged() -> None:
    lines = text(scorecard(RESULT)).splitlines()
    shares = [word for level in ("50", "90", "95") for word in ("in", level, "%")]
    assert lines[0].split() == ["n", "RMSE", "p95", "entropy", "log", "score", *shares]
    assert lines[1].split() == ["unit", "m", "m", "nats", "nats", "share", "share", "share"]
    assert lines[2].split() == ["better", "is", "smaller", "smaller", "smaller", "larger", "0.5", "0.9", "0.95"]
    assert [line.split()[:4] for line in lines[3:6]] == [
        ["robots", "solo", "2", "1.250"],
        ["robots", "consensus", "2", "0.750"],
        ["robots", "agreed", "2", "0.500"],
    ]
    assert lines[3].split()[4:] == ["0.900", "3.000", "-2.500", "0.500", "0.875", "1.000"]
    assert lines[5].endswith("1.000  over-cautious")
    assert len({len(line) for line in lines[:5]}) == 1
    assert lines[6:] == [
        "",
        "regions that hold the truth more or less often than they claim (95 % intervals):",
        "  robots agreed: over-cautious at 50 %: holds the truth in 60 % (55 to 65)",
        "",
        "7 ticks, 0.7 s of team time in 1.2 s",
        "rule coalition, fusion joint, seed 7, consensuses abc",
        "(the same scenario and seed give the same hash on the same kind of processor only)",
        "9 messages received, 1 dropped, 0 late, 3 refused",
        "PASS",
        "  robots: fine",
        "  likely cause: r3 is off",
    ]


def test_a_run_that_did_not_wait_for_all_does_not_claim_to_be_repeatable() -> None:
    late = replace(RESULT, messages={**RESULT.messages, "late": 9})
    lines = text(scorecard(late)).splitlines()
    assert "9 messages received, 1 dropped, 9 late, 3 refused" in lines
    assert "(waits ended before all had come (late), so the same scenario and seed may give another hash)" in lines
    assert not any("give the same hash" in line for line in lines)
