"""The recorded robots with odometry that is worse than their model of it.

Their mates correct them, their own model of the odometry adapts, and nobody is left out as a liar.
"""

import pytest

from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.run.flags import RecordingFlags
from tests.field.play import Score
from tests.files import DATASET7, needs_dataset7
from tests.robot_agent.spoilt import SPOILS, Spoil, driven, recorded, slipping

pytestmark = needs_dataset7
SECONDS = 420.0  # a robot that is off by 5 % in its turns has contradicted its mates three times by then


def believes_all(joint: TeamJoint) -> None:
    assert not joint.trust.left_out() | joint.contacts.left_out()


def run(protocol: str, spoil: Spoil, seconds: float = SECONDS, after: float = 0.0) -> Score:
    scenario = RecordingFlags(str(DATASET7), 1248446200.0, protocol).scenario().changed("time", seconds=seconds)
    return recorded(scenario, spoil, after=after, each=believes_all)


@pytest.mark.parametrize(("turn", "drift"), [(1.05, 0.0), (1.0, 0.01)])
def test_two_robots_without_landmarks_are_kept_in_place_by_their_mates(turn: float, drift: float) -> None:
    rmse = run("C_blind12", driven(turn=turn, drift=drift)).rmse
    assert rmse < 0.2, "metres; 0.12 with good odometry, 0.5 to 2 without the mates' help"


def test_wheels_that_slip_more_than_the_physics_say_are_found_out() -> None:
    """Three times the error along the way. Without `noise.py` .72 of the 95 % ellipses held the truth, with it .87."""
    score = run("A_all", slipping(0.08))
    assert score.rmse < 0.17, "metres; 0.172 without"
    assert score.coverage() > 0.8


@pytest.mark.parametrize("name", ["camera x3", "camera claimed /3"])
def test_a_camera_that_is_worse_than_its_model_leaves_the_team_honest(name: str) -> None:
    """Four robots see mates only. Before errors of ranges were taken at the expected range .36 and .80, now .87 and .97."""
    score = run("D_one3", SPOILS[name], 300.0, 60.0)
    assert score.coverage() > 0.82
