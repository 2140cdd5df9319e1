"""What a sighting says, by the robot's own model of its camera (the world's physics is written elsewhere, on purpose)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.grid import Array
from blackboard.wire.messages import Odometry, Sighting
from robot_agent.config import OdometrySection, VisionSection

BEST_VIEW = 7.5  # where the printed sigma is zero; this and the next four numbers are those of (VI-.1)
SEEN_FROM, LINEAR_FROM, LINEAR_TO, SEEN_TO = 1.0, 3.0, 11.0, 13.0

_nodes, _weights = np.polynomial.hermite_e.hermegauss(7)
NODES = _nodes, _weights / _weights.sum()  # of a standard normal distribution


@dataclass(frozen=True)
class Motion:
    """One tick's motion by the robot's model: forward (unit), turn (radians), and the variances it adds."""

    distance: float
    turn: float
    dt: float
    along: float  # unit ** 2
    across: float  # unit ** 2
    heading: float  # radians ** 2


def motion(odometry: Odometry, model: OdometrySection) -> Motion:
    """The odometry corrected by the model's scales; noise grows with the square root of time, less while standing."""
    moving = abs(odometry.distance) > 1e-9 or abs(odometry.turn) > 1e-9
    share = odometry.dt * (1.0 if moving else model.standing**2)
    return Motion(
        odometry.distance * model.distance_scale,
        odometry.turn * model.turn_scale,
        odometry.dt,
        model.along**2 * share,
        model.across**2 * share,
        model.turn**2 * share,
    )


def position_sigma(distance: Array, vision: VisionSection) -> Array:
    """Sigma of a seen position at some distances (VI-.1) times the gain, at least `floor`; infinite where nothing is seen."""
    off = np.abs(distance - BEST_VIEW)
    with np.errstate(divide="ignore"):
        printed = np.where((distance >= LINEAR_FROM) & (distance <= LINEAR_TO), 8.0 * off, 20.0 * np.log(off))
    seen = (distance > SEEN_FROM) & (distance < SEEN_TO)
    return np.where(seen, np.maximum(vision.floor, vision.gain * printed), np.inf)


def position_likelihood(dx: Array, dy: Array, seen: tuple[float, float], vision: VisionSection) -> Array:
    """p(seen | the subject is at (dx, dy) from the robot), world axes: isotropic, sigma by the hypothesised distance."""
    sigma = position_sigma(np.hypot(dx, dy), vision)
    away = (dx - seen[0]) ** 2 + (dy - seen[1]) ** 2
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(sigma), np.exp(-0.5 * away / sigma**2) / (2 * math.pi * sigma**2), 0.0)


def uncertain_likelihood(
    dx: Array, dy: Array, seen: tuple[float, float], covariance: Array, vision: VisionSection
) -> Array:
    """The same where the subject's place is uncertain by a covariance (unit ** 2); (dx, dy) leads to its mean.

    The mean over the distances at which the subject may be (Gauss-Hermite), each with its sigma, convolved with the covariance:
    (VI-.1) rises so steeply that the sigma of one distance would claim too much.
    """
    distance = np.maximum(np.hypot(dx, dy), 1e-9)
    cxx, cyy, cxy = covariance[0, 0], covariance[1, 1], covariance[0, 1]
    spread = np.sqrt(dx**2 * cxx + 2 * dx * dy * cxy + dy**2 * cyy) / distance
    x, y = dx - seen[0], dy - seen[1]
    likelihood = np.zeros(np.broadcast_shapes(dx.shape, dy.shape))
    for node, weight in zip(*NODES, strict=True):
        variance = position_sigma(distance + node * spread, vision) ** 2
        with np.errstate(invalid="ignore"):
            xx, yy = variance + cxx, variance + cyy
            determinant = xx * yy - cxy * cxy
            away = (yy * x * x - 2 * cxy * x * y + xx * y * y) / determinant
            density = np.exp(-0.5 * away) / (2 * math.pi * np.sqrt(determinant))
        likelihood += weight * np.where(np.isfinite(variance), density, 0.0)
    return likelihood


def range_variance(distance: float | Array, vision: VisionSection) -> float | Array:
    """Variance of a range (unit ** 2); frames that follow each other share their error."""
    return vision.frames * (vision.range_floor**2 + (vision.range_share * distance) ** 2)


def bearing_variance(vision: VisionSection) -> float:
    """Variance of a bearing (radians ** 2)."""
    return vision.frames * vision.bearing**2


def rewound(sighting: Sighting, moved: Motion | None) -> tuple[float, float]:
    """How far the robot has driven (unit) and turned (radians) since the sighting was taken."""
    if moved is None or not sighting.age:
        return 0.0, 0.0
    share = sighting.age / moved.dt
    return moved.distance * share, moved.turn * share


def wrap(angle: Array) -> Array:
    """The same angles in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
