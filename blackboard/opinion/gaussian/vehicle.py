"""A robot in the plane with the lasting errors of its sensors, as one block of a joint Gaussian.

States: x, y (unit); heading (rad); forward and turn scale (true = scale * told); heading drift (rad/s) while it moves;
bearing bias of its camera (rad); slip, an error of the forward scale that lasts seconds; range scale, an error of all its
ranges as a share of them. Then what differs by kind of motion: by how much the scale of the way differs on a curve from
that straight ahead, and the scale of a turn that is driven from that of a turn on the spot; and lag (s), by how much later
than told the robot moves. Scales, drift and lag are random walks; bias, slip and range scale forget (`Nuisance.memory`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import add, sub
from typing import TypeVar

import numpy as np

from blackboard.opinion.gaussian.joint import Block, Expected, Factor, Joint, Moments
from blackboard.opinion.grid import Array

X, Y, HEADING, FORWARD, TURN, DRIFT, BEARING, SLIP, RANGE, CURVED_WAY, CURVED_TURN, LAG = range(12)
STATES = 12
WANDERING = [FORWARD, TURN, DRIFT, CURVED_WAY, CURVED_TURN, LAG]  # random walks
AXES = slice(0, 2)  # the position
POSE = slice(0, 3)
ANYWHERE = math.pi**2 / 3  # radians ** 2: the variance of a heading of which nothing is known
TRACK = 0.26  # unit: the distance between the wheels, where none is given
THERE_AND_BACK = 1e3  # unit or radians: by so much a part of a step may be more than the step in all
CURVED, SPINNING = 0.3, 0.6  # shares (`kinds`) from which on a way is a curve, and a turn begins to be one on the spot
Angle = TypeVar("Angle", float, Array)
# The share of its speed by which a robot may go faster or slower, or aside, than in the tick before or after.
UNSTEADY = 0.5
LATELY = 2.0  # seconds after which what a robot did says little of what it does
FLAT = 1e6  # unit ** 2: the variance of a coordinate of which nothing is known
KEPT, MOST_KEPT = 1.0, 32  # how many seconds of motions before the newest one are kept, and how many motions
GAP = 1.5  # times its own: a motion that ends so much time after the one before did not follow at once


@dataclass(frozen=True)
class Nuisance:
    """The model of the lasting errors; the zeros of a sensor without them leave the states out."""

    forward: float = 1.0
    turn: float = 1.0
    sigmas: tuple[float, ...] = (0.0,) * 9  # at the start, of the states from the forward scale on
    #: Of forward and turn scale, drift, curved way and turn, lag: per square root of a second of motion.
    walks: tuple[float, ...] = (0.0,) * 6
    memory: tuple[float, ...] = (math.inf,) * 3  # seconds: of the bearing bias, the slip and the range scale
    alike: float = 0.0  # share of the scales' variances that robots with the same `Nuisance` have in common (`alike`)

    def __post_init__(self) -> None:
        """The last sigmas and walks may be left out: they are 0."""
        object.__setattr__(self, "sigmas", (*self.sigmas, *(0.0,) * (STATES - FORWARD - len(self.sigmas))))
        object.__setattr__(self, "walks", (*self.walks, *(0.0,) * (len(WANDERING) - len(self.walks))))

    def prior(self) -> Moments:
        """Mean and covariance of the states from the forward scale on, shape (12,) and (12, 12)."""
        mean = np.zeros(STATES - FORWARD)
        mean[:2] = self.forward, self.turn
        return Moments(mean, np.diag(np.square(self.sigmas)))


@dataclass(frozen=True)
class Motion:
    """Odometry over a span of time, with the variances of its error; those of spans that follow each other add up."""

    distance: float = 0.0  # unit, as the odometry has it
    turn: float = 0.0  # radians, the same
    dt: float = 0.0  # seconds
    moving: float = 0.0  # seconds of them in motion
    along: float = 0.0  # unit ** 2
    across: float = 0.0  # unit ** 2
    heading: float = 0.0  # radians ** 2
    curved: float = 0.0  # unit: of the distance, what was driven on a curve
    driven: float = 0.0  # radians: of the turn, what was not on the spot
    faster: float = 0.0  # unit / s: by how much the speed grew
    quicker: float = 0.0  # radians / s: by how much the rate of the turn grew
    aside: float = 0.0  # unit: to the left, as the odometry has it
    #: What the robot did before, the newest first, where that is kept (`after`). A sum of motions has none of it.
    before: tuple[Motion, ...] = field(default=(), repr=False, compare=False, kw_only=True)

    @property
    def way(self) -> float:
        """Unit: how far it went, in whichever direction."""
        return math.hypot(self.distance, self.aside)

    def numbers(self) -> tuple[float, ...]:
        """All that adds up, in the order of the fields."""
        *numbers, _ = vars(self).values()
        return tuple(numbers)

    @property
    def covered(self) -> float:
        """Seconds of it and of what is kept before it."""
        return self.dt + sum(earlier.dt for earlier in self.before)

    def after(self, earlier: Motion, seconds: float) -> Motion:
        """The same with what the robot did before, for `KEPT`, if that is known: the `earlier` one ended so many `seconds` before."""
        if earlier.dt <= 0 or seconds > GAP * self.dt:
            return replace(self, before=())
        kept, length = list[Motion](), 0.0
        for motion in (replace(earlier, before=()), *earlier.before)[:MOST_KEPT]:
            if length < KEPT:
                kept.append(motion)
                length += motion.dt
        return replace(self, before=tuple(kept))

    def back(self, age: float) -> Iterator[tuple[Motion, float]]:
        """The motions of its last `age` seconds, the newest first, with the share of each; before all that are kept it did as then."""
        last = self
        for earlier in self.before:
            if age <= last.dt:
                break
            yield last, 1.0
            age, last = age - last.dt, earlier
        yield last, age / last.dt

    def plus(self, later: Motion) -> Motion:
        """Both spans as one; the shape of the way between is lost."""
        return Motion(*map(add, self.numbers(), later.numbers()))

    def then(self, later: Motion) -> Motion:
        """Both spans as one that leads where they lead: its way is seen at the heading halfway through its turn."""
        (ahead, aside), (further, to_side) = (
            turned_by((part.distance, part.aside), off)
            for part, off in ((self, -later.turn / 2), (later, self.turn / 2))
        )
        curved = self.curved * math.cos(later.turn / 2) + later.curved * math.cos(self.turn / 2)
        return replace(self.plus(later), distance=float(ahead + further), aside=float(aside + to_side), curved=curved)

    def times(self, share: float) -> Motion:
        """So much of it, at an even speed."""
        part = Motion(*(share * number for number in self.numbers()))
        return replace(part, faster=0.0, quicker=0.0)

    def since(self, earlier: Motion) -> Motion:
        """What was added to a sum of motions since it was `earlier`."""
        return Motion(*map(sub, self.numbers(), earlier.numbers()))

    def unheard(self, seconds: float) -> Motion:
        """The same with more noise, where evidence of so many seconds was lost: the robot may have driven curves in that time."""
        off = (UNSTEADY * self.way * min(1.0, max(0.0, seconds) / LATELY)) ** 2
        return replace(self, along=self.along + off, across=self.across + off) if off else self


def entering(pose: Moments, nuisance: Nuisance) -> Moments:
    """A whole block from a pose (x, y, heading) and the prior of the rest, independent of each other."""
    prior = nuisance.prior()
    covariance = np.zeros((STATES, STATES))
    covariance[POSE, POSE], covariance[FORWARD:, FORWARD:] = pose.covariance, prior.covariance
    return Moments(np.concatenate([pose.mean, prior.mean]), covariance)


def kinds(way: float | Array, turn: float | Array, track: float = TRACK) -> tuple[Array, Array]:
    """Which share of a way (unit) is on a curve, and which of a turn (radians) is driven: 0 to 1 each.

    By how far the wheels, `track` apart (unit), go against each other, as a share of all that they go: 0 straight ahead, 1 on
    the spot.
    """
    against = np.abs(turn) * track / 2
    total = np.abs(way) + against
    share = against / np.maximum(total, np.finfo(float).tiny)
    return np.minimum(1.0, share / CURVED), np.minimum(1.0, (1 - share) / (1 - SPINNING))


def curved_and_driven(
    way: float | Array, turn: float | Array, told: Sequence[float | Array], track: float
) -> tuple[Array, Array]:
    """What of a way was on a curve (unit), and what of a turn while driving (radians).

    `told` is both as they were measured; where that is NaN, `kinds` says it. `track` is the distance between the wheels (unit).
    Of ways there and back a part may be more than the whole, but not without bound.
    """
    on_curve, while_driving = kinds(way, turn, track)
    return _part(way, told[0], on_curve), _part(turn, told[1], while_driving)


def _part(whole: float | Array, told: float | Array, share: Array) -> Array:
    most = np.abs(whole) + THERE_AND_BACK
    return np.where(np.isnan(told), share * whole, np.clip(told, -most, most))


def meant(state: Array, motion: Motion) -> tuple[float, float, float, Array]:
    """How far a robot (its state, shape (12,)) has come and turned by its odometry, and come to its left; their derivatives (3, 12).

    The scale of a way to the side is that of the way ahead.
    """
    by = np.zeros((3, STATES))
    of_way, of_turn, of_side = by
    of_side[FORWARD] = of_side[SLIP] = motion.aside
    of_way[FORWARD] = of_way[SLIP] = motion.distance
    of_way[CURVED_WAY], of_way[LAG] = motion.curved, -motion.faster
    of_turn[TURN], of_turn[DRIFT] = motion.turn, motion.moving
    of_turn[CURVED_TURN], of_turn[LAG] = motion.driven, -motion.quicker
    way, turn, aside = (by @ state).tolist()
    return way, turn, aside, by


def drive(joint: Joint, robot: Block, motion: Motion, nuisance: Nuisance, *, bent: bool = True) -> None:
    """Move a robot's block by its odometry, through its scales, drift, slip and lag, along the chord of the turn.

    `bent`: with the variance that a badly known heading adds along the way; without it as an extended Kalman filter does it.
    """
    drive_alike([(joint, motion)], robot, nuisance, bent=bent)


def drive_alike(moves: Sequence[tuple[Joint, Motion]], robot: Block, nuisance: Nuisance, *, bent: bool = True) -> None:
    """As `drive`, of joints that have the robot at the same mean, by motions that differ in their noise alone."""
    joint, motion = moves[0]
    state = joint.mean[joint.blocks[robot]]
    keep = np.ones(STATES)
    keep[BEARING:CURVED_WAY] = [math.exp(-motion.dt / seconds) for seconds in nuisance.memory]
    distance, turn, aside, by = meant(state, motion)
    c, s = math.cos(state[HEADING] + turn / 2), math.sin(state[HEADING] + turn / 2)
    went = np.array([distance * c - aside * s, distance * s + aside * c])
    mean = state * keep
    mean[POSE] = state[X] + went[0], state[Y] + went[1], wrap(state[HEADING] + turn)
    transition = np.diag(keep)
    by_heading = np.array([-went[1], went[0]])
    transition[AXES, HEADING] = by_heading
    along = np.array([c, s])
    transition[AXES] += along[:, np.newaxis] * by[0] + (by_heading / 2)[:, np.newaxis] * by[1]
    if aside:
        transition[AXES] += np.array([-s, c])[:, np.newaxis] * by[2]
    transition[HEADING] += by[1]
    noise = np.zeros(STATES)
    noise[WANDERING] = np.square(nuisance.walks) * motion.moving
    forgets = slice(BEARING, CURVED_WAY)
    noise[forgets] = np.square(nuisance.sigmas[BEARING - FORWARD : CURVED_WAY - FORWARD]) * (1 - keep[forgets] ** 2)
    frame = np.array([[c, -s], [s, c]])
    for joint, motion in moves:
        added = np.diag(noise)
        added[HEADING, HEADING] = motion.heading
        added[AXES, AXES] = (frame * [motion.along, motion.across]) @ frame.T
        if bent:
            path = math.hypot(distance, aside)
            ahead, far = (along, distance) if not aside else (went / path, path)
            added[AXES, AXES] += ahead[:, np.newaxis] * ahead * _bent(joint, robot, far, ahead)
        joint.move(robot, mean, transition, added)


def _bent(joint: Joint, robot: Block, distance: float, way: Array) -> float:
    """Variance (unit ** 2) that a distance adds along a way, shape (2,), because its heading is known badly.

    A heading that errs by e leaves 1 - cos e of the distance undone, which no linear filter knows: in the mean square, for a
    variance V, 3/2 - 2 exp(-V / 2) + exp(-2 V) / 2. Such errors follow each other for as long as the heading stays unknown, so
    their sigmas add up, and not their variances.
    """
    at = joint.blocks[robot].start
    place = joint.covariance[at : at + 2, at : at + 2]
    if place[0, 0] + place[1, 1] >= FLAT:
        return 0.0
    variance = float(joint.covariance[at + HEADING, at + HEADING])
    undone = 0.5 * math.expm1(-2 * variance) - 2 * math.expm1(-variance / 2)
    shorter = abs(distance) * math.sqrt(max(0.0, undone))
    return shorter * (shorter + 2 * math.sqrt(max(0.0, float(way @ place @ way))))


def moved_in(state: Array, motion: Motion | None, age: float) -> tuple[Array, float]:
    """How far a robot (its state, shape (12,)) has come, shape (2,), and turned in the last `age` seconds of a motion.

    Where `age` is negative, it is what the robot will do if it goes on like that, with the other sign.
    """
    went, turned = np.zeros(2), 0.0
    if motion is None or not age or motion.dt <= 0:
        return went, turned
    for piece, share in motion.back(age):
        way, turn, aside = (share * part for part in meant(state, piece)[:3])
        middle = float(state[HEADING]) - turned - turn / 2
        c, s = math.cos(middle), math.sin(middle)
        went += [way * c - aside * s, way * s + aside * c]
        turned += turn
    return went, turned


def speed(state: Moments, motion: Motion) -> Moments | None:
    """Velocity (unit / s) along x and y and rate of turn (rad / s) in the mean of a motion, shape (3,), of the block that it led to.

    None of a motion without time, and where nothing is known of the heading.
    """
    if motion.dt <= 0 or state.covariance[HEADING, HEADING] > ANYWHERE:
        return None
    way, turn, sideways, by = meant(state.mean, motion)
    along = np.array([math.cos(state.mean[HEADING]), math.sin(state.mean[HEADING])])
    aside = np.array([-along[1], along[0]])
    rows = np.vstack([np.outer(along, by[0]) + np.outer(aside, by[2]), by[1]])
    rows[AXES, HEADING] += way * aside - sideways * along
    noise = np.diag([0.0, 0.0, motion.heading])
    noise[AXES, AXES] = motion.along * np.outer(along, along) + motion.across * np.outer(aside, aside)
    mean = np.array([*(way * along + sideways * aside), turn])
    return Moments(mean / motion.dt, (rows @ state.covariance @ rows.T + noise) / motion.dt**2)


def correct(
    joint: Joint, factor: Factor, only: Collection[Block] | None = None, expected: Expected | None = None
) -> None:
    """`Joint.update`, of all blocks or `only` of some, where poses' errors are kept in coordinates that turn with the heading's.

    A position's error is held as what is left after the world is turned by the heading's error, so that moving the mean
    moves the tie between both along. Else the filter takes its changes of mind for knowledge of the heading
    (Barrau and Bonnabel, IEEE TAC 62(4), 2017; for teams Huang, Trawny, Mourikis, Roumeliotis, RSS 2009).

    A GPS errs in the world, so a measurement of a place alone (`Factor.of_place`) changes these ties only by the part of the move
    that the heading explains (the left-invariant error of the same paper). Otherwise, with an unknown heading, a fix would leave the
    place nearly as unsure as before.
    """
    if not factor.of_place:
        turn_ties(joint, joint.update(factor, only, expected))
        return
    first = joint.firsts(STATES)
    blocks = joint.among_each(first[:, np.newaxis] + np.arange(STATES))
    variances = blocks[:, HEADING, HEADING]
    moved = joint.update(factor, only, expected)
    turned = np.zeros_like(moved)
    by = np.divide(moved[first + HEADING], variances, out=np.zeros(len(first)), where=variances > 0.0)
    turned[first + X], turned[first + Y] = blocks[:, X, HEADING] * by, blocks[:, Y, HEADING] * by
    turn_ties(joint, turned)


def turn_ties(joint: Joint, moved: Array) -> None:
    """Once all means have moved by so much, shape (n,): let the ties between places and headings move along (`correct`)."""
    first = joint.firsts(STATES)
    dx, dy = moved[first + X], moved[first + Y]
    first, dx, dy = (rows[(dx != 0) | (dy != 0)] for rows in (first, dx, dy))
    if len(first):
        heading = first + HEADING
        joint.shear(
            np.concatenate([first + X, first + Y]), np.concatenate([heading, heading]), np.concatenate([-dy, dx])
        )


def wrap(angle: Angle) -> Angle:
    """The same angle, or angles, in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def turned_by(offset: Sequence[float] | Array, angle: float) -> Array:
    """An offset, turned counter-clockwise by an angle (radians): shape (2,)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]])
