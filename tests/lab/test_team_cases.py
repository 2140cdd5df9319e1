"""The cases of a team are the opinions that its boards get, and scores by team size count what one more robot adds."""

from pathlib import Path

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.lab.cases import Case
from blackboard.lab.team import InProcessTeam
from blackboard.lab.team_cases import first_hand_cases, variant
from blackboard.lab.team_size import TeamSizeScores, score_sizes
from blackboard.opinion.averages import Logarithmic
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from tests.heard import Heard
from tests.scenarios import SCENARIO
from tests.sim_world.datasets import write

GRID = Grid((20, 20))


def test_it_gives_the_first_hand_beliefs_of_a_real_team() -> None:
    """The same scenario with boards, feedback and the wire: what the robots report is what the cases have."""
    team = InProcessTeam(SCENARIO)
    heard = Heard(team.bus)
    team.run()
    reported = {(said.time, said.subject, said.source): said for said in heard.of(keys.REPORT)}
    cases = first_hand_cases(SCENARIO, every=0.5)
    opinions = {(c.time, c.subject, s): p for c in cases for s, p in zip(c.sources, c.opinions, strict=True)}
    later = {key: report for key, report in reported.items() if key[0] > 0}
    assert opinions.keys() == later.keys()
    for key, report in later.items():
        assert unpack(report.belief, SCENARIO.grid).p == pytest.approx(opinions[key], rel=0.05, abs=1e-4), key  # log8


def test_every_so_many_seconds() -> None:
    times = sorted({case.time for case in first_hand_cases(SCENARIO, every=1.0)})
    assert times == [1.0, 2.0]


def test_a_variant_has_another_seed() -> None:
    assert variant(SCENARIO, 0) is SCENARIO
    assert variant(SCENARIO, 2).tables["world"]["seed"] == 5
    first, second = first_hand_cases(SCENARIO)[0], first_hand_cases(variant(SCENARIO, 1))[0]
    assert first.truth != second.truth


def test_a_variant_of_a_recording_is_its_next_stretch(tmp_path: Path) -> None:
    write(tmp_path)
    team = {"sub_teams": {"a": ["r1", "r2"]}}
    world = {"kind": "mrclam", "dir": str(tmp_path), "start": 1001.0}
    recorded = Scenario({"team": team, "world": world, "time": {"seconds": 4.0, "tick": 1.0}, "grid": {"unit": "m"}})
    assert variant(recorded, 2).tables["world"]["start"] == 1009.0
    assert {case.time for case in first_hand_cases(variant(recorded, 2))} == {1.0, 2.0, 3.0, 4.0}


# --- team size ----------------------------------------------------------------------------------------------------------


def opinion(x: float, sigma: float) -> np.ndarray:
    return gaussian(GRID, (x, 10.0), sigma).p


CASES = [
    Case(GRID, "robot/r1", 1.0, ("r1", "r3"), np.stack([opinion(9, 2), opinion(10, 3)]), (9.5, 10.0)),
    Case(GRID, "object/ball", 1.0, ("r2", "r3"), np.stack([opinion(4, 1), opinion(5, 2)]), (4.5, 10.0)),
]


def sizes() -> TeamSizeScores:
    return score_sizes([(7, CASES)], ["r1", "r2", "r3"], {"product": Logarithmic()})["product"]


def test_sizes_begin_with_the_robot_alone_and_add_its_mates_in_order() -> None:
    planned = sizes()
    assert planned.subject == ["robot/r1", "object/ball", "object/ball"]
    assert planned.run == [7, 7, 7]
    own = [entropy(opinion(9, 2)), entropy(opinion(4, 1)), entropy(opinion(5, 2))]
    assert planned.original == pytest.approx(own)
    assert [row[0] for row in planned.entropies] == pytest.approx(own)
    r1, r2, r3 = planned.entropies
    assert r1[1] == r1[0]  # r2 has nothing to say about r1
    assert r1[2] < r1[1]  # r3 has
    assert r2[1] < r2[0]  # r3 comes after r2
    assert r3[1] == r3[0]  # r1 comes after r3 and has not seen the ball
    assert r3[2] == pytest.approx(r2[1])  # both hold the same in the end


def test_sizes_are_merged_and_averaged_by_run() -> None:
    both = sizes().merge(TeamSizeScores(**{**sizes().__dict__, "run": [8, 8, 8]}))
    assert both.run == [7, 7, 7, 8, 8, 8]
    means = both.means(np.array(both.entropies))
    assert means.shape == (2, 3)
    assert means[0] == pytest.approx(np.mean(sizes().entropies, axis=0))
