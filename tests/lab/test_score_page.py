"""docs/real-robots.md and its note have the numbers that `blackboard score` wrote."""

import re

import pytest

from blackboard.config.protocols import PROTOCOLS
from tests.files import page
from tests.lab.scored import scored


def table(text: str, heading: str) -> dict[str, list[str]]:
    """The rows of the first table below a heading, by their first cell."""
    _, _, below = text.partition(f"## {heading}\n")
    rows = re.findall(r"^\| (\w+) \| (.*) \|$", below.partition("\n## ")[0], re.MULTILINE)
    return {name: rest.split(" | ") for name, rest in rows}


def share(value: str, digits: int = 2) -> str:
    """As the pages write shares: without the zero in front."""
    return f"{float(value):.{digits}f}".removeprefix("0")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_row_of_the_page_is_what_was_scored(protocol: str) -> None:
    told = table(page("real-robots.md"), "Protocols")[protocol]
    scores = [scored()[protocol, way] for way in ("solo", "opinions", "solo (joint)", "joint", "ideal")]
    assert told == [f"{float(row['rmse']):.3f} ({share(row['coverage_95_value'])})" for row in scores]


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_row_of_the_note_is_what_was_scored(protocol: str) -> None:
    told, row = table(page("notes/real-robots.md"), "The joint on dataset 7")[protocol], scored()[protocol, "joint"]
    covered = [
        f"{share(row[f'coverage_{level}_value'], 3)} "
        f"({share(row[f'coverage_{level}_low'])} {share(row[f'coverage_{level}_high'])})"
        for level in (50, 95)
    ]
    numbers = f"{float(row['p95']):.3f}", *covered, f"{float(row['log_score']):.2f}", f"{float(row['area']):.2f}"
    assert told == list(numbers)


def test_what_the_page_concludes_is_so() -> None:
    text, scores = " ".join(page("real-robots.md").split()), scored()
    alone, opinions, joint = (float(scores["G_wake", way]["localised_s"]) for way in ("solo", "opinions", "joint"))
    assert f"after {alone:g} s alone, after {opinions:g} s with opinions, in the first second with the joint" in text
    assert joint == 1.0
    ratios = [float(scores[p, "joint"]["rmse"]) / float(scores[p, "opinions"]["rmse"]) for p in PROTOCOLS]
    assert "at least two fifths smaller in every protocol" in text
    assert max(ratios) <= 3 / 5
    beside = [float(scores[p, "joint"]["rmse"]) / float(scores[p, "ideal"]["rmse"]) for p in PROTOCOLS]
    assert "It is at most 1 % farther off than the ideal" in text
    assert max(beside) <= 1.01
    assert f"the team is {float(scores['F_nolm', 'joint']['rmse']):.1f} m off over ten minutes" in text
    assert f"in B_turns r1 is {float(scores['B_turns', 'opinions']['max']):.0f} m off" in text
