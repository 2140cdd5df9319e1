"""Who is believed: what the gate said of each pair lately, and whom the majority of its partners contradicts.

The joint alone cannot tell which end of a contradiction is wrong. A robot that most of the partners who saw it, or whom it
saw, contradict is left out (as coalitions leave out the smaller one), and an object that most observers contradict was
entered at a wrong place. Where two equally large camps contradict each other, neither is left out.
"""

from collections.abc import Collection
from dataclasses import dataclass, field

from blackboard.opinion.believed import ACCUSED, FEWEST, REDEEMED_PAIR, UNMET, Pair, Verdicts, accusers, camps_of
from blackboard.opinion.gaussian.copying import Copyable


@dataclass
class Trust(Copyable):
    """Mutable; `pass_time` once per tick, `judge` once per relative belief, in the order in which they are settled."""

    _pairs: dict[tuple[str, str], Verdicts] = field(default_factory=dict)  # observer and subject
    _ages: dict[tuple[str, str], float] = field(default_factory=dict)  # of pairs of robots: seconds since a verdict

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass. Verdicts against a robot are forgotten after `UNMET` without a new one: its accuser may be gone."""
        self._ages = {pair: age + dt for pair, age in self._ages.items() if pair in self._pairs}
        for pair in [pair for pair, age in self._ages.items() if age > UNMET and self._pairs[pair].against]:
            del self._pairs[pair], self._ages[pair]

    def judge(self, observer: str, subject: str, agrees: bool) -> None:
        """Take a verdict of the gate on what an observer says of a subject."""
        before = self._pairs.get((observer, subject), Verdicts())
        slow = agrees and before.firm and before.against
        self._pairs[observer, subject] = before.plus(not agrees, REDEEMED_PAIR if slow else ACCUSED)
        if subject.startswith("robot/"):
            self._ages[observer, subject] = 0.0

    def observers(self, subject: str) -> list[str]:
        """Whose sightings of a subject mostly agreed, since it was forgotten."""
        return [
            observer for (observer, seen), verdicts in self._pairs.items() if seen == subject and not verdicts.against
        ]

    def by_subject(self) -> dict[str, set[str]]:
        """`observers` of every subject."""
        observers: dict[str, set[str]] = {}
        for (observer, subject), verdicts in self._pairs.items():
            if not verdicts.against:
                observers.setdefault(subject, set()).add(observer)
        return observers

    def judged(self, observer: str) -> set[str]:
        """What an observer was judged by, whether its sightings agreed or not."""
        return {subject for one, subject in self._pairs if one == observer}

    def left_out(self) -> frozenset[str]:
        """The robots that more partners contradict than confirm, at least `FEWEST`.

        The most contradicted one goes first, and what concerned it no longer counts: else a liar in a small team would
        take honest partners with it. Nobody of opposed camps is left out.
        """
        return self._sentence()[0]

    def camps(self) -> list[frozenset[str]]:
        """The equally large groups of robots that contradict each other, so that nobody can tell who is right."""
        return self._sentence()[1]

    def _sentence(self) -> tuple[frozenset[str], list[frozenset[str]]]:
        out: set[str] = set()
        contradictions = self._contradictions()
        while True:
            excess, by = accusers(contradictions, out)
            worst = max(((excess[name], name) for name in by if len(by[name]) >= FEWEST), default=(0, ""))
            if worst[0] <= 0:
                return frozenset(out), []
            camps = camps_of(excess, [pair for pair, contradicts in contradictions.items() if not contradicts])
            if any(worst[1] in camp for camp in camps) and _opposed(camps, contradictions):
                return frozenset(out), camps
            out.add(worst[1])

    def misplaced(self, thing: str, unheard: Collection[str] = ()) -> bool:
        """Whether more of the observers of an object contradict its place than confirm it; who is left out or `unheard` does not."""
        out = self.left_out() | set(unheard)
        votes = [
            verdicts.against
            for (o, subject), verdicts in self._pairs.items()
            if subject == thing and o not in out and verdicts.number > 1
        ]
        return 2 * sum(votes) > len(votes) and sum(votes) >= min(FEWEST, max(1, len(votes)))

    def forget(self, subject: str) -> None:
        """Drop the verdicts on a subject and those on what it observed."""
        self._pairs = {pair: record for pair, record in self._pairs.items() if subject not in pair}

    def forget_pair(self, observer: str, subject: str) -> None:
        """Drop the verdicts on what an observer says of a subject."""
        self._pairs.pop((observer, subject), None)

    def _contradictions(self) -> dict[Pair, bool]:
        """For each two robots that were judged often enough, whether they contradict each other."""
        contradictions: dict[Pair, bool] = {}
        for (observer, subject), verdicts in self._pairs.items():
            if verdicts.firm and subject.startswith("robot/"):
                first, second = sorted((observer, subject))
                contradictions[first, second] = contradictions.get((first, second), False) or verdicts.against
        return contradictions


def _opposed(camps: list[frozenset[str]], contradictions: dict[Pair, bool]) -> bool:
    """Whether members of different camps contradict each other."""
    camp = {name: number for number, members in enumerate(camps) for name in members}
    return any(
        contradicts and a in camp and b in camp and camp[a] != camp[b] for (a, b), contradicts in contradictions.items()
    )
