"""How what a team measured follows from its poses and from what its sensors are like: residuals and derivatives."""

from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.calibrate.chain import Factors
from blackboard.calibrate.drives import Drives, SightingRows
from blackboard.opinion.gaussian.vehicle import curved_and_driven, wrap
from blackboard.opinion.grid import Array

WAY, CURVED_WAY, TURN, DRIVEN_TURN, DRIFT, LAG, RANGE, RANGE_BIAS, BEARING = range(9)
EACH = 9  # shared numbers of a robot
#: Prior means and sigmas of the shared numbers of a robot; the lag in seconds, the drift in rad/s.
EXPECTED = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
WIDE = np.array([0.4, 0.4, 0.3, 0.5, 0.01, 0.4, 0.2, 0.1, 0.1])
UNSEEN = 10.0  # unit, radians: sigmas of a tick that the odometry did not measure
EPSILON = 1e-9


@dataclass(frozen=True, eq=False)
class Noise:
    """Of N robots: variances in a second of motion and in one of standing; sigmas of a sighting; the share of misreads."""

    moving: Array  # (N, 3): along, across (unit ** 2), turn (rad ** 2)
    standing: Array  # (N, 3)
    floor: Array  # (N,): unit
    share: Array  # (N,): of the range
    bearing: Array  # (N,): radians
    misread: Array  # (N,)

    @staticmethod
    def usual(robots: int) -> "Noise":
        """Where a search begins: wide."""
        return Noise.alike(robots, (0.05, 0.02, 0.08), 0.1, 0.1, 0.07, 0.05, misread=0.02)

    @staticmethod
    def alike(
        robots: int,
        moving: tuple[float, float, float],
        standing: float,
        floor: float,
        share: float,
        bearing: float,
        misread: float = 0.01,
    ) -> "Noise":
        """Equal noise of all robots: sigmas along, across and of the turn in motion, their share at a stand; and of sightings."""
        each, flat = np.tile(np.square(moving), (robots, 1)), np.ones(robots)
        return Noise(each, each * standing**2, floor * flat, share * flat, bearing * flat, misread * flat)

    def times(self, factor: float) -> "Noise":
        """The noise with the sigmas of all sightings times a factor."""
        return replace(self, floor=self.floor * factor, share=self.share * factor, bearing=self.bearing * factor)

    def range_variance(self, robot: Array, distance: Array) -> Array:
        """Variances of measured ranges, unit^2."""
        return np.asarray(self.floor[robot] ** 2 + (self.share[robot] * distance) ** 2)


@dataclass(frozen=True, eq=False)
class Model:
    """The measurements of some drives; what is expected of them depends on poses (K, N, 3) and shared numbers (N, 9)."""

    drives: Drives
    track: float
    _sums: Array = field(init=False)

    def __post_init__(self) -> None:
        """Add up the commands: way, way on a curve, turn, driven turn, time in motion, each until the end of each tick."""
        odometry = self.drives.odometry
        way, turn = odometry[:, :, 0], odometry[:, :, 1]
        curved, driven = curved_and_driven(way, turn, (odometry[:, :, 2], odometry[:, :, 3]), self.track)
        moving = ((np.abs(way) > EPSILON) | (np.abs(turn) > EPSILON)) * self.drives.dt[:, None]
        rows = np.stack([way, curved, turn, driven, moving], axis=2)
        object.__setattr__(self, "_sums", np.cumsum(rows, axis=0))

    def commands(self, lag: Array) -> tuple[Array, Array]:
        """What each tick adds to the sums of commands that act `lag` (N,) seconds late, and its derivative by the lag."""
        times, dt = self.drives.times, self.drives.dt
        moves, slope = np.zeros((2, *self._sums.shape))
        half = 0.5 * float(np.median(dt[1:])) if len(dt) > 1 else 0.5
        for n, late in enumerate(lag):
            for column in range(self._sums.shape[2]):
                at = [np.interp(times - late + step, times, self._sums[:, n, column]) for step in (0.0, half, -half)]
                rate = (at[1] - at[2]) / (2 * half)
                moves[1:, n, column], slope[1:, n, column] = np.diff(at[0]), -np.diff(rate)
        return moves, slope

    def steps(self, shared: Array) -> tuple[Array, Array]:
        """The way (unit) and the turn (rad) of each tick by the odometry with some shared numbers (N, 9), shape (K, N)."""
        return _scaled(shared, self.commands(shared[:, LAG])[0])

    def moving(self, shared: Array) -> Array:
        """Seconds in motion in each tick, shape (K, N)."""
        return self.commands(shared[:, LAG])[0][:, :, 4]

    def odometry(self, poses: Array, shared: Array, noise: Noise) -> Factors:
        """Each motion against the commands: along, across (unit) and turn (rad), tick by tick for each robot."""
        moves, slope = self.commands(shared[:, LAG])
        ticks, robots = poses.shape[:2]
        way, turn = _scaled(shared, moves)
        by_way, by_turn = np.zeros((2, ticks, robots, EACH))
        by_way[:, :, [WAY, CURVED_WAY]] = moves[:, :, :2]
        by_turn[:, :, [TURN, DRIVEN_TURN, DRIFT]] = moves[:, :, 2:]
        by_way[:, :, LAG], by_turn[:, :, LAG] = _scaled(shared, slope)
        k, n = (index.ravel() for index in np.mgrid[1:ticks, 0:robots])
        before, after = poses[k - 1, n], poses[k, n]
        angle = before[:, 2] + turn[k, n] / 2
        c, s = np.cos(angle), np.sin(angle)
        frame = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)  # (M, 2, 2)
        went = np.einsum("mij,mj->mi", frame, after[:, :2] - before[:, :2])
        by_after, by_before, by_shared = np.zeros((len(k), 3, 3)), np.zeros((len(k), 3, 3)), np.zeros((len(k), 3, EACH))
        by_after[:, :2, :2], by_before[:, :2, :2] = frame, -frame
        by_angle = np.stack([went[:, 1], -went[:, 0]], axis=1)
        by_before[:, :2, 2] = by_angle
        by_after[:, 2, 2], by_before[:, 2, 2] = 1.0, -1.0
        by_shared[:, :2] = 0.5 * by_angle[:, :, None] * by_turn[k, n][:, None, :]
        by_shared[:, 0] -= by_way[k, n]
        by_shared[:, 2] -= by_turn[k, n]
        residual = np.column_stack(
            [way[k, n] - went[:, 0], -went[:, 1], -wrap(after[:, 2] - before[:, 2] - turn[k, n])]
        )
        variance = self.odometry_variance(shared, noise)[k, n]
        return Factors(residual, 1.0 / variance, [(k, n, by_after), (k - 1, n, by_before)], [(n, by_shared)])

    def odometry_variance(self, shared: Array, noise: Noise) -> Array:
        """Variances of motions, shape (K, N, 3)."""
        moving, dt = self.moving(shared)[:, :, None], self.drives.dt[:, None, None]
        variance = noise.moving * moving + noise.standing * np.maximum(0.0, dt - moving) + EPSILON
        return np.asarray(np.where(self.drives.measured[:, :, None], variance, UNSEEN**2))

    def sightings(self, poses: Array, shared: Array, noise: Noise) -> Factors:
        """Range (unit) and bearing (rad) of each sighting."""
        sightings = self.drives.sightings
        mates = sightings.mate >= 0
        mine, its = self.at(poses, sightings, sightings.robot), self.at(poses, sightings, np.maximum(sightings.mate, 0))
        place = its[:, :2].copy()
        if (~mates).any():
            place[~mates] = self.drives.places[sightings.landmark[~mates]]
        apart = place - mine[:, :2]
        away = np.maximum(np.hypot(*apart.T), 1e-3)
        unit = apart / away[:, None]
        across = np.stack([-unit[:, 1], unit[:, 0]], axis=1) / away[:, None]
        scale = 1 + shared[sightings.robot, RANGE]
        residual = np.column_stack(
            [
                sightings.range - scale * away - shared[sightings.robot, RANGE_BIAS],
                wrap(
                    sightings.bearing
                    - np.arctan2(apart[:, 1], apart[:, 0])
                    + mine[:, 2]
                    - shared[sightings.robot, BEARING]
                ),
            ]
        )
        by_mine, by_its, by_shared = (
            np.zeros((len(away), 2, 3)),
            np.zeros((len(away), 2, 3)),
            np.zeros((len(away), 2, EACH)),
        )
        by_mine[:, 0, :2], by_mine[:, 1, :2], by_mine[:, 1, 2] = -scale[:, None] * unit, -across, -1.0
        by_its[mates, :, :2] = -by_mine[mates, :, :2]
        by_shared[:, 0, RANGE], by_shared[:, 0, RANGE_BIAS], by_shared[:, 1, BEARING] = away, 1.0, 1.0
        weight = np.column_stack(
            [1 / noise.range_variance(sightings.robot, away), 1 / noise.bearing[sightings.robot] ** 2]
        )
        back, mate = sightings.share[:, None, None], np.maximum(sightings.mate, 0)
        spots = [
            (sightings.tick, sightings.robot, (1 - back) * by_mine),
            (sightings.tick - 1, sightings.robot, back * by_mine),
        ]
        spots += [(sightings.tick, mate, (1 - back) * by_its), (sightings.tick - 1, mate, back * by_its)]
        return Factors(residual, weight, spots, [(sightings.robot, by_shared)])

    def at(self, poses: Array, sightings: SightingRows, robot: Array) -> Array:
        """Poses of robots at the times of sightings, shape (M, 3), on the straight line between two ticks."""
        after, before = poses[sightings.tick, robot], poses[sightings.tick - 1, robot]
        went = after - before
        went[:, 2] = wrap(went[:, 2])
        return np.asarray(after - sightings.share[:, None] * went)

    def fixes(self, poses: Array) -> Factors:
        fixes = self.drives.fixes
        by = np.zeros((len(fixes.tick), 2, 3))
        by[:, [0, 1], [0, 1]] = 1.0
        weight = np.repeat(1 / fixes.sigma[:, None] ** 2, 2, axis=1)
        return Factors(fixes.value - poses[fixes.tick, fixes.robot, :2], weight, [(fixes.tick, fixes.robot, by)], [])

    def headings(self, poses: Array) -> Factors:
        headings = self.drives.headings
        by = np.zeros((len(headings.tick), 1, 3))
        by[:, 0, 2] = 1.0
        residual = wrap(headings.value - poses[headings.tick, headings.robot, 2:])
        return Factors(residual, 1 / headings.sigma[:, None] ** 2, [(headings.tick, headings.robot, by)], [])


def _scaled(shared: Array, moves: Array) -> tuple[Array, Array]:
    """Ways and turns by commands, shape (K, N, 5), each of which counts as the shared numbers (N, 9) say: shape (K, N)."""
    way = shared[:, WAY] * moves[:, :, 0] + shared[:, CURVED_WAY] * moves[:, :, 1]
    turn = shared[:, TURN] * moves[:, :, 2] + shared[:, DRIVEN_TURN] * moves[:, :, 3]
    return way, turn + shared[:, DRIFT] * moves[:, :, 4]
