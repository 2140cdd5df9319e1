"""What was found of a team's sensors, robot by robot: numbers with intervals, residuals, and how well they predict the rest."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from blackboard.calibrate.drives import Drives
from blackboard.calibrate.fit import ROUNDS, Fit, Prior, covariance, fitted, scored, smoothed
from blackboard.calibrate.landmarks import Misplaced, apart, exchanged, misplaced
from blackboard.calibrate.model import (
    BEARING,
    CURVED_WAY,
    DRIFT,
    DRIVEN_TURN,
    EACH,
    LAG,
    RANGE,
    RANGE_BIAS,
    TURN,
    WAY,
    WIDE,
    Model,
    Noise,
)
from blackboard.errors import UserError
from blackboard.opinion.grid import Array

LIKELY = 2.0  # sigmas of an interval of 95 %, over some twenty blocks
UNSEEN = 0.5  # of the prior sigma: a number that stays wider than this is not reported
DISTANCES = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, math.inf)  # unit: of the table of ranges
SPANS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # seconds: over which residuals are compared
FEWEST = 20  # pairs of residuals before anything is said of them
STOOD = 10.0  # seconds of standing, or of motion, likewise
SOUND = 0.05  # share of misreads up to which a fit without some landmarks goes on from the one with them
LONG, FEWEST_SPANS = 16.0, 5  # seconds of motion in a span, and spans, for noise that lasts
LEAST = 20  # ticks of a half, and sightings or fixes in it

#: The numbers that are reported: name, unit, and the shared numbers whose sum each is. Ranges are true over read.
NUMBERS: dict[str, tuple[str, tuple[int, ...]]] = {
    "way, straight": ("factor", (WAY,)),
    "way, arc": ("factor", (WAY, CURVED_WAY)),
    "turn, spin": ("factor", (TURN,)),
    "turn, arc": ("factor", (TURN, DRIVEN_TURN)),
    "drift": ("rad/s", (DRIFT,)),
    "lag": ("s", (LAG,)),
    "range scale": ("factor", (RANGE,)),
    "range bias": ("unit", (RANGE_BIAS,)),
    "bearing bias": ("rad", (BEARING,)),
}


@dataclass(frozen=True)
class Number:
    """An estimate, and half of its 95 % interval; None where the drive does not determine it."""

    value: float | None
    within: float = 0.0


@dataclass(frozen=True, eq=False)
class FoundSensors:
    """What was found of one robot."""

    numbers: Mapping[str, Number]  # of `NUMBERS`, and the noise
    ranges: list[tuple[float, float, int, float]]  # from, to (unit), sightings, RMS error of their ranges (unit)
    lasting: dict[str, float]  # "range", "bearing" -> seconds until errors are alike by 1/e only; 0: less than a second
    misread: float  # share of the sightings
    sightings: int


@dataclass(frozen=True, eq=False)
class FoundTeam:
    """What was found of a team."""

    robots: Mapping[str, FoundSensors]
    landmarks: list[Misplaced]
    fit: Fit  # of the first half
    nats: Mapping[str, float]  # of a reading of the second half: by what was found, and by other models


def calibrated(
    drives: Drives, track: float, others: Mapping[str, Noise], show: Callable[[int, int], None] | None = None
) -> FoundTeam:
    """Fit the first half, and score the second by what was found and by `others`, which know no lasting errors.

    `track` is from wheel to wheel (unit). UserError: too little was measured.
    """
    moved = _moving(show)
    first, second = drives.split()
    _check(first, second)
    fit, off = _placed(first, track, moved)
    named = exchanged([told for _, told in off])
    numbers = [number for number, _ in off]
    wide = Prior.wide(len(drives.robots))
    spread = covariance(fit, wide)
    rest = second.without(numbers)
    count = max(1, len(rest.sightings.tick) + len(rest.fixes.tick))
    nats = {"found": scored(rest, track, fit.noise, Prior(fit.shared, np.linalg.inv(spread)), moved) / count}
    nats |= {name: scored(rest, track, noise, wide, moved) / count for name, noise in others.items()}
    robots = {name: _sensors(fit, n, spread) for n, name in enumerate(drives.robots)}
    return FoundTeam(robots, named, fit, nats)


def _placed(drives: Drives, track: float, moved: Callable[[], None]) -> tuple[Fit, list[tuple[int, Misplaced]]]:
    """A fit without the landmarks that are not where the map has them, and those, by their numbers."""
    fit = fitted(drives, track, moved)
    off, numbers = misplaced(fit), set[int]()
    for _ in range(len(drives.landmarks) // 2):
        suspects = {number for number, _ in off} - numbers or _suspect(fit, moved)
        if not suspects:
            break
        begin = fit if fit.misread < SOUND else None  # where much was misread, the poses may be wrong, too
        other = fitted(drives.without(numbers | suspects), track, moved, begin)
        places = misplaced(replace(other, model=Model(drives, track)))
        if not suspects & {number for number, _ in places} or len(places) > len(drives.landmarks) / 2:
            break
        fit, off, numbers = other, places, {number for number, _ in places} & (numbers | suspects)
    return fit, [one for one in off if one[0] in numbers]


def _suspect(fit: Fit, moved: Callable[[], None]) -> set[int]:
    """The landmark that is farthest off by all others, if any is off by more than a sighting errs: it may have bent the fit."""
    worst, farthest = set[int](), 1.0
    for number in np.unique(fit.drives.sightings.landmark[fit.drives.sightings.landmark >= 0]):
        model = Model(fit.drives.without([number]), fit.model.track)
        without = smoothed(model, fit.poses, fit.shared, fit.noise, Prior.wide(len(fit.drives.robots)), moved)
        off = apart(replace(without, model=fit.model), int(number))
        if off > farthest:
            worst, farthest = {int(number)}, off
    return worst


def _moving(show: Callable[[int, int], None] | None) -> Callable[[], None]:
    """A function that moves a progress bar by one of the usual number of steps; it stops short of the end."""
    done, total = 0, 5 * ROUNDS

    def moved() -> None:
        nonlocal done
        done += 1
        if show is not None:
            show(done, max(total, done + 1))

    return moved


def _check(*halves: Drives) -> None:
    for half in halves:
        if not (half.sightings.landmark >= 0).any() and not len(half.fixes.tick):
            raise UserError("nothing says where the robots are: calibrate needs sightings of landmarks, or fixes")
        told = len(half.sightings.tick) + len(half.fixes.tick)
        if len(half.times) < LEAST or told < LEAST:
            raise UserError(
                f"too little to calibrate: half of it has {len(half.times)} ticks with {told} sightings of landmarks and mates "
                f"and fixes; {LEAST} of each are needed"
            )


# --- one robot ----------------------------------------------------------------------------------------------------------


def _sensors(fit: Fit, n: int, spread: Array) -> FoundSensors:
    own = slice(EACH * n, EACH * (n + 1))
    covariance, shared, noise = spread[own, own], fit.shared[n], fit.noise
    numbers = {}
    for name, (_, parts) in NUMBERS.items():
        row = np.zeros(EACH)
        row[list(parts)] = 1.0
        value, sigma = float(row @ shared), math.sqrt(float(row @ covariance @ row))
        if name == "range scale":
            value, sigma = 1 / (1 + value), sigma / (1 + value) ** 2
        known = sigma < UNSEEN * float(np.sqrt((row * WIDE**2).sum()))
        numbers[name] = Number(value, LIKELY * sigma) if known else Number(None)
    numbers |= _wheels(fit, n)
    seen = fit.drives.sightings.robot == n
    believed = fit.believed[seen]
    trusted = believed.sum() >= FEWEST
    share = LIKELY / math.sqrt(2 * max(1.0, float(believed.sum())))
    for name, value in (
        ("range floor", noise.floor[n]),
        ("range share", noise.share[n]),
        ("bearing", noise.bearing[n]),
    ):
        numbers[f"noise, {name}"] = Number(float(value), float(value) * share) if trusted else Number(None)
    return FoundSensors(
        numbers,
        _ranges(fit, seen),
        _lasting(fit, n),
        float((1 - believed).mean()) if len(believed) else 0.0,
        int(seen.sum()),
    )


def _wheels(fit: Fit, n: int) -> dict[str, Number]:
    """Sigmas per square root of a second, in motion and standing, and for how long it stood."""
    moving = fit.model.moving(fit.shared)[:, n]
    seconds = {"moving": float(moving.sum()), "standing": float(fit.drives.dt.sum() - moving.sum())}
    numbers = {}
    for state, table in (("moving", fit.noise.moving), ("standing", fit.noise.standing)):
        within = LIKELY / math.sqrt(max(2.0, seconds[state] / 4))
        for name, variance in zip(("along", "across", "turn"), table[n], strict=True):
            value = math.sqrt(float(variance))
            known = seconds[state] >= STOOD
            numbers[f"{state}, {name}"] = Number(value, value * within) if known else Number(None)
    return {**numbers, **_over_long(fit, n), "stood": Number(seconds["standing"])}


def _over_long(fit: Fit, n: int) -> dict[str, Number]:
    """Sigmas per square root of a second of motion, by what the wheels miss over `LONG` seconds: errors that last count."""
    rows = np.flatnonzero(fit.odometry.shared[0][0] == n)
    moving = fit.model.moving(fit.shared)[fit.odometry.poses[0][0][rows], n]
    number = np.floor(np.cumsum(moving) / LONG).astype(int)
    spans = int(number.max(initial=0))  # the last one is not whole
    sums = np.zeros((spans + 1, 3))
    np.add.at(sums, number, fit.odometry.residual[rows])
    numbers = {}
    for column, name in enumerate(("along", "across", "turn")):
        value = math.sqrt(float(np.mean(sums[:spans, column] ** 2)) / LONG) if spans >= FEWEST_SPANS else None
        numbers[f"over {LONG:g} s, {name}"] = Number(value, (value or 0.0) * LIKELY / math.sqrt(2 * max(1, spans)))
    return numbers


def _ranges(fit: Fit, seen: Array) -> list[tuple[float, float, int, float]]:
    distance, error, believed = fit.drives.sightings.range[seen], fit.sighted.residual[seen, 0], fit.believed[seen]
    ranges = []
    for low, high in pairwise(DISTANCES):
        some = (distance >= low) & (distance < high) & (believed > 0.5)
        if some.any():
            ranges.append((low, high, int(some.sum()), float(np.sqrt(np.mean(error[some] ** 2)))))
    return ranges


def _lasting(fit: Fit, n: int) -> dict[str, float]:
    """How long errors of range and bearing of one thing last: where their correlation falls to 1/e."""
    seen = fit.drives.sightings
    rows = np.flatnonzero((seen.robot == n) & (fit.believed > 0.5))
    seconds = {}
    for column, name in enumerate(("range", "bearing")):
        errors = fit.sighted.residual[rows, column]
        errors = errors / (np.sqrt(fit.noise.range_variance(seen.robot[rows], seen.range[rows])) if not column else 1.0)
        likeness = [_alike(fit, rows, errors, low, high) for low, high in pairwise((0.5, *SPANS))]
        told = [one for one in likeness if one is not None]
        if len(told) >= 2:
            fallen = next((k for k, one in enumerate(told) if one < math.exp(-1)), len(told))
            seconds[name] = 0.0 if not fallen else SPANS[fallen - 1]
    return seconds


def _alike(fit: Fit, rows: Array, errors: Array, low: float, high: float) -> float | None:
    """The correlation of errors of the same robot and thing that are so many seconds apart; None where there are few."""
    seen, times = fit.drives.sightings, fit.drives.times
    total = square = count = 0.0
    for step in range(1, 40):
        one, other = rows[:-step], rows[step:]
        apart = times[seen.tick[other]] - times[seen.tick[one]]
        same = (seen.landmark[one] == seen.landmark[other]) & (seen.mate[one] == seen.mate[other])
        some = same & (apart >= low) & (apart < high)
        total += float((errors[:-step] * errors[step:])[some].sum())
        square += 0.5 * float((errors[:-step] ** 2 + errors[step:] ** 2)[some].sum())
        count += int(some.sum())
    return None if count < FEWEST or not square else total / square
