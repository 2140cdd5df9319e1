"""What a team measured, as arrays: commands and readings of its robots by ticks, without anything that says where they were."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from blackboard.errors import UserError
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Readings

# Seconds: one sighting of each thing by each robot in so long, because frames that follow each other err alike.
EVERY = 1.0
LONGEST_TICK = 86_400.0  # seconds
MOST_TICKS = 20_000  # that are taken of a recording
COMPASS = 0.03  # radians: the sigma of a heading that comes without one


@dataclass(frozen=True, eq=False)
class SightingRows:
    """What was seen at a range and a bearing, one row each, in time order."""

    tick: Array  # (M,)
    robot: Array  # (M,): number of who saw it
    mate: Array  # (M,): number of the mate that was seen; -1 of a landmark
    landmark: Array  # (M,): number of the landmark; -1 of a mate
    range: Array  # (M,)
    bearing: Array  # (M,): radians
    share: Array  # (M,): how long before the end of the tick it was seen, as a share of the tick, 0 to 1

    def where(self, chosen: Array) -> SightingRows:
        return SightingRows(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Absolute:
    """Fixes of a position, and headings, one row each."""

    tick: Array
    robot: Array
    value: Array  # (M, 2) of positions, (M, 1) of headings
    sigma: Array  # (M,)

    def where(self, chosen: Array) -> Absolute:
        return Absolute(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Drives:
    """K ticks of N robots. Lengths are in the grid's unit, angles in radians, times in seconds."""

    robots: tuple[str, ...]
    landmarks: tuple[str, ...]
    places: Array  # (L, 2): where the map has the landmarks
    times: Array  # (K,): of the ends of the ticks
    #: (K, N, 4): distance and turn in the tick, by the odometry; of them what was on a curve, and driven, NaN where it does not say.
    odometry: Array
    measured: Array  # (K, N): whether the odometry measured all of the tick
    sightings: SightingRows
    fixes: Absolute
    headings: Absolute

    @property
    def dt(self) -> Array:
        """Lengths of the ticks, shape (K,); that of the first is 0."""
        return np.diff(self.times, prepend=self.times[0])

    def split(self) -> tuple[Drives, Drives]:
        """The first half and the second."""
        middle = len(self.times) // 2
        return self.part(0, middle), self.part(middle, len(self.times))

    def part(self, first: int, until: int) -> Drives:
        """The ticks from one on until before another."""

        def inside(tick: Array) -> Array:
            return (tick >= first) & (tick < until)

        def moved(measured: Absolute) -> Absolute:
            some = measured.where(inside(measured.tick))
            return replace(some, tick=some.tick - first)

        seen = self.sightings.where(inside(self.sightings.tick))
        odometry, measured = self.odometry[first:until].copy(), self.measured[first:until].copy()
        odometry[:1], measured[:1] = 0.0, True
        return replace(
            self,
            times=self.times[first:until],
            odometry=odometry,
            measured=measured,
            sightings=replace(seen, tick=seen.tick - first),
            fixes=moved(self.fixes),
            headings=moved(self.headings),
        )

    def without(self, landmarks: Iterable[int]) -> Drives:
        """The same without the sightings of some landmarks, by their numbers."""
        return replace(self, sightings=self.sightings.where(~np.isin(self.sightings.landmark, list(landmarks))))


def drives_of(readings: Iterable[Readings], trusted: bool = True) -> Drives:
    """The readings of a team as arrays. A heading without a sigma has `COMPASS`.

    Ticks that do not end after all before them are left out.
    Not `trusted`: fixes and headings are left out, as those of a replay, which come from the truth. UserError: a tick of days.
    """
    by_tick = _by_tick(readings)
    ends = _ends(by_tick)
    robots = tuple(sorted({name for some in by_tick.values() for name in some}))
    number = {f"robot/{name}": n for n, name in enumerate(robots)}
    times = np.array([*ends.values()])
    if (longest := float(np.diff(times).max(initial=0.0))) > LONGEST_TICK:
        raise UserError(
            f"the times of the readings jump by {longest:g} s: give a part of them, as `blackboard tape cut` makes it"
        )
    odometry, measured = np.zeros((len(ends), len(robots), 4)), np.zeros((len(ends), len(robots)), dtype=bool)
    seen, fixes, headings = list[tuple[float, ...]](), list[tuple[float, ...]](), list[tuple[float, ...]]()
    places: dict[str, tuple[float, float]] = {}
    newest: dict[tuple[int, str], float] = {}
    for k, tick in enumerate(ends):
        for name, one in sorted(by_tick[tick].items()):
            n, dt = number[f"robot/{name}"], float(times[k] - times[k - 1]) if k else 0.0
            if one.odometry is not None and k:
                parts = one.odometry.curved, one.odometry.driven
                odometry[k, n, :2] = one.odometry.distance, one.odometry.turn
                odometry[k, n, 2:] = [math.nan if part is None else part for part in parts]
                measured[k, n] = one.odometry.dt > dt / 2
            if trusted and one.fix is not None:
                fixes.append((k, n, *one.fix.position, one.fix.sigma))
            if trusted:
                headings += [(k, n, *heading) for heading in _headings(one)]
            seen += _rows(one, k, times, number, places, newest)
    measured[0] = True
    columns = np.array(seen, dtype=float).reshape(-1, 7)
    columns = columns[np.argsort(columns[:, 0], kind="stable")]
    whole = [columns[:, c].astype(int) for c in range(4)]
    sightings = SightingRows(*whole, *(columns[:, c] for c in range(4, 7)))
    spots = np.array(list(places.values()), dtype=float).reshape(-1, 2)
    return Drives(
        robots, tuple(places), spots, times, odometry, measured, sightings, _absolute(fixes, 2), _absolute(headings, 1)
    )


def _ends(by_tick: Mapping[int, Mapping[str, Readings]]) -> dict[int, float]:
    """When each tick ends (s), in their order, but for those that do not end after all before them."""
    ends, newest = dict[int, float](), -math.inf
    for tick in sorted(by_tick):
        end = max(one.time for one in by_tick[tick].values())
        if end > newest:
            ends[tick] = newest = end
    return ends


def _headings(one: Readings) -> Iterator[tuple[float, float]]:
    """The headings that a robot measured in a tick, with their sigmas."""
    if one.fix is not None and one.fix.heading is not None:
        yield one.fix.heading, one.fix.heading_sigma or COMPASS
    if one.compass is not None:
        yield one.compass, one.compass_sigma or COMPASS


def _by_tick(readings: Iterable[Readings]) -> dict[int, dict[str, Readings]]:
    """Readings by tick and robot, of so many ticks at most."""
    by_tick: dict[int, dict[str, Readings]] = {}
    for one in readings:
        if one.tick in by_tick or len(by_tick) < MOST_TICKS:
            by_tick.setdefault(one.tick, {})[one.robot] = one
    return by_tick


def _rows(
    one: Readings,
    k: int,
    times: Array,
    number: Mapping[str, int],
    places: dict[str, tuple[float, float]],
    newest: dict[tuple[int, str], float],
) -> Iterator[tuple[float, ...]]:
    """The sightings of a robot's tick k, of landmarks and mates, as rows of `SightingRows`.

    Each landmark is added to `places`, and the time of the newest sighting of each subject to `newest`, by observer and subject.
    """
    own = f"robot/{one.robot}"
    for sighting in sorted(one.sightings, key=lambda s: -s.age) if k else ():
        at, name = one.time - sighting.age, (number[own], sighting.subject)
        known = sighting.landmark is not None or sighting.subject in number
        if not known or sighting.subject == own or at - newest.get(name, -math.inf) < EVERY:
            continue
        newest[name] = at
        back = k
        while back > 1 and times[back - 1] > at:
            back -= 1
        share = min(1.0, max(0.0, (times[back] - at) / (times[back] - times[back - 1])))
        mate, landmark = number.get(sighting.subject, -1), -1
        if sighting.landmark is not None:
            places.setdefault(sighting.subject, (sighting.landmark[0], sighting.landmark[1]))
            mate, landmark = -1, list(places).index(sighting.subject)
        yield back, number[own], mate, landmark, sighting.range, sighting.bearing, share


def _absolute(rows: list[tuple[float, ...]], size: int) -> Absolute:
    table = np.array(rows, dtype=float).reshape(-1, size + 3)
    return Absolute(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2 : 2 + size], table[:, -1])
