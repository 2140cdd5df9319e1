"""Robots that never tell any odometry: drones and boats that move, and masts that stand, as their fixes show."""

import math
from typing import Any

import numpy as np
import pytest

from blackboard.wire.messages import Fix
from robot_agent.driven import UNKNOWN_WHEELS
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.roaming import APART, SPAN, Roaming
from robot_agent.gaussian.sensors import Sensors
from tests.present import present
from tests.robot_agent.robots import measured

SIGMA, COMPASS = 0.3, 0.05  # unit, radians
INSIDE_95 = 5.991  # chi-squared


def alone(speed: float, every: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors (unit) and squared distances of a robot on a wavy way of 20 s, with fixes and a compass alone, from 8 s on."""
    random, robot = np.random.default_rng(seed), FirstHand("robot/r1", Sensors(wheels=UNKNOWN_WHEELS))
    place, errors, squared = np.zeros(2), [], []
    for step in range(200):
        heading = math.remainder(1.5 * math.sin(0.05 * step), math.tau)
        place = place + 0.1 * speed * np.array([math.cos(heading), math.sin(heading)])
        told: dict[str, Any] = {
            "compass": math.remainder(heading + COMPASS * random.normal(), math.tau),
            "compass_sigma": COMPASS,
        }
        if step % round(10 * every) == 0:
            told["fix"] = Fix(position=tuple(place + SIGMA * random.normal(size=2)), sigma=SIGMA)
        robot.step(measured(step, time=100.0 + 0.1 * step, **told))
        if step >= 80:
            belief = present(robot.belief)
            off = belief.mean[:2] - place
            errors.append(math.hypot(*off))
            squared.append(off @ np.linalg.solve(belief.covariance[:2, :2], off))
    return np.array(errors), np.array(squared)


@pytest.mark.parametrize("speed", [0.5, 3.0])
@pytest.mark.parametrize("every", [0.2, 1.0])
def test_a_robot_that_moves_without_odometry_is_where_its_fixes_have_it(speed: float, every: float) -> None:
    """It was taken to stand: a single fix told more of where it was than its belief, which was sure of another place."""
    played = [alone(speed, every, seed) for seed in range(2)]
    errors, squared = (np.concatenate(some) for some in zip(*played, strict=True))
    assert np.sqrt(np.mean(errors**2)) <= math.sqrt(2) * SIGMA + speed * every
    assert np.mean(squared <= INSIDE_95) >= 0.9


@pytest.mark.parametrize("every", [0.2, 1.0])
def test_one_that_stands_is_known_better_with_each_fix(every: float) -> None:
    played = [alone(0.0, every, seed) for seed in range(4)]
    last = np.array([errors[-1] for errors, _ in played])
    assert np.sqrt(np.mean(last**2)) <= 0.7 * SIGMA


def test_a_speed_is_what_fixes_show_and_one_that_stops_stands_in_the_end() -> None:
    roaming = Roaming()
    for second in range(10):
        roaming.on_fix(float(second), Fix(position=(2.0 * second, 0.0), sigma=SIGMA))
    assert roaming.speed == pytest.approx(2.0, rel=0.05)
    for second in range(10, 10 + 2 * round(SPAN) + 5):
        roaming.on_fix(float(second), Fix(position=(18.0, 0.0), sigma=SIGMA))
    assert roaming.speed == 0.0
    assert roaming.motion(1.0).along == 0.0


def test_fixes_that_only_err_as_they_claim_show_no_speed() -> None:
    found = 0
    for seed in range(20):
        roaming, random = Roaming(), np.random.default_rng(seed)
        for second in range(60):
            roaming.on_fix(float(second), Fix(position=tuple(SIGMA * random.normal(size=2)), sigma=SIGMA))
            found += roaming.speed > 0.0
    assert found <= 0.05 * 20 * 60


@pytest.mark.parametrize("noise", [0.0, SIGMA])
def test_a_mast_that_tells_its_heading_once_and_its_place_again_and_again_keeps_both(noise: float) -> None:
    random, robot = np.random.default_rng(1), FirstHand("robot/r1", Sensors(wheels=UNKNOWN_WHEELS))
    for step in range(100):
        told: dict[str, Any] = {} if step else {"heading": 0.3, "heading_sigma": COMPASS}
        x, y = np.array([3.0, 4.0]) + noise * random.normal(size=2)
        fix = Fix(position=(float(x), float(y)), sigma=SIGMA, **told)
        robot.step(measured(step, time=100.0 + 0.1 * step, fix=fix))
    belief = present(robot.belief)
    assert belief.mean[2] == pytest.approx(0.3, abs=0.01)
    assert belief.covariance[2, 2] == pytest.approx(COMPASS**2, rel=0.01)
    assert belief.covariance.diagonal()[:2].max() <= SIGMA**2


@pytest.mark.parametrize("speed", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("every", [0.2, 1.0])
def test_before_two_fixes_can_be_compared_it_is_as_fast_as_they_do_not_exclude(speed: float, every: float) -> None:
    """Before, it was taken to stand for three seconds, and mates learned a wrong scale of their wheels by that."""
    roaming = Roaming()
    roaming.on_fix(100.0, Fix(position=(0.0, 0.0), sigma=SIGMA))
    assert roaming.speed == 0.0, "one fix may be of a mast"
    for step in range(1, math.ceil(APART / every)):
        roaming.on_fix(100.0 + every * step, Fix(position=(speed * every * step, 0.0), sigma=SIGMA))
        motion = roaming.motion(every)
        assert motion.along >= (speed * every) ** 2
        assert motion.heading == 0.0


def test_fixes_that_claim_to_know_nothing_make_no_evidence_that_boards_refuse() -> None:
    """Before, a robot whose fixes claimed 1000 units was refused for good by the sum of its variances."""
    roaming, along = Roaming(), 0.0
    for second in range(60):
        roaming.on_fix(float(second), Fix(position=(float(second), 0.0), sigma=1e5))
        along += roaming.motion(1.0).along
    assert along <= 1e6
