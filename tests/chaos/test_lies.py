"""What a lie costs, as rows and as a table."""

from typing import Any

import pytest

from blackboard.chaos.lies.catalogue import CATALOGUE
from blackboard.chaos.lies.table import asked, row, text
from blackboard.chaos.lies.trial import Trial, honest
from blackboard.config import load
from blackboard.judge.samples import Sample

DEMO = load("demo").changed("time", seconds=20.0)


def sample(robot: str, subject: str, mean_x: float, time: float = 10.0, region: float = 0.5) -> Sample:
    return Sample(1, time, robot, "a", subject, "agreed", 0.0, 0.0, mean_x, 0.0, -1.0, region, 0.0, 1.0, 0.0)


CALM = Trial([sample("r1", "robot/r1", 1.0), sample("r3", "robot/r3", 1.0), sample("r1", "object/ball", 2.0)], {}, 5.0)


def row_with(**more: Any) -> dict[str, Any]:
    """The row of a lie that costs nothing, with some columns changed."""
    return row(DEMO, 1, CATALOGUE["off-3"], CALM, CALM) | more


def test_only_the_honest_are_judged_and_only_from_the_beginning_of_the_lie() -> None:
    samples = [*CALM.samples, sample("r1", "robot/r1", 1.0, time=3.9)]
    assert honest(samples, ["r1", "r2"], 4.0) == [CALM.samples[0], CALM.samples[2]]


def test_a_row_compares_with_the_calm_run() -> None:
    lied = [sample("r1", "robot/r1", 2.0, region=0.97), sample("r3", "robot/r3", 9.0), sample("r1", "object/ball", 2.0)]
    columns = row(DEMO, 7, CATALOGUE["off-3"], CALM, Trial(lied, {}, 10.0))
    assert (columns["robots"], columns["objects"], columns["told"], columns["slower"]) == (2.0, 1.0, 1.0, 2.0)
    assert (columns["coverage"], columns["log_score"], columns["seed"]) == (0.0, 0.0, 7)


def test_what_was_never_told_is_no_error() -> None:
    columns = row(DEMO, 1, CATALOGUE["off-3"], CALM, Trial([CALM.samples[2]], {}, 5.0))
    assert (columns["robots"], columns["coverage"], columns["told"]) == (None, None, 0.5)
    assert not asked([columns], "joint")[0][0]


@pytest.mark.parametrize(
    ("times", "named", "cleared"),
    [
        ([], None, None),
        ([6.0, 7.0, 15.0], 2.0, 0.0),
        ([6.0, 17.5], 2.0, 1.5),
        ([6.0, 7.0, 19.8], 2.0, None),  # it is still named at the end
    ],
)
def test_when_a_liar_is_named_and_cleared(times: list[float], named: float | None, cleared: float | None) -> None:
    columns = row(DEMO, 1, CATALOGUE["off-3"], CALM, Trial(CALM.samples, {"r3": times} if times else {}, 5.0))
    assert (columns["named"], columns["cleared"]) == (named, pytest.approx(cleared) if cleared is not None else None)


def test_how_long_an_honest_robot_was_named() -> None:
    columns = row(DEMO, 1, CATALOGUE["off-3"], CALM, Trial(CALM.samples, {"r1": [1.0, 2.0, 2.5, 9.0, 10.0]}, 5.0))
    assert columns["innocent"] == 1.5


def test_what_is_asked_for() -> None:
    rows = [
        row_with(robots=1.3),
        row_with(lie="x", robots=0.8, coverage=0.95),
        row_with(lie="two", liars=2, robots=1.4),
    ]
    criteria = dict(asked(rows, "joint"))
    assert len(criteria) == 2  # by whether it holds
    lines = [f"{'yes' if holds else 'NO'} {what}" for holds, what in asked(rows, "joint")]
    assert lines == [
        "yes one liar, robots, mean, at most 1.1: 1.05",
        "NO one liar, robots, worst, at most 1.25: 1.30 (off-3, seed 1)",
        "yes one liar, objects, mean, at most 1.25: 1.00",
        "yes one liar, 95 % regions hold at least 0.90: 0.95 (x, seed 1)",
        "NO two that collude, robots, mean, at most 1.35: 1.40",
        "yes an honest robot is named, seconds, at most 5: 0.00 (off-3, seed 1)",
        "yes slower, at most 2: 1.00 (off-3, seed 1)",
    ]
    assert asked(rows[:1], "opinions")[1][0]


def test_the_table_has_a_line_for_each_lie_with_the_mean_of_its_seeds() -> None:
    rows = [row_with(robots=1.0, named=2.0), row_with(seed=2, robots=1.5, named=None)]
    lines = text({"rows": rows, "asked": asked(rows, "joint"), "what": "ratios"}).splitlines()
    assert lines[2] == "| off-3 | 1.25 | 1.50 | 1.00 | +0.00 | 1.00 | 1.00 | - | - | 0.0 s | 1.0 |"
    assert lines[-1] == "ratios"
