"""Provenance: which opinions rest on different evidence, so that they may be multiplied.

Multiplying opinions is right only where they rest on different evidence. An opinion names its ancestors: all robots whose
information it contains. Opinions without a common ancestor are independent; all others may hold the same evidence twice.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from blackboard.opinion.belief import Belief
from blackboard.opinion.bell import bell
from blackboard.opinion.grid import Array

Ancestors = Mapping[str, float]  # robot -> until which team time (seconds) its information is contained


@dataclass(frozen=True, eq=False)
class Opinion:
    """A belief, who reported it, and whose information it contains; `age` in seconds of team time.

    `whole`: a sub-team's belief beside which the part stands that is to be multiplied.
    """

    source: str
    belief: Belief
    ancestors: Ancestors
    age: float = 0.0
    whole: bool = False

    @cached_property
    def bell(self) -> tuple[Array, Array] | None:
        """Mean and covariance of a belief that is shaped like a bell (`blackboard.opinion.bell`); None of others."""
        return bell(self.belief)


def split(opinions: Iterable[Opinion]) -> tuple[list[Opinion], list[Opinion]]:
    """The independent opinions, and the rest, which overlap with them.

    First what is no whole, fewest ancestors first (first-hand opinions), then by name: the choice does not depend on the order of
    arrival.
    """
    independent: list[Opinion] = []
    overlapping: list[Opinion] = []
    taken: set[str] = set()
    for opinion in sorted(opinions, key=lambda o: (o.whole, len(o.ancestors), o.source, sorted(o.ancestors))):
        if taken.isdisjoint(opinion.ancestors):
            independent.append(opinion)
            taken |= opinion.ancestors.keys()
        else:
            overlapping.append(opinion)
    return independent, overlapping


def union(all_ancestors: Iterable[Ancestors]) -> dict[str, float]:
    """The ancestors of several opinions, each until the latest time any of them names, sorted by name."""
    ages: dict[str, float] = {}
    for ancestors in all_ancestors:
        for name, until in ancestors.items():
            ages[name] = max(until, ages.get(name, until))
    return dict(sorted(ages.items()))
