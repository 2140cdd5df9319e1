"""A localizer from scratch: a Kalman filter of the robot's place, with the heading of its compass.

`python examples/own_localizer.py` lets the demo's robots look for themselves with it and with the package's own, all in this
process. A package offers it as an entry point (docs/rules.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard import Belief, Grid
from blackboard.config import load
from blackboard.lab.sweep import run_one
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizers import localizer
from robot_agent.sensing import TickMotion, displacement, displacement_covariance


@dataclass(frozen=True, eq=False)
class Kalman:
    """A Gaussian of the place: `mean`, shape (2,), in the grid's unit, and `covariance`, shape (2, 2). Each step gives a new one."""

    settings: RobotSection
    grid: Grid
    mean: Array
    covariance: Array
    heading: float = 0.0

    def predict(self, motion: TickMotion, compass: float | None) -> Kalman:
        heading = self.heading + motion.turn if compass is None else compass
        ahead = np.array([math.cos(heading), math.sin(heading)])
        aside = np.array([-ahead[1], ahead[0]])
        noise = motion.along * np.outer(ahead, ahead) + motion.across * np.outer(aside, aside)
        mean = self.mean + motion.distance * ahead
        return replace(self, mean=mean, covariance=self.covariance + noise, heading=heading)

    def update_with_fix(self, fix: Fix) -> Kalman:
        turned = self if fix.heading is None else replace(self, heading=fix.heading)
        return turned._measured(np.array(fix.position), fix.sigma**2 * np.eye(2))

    def update_with_sighting(
        self, sighting: Sighting, motion: TickMotion | None, place: Array, covariance: Array
    ) -> Kalman:
        away, noise = self._away(sighting, motion)
        return self._measured(place - away, covariance + noise)

    def tempered(self, power: float) -> Kalman:
        return replace(self, covariance=self.covariance / power)

    def entropy(self) -> float:
        """Of the Gaussian, in nats over cells."""
        return 1 + math.log(2 * math.pi / self.grid.cell**2) + 0.5 * float(np.linalg.slogdet(self.covariance)[1])

    def marginal(self) -> Belief:
        return self._belief(self.mean, self.covariance)

    def fold(self, agreed: Belief, reported: Belief) -> Kalman:
        """Its Gaussian times that of `agreed`, divided by that of `reported`; `agreed` where that is no Gaussian."""
        of = [(self.mean, self.covariance), self._moments(agreed), self._moments(reported)]
        precisions = [np.linalg.inv(covariance) for _, covariance in of]
        precision = precisions[0] + precisions[1] - precisions[2]
        if np.linalg.eigvalsh(precision)[0] <= 0:
            mean, covariance = of[1]
            return replace(self, mean=mean, covariance=covariance)
        first, second, third = (inverse @ mean for inverse, (mean, _) in zip(precisions, of, strict=True))
        covariance = np.linalg.inv(precision)
        return replace(self, mean=covariance @ (first + second - third), covariance=covariance)

    def project(self, sighting: Sighting, motion: TickMotion | None) -> Belief:
        away, noise = self._away(sighting, motion)
        return self._belief(self.mean + away, self.covariance + noise)

    def _away(self, sighting: Sighting, motion: TickMotion | None) -> tuple[Array, Array]:
        """Where something is from the robot, and the covariance of that."""
        noise = displacement_covariance(sighting, self.heading, self.settings.vision)
        return np.array(displacement(sighting, motion, self.heading)), noise

    def _measured(self, place: Array, noise: Array) -> Kalman:
        """Bayes with a measured place of the robot."""
        gain = self.covariance @ np.linalg.inv(self.covariance + noise)
        covariance = self.covariance - gain @ self.covariance
        return replace(self, mean=self.mean + gain @ (place - self.mean), covariance=(covariance + covariance.T) / 2)

    def _moments(self, belief: Belief) -> tuple[Array, Array]:
        mean, covariance = belief.moments()
        return mean, covariance + np.eye(2) * self.grid.cell**2 / 12  # a cell is as wide as it is

    def _belief(self, mean: Array, covariance: Array) -> Belief:
        low = np.array(self.grid.origin)
        high = low + self.grid.cell * np.array(self.grid.shape)
        return Belief.from_gaussian(self.grid, np.clip(mean, low, high), covariance)


@localizer("kalman")
def kalman(settings: RobotSection, grid: Grid) -> Kalman:
    """At first the robot may be anywhere on the grid."""
    size = grid.cell * np.array(grid.shape, float)
    return Kalman(settings, grid, np.array(grid.origin) + size / 2, np.diag(size**2 / 12))


def main(seconds: float = 10.0) -> None:
    """Print how far off the demo's robots are with each localizer, alone and as the team agrees, after so many seconds."""
    demo = load("demo").changed("time", seconds=seconds).changed("board", fusion="opinions")
    for name in ("kalman", "position"):
        card = run_one(name, demo.changed("robot", localizer=name))["card"]
        solo, agreed = (card["scores"]["robots"][level] for level in ("solo", "agreed"))
        print(f"{name:8}  RMSE: solo {solo['rmse']:.2f}, agreed {agreed['rmse']:.2f} {card['unit']}")


if __name__ == "__main__":
    main()
