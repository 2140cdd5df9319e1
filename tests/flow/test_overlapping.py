"""A robot in two sub-teams: what both boards agree on is as good as what one board with all robots makes of the same run."""

import math

import pytest

from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from tests.heard import Agreed, played
from tests.scenarios import SCENARIO

PRODUCT = {"independence": 1.0, "gate": 50.0}


def new_scenario(sub_teams: dict[str, list[str]], **board: object) -> Scenario:
    """Robots that take nothing back, so that what they report is the same whatever their boards do."""
    scenario = SCENARIO.changed("team", sub_teams=sub_teams).changed("time", seconds=2.0)
    return scenario.changed("board", feedback="off", **PRODUCT, **board)


def agreed(sub_teams: dict[str, list[str]], **board: object) -> Agreed:
    """What was agreed on in a run to the end."""
    team = InProcessTeam(new_scenario(sub_teams, **board))
    _, agreed = played(team)
    assert [service.counters["late"] for service in team.boards.values()] == [0] * len(sub_teams)
    return agreed


COVERS = ({"a": ["r1", "r2"], "b": ["r2", "r3"]}, {"a": ["r1", "r2"], "b": ["r2", "r3"], "c": ["r3", "r1"]})


@pytest.mark.parametrize(("cover", "fusion"), [(COVERS[0], "opinions"), (COVERS[1], "opinions"), (COVERS[1], "joint")])
def test_an_overlapping_cover_agrees_on_what_one_board_would(cover: dict[str, list[str]], fusion: str) -> None:
    (whole,) = agreed({"a": ["r1", "r2", "r3"]}, fusion=fusion).values()
    boards = agreed(cover, fusion=fusion)
    for agreed_on in boards.values():
        assert agreed_on.keys() == whole.keys()
        for name, consensus in agreed_on.items():
            assert consensus.belief == boards["a"][name].belief, name
            gap = consensus.entropy - whole[name].entropy
            assert gap <= (1e-6 if consensus.rule == "joint" else 0.05), (name, gap)
            assert set(consensus.ancestors) == set(whole[name].ancestors)
    entropies = [
        sum(consensus.entropy for consensus in agreed_on.values()) / len(agreed_on)
        for agreed_on in (whole, boards["a"])
    ]
    assert math.isclose(*entropies, abs_tol=0.02)
