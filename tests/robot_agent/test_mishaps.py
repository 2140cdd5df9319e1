"""Wheels that turn while the robot stands are named by its landmarks, and it is found again; sound drives name nothing."""

import statistics
from functools import cache

import numpy as np
import pytest

from tests.present import present
from tests.robot_agent.mishaps import BEGAN, Course, course

SEEDS = range(30, 38)
SECONDS = 6


@cache
def stuck(seed: int) -> Course:
    return course(seed, stuck=SECONDS)


def test_a_robot_that_is_stuck_says_so_while_it_is() -> None:
    """A robot that should stand or go straight on may look stuck only later; of eight, seven are named before it ends."""
    named = [stuck(seed).named("stuck") for seed in SEEDS]
    in_time = [after for after in named if after is not None and after <= SECONDS]
    assert len(in_time) >= 7
    assert statistics.median(in_time) <= 3


@pytest.mark.parametrize("seed", SEEDS)
def test_it_is_found_again_and_no_longer_called_stuck(seed: int) -> None:
    seconds = present(stuck(seed).found())
    assert seconds <= SECONDS + 15
    assert stuck(seed).stuck[-1] == 0.0
    assert np.nanmax(stuck(seed).errors[BEGAN:]) < 2.0, "unit; it was commanded to drive 1.8"


@pytest.mark.parametrize("misreads", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_sound_wheels_are_not_called_stuck_and_nobody_moved(seed: int, misreads: bool) -> None:
    drive = course(seed, misreads=misreads)
    assert not any(drive.stuck)
    assert not any(drive.moved)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robot_that_was_carried_away_says_so(seed: int) -> None:
    after = present(course(seed, push=(2.0, 2.0), turn=1.0).named("moved"))
    assert after <= 8
