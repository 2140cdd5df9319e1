"""Robots that mates see elsewhere, sighting after sighting, while nothing else says where they are.

Whose wheels slip, or who is carried, is not where its odometry leads. It may have nothing of its own that tells. A single mate that
sees it is no majority, and yet its sightings are all that is known of the place since. One misread is followed by sightings that fit.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from blackboard.opinion.gaussian.copying import Copyable

PATIENCE = 5  # ticks in a row in which what is told of a robot's place is left out, before its block is widened


@dataclass
class Strayed(Copyable):
    """Mutable; `on_sighting` and `confirm` in a tick, then `end_tick`."""

    _rows: dict[str, int] = field(
        default_factory=dict
    )  # robot -> ticks in a row in which all sightings contradicted its place
    _away: dict[str, float] = field(default_factory=dict)  # robot -> how far those of this tick put it (unit), at most
    _confirmed: set[str] = field(default_factory=set)  # of this tick

    def on_sighting(self, ends: Iterable[str], *, taken: bool, away: float) -> None:
        """Take a sighting of a mate: how far one of its ends has to be moved for it to fit (unit)."""
        for robot in ends:
            if taken:
                self._confirmed.add(robot)
            elif away:
                self._away[robot] = max(away, self._away.get(robot, 0.0))

    def confirm(self, robot: str) -> None:
        """Evidence of its own told a robot its place in this tick, and fitted."""
        self._confirmed.add(robot)

    def end_tick(self) -> dict[str, float]:
        """Who is contradicted for the `PATIENCE`th tick in a row, and how far away it may be (unit)."""
        for robot in self._confirmed:
            self._rows.pop(robot, None)
        for robot in self._away.keys() - self._confirmed:
            self._rows[robot] = self._rows.get(robot, 0) + 1
        strayed = {robot: self._away[robot] for robot, row in sorted(self._rows.items()) if row >= PATIENCE}
        for robot in strayed:
            del self._rows[robot]
        self._away, self._confirmed = {}, set()
        return strayed
