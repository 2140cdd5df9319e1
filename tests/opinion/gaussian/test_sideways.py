"""A robot that drives sideways goes as one that is turned to where it goes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import FORWARD, HEADING, POSE, STATES, Motion, Nuisance, drive, moved_in, speed

WAY, ANGLE = st.floats(-2, 2), st.floats(-3, 3)
NUISANCE = Nuisance(sigmas=(0.05, 0.05, 0.003, 0.0, 0.0, 0.0))


def began(heading: float) -> Moments:
    mean, covariance = np.zeros(STATES), np.diag([0.04, 0.04, 0.01, *[0.0] * (STATES - HEADING - 1)])
    mean[HEADING], mean[FORWARD : FORWARD + 2], covariance[FORWARD, FORWARD] = heading, 1.0, 0.05**2
    return Moments(mean, covariance)


def driven(heading: float, motion: Motion) -> Moments:
    joint = Joint()
    joint.add("robot/r1", began(heading))
    drive(joint, "robot/r1", motion, NUISANCE)
    return joint.moments("robot/r1")


@given(ANGLE, WAY, ANGLE)
def test_to_the_side_is_ahead_of_a_robot_that_looks_there(heading: float, way: float, turn: float) -> None:
    sideways = Motion(aside=way, turn=turn, dt=0.1, moving=0.1, along=0.01, across=0.04)
    ahead = Motion(distance=way, turn=turn, dt=0.1, moving=0.1, along=0.04, across=0.01)
    one, other = driven(heading, sideways), driven(heading + math.pi / 2, ahead)
    other.mean[HEADING] -= math.pi / 2
    apart = one.mean[POSE] - other.mean[POSE]
    apart[HEADING] = math.remainder(apart[HEADING], math.tau)
    assert apart == pytest.approx(np.zeros(3), abs=1e-9)
    assert one.covariance == pytest.approx(other.covariance, abs=1e-9)


def test_what_it_did_lately_and_how_fast_it_is_say_so_too() -> None:
    motion = Motion(distance=0.3, aside=0.4, dt=0.1, moving=0.1)
    way, _ = moved_in(began(math.pi / 2).mean, motion, 0.05)
    assert way == pytest.approx([-0.2, 0.15])
    velocity = speed(began(math.pi / 2), motion)
    assert velocity is not None
    assert velocity.mean == pytest.approx([-4.0, 3.0, 0.0])
    assert motion.way == pytest.approx(0.5)
    assert motion.plus(motion).times(0.5) == motion
