"""docs/fields.md documents every JSON field that is really printed, and no other; docs/scorecard.md every word."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from blackboard.judge import calibration
from blackboard.judge.card import scorecard
from blackboard.judge.samples import COLUMNS, GROUPS, LEVELS
from blackboard.wire.evidence import PackedVelocity
from blackboard.wire.messages import UnnamedSighting
from tests.files import page
from tests.judge.instants import at, both, new_instant, referee, solo
from tests.judge.results import RESULT

PAGE = page("scorecard.md") + page("fields.md")
BLOCK = {"n", "rmse", "mean", "p95", "max", "entropy", "log_score", "coverage"}
#: Names that differ from run to run, below these paths.
NAMED = ("tracks", "messages.refused", "counters", "missing", "scores.GROUP.by_name", "motion.velocities.GROUP.by_name")


def real_card() -> dict[str, Any]:
    """The scorecard of 30 s in which every block has something."""
    judge = referee(unnamed=["person"])
    for tick in (50, 100, 150):
        instant = new_instant(
            {"robot/r1": (2.5, 2.5), "object/ball": (5.5, 5.5), "person/p1": (8.5, 8.5)},
            tick,
            velocities={"robot/r1": (1, 0)},
            unnamed={"r1": ["object/ball"]},
        )
        solo(instant, "r1", {"robot/r1": at(2, 4), "object/ball": at(5, 5)})
        for subject, place in (("robot/r1", (2, 3)), ("object/ball", (5, 5))):
            velocity = PackedVelocity(mean=(1.0, 0.0), covariance=(1.0, 0.0, 1.0))
            sighting = UnnamedSighting(source="r1", time=instant.truth.time, mark=0, probability=0.5)
            both(instant, "a", subject, at(*place), at(*place), velocity=velocity, lost=0.1, unnamed=[sighting])
        judge.judge_instant(instant, judged=True)
    return scorecard(replace(RESULT, judgement=judge.judgement()))


def paths(value: object, path: str = "") -> Iterator[str]:
    """Every path to a leaf, with names as NAME, groups as GROUP, levels as LEVEL and levels of regions as PERCENT."""
    if path == "identities.odds" or (path.startswith("motion") and path.endswith("by_name.NAME")):
        yield path  # its fields are those of `lost`, or of the whole group
    elif isinstance(value, list):
        yield f"{path}[]"
    elif not isinstance(value, dict) or value.keys() == BLOCK:
        yield path
    else:
        for key, inner in value.items():
            name = "NAME" if path in NAMED else key
            name = "GROUP" if name in GROUPS else "LEVEL" if name in LEVELS else name
            yield from paths(inner, f"{path}.{'PERCENT' if name.isdigit() else name}".removeprefix("."))


def fields(title: str) -> list[str]:
    """The first column of the table of fields that follows a text."""
    table = PAGE.split(title, 1)[1].split("| field |", 1)[1].split("\n\n", 1)[0]
    return re.findall(r"^\| `([^`]+)` \|", table, re.MULTILINE)


def test_every_field_is_documented_and_every_documented_field_is_there() -> None:
    assert sorted(fields("## As JSON")) == sorted(set(paths(real_card())))


def test_the_block_s_is_documented() -> None:
    block = real_card()["scores"]["robots"]["agreed"]
    assert block.keys() == BLOCK
    flat = [f"{name}.PERCENT" if isinstance(value, dict) else name for name, value in block.items()]
    assert fields("A block S;") == flat


def test_every_column_of_the_table_is_documented() -> None:
    table = PAGE.split("| column |", 1)[1].split("\n\n", 1)[0]
    names = [name for row in table.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert sorted(names) == sorted(COLUMNS)


def test_every_word_is_explained() -> None:
    words = re.findall(
        r"^\| `([a-z -]+?)(?: \([^`]+\))?` \| [^|]+\|$", PAGE.split("| word |", 1)[1].split("\n\n", 1)[0], re.MULTILINE
    )
    assert words == [
        calibration.CONSISTENT,
        calibration.CAUTIOUS,
        calibration.CONFIDENT,
        calibration.MIXED,
        calibration.SHORT,
    ]
