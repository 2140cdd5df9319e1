"""A joint so large that its changes wait: boards that settle the same evidence agree to the bit."""

import numpy as np
import pytest

from blackboard.config import load
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.gaussian.covariance import LARGE
from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.vehicle import STATES

pytestmark = pytest.mark.team


def joint_of(team: InProcessTeam, sub_team: str) -> Joint:
    desk = team.boards[sub_team].board.joint
    assert desk is not None
    return desk.team.joint


def test_boards_of_a_large_team_agree_to_the_bit_though_only_one_is_looked_at() -> None:
    names = [f"r{i}" for i in range(LARGE // STATES + 2)]
    scenario = load("demo").changed("team", sub_teams={"a": names[::2], "b": names[1::2]})
    team = InProcessTeam(scenario.changed("time", seconds=3 * scenario.time.tick))
    looked = set[int]()
    team.bus.spies.append(lambda envelope: looked.add(len(joint_of(team, "a").covariance)))
    team.run()
    mine, theirs = joint_of(team, "a"), joint_of(team, "b")
    assert max(looked) > LARGE
    assert np.array_equal(mine.mean, theirs.mean)
    assert np.array_equal(mine.covariance, theirs.covariance)
