"""Of which objects the joint takes sightings. Each robot has its share of a largest number. Pure."""

from dataclasses import replace

from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.evidence import Evidence

# In the joint that one robot has seen, and as many that several have; others are left to the pooled opinions.
MAX_OBJECTS = 64


class ObjectRoom:
    """Mutable: the objects of which the joint takes sightings.

    Each robot has its share of `MAX_OBJECTS` for those that no other robot has seen: of one that sees more the newest are
    left out. Those that several have seen have as much room again. Who has not seen an object for as long as it is kept has
    not seen it.
    """

    def __init__(self, kept: float) -> None:
        """`kept`: seconds for which an object is kept without a sighting."""
        self._kept = kept
        #: Of the objects that are taken, the first first: who saw it, and when last (team time, s).
        self._objects: dict[str, dict[str, float]] = {}

    def bounded(self, evidence: Evidence, robots: int) -> Evidence:
        """Evidence without sightings of more objects than a robot may have that shares the room with `robots`, itself included."""
        robot, time = evidence.robot, evidence.time
        self._forget(time - self._kept)
        share = max(1, MAX_OBJECTS // max(1, robots))
        alone = [name for name, seen in self._objects.items() if set(seen) == {robot}]
        known = set(alone[:share]) | {name for name in self._objects if name not in alone}
        room = share - min(share, len(alone))
        others = {
            relative.subject
            for relative in evidence.relatives
            if relative.subject.startswith("robot/") or is_class(relative.subject)
        }
        sighted = sorted({relative.subject for relative in evidence.relatives} - others)
        known |= set([name for name in sighted if name not in self._objects][:room])
        for name in sighted:
            if name in known:
                self._objects.setdefault(name, {})[robot] = time
        several = [name for name, seen in self._objects.items() if len(seen) > 1]
        known -= set(several[MAX_OBJECTS:])
        return replace(
            evidence, relatives=tuple(relative for relative in evidence.relatives if relative.subject in known | others)
        )

    def _forget(self, oldest: float) -> None:
        """Forget what was seen before a team time (s)."""
        self._objects = {
            name: young
            for name, seen in self._objects.items()
            if (young := {observer: at for observer, at in seen.items() if at >= oldest})
        }
