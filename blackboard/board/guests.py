"""Robots that the scenario does not name: whether a board hears them, and how much they count until a named robot has seen
them. Pure.

A name costs nothing: a process that may report under any name could have as many votes as it likes. A body cannot be invented:
a guest is confirmed once a robot that the scenario names has seen it where it says it is. From then on it counts as everybody.
"""

from collections.abc import Collection, Mapping

from blackboard.board.dissent import distance
from blackboard.board.entries import Entry
from blackboard.config import TeamSection
from blackboard.errors import Refused
from blackboard.opinion.chi_squared import DOUBT, quantile
from blackboard.opinion.provenance import Opinion

TURN = 5.0  # seconds of team time for which one unconfirmed guest counts, before the next one does
CURE = 'name it in [team] sub_teams, or set [team] guests = "vote"'
WAITS = "a guest that nobody named has seen yet; these take turns"


class Guests:
    """The guests of one board. Mutable; the order in which subjects are looked at changes nothing but the tick of a confirmation."""

    def __init__(self, team: TeamSection | None = None) -> None:
        """`team` is the section of the scenario that names the robots; without it there are no guests."""
        self._team = team or TeamSection()
        self._confirmed: set[str] = set()

    def may_report(self, robot: str) -> bool:
        """Whether a board hears what a robot reports."""
        return self._team.guests == "vote" or not self._team.is_guest(robot)

    def check(self, robot: str) -> None:
        """Refused: "guest", a robot that the scenario does not name and that may not report."""
        if not self.may_report(robot):
            raise Refused("guest", f"{robot} is not named in the scenario: {CURE}")

    def waits(self, robot: str) -> bool:
        """Whether it is a guest that no named robot has confirmed."""
        return self._team.is_guest(robot) and robot not in self._confirmed

    def aside(self, sources: Collection[str], now: float) -> set[str]:
        """Who does not count now, of those who speak of one thing: of all guests that wait one does, each for a `TURN`.

        Where no other robot reports on it, all of them count.
        """
        waiting = sorted(filter(self.waits, sources))
        if len(waiting) == len(sources):
            return set()
        return set(waiting) - {waiting[int(now // TURN) % len(waiting)]} if waiting else set()

    def hear_place(self, robot: str, entries: Mapping[str, Entry]) -> None:
        """Take what is said of a robot's place, by source: a named robot's own evidence that agrees with a guest's confirms it."""
        if not self.waits(robot) or (own := _firsthand(entries, robot)) is None or own.bell is None:
            return
        gate = quantile(DOUBT, own.belief.grid.ndim)
        for source in entries:
            seen = None if self._team.is_guest(source) else _firsthand(entries, source)
            if seen is not None and seen.bell is not None and distance(own.bell, seen.bell) <= gate:
                self._confirmed.add(robot)

    def forget(self, kept: Collection[str]) -> None:
        """Keep only these confirmations: a later process of the same name may be another robot."""
        self._confirmed.intersection_update(kept)


def _firsthand(entries: Mapping[str, Entry], source: str) -> Opinion | None:
    """What a source says by its own evidence alone."""
    opinions = entries[source].opinions if source in entries else ()
    return next((opinion for opinion in opinions if set(opinion.ancestors) == {source}), None)
