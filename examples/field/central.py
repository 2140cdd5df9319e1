"""An extended Kalman filter of the readings of some robots, with the true models. Nothing here is of the product.

Of all robots it is the best that any team can do; of one robot it is a filter of its own.
"""

import math
from collections.abc import Mapping

import numpy as np

from examples.field.world import BALL, Said, Seen, Truth

FLAT = 100.0  # m^2: of a ball that nobody has seen


class Central:
    """States: x, y, heading of each robot, then x, y of the ball."""

    def __init__(self, truths: Mapping[str, Truth]) -> None:
        """`truths`: what each robot is like; the first one's has the ball's walk."""
        self.robots, self.truths = (*truths,), truths
        n = 3 * len(truths)
        self.ball = slice(n, n + 2)
        self.mean, self.covariance = np.zeros(n + 2), np.eye(n + 2) * FLAT

    def of(self, subject: str) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance: of a robot (x, y, heading), of the ball (x, y)."""
        at = self._at(subject)
        return self.mean[at].copy(), self.covariance[at, at].copy()

    def step(self, said: Mapping[str, Said], dt: float) -> None:
        """Take what some of its robots' sensors said, `dt` seconds after the step before; what they saw of others is left out."""
        for robot, step in said.items():
            self._drive(robot, step)
        self.covariance[self.ball, self.ball] += np.eye(2) * self.truths[self.robots[0]].ball ** 2 * dt
        for robot, step in said.items():
            truth, at = self.truths[robot], self._at(f"robot/{robot}")
            if step.start is not None:
                self.mean[at] = step.start
                self.covariance[at, at] = np.diag(np.square([truth.start, truth.start, truth.start_heading]))
            if step.gps is not None:
                rows = np.zeros((2, len(self.mean)))
                rows[:, at] = np.eye(2, 3)
                self._correct(np.array(step.gps) - self.mean[at][:2], rows, np.eye(2) * truth.gps**2)
            for sighting in step.seen:
                if self.knows(sighting.subject):
                    self._see(robot, sighting)

    def take(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Take a pose of the first robot for a measurement, as who feeds back what the team believes."""
        rows, off = np.eye(3, len(self.mean)), np.asarray(mean) - self.mean[:3]
        off[2] = math.remainder(off[2], math.tau)
        self._correct(off, rows, np.asarray(covariance))

    def knows(self, subject: str) -> bool:
        """Whether it has states of a subject."""
        return subject == BALL or subject.partition("/")[2] in self.robots

    def _at(self, subject: str) -> slice:
        if subject == BALL:
            return self.ball
        first = 3 * self.robots.index(subject.partition("/")[2])
        return slice(first, first + 3)

    def _drive(self, robot: str, step: Said) -> None:
        at, truth = self._at(f"robot/{robot}"), self.truths[robot]
        x, y, heading = self.mean[at]
        c, s = math.cos(heading + step.turn / 2), math.sin(heading + step.turn / 2)
        self.mean[at] = x + step.distance * c, y + step.distance * s, heading + step.turn
        transition = np.eye(len(self.mean))
        transition[at, at][:2, 2] = -step.distance * s, step.distance * c
        by = np.array([[c, -step.distance * s / 2], [s, step.distance * c / 2], [0, 1]])
        noise = np.diag([truth.along**2 * abs(step.distance), truth.turn**2 * step.dt if step.start is None else 0.0])
        self.covariance = transition @ self.covariance @ transition.T
        self.covariance[at, at] += by @ noise @ by.T

    def _see(self, robot: str, seen: Seen) -> None:
        truth, me, at = self.truths[robot], self._at(f"robot/{robot}"), self._at(seen.subject)
        if at == self.ball and self.covariance[at, at][0, 0] > FLAT / 2:
            angle = self.mean[me][2] + seen.bearing
            self.mean[at] = self.mean[me][:2] + seen.range * np.array([math.cos(angle), math.sin(angle)])
        dx, dy = self.mean[at][:2] - self.mean[me][:2]
        far = max(math.hypot(dx, dy), 1e-6)
        rows = np.zeros((2, len(self.mean)))
        place = np.array([[dx / far, dy / far], [-dy / far**2, dx / far**2]])
        rows[:, at.start : at.start + 2], rows[:, me.start : me.start + 2] = place, -place
        rows[1, me.start + 2] = -1.0
        off = math.remainder(seen.bearing - math.atan2(dy, dx) + self.mean[me][2], math.tau)
        self._correct(np.array([seen.range - far, off]), rows, np.diag([truth.range**2, truth.bearing**2]))

    def _correct(self, residual: np.ndarray, rows: np.ndarray, noise: np.ndarray) -> None:
        gain = self.covariance @ rows.T @ np.linalg.inv(rows @ self.covariance @ rows.T + noise)
        self.mean = self.mean + gain @ residual
        rest = np.eye(len(self.mean)) - gain @ rows
        self.covariance = rest @ self.covariance @ rest.T + gain @ noise @ gain.T
