"""Robots with steps of half a second, whose ranges are too long, or whose wheels measure nothing, beside one filter of all readings."""

from typing import Any

import pytest

from tests.field.grounds import Ground, Grounds
from tests.field.play import Score

pytestmark = pytest.mark.long


def test_robots_that_step_twice_a_second_know_how_exact_they_are() -> None:
    """Told their odometry in pieces, their regions held .72 of the truth; they were 1.8 times as far off as one filter, now 1.5."""
    scores = Grounds(Ground(7103, 2.0), told=True, each=True).play(60.0)
    team = Score()
    for robot in ("r1", "r2", "r3"):
        team.take(scores["team"][robot])
    assert team.coverage() >= 0.87
    assert team.log_score >= 1.0


@pytest.mark.parametrize("has_gps", [True, False])
def test_a_robot_whose_wheels_measure_nothing_leads_nobody_away(has_gps: bool) -> None:
    """It was sure that it stood, and so its team was, or its mates: they were up to 8 m off, in 95 % regions that held .33."""
    ground = Ground(7002)
    (gps,) = (robot for robot, kit in ground.kits.items() if kit.gps)
    dead = gps if has_gps else min(set(ground.kits) - {gps})
    played = Grounds(ground, dead={dead: (10.0, 25.0)}).play(30.0)["team"]
    mates = Score()
    for robot in set(ground.kits) - {dead}:
        mates.take(played[robot])
    assert mates.rmse < 0.5
    assert played[dead].rmse < 1.0
    assert played["ball"].rmse < 1.0


@pytest.mark.parametrize(
    ("seed", "wrong", "times", "covered"),
    [
        (9802, {"longer": 1.1}, 1.4, 0.88),
        (2, {"askew": 0.2}, 1.4, 0.9),
        (2, {"less": (0.7, 1.0)}, 1.5, 0.9),
        (2, {"compass": 0.2}, 2.0, 0.6),
        (354, {"less": (1.0, 0.7)}, 2.2, 0.9),
        (752, {"described": True, "less": (0.95, 0.95), "askew": 0.035}, 2.0, 0.9),
    ],
    ids=["long ranges", "askew", "short ways", "compasses", "small turns", "described"],
)
def test_sensors_that_are_far_from_what_robots_were_told_are_found_out(
    seed: int, wrong: dict[str, Any], times: float, covered: float
) -> None:
    """Robots were up to 7.1 times as far off as one filter with the true models; 95 % regions held .75 to .78 of the truth."""
    scores, team, central = Grounds(Ground(seed), **wrong).play(40.0), Score(), Score()
    for robot in ("r1", "r2", "r3"):
        team.take(scores["team"][robot])
        central.take(scores["central"][robot])
    assert team.rmse < times * central.rmse
    assert team.coverage() >= covered
