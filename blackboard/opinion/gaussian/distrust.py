"""Odometry that was contradicted: a wheel that measures nothing, a turn with the wrong sign, a value that is repeated.

A robot that was not where its odometry had it may have been carried once, or its odometry is wrong for longer. If that were
believed, the robot would be sure of a wrong place again soon, and it would lead its mates away. So from then on it may have
moved in any way at its usual speed, until sightings show that the odometry is right: by a sequential probability ratio test
(Wald, Annals of Mathematical Statistics 16(2), 1945) of where it has the robot after some seconds.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Joint, Moments, squared_distance
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, POSE, Motion, Nuisance, drive, wrap
from blackboard.opinion.grid import Array

DISTRUSTED = "odometry distrusted"  # the name by which boards tell it among the parameters of a consensus

LASTING = 1.0  # seconds for which a robot usually goes on in one direction
SPAN = (3.0, 30.0)  # seconds of odometry that are compared with what was seen: at least, at most
TURNING = 1.0  # rad / s, while it is not known how fast robots turn
SURE = 3.0  # nats: the odometry is believed again where it is 20 times as likely to be right as not
LONGEST = 30.0  # seconds without anything against the odometry, after which it is believed again


@dataclass(frozen=True)
class Record:
    """Of one robot whose odometry is not believed."""

    nats: float = 0.0  # the sum of log likelihood ratios for the odometry, at least -SURE
    unopposed: float = 0.0  # seconds since a ratio was against it
    began: float = np.inf  # variance of its place (unit ** 2) when the present span of odometry began
    alone: Moments | None = None  # its block, by odometry alone since the span began
    seconds: float = 0.0  # since the span began


@dataclass
class Distrust(Copyable):
    """Mutable; in a tick `on_motion`, and `judge` when all was taken. `usual` are unit / s and rad / s, shape (2,)."""

    _records: dict[str, Record] = field(default_factory=dict)

    def __contains__(self, robot: str) -> bool:
        return robot in self._records

    def begin(self, robot: str) -> None:
        """Do not believe the odometry of a robot from now on."""
        self._records[robot] = Record()

    def on_motion(self, robot: str, motion: Motion, seconds: float, nuisance: Nuisance, usual: Array) -> Motion:
        """The motion of a step of so many `seconds`, with the noise of a motion in any direction if the odometry is not believed."""
        record = self._records.get(robot)
        if record is None or seconds <= 0:
            return motion
        if record.unopposed > LONGEST:
            del self._records[robot]
            return motion
        record = replace(record, unopposed=record.unopposed + seconds)
        if record.alone is not None:
            joint = Joint.of({robot: record.alone})
            drive(joint, robot, motion, nuisance)
            record = replace(record, alone=joint.moments(robot), seconds=record.seconds + seconds)
        self._records[robot] = record
        way, turn = any_way(usual, min(seconds, LONGEST))
        return replace(motion, along=motion.along + way, across=motion.across + way, heading=motion.heading + turn)

    def judge(self, robot: str, belief: Moments, usual: Array) -> None:
        """Compare a robot's odometry with where the robot is believed to be, its whole block, shape (12,) and (12, 12)."""
        record = self._records.get(robot)
        if record is None:
            return
        alone, now, (shortest, longest) = record.alone, _spread(belief), SPAN
        if alone is None or record.seconds > longest or 2 * now < record.began:
            self._records[robot] = replace(record, began=now, alone=belief, seconds=0.0)
            return
        way, turn = any_way(usual, record.seconds)
        if record.seconds < shortest or _spread(alone) + now > way:
            return
        shown = _log_ratio(alone, belief, way, turn)
        if record.nats + shown > SURE:
            del self._records[robot]
        else:
            unopposed = 0.0 if shown < 0 else record.unopposed
            self._records[robot] = Record(max(record.nats + shown, -SURE), unopposed, now, belief)


def _spread(block: Moments) -> float:
    return float(np.trace(block.covariance[AXES, AXES]))


def any_way(usual: Array, seconds: float) -> tuple[float, float]:
    """Variances of a way along each axis (unit ** 2) and of a turn (radians ** 2) of a robot that may go and turn in any direction.

    `usual` has unit / s and rad / s; 0 rad / s: it is not known how fast it turns.
    """
    speed, turning = usual.tolist()
    return 2.0 * LASTING * seconds * speed**2, 2.0 * LASTING * seconds * (turning or TURNING) ** 2


def _log_ratio(alone: Moments, belief: Moments, way: float, turn: float) -> float:
    """Log likelihood (nats) of where a robot is if its odometry is right, over that if it may have moved in any way."""
    off = belief.mean[POSE] - alone.mean[POSE]
    off[HEADING] = wrap(float(off[HEADING]))
    right = alone.covariance[POSE, POSE] + belief.covariance[POSE, POSE]
    wrong = right + np.diag([way, way, turn])
    larger = np.linalg.slogdet(wrong)[1] - np.linalg.slogdet(right)[1]
    return 0.5 * float(larger + squared_distance(off, wrong) - squared_distance(off, right))
