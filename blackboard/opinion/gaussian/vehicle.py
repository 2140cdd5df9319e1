"""A robot in the plane with the lasting errors of its sensors, as one block of a joint Gaussian.

States: x, y (unit); heading (rad); forward and turn scale (true = scale * told); heading drift (rad/s) while it moves;
bearing bias of its camera (rad); slip, an error of the forward scale that lasts seconds; range scale, an error of all its
ranges as a share of them. Scales and drift are random walks; bias, slip and range scale forget (`Nuisance.memory`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.grid import Array

X, Y, HEADING, FORWARD, TURN, DRIFT, BEARING, SLIP, RANGE = range(9)
STATES = 9
AXES = slice(0, 2)  # the position
POSE = slice(0, 3)
FLAT = 1e6  # unit ** 2: the variance of a coordinate of which nothing is known


@dataclass(frozen=True)
class Nuisance:
    """The model of the lasting errors; the zeros of a sensor without them leave the states out."""

    forward: float = 1.0
    turn: float = 1.0
    sigmas: tuple[float, ...] = (0.0,) * 6  # at the start: forward and turn scale, drift, bearing, slip, range scale
    walks: tuple[float, ...] = (0.0,) * 3  # of forward and turn scale and drift, per square root of a second of motion
    memory: tuple[float, ...] = (math.inf,) * 3  # seconds: of the bearing bias, the slip and the range scale

    def prior(self) -> Moments:
        """Mean and covariance of the states from the forward scale on, shape (6,) and (6, 6)."""
        mean = np.array([self.forward, self.turn, 0.0, 0.0, 0.0, 0.0])
        return Moments(mean, np.diag(np.square(self.sigmas)))


@dataclass(frozen=True)
class Motion:
    """Odometry over a span of time, with the variances of its error; those of spans that follow each other add up."""

    distance: float = 0.0  # unit, as told
    turn: float = 0.0  # radians, as told
    dt: float = 0.0  # seconds
    moving: float = 0.0  # seconds of them in motion
    along: float = 0.0  # unit ** 2
    across: float = 0.0  # unit ** 2
    heading: float = 0.0  # radians ** 2

    def plus(self, later: Motion) -> Motion:
        """Both spans as one; the shape of the way between is lost."""
        return Motion(*(getattr(self, name) + getattr(later, name) for name in self.__dataclass_fields__))

    def since(self, earlier: Motion) -> Motion:
        """What was added to a sum of motions since it was `earlier`."""
        return Motion(*(getattr(self, name) - getattr(earlier, name) for name in self.__dataclass_fields__))


def entering(pose: Moments, nuisance: Nuisance) -> Moments:
    """A whole block from a pose (x, y, heading) and the prior of the rest, independent of each other."""
    prior = nuisance.prior()
    covariance = np.zeros((STATES, STATES))
    covariance[POSE, POSE], covariance[FORWARD:, FORWARD:] = pose.covariance, prior.covariance
    return Moments(np.concatenate([pose.mean, prior.mean]), covariance)


def drive(joint: Joint, robot: Block, motion: Motion, nuisance: Nuisance) -> None:
    """Move a robot's block by its odometry, through its scales, drift and slip, along the chord of the turn."""
    state = joint.mean[joint.blocks[robot]]
    keep = np.ones(STATES)
    keep[BEARING:] = [math.exp(-motion.dt / seconds) for seconds in nuisance.memory]
    distance = (state[FORWARD] + state[SLIP]) * motion.distance
    turn = state[TURN] * motion.turn + state[DRIFT] * motion.moving
    c, s = math.cos(state[HEADING] + turn / 2), math.sin(state[HEADING] + turn / 2)
    mean = state * keep
    mean[POSE] = state[X] + distance * c, state[Y] + distance * s, wrap(state[HEADING] + turn)
    transition = np.diag(keep)
    by_heading = np.array([-distance * s, distance * c])
    transition[AXES, HEADING] = by_heading
    for source, by_turn in ((TURN, motion.turn), (DRIFT, motion.moving)):
        transition[AXES, source] = by_heading * (by_turn / 2)
        transition[HEADING, source] = by_turn
    transition[AXES, FORWARD] = transition[AXES, SLIP] = motion.distance * c, motion.distance * s
    noise = np.zeros(STATES)
    noise[HEADING] = motion.heading
    noise[FORWARD:BEARING] = np.square(nuisance.walks) * motion.moving
    noise[BEARING:] = np.square(nuisance.sigmas[3:]) * (1 - keep[BEARING:] ** 2)
    added = np.diag(noise)
    frame = np.array([[c, -s], [s, c]])
    added[AXES, AXES] = (frame * [motion.along, motion.across]) @ frame.T
    joint.move(robot, mean, transition, added)


def moved_in(state: Array, motion: Motion | None, age: float) -> tuple[Array, float]:
    """How far a robot (its state, shape (9,)) has come, shape (2,), and turned in the last `age` seconds of a motion.

    Where `age` is negative, it is what the robot will do if it goes on like that, with the other sign.
    """
    if motion is None or not age or motion.dt <= 0:
        return np.zeros(2), 0.0
    share = age / motion.dt
    turn = float(state[TURN]) * motion.turn * share
    way = float(state[FORWARD] + state[SLIP]) * motion.distance * share
    middle = float(state[HEADING]) - turn / 2
    return np.array([way * math.cos(middle), way * math.sin(middle)]), turn


def correct(joint: Joint, factor: Factor) -> None:
    """`Joint.update` with the errors of all robots' poses kept in coordinates that turn with the heading's error.

    A position's error is held as what is left after the world is turned by the heading's error, so that moving the mean
    moves the tie between both along. Else the filter takes its changes of mind for knowledge of the heading
    (Barrau and Bonnabel, IEEE TAC 62(4), 2017; for teams Huang, Trawny, Mourikis, Roumeliotis, RSS 2009).
    """
    moved = joint.update(factor)
    first = joint.firsts(STATES)
    dx, dy = moved[first + X], moved[first + Y]
    first, dx, dy = (it[(dx != 0) | (dy != 0)] for it in (first, dx, dy))
    if len(first):
        heading = first + HEADING
        joint.shear(
            np.concatenate([first + X, first + Y]), np.concatenate([heading, heading]), np.concatenate([-dy, dx])
        )


def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
