"""The client with keys: its team and sub-team are those of its certificate, and it is told of refusals through the same door."""

from pathlib import Path

import numpy as np
import pytest

from blackboard import Belief, Grid
from blackboard.client import Team, UserError
from blackboard.opinion.belief import uniform
from tests.access.doors import Shut
from tests.client.boards import serving
from tests.processes import LONG, wait_until

pytestmark = pytest.mark.team

GRID = Grid((30, 20))


def test_a_client_with_a_certificate_takes_part_and_is_told_why_it_is_refused(shut: Shut, keys: Path) -> None:
    with serving(shut[0], GRID, keys=str(keys)), Team("r1", endpoint=shut[0], keys=str(keys)) as team:
        assert (team.name, team.sub_teams, team.grid) == ("t", ("a",), GRID)
        team.report("robot/r1", Belief.from_gaussian(team.grid, (5, 5), np.eye(2)))
        assert team.newest("robot/r1", LONG).belief.mean() == pytest.approx((5, 5), abs=0.1)
        assert "r1: independent" in str(team.why("robot/r1"))
        other = Grid((9, 9))
        with Team("r2", endpoint=shut[0], keys=str(keys), grid=other) as stranger:
            stranger.report("object/ball", uniform(other))
            wait_until(lambda: stranger.refused, "the board says so")
            assert [refusal.reason for refusal in stranger.refused] == ["grid"]
        assert "robot/r2/1 may not" not in shut[1].err
        assert team.refused == []


def test_a_certificate_of_another_sub_team_is_one_line(shut: Shut, keys: Path) -> None:
    with pytest.raises(UserError, match="robot/r3: its certificate .* is for team t, sub-team b, and may not hold"):
        Team("r3", endpoint=shut[0], keys=str(keys), sub_team="a", grid=GRID).__enter__()
    with pytest.raises(UserError, match="no certificate of robot/x9"):
        Team("x9", endpoint=shut[0], keys=str(keys)).__enter__()
