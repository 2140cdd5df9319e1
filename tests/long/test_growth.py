"""A long run holds no more than a short one: what the world, the boards and the robots of a team keep is bounded."""

from collections import Counter
from functools import reduce
from operator import and_, or_

import pytest

from blackboard.lab.team import InProcessTeam
from tests.holdings import grown, holdings
from tests.scenarios import JOINT, SCENARIO

TICKS = 80  # by then windows, histories and caches are full
# What one tick holds depends on what is seen in it: the least of some looks is held against the most of others.
LOOKS = 4


def held(team: InProcessTeam, tick: int) -> list[Counter[str]]:
    """What all services hold at some ticks from this one on, those of a kind together."""
    looks = []
    for k in range(LOOKS):
        team.run_until(lambda at=tick + 3 * k: team.world.tick >= at)  # type: ignore[misc]
        sizes = holdings(team.world, "world")
        for board in team.boards.values():
            sizes += holdings(board, "board")
        for robot in team.robots.values():
            sizes += holdings(robot, "robot")
        looks.append(sizes)
    return looks


@pytest.mark.parametrize("fusion", ["opinions", "joint"])
def test_what_a_team_holds_does_not_grow(fusion: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blackboard.judge.distances.KEPT", 20)  # what is reached in a long run is reached in this one
    monkeypatch.setattr("blackboard.judge.calibration.MOST", 3)
    scenario = SCENARIO if fusion == "opinions" else JOINT
    team = InProcessTeam(scenario.changed("time", seconds=TICKS * 2.0))
    most = reduce(or_, held(team, TICKS))
    least = reduce(and_, held(team, 2 * TICKS))
    more = {path: counts for path, counts in grown(most, least).items() if counts[1] > 1.1 * counts[0]}
    assert {path: counts for path, counts in more.items() if counts[1] - counts[0] > 20} == {}
