"""The robot's own sensor models: odometry to motion, and the likelihood of a sighting.

The world's physics (`sim_world.sensors`) is written separately on purpose, so that a robot with a wrong model can be tested.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.classes import LANDMARK, is_class
from blackboard.opinion.grid import Array
from blackboard.wire.evidence import Seen
from blackboard.wire.gaussians import unpack_seen
from blackboard.wire.messages import Odometry, Readings, Sighting
from robot_agent.config import OdometrySection, RobotSection, VisionSection
from robot_agent.untold import NOTHING, Unseen, Untold

# The distances of (VI-.1), in cells: the printed sigma is 0 at the best view, and nothing is seen outside SEEN_FROM..SEEN_TO.
BEST_VIEW = 7.5
SEEN_FROM, LINEAR_FROM, LINEAR_TO, SEEN_TO = 1.0, 3.0, 11.0, 13.0

MAX_TRACKED = 64  # objects, and mates in one tick, of which a robot has a belief; each costs it a grid

PARTS = ("range", "bearing")  # sightings that alone tell no place

_nodes, _weights = np.polynomial.hermite_e.hermegauss(7)
#: Gauss-Hermite quadrature: E f(X) of a standard normal X is about the sum of weight * f(node).
NODES = _nodes, _weights / _weights.sum()


@dataclass(frozen=True)
class TickMotion:
    """One tick's motion by the robot's model: forward distance (unit), turn (radians), and the variances of its noise."""

    distance: float
    turn: float
    dt: float  # seconds
    along: float  # unit ** 2
    across: float  # unit ** 2
    heading: float  # radians ** 2


def trackable(readings: Readings, tracked: Collection[str]) -> Readings:
    """The readings without sightings of more mates, or of more objects beside the `tracked` subjects, than a robot tracks."""
    in_view = zip(readings.subjects, readings.landmarks, strict=True)
    names = {subject for subject, landmark in in_view if landmark is None and not is_class(subject)}
    mates = sorted(name for name in names if name.startswith("robot/"))
    objects = sorted(names - set(mates) - set(tracked))
    room = max(0, MAX_TRACKED - sum(not name.startswith("robot/") for name in tracked))
    left = {*mates[MAX_TRACKED:], *objects[room:]}
    if not left:
        return readings
    kept = [s for s in readings.sightings if s.landmark is not None or s.subject not in left]
    seen = [s for s in readings.seen if s.landmark is not None or s.subject not in left]
    return readings.model_copy(update={"sightings": kept, "seen": seen})


def placed(readings: Readings) -> Readings:
    """The readings with positions and poses that were seen as sightings in range and bearing, for beliefs on grids."""
    places = [_placed(seen) for seen in readings.seen if seen.kind in ("position", "pose")]
    return readings.model_copy(update={"sightings": [*readings.sightings, *places]}) if places else readings


def _placed(further: Seen) -> Sighting:
    seen, told = unpack_seen(further, ""), further.confidence
    return Sighting(
        subject=further.subject,
        range=seen.range,
        bearing=seen.bearing,
        landmark=further.landmark,
        age=further.age,
        confidence=told,
    )


def unnamed(readings: Readings) -> list[tuple[int, Sighting]]:
    """Of the newest frame what has no name and a place, each with its number among all that has no name; no landmarks."""
    everything: list[Sighting | Seen] = [*readings.sightings, *readings.seen]
    there = [sighting for sighting in everything if is_class(sighting.subject)]
    sightings = [
        (mark, sighting if isinstance(sighting, Sighting) else _placed(sighting))
        for mark, sighting in enumerate(there)
        if sighting.subject != LANDMARK and (isinstance(sighting, Sighting) or sighting.kind in ("position", "pose"))
    ]
    newest = min((sighting.age for _, sighting in sightings), default=0.0)
    return [(mark, sighting) for mark, sighting in sightings if sighting.age == newest]


def motion(odometry: Odometry, model: OdometrySection, unseen: Unseen = NOTHING) -> TickMotion:
    """The odometry corrected by the model's scales, with noise variances that grow with time, slower while standing.

    What was `unseen` before it is added to them.
    """
    moving = abs(odometry.distance) > 1e-9 or abs(odometry.turn) > 1e-9
    share = odometry.dt * (1.0 if moving else model.standing**2)
    return TickMotion(
        odometry.distance * model.distance_scale,
        odometry.turn * model.turn_scale,
        odometry.dt,
        model.along**2 * share + unseen.way**2,
        model.across**2 * share + unseen.way**2,
        model.turn**2 * share + min(math.pi, unseen.turn) ** 2,
    )


def still(untold: Untold) -> TickMotion:
    """The motion of a tick without odometry: none, but the noise of unmeasured motion."""
    now, before = untold.whole, untold.whole.less(untold.lapse)
    way = now.way**2 - before.way**2
    return TickMotion(0.0, 0.0, 1.0, way, way, min(math.pi, now.turn) ** 2 - min(math.pi, before.turn) ** 2)


def position_sigma(distance: Array, vision: VisionSection) -> Array:
    """Sigma (unit) of a seen position at some distances: (VI-.1) times the gain, at least `floor`; infinite where unseen."""
    off = np.abs(distance - BEST_VIEW)
    with np.errstate(divide="ignore"):
        # (VI-.1): sigma(d) = 8 |d - 7.5| for 3 <= d <= 11, and 20 ln |d - 7.5| for 1 < d < 3 and 11 < d < 13
        printed = np.where((distance >= LINEAR_FROM) & (distance <= LINEAR_TO), 8.0 * off, 20.0 * np.log(off))
    seen = (distance > SEEN_FROM) & (distance < SEEN_TO)
    return np.where(seen, np.maximum(vision.floor, vision.gain * printed), np.inf)


def position_likelihood(dx: Array, dy: Array, seen: tuple[float, float], vision: VisionSection) -> Array:
    """p(seen | the subject is at (dx, dy) from the robot), world axes: N(seen; (dx, dy), sigma(|(dx, dy)|)^2 I)."""
    sigma = position_sigma(np.hypot(dx, dy), vision)
    squared = (dx - seen[0]) ** 2 + (dy - seen[1]) ** 2
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(sigma), np.exp(-0.5 * squared / sigma**2) / (2 * math.pi * sigma**2), 0.0)


def uncertain_likelihood(
    dx: Array, dy: Array, seen: tuple[float, float], covariance: Array, vision: VisionSection
) -> Array:
    """`position_likelihood` of a subject whose place is uncertain: (dx, dy) leads to its mean, `covariance` is in unit ** 2.

    The sum over Gauss-Hermite nodes x_k with weights w_k of w_k N(seen; (dx, dy), sigma(d + x_k s)^2 I + covariance), where s
    is the standard deviation of the distance d. One sigma(d) would claim too much, because (VI-.1) rises so steeply.
    """
    distance = np.maximum(np.hypot(dx, dy), 1e-9)
    cxx, cyy, cxy = covariance[0, 0], covariance[1, 1], covariance[0, 1]
    spread = np.sqrt(dx**2 * cxx + 2 * dx * dy * cxy + dy**2 * cyy) / distance  # s^2 = u^T covariance u along u
    x, y = dx - seen[0], dy - seen[1]
    likelihood = np.zeros(np.broadcast_shapes(dx.shape, dy.shape))
    for node, weight in zip(*NODES, strict=True):
        variance = position_sigma(distance + node * spread, vision) ** 2
        with np.errstate(invalid="ignore"):
            xx, yy = variance + cxx, variance + cyy
            determinant = xx * yy - cxy * cxy
            squared = (yy * x * x - 2 * cxy * x * y + xx * y * y) / determinant  # Mahalanobis
            density = np.exp(-0.5 * squared) / (2 * math.pi * np.sqrt(determinant))
        likelihood += weight * np.where(np.isfinite(variance), density, 0.0)
    return likelihood


def place_likelihood(
    dx: Array, dy: Array, seen: tuple[float, float], covariance: Array, vision: VisionSection
) -> Array:
    """`position_likelihood`, or `uncertain_likelihood` where the subject's place has a `covariance` (2, 2), unit ** 2, but 0."""
    if covariance.any():
        return uncertain_likelihood(dx, dy, seen, covariance, vision)
    return position_likelihood(dx, dy, seen, vision)


def range_variance(distance: float | Array, vision: VisionSection) -> float | Array:
    """Variance of a range (unit ** 2), `frames` times that of one frame, because consecutive frames share their error."""
    return vision.frames * (vision.range_floor**2 + (vision.range_share * distance) ** 2)


def bearing_variance(vision: VisionSection) -> float:
    """Variance of a bearing (radians ** 2), `frames` times that of one frame."""
    return vision.frames * vision.bearing**2


def part_variance(seen: Seen, settings: RobotSection) -> float:
    """Variance of a range (unit ** 2) or a bearing (radians ** 2) alone: as it says, else by the robot's model."""
    if seen.kind == "range":
        fresh = seen.covariance[0] if seen.covariance else float(range_variance(seen.values[0], settings.vision))
        return fresh + settings.ranging.bias**2 + sum(sigma**2 for sigma, _ in seen.biases)
    return seen.covariance[0] if seen.covariance else bearing_variance(settings.vision)


def along_and_across(ux: Array, uy: Array, covariance: Array) -> tuple[Array, Array]:
    """Variances (unit ** 2) of a place with a covariance (2, 2) along unit vectors u, and across them: u^T C u, and n^T C n."""
    (cxx, cxy), (_, cyy) = covariance
    return ux * ux * cxx + 2 * ux * uy * cxy + uy * uy * cyy, uy * uy * cxx - 2 * ux * uy * cxy + ux * ux * cyy


def displacement(sighting: Sighting, motion: TickMotion | None, heading: float) -> tuple[float, float]:
    """The measured displacement from where the robot is now, with its `heading` (radians), to the subject, in world axes (unit)."""
    driven, turned = motion_since(sighting, motion)
    angle = heading - turned + sighting.bearing
    return (
        sighting.range * math.cos(angle) - driven * math.cos(heading),
        sighting.range * math.sin(angle) - driven * math.sin(heading),
    )


def displacement_covariance(sighting: Sighting, heading: float, vision: VisionSection) -> Array:
    """Covariance of the displacement that a sighting measures, shape (2, 2), world axes (unit ** 2): R diag(var r, r^2 var b) R^T."""
    angle = heading + sighting.bearing
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    spread = np.diag([range_variance(sighting.range, vision), sighting.range**2 * bearing_variance(vision)])
    return np.asarray(turn @ spread @ turn.T)


def motion_since(sighting: Sighting | Seen, motion: TickMotion | None) -> tuple[float, float]:
    """Distance driven (unit) and angle turned (radians) since the sighting was taken, at the constant speed of `motion`."""
    if motion is None or not sighting.age:
        return 0.0, 0.0
    share = sighting.age / motion.dt
    return motion.distance * share, motion.turn * share
