"""Robots that mates see elsewhere, sighting after sighting, while nothing else says where they are.

Whose wheels slip, or who is carried, is not where its odometry leads. It may have nothing of its own that tells. Mates that see it
in different ticks are no coalition of one tick, and yet they agree that it is not there. One mate alone may lie, or be astray itself.
It is believed in a team of three only, where no third robot can tell. One misread is followed by sightings that fit.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from blackboard.opinion.gaussian.copying import Copyable

PATIENCE = 5  # ticks in a row in which what is told of a robot's place is left out, before its block is widened
OUTVOTED = 4  # robots in a team, at least, in which one mate alone is not enough
WITNESSES = 2  # so many mates, at least, in so many of these ticks each: one may lie, and a misread is no witness


@dataclass
class Strayed(Copyable):
    """Mutable; `on_sighting` and `confirm` in a tick, then `end_tick`."""

    #: Robot -> ticks in a row in which all sightings contradicted its place.
    _rows: dict[str, int] = field(default_factory=dict)
    #: Robot -> mate at the other end -> in how many of them.
    _mates: dict[str, Counter[str]] = field(default_factory=dict)
    #: Robot -> mate -> how far those of this tick put the robot away (unit), at most.
    _away: dict[str, dict[str, float]] = field(default_factory=dict)
    _confirmed: set[str] = field(default_factory=set)  # of this tick

    def on_sighting(self, observer: str, subject: str, *, taken: bool, away: float) -> None:
        """Take a sighting of a mate: how far one of its ends has to be moved for it to fit (unit)."""
        for robot, mate in ((observer, subject), (subject, observer)):
            if taken:
                self._confirmed.add(robot)
            elif away:
                by_mate = self._away.setdefault(robot, {})
                by_mate[mate] = max(away, by_mate.get(mate, 0.0))

    def confirm(self, robot: str) -> None:
        """Evidence of its own told a robot its place in this tick, and fitted."""
        self._confirmed.add(robot)

    def end_tick(self, robots: int) -> Mapping[str, float]:
        """Who is contradicted for the `PATIENCE`th tick in a row, or later, by enough mates, and how far away it may be (unit).

        There are so many `robots` in the team.
        """
        enough = WITNESSES if robots >= OUTVOTED else 1
        for robot in self._confirmed:
            self._forget(robot)
        strayed = {}
        for robot in sorted(self._away.keys() - self._confirmed):
            self._rows[robot] = self._rows.get(robot, 0) + 1
            mates = self._mates.setdefault(robot, Counter())
            mates.update(self._away[robot].keys())
            if self._rows[robot] >= PATIENCE and sum(ticks >= WITNESSES for ticks in mates.values()) >= enough:
                strayed[robot] = max(self._away[robot].values())
                self._forget(robot)
        self._away, self._confirmed = {}, set()
        return strayed

    def _forget(self, robot: str) -> None:
        self._rows.pop(robot, None)
        self._mates.pop(robot, None)
