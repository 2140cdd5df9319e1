"""Robots that slipped or were carried: mates' sightings contradict, tick after tick, where the joint has them.

Without fixes and landmarks such a robot cannot know it. Mates that see it in different ticks form no coalition, which takes the
evidence of one tick (`coalitions.py`). So contradictions are counted over ticks, until a sighting or an increment of the robot fits.
One mate alone may lie, or be lost itself. It is enough in a team of three only, where no other robot can tell.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from blackboard.opinion.gaussian.copying import Copyable

#: Ticks in a row in which a robot's increments, or the sightings of it, are all left out. Then the covariance of its pose is widened.
PATIENCE = 5
OUTVOTED = 4  # robots in a team, at least, in which one mate alone is not enough
WITNESSES = 2  # so many mates, at least, in so many of these ticks each: one may lie, and a misread is no witness


@dataclass
class Strayed(Copyable):
    """Mutable; `contradict` and `confirm` in a tick, then `end_tick`."""

    #: Robot -> ticks in a row in which sightings contradicted its place, and none fitted.
    _rows: dict[str, int] = field(default_factory=dict)
    #: Robot -> mate that saw it, or that it saw -> in how many of them.
    _mates: dict[str, Counter[str]] = field(default_factory=dict)
    #: Of this tick: robot -> mate -> how far the robot would have to be moved for their sightings to fit (unit), at most.
    _away: dict[str, dict[str, float]] = field(default_factory=dict)
    _confirmed: set[str] = field(default_factory=set)  # of this tick

    def contradict(self, observer: str, subject: str, away: float) -> None:
        """A sighting of a mate does not fit; it would if one of both were moved so far (unit)."""
        for robot, mate in ((observer, subject), (subject, observer)):
            by_mate = self._away.setdefault(robot, {})
            by_mate[mate] = max(away, by_mate.get(mate, 0.0))

    def confirm(self, *robots: str) -> None:
        """A sighting of two robots, or an increment of one, was taken: it fits where the joint has them."""
        self._confirmed.update(robots)

    def end_tick(self, robots: int) -> Mapping[str, float]:
        """Who has strayed, and how far at most (unit), in a team of so many `robots`."""
        enough = WITNESSES if robots >= OUTVOTED else 1
        for robot in self._confirmed:
            self.forget(robot)
        strayed = {}
        for robot in sorted(self._away.keys() - self._confirmed):
            self._rows[robot] = self._rows.get(robot, 0) + 1
            mates = self._mates.setdefault(robot, Counter())
            mates.update(self._away[robot].keys())
            if self._rows[robot] >= PATIENCE and sum(ticks >= WITNESSES for ticks in mates.values()) >= enough:
                strayed[robot] = max(self._away[robot].values())
                self.forget(robot)
        self._away, self._confirmed = {}, set()
        return strayed

    def forget(self, robot: str) -> None:
        """Its place is another one from now on."""
        self._rows.pop(robot, None)
        self._mates.pop(robot, None)
