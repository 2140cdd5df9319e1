"""Robots that drive in a row, are told their places now and then, and see each other where they stand at the end of the tick."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import gained
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Motion, Nuisance, drive, entering
from blackboard.opinion.grid import Array

NUISANCE = Nuisance()


@dataclass
class Own:
    """A robot that drives along x, is told its position now and then, and sees the next one; everything is linear."""

    name: str
    place: Array
    chance: np.random.Generator
    epoch: int = 0

    def __post_init__(self) -> None:
        self.joint, self.travelled = Joint(), Motion()
        pose = Moments(np.array([*self.place, 0.0]), np.diag([0.5, 0.5, 0.0]))
        self.joint.add(self.name, entering(pose, NUISANCE))
        self.fixed: list[Array] = []

    def tick(self, tick: int, others: "Sequence[Own]") -> Evidence:
        self.travelled = self.travelled.plus(Motion(1.0, 0.0, 1.0, 1.0, along=0.04, across=0.02))
        drive(self.joint, self.name, Motion(1.0, 0.0, 1.0, 1.0, along=0.04, across=0.02), NUISANCE)
        self.place = self.place + [1.0, 0.0]
        prediction = self.joint.moments(self.name)
        fix = self.place + self.chance.normal(0, 0.5, 2)
        self.fixed = [fix] if self.chance.random() < 0.5 else []
        for measured in self.fixed:
            residual = measured - self.joint.moments(self.name).mean[AXES]
            self.joint.update(Factor(residual, {self.name: np.eye(STATES)[AXES]}, np.eye(2) * 0.25))
        belief = self.joint.moments(self.name)
        relatives = tuple(self.see(other) for other in others if other is not self and self.chance.random() < 0.7)
        increment = gained(prediction, belief)
        return Evidence(
            self.name, self.epoch, tick, self.travelled, NUISANCE, belief, increment, relatives, float(tick)
        )

    def see(self, other: "Own") -> Relative:
        dx, dy = other.place - self.place + self.chance.normal(0, 0.2, 2)
        distance = math.hypot(dx, dy)
        return Relative(self.name, other.name, distance, math.atan2(dy, dx), 0.04, 0.04 / distance**2)


def team(number: int, seed: int) -> list[Own]:
    chance = np.random.default_rng(seed)
    return [Own(f"robot/r{k}", np.array([0.0, 3.0 * k]), chance) for k in range(number)]


def reports_of(robots: Sequence[Own], tick: int) -> list[Evidence]:
    """What all robots report of a tick, once all have moved."""
    alone = [robot.tick(tick, []) for robot in robots]
    return [
        replace(report, relatives=tuple(own.see(other) for other in robots if other is not own))
        for own, report in zip(robots, alone, strict=True)
    ]


def furthest_slope(joint: Joint, relative: Relative, factor: Factor) -> float:
    """How far the derivatives of a sighting's factor are from numeric ones, at most; 1e-5 of themselves is granted."""
    joint.begin(factor.priors)
    mean, off = joint.mean.copy(), 0.0
    for block, jacobian in factor.jacobians.items():
        place = joint.blocks[block]
        for k in range(place.start, place.stop):
            ends = []
            for step in (1e-6, -1e-6):
                joint.mean = mean.copy()
                joint.mean[k] += step
                ends.append(linearise(joint, relative, {}).residual)
            said = -jacobian[:, k - place.start]
            off = max(off, float((np.abs((ends[0] - ends[1]) / 2e-6 - said) - 1e-5 * np.abs(said)).max()))
    return off
