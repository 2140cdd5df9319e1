"""Mounting errors of a robot's compass and GPS antenna, estimated from all else that is measured. Pure.

A compass that is mounted askew reads too large an angle, always by the same amount. An antenna may be ahead of the robot's centre of
rotation, or to its side. A joint holds these errors as states. Their prior says that they are small. Once measurements contradict
it, a wide prior takes its place (`priors`). A wide one from the start would make exact sensors useless until the robot has moved.

Noise that is larger than assumed looks like a mounting error. So the evidence is dropped whenever a sensor is found to be noisier.

A compass errs alike in all its readings. What several of them say of the heading is no independent evidence. So a robot tells a joint
the readings, as it tells what it sees, and the joint holds their error.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.priors import Contradiction, most_contradicted, replace_prior
from blackboard.opinion.gaussian.vehicle import HEADING, STATES, wrap
from blackboard.opinion.grid import Array

#: Sigmas of a compass's error, radians: by the wide prior; by the first prior in its robot's filter; by the first prior in a joint.
#: A joint expects more, because a robot without fixes has nothing that could contradict its compass.
WIDE, SMALL, USUAL = 0.2, 0.001, 0.05
#: Readings in a row beyond the gate, and seconds that they span, after which what they contradict counts as wrong.
FEWEST, PATIENCE = 5, 5.0
MORE = 1.5  # The evidence is dropped where the variance of the noise is found to be larger by this factor.


@dataclass(frozen=True)
class CompassReading:
    """A heading (rad) with the sigma (rad) that the compass claims, and what its robot has found of it.

    `noise` is the factor of that sigma that counts, `most` the largest that it may be; infinite while it is not known. The compass
    reads too much by `bias`, with its sigma (rad). `tie` is the regression
    coefficient of the heading that its robot believes on that error: -1 where the heading rests on the compass alone.
    """

    heading: float
    sigma: float
    noise: float = 1.0
    most: float = math.inf
    bias: float = 0.0
    bias_sigma: float = 0.0
    tie: float = 0.0

    @property
    def variance(self) -> float:
        """Of the noise that counts, radians^2."""
        return (self.sigma * self.noise) ** 2


@dataclass(frozen=True)
class Beyond:
    """Readings of one sensor in a row that were beyond the gate."""

    since: float  # team time (s) of the first one
    until: float  # and of the newest one
    number: int = 1
    off: float = 0.0  # radians by which the newest reading of a compass differs from the heading that is believed

    def plus(self, time: float, off: float = 0.0) -> "Beyond":
        """With one more reading, at a team time (s)."""
        return Beyond(self.since, time, self.number + 1, off)

    @property
    def is_lasting(self) -> bool:
        """Whether they are so many, over so long a time, that what they contradict counts as wrong."""
        return self.number >= FEWEST and self.until - self.since >= PATIENCE


@dataclass
class Mount(Copyable):
    """Mutable: the mounting errors of one sensor. Call `with_errors` and `on_noise` for each reading, and `judge` once a tick."""

    robot: str
    parts: tuple[str, ...]  # the names of the errors in the robot's status
    small: float  # sigma of each error by the first prior, unit or radians
    wide: float  # sigma of each error by the wide prior
    first: float = 0.0  # the mean of each error by the first prior
    found: frozenset[int] = frozenset()  # indices of the errors that have the wide prior
    # The variance of the sensor's noise, as a factor of what the sensor claims.
    _noise: float = 1.0  # the least with which evidence was counted since it was last dropped
    _most: float = math.inf  # one sigma above the estimate; infinite while the noise is not known well enough

    @property
    def block(self) -> Block:
        """The name of their block in a joint that has the robot."""
        return ("mount", self.robot, self.parts)

    def errors(self, joint: Joint) -> dict[str, tuple[float, float]]:
        """The errors that have the wide prior, each with its sigma, by name."""
        known = self.known(joint)
        return {
            self.parts[part]: (float(known.mean[part]), math.sqrt(float(known.covariance[part, part])))
            for part in sorted(self.found)
        }

    def known(self, joint: Joint) -> Moments:
        """Mean and covariance of the errors, shape (parts,) and (parts, parts)."""
        return joint.moments(self.block) if self.block in joint else self.prior()

    def with_errors(self, factor: Factor, rows: Array, known: Moments) -> Factor:
        """The same measurement with these errors as further states; `rows` are its derivatives by them, shape (m, parts)."""
        return replace(
            factor,
            residual=factor.residual - rows @ known.mean,
            jacobians={**factor.jacobians, self.block: rows},
            priors={**factor.priors, self.block: known},
        )

    @property
    def doubt(self) -> float:
        """The largest variance that the noise may have, over the least with which evidence was counted."""
        return self._most / self._noise

    def on_noise(self, joint: Joint, variance: float, most: float) -> None:
        """Take the estimate of the noise, and what it is `most`; both are factors of the variance that the sensor claims."""
        self._most = max(variance, most)
        if variance > MORE * self._noise:
            self._noise, self.found = variance, frozenset()
            if self.block in joint:
                joint.drop(self.block)
        self._noise = max(1.0, min(self._noise, variance))

    def contradicted(self, joint: Joint, doubt: float) -> Contradiction | None:
        """The error whose prior is contradicted most. The limit is larger by `doubt`; None: no error is beyond it."""
        if self.block not in joint:
            return None
        known, prior, wide = joint.moments(self.block), (self.first, self.small**2), (0.0, self.wide)
        return most_contradicted(
            [
                (part, prior, (float(known.mean[part]), float(known.covariance[part, part])), wide)
                for part in sorted(set(range(len(self.parts))) - self.found)
            ],
            doubt,
        )

    def judge(self, joint: Joint) -> bool:
        """Give the error whose prior is contradicted most the wide prior. False: none is."""
        worst = self.contradicted(joint, self.doubt)
        if worst is None:
            return False
        replace_prior(joint, joint.blocks[self.block].start + worst.state, worst.mean, worst.variance)
        self.found |= {worst.state}
        return True

    def prior(self) -> Moments:
        """What is known of the errors before anything was measured, shape (parts,) and (parts, parts)."""
        sigmas = [self.wide if part in self.found else self.small for part in range(len(self.parts))]
        means = [0.0 if part in self.found else self.first for part in range(len(self.parts))]
        return Moments(np.array(means), np.diag(np.square(sigmas)))


def compass_of(robot: str, small: float = SMALL, first: float = 0.0) -> Mount:
    """The mount of a robot's compass. Motors and batteries nearby turn small ones by 10 degrees; magnetic north is not the map's."""
    return Mount(robot, ("compass bias",), min(small, WIDE), WIDE, first)


def north_of() -> Mount:
    """The common error of all compasses of a team: the angle between their north and the map's, as the declination."""
    return Mount("team", ("north",), USUAL, WIDE)


def surely(mean: float, sigma: float) -> float:
    """A noise's variance relative to what is claimed, where that is surely larger or smaller; else the claim holds, 1.

    `mean` and `sigma` are of the binary logarithm of the factor of its sigma. Larger to one sigma, because a claim that is too good is
    the worse mistake; smaller to two.
    """
    larger, smaller = (float(4.0 ** (mean + sigmas * sigma)) for sigmas in (-1, 2))
    return larger if larger > 1.0 else min(smaller, 1.0)


def at_most(mean: float, sigma: float) -> float:
    """The variance that a noise may have, relative to what is claimed; infinite while it is not known well enough."""
    return float(4.0 ** (mean + sigma)) if sigma <= 1.0 else math.inf


def heading_factor(joint: Joint, robot: Block, heading: float, sigma: float) -> Factor:
    """A heading (rad) as a measurement of a robot's block."""
    off = np.array([wrap(heading - float(joint.moments(robot).mean[HEADING]))])
    return Factor(off, {robot: np.eye(STATES)[[HEADING]]}, np.array([[sigma**2]]))


def reading_factor(joint: Joint, robot: str, reading: CompassReading, *errors: Mount) -> Factor:
    """A reading of a compass as a measurement of its robot's heading plus the errors given."""
    factor = heading_factor(joint, robot, reading.heading, reading.sigma * reading.noise)
    for error in errors:
        factor = error.with_errors(factor, np.eye(1), error.known(joint))
    return replace(factor, residual=np.asarray(wrap(factor.residual)))


def add_with_heading(joint: Joint, mount: Mount, prior: Moments, tie: float) -> None:
    """Add the error of a compass to a joint, correlated with the heading of its robot: `tie` as in `CompassReading`."""
    variance = float(joint.variances[joint.blocks[mount.robot].start + HEADING])
    own, rows = float(prior.covariance[0, 0]), np.zeros((1, STATES))
    tied = max(-math.sqrt(own * variance), min(tie * own, math.sqrt(own * variance)))
    rows[0, HEADING] = tied / variance if variance > 0 else 0.0
    joint.add(mount.block, Moments(prior.mean, np.array([[own - rows[0, HEADING] * tied]])), {mount.robot: rows})


def correct_heading(joint: Joint, robot: str, reading: CompassReading, *errors: Mount) -> None:
    """Correct the heading with which a robot enters by the errors of its compass that a joint has, and correlate it with them.

    The belief with which it enters assumed that they sum to `CompassReading.bias`.
    """
    at, tie = joint.blocks[robot].start + HEADING, max(-1.0, min(reading.tie, 1.0))
    row, mean, covariance = np.zeros(len(joint.mean)), joint.mean.copy(), joint.covariance.copy()
    row[at] = 1.0
    for error in errors:
        row[joint.blocks[error.block]] = tie
    cross = row @ joint.covariance
    mean[at], cross[at] = row @ joint.mean - tie * reading.bias, cross @ row
    covariance[at], covariance[:, at] = cross, cross
    joint.mean, joint.covariance = mean, covariance
