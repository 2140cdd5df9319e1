"""Who is believed: what the gate said of each pair lately, and whom the majority of its partners contradicts.

The joint alone cannot tell which end of a contradiction is wrong. A robot that most of the partners who saw it, or whom it
saw, contradict is left out (as coalitions leave out the smaller one), and an object that most observers contradict was
entered at a wrong place. Where two equally large camps contradict each other, neither is left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

MEMORY = 0.9  # of the share of verdicts that were against a pair; the newest counts a tenth
SLOW = 0.96  # the same, of a verdict for a pair that contradicts: from all against it takes 17 until it counts as agreeing again
FIRM = 5  # verdicts before a pair counts
FEWEST = 2  # partners that must contradict


@dataclass
class Trust:
    """Mutable; `judge` once per relative belief, in the order in which they are settled."""

    _pairs: dict[tuple[str, str], tuple[float, int]] = field(default_factory=dict)  # share against, number of verdicts

    def copy(self) -> Trust:
        """The same, which may be changed without changing this one."""
        return Trust(dict(self._pairs))

    def judge(self, observer: str, subject: str, agrees: bool) -> None:
        """Take a verdict of the gate on what an observer says of a subject."""
        against, number = self._pairs.get((observer, subject), (0.0, 0))
        slow = agrees and number >= FIRM and against > 0.5
        keep = min(SLOW if slow else MEMORY, number / (number + 1))  # the plain mean at first
        self._pairs[observer, subject] = keep * against + (1 - keep) * (not agrees), number + 1

    def observers(self, subject: str) -> list[str]:
        """Whose sightings of a subject mostly agreed, since it was forgotten."""
        return [
            observer for (observer, seen), (against, _) in self._pairs.items() if seen == subject and against <= 0.5
        ]

    def by_subject(self) -> dict[str, set[str]]:
        """`observers` of every subject."""
        found: dict[str, set[str]] = {}
        for (observer, subject), (against, _) in self._pairs.items():
            if against <= 0.5:
                found.setdefault(subject, set()).add(observer)
        return found

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
            votes: dict[str, list[bool]] = {}
            for (a, b), contradicts in contradictions.items():
                if a not in out and b not in out:
                    votes.setdefault(a, []).append(contradicts)
                    votes.setdefault(b, []).append(contradicts)
            accused = [(2 * sum(v) - len(v), name) for name, v in votes.items() if sum(v) >= FEWEST]
            excess, name = max(accused, default=(0, ""))
            if excess <= 0:
                return frozenset(out), []
            camps = camps_of(votes, [pair for pair, contradicts in contradictions.items() if not contradicts])
            if any(name in camp for camp in camps) and _opposed(camps, contradictions):
                return frozenset(out), camps
            out.add(name)

    def misplaced(self, thing: str) -> bool:
        """Whether more of the observers of an object contradict its place than confirm it; those left out do not count."""
        out = self.left_out()
        votes = [
            s > 0.5 for (o, subject), (s, n) in self._pairs.items() if subject == thing and o not in out and n >= 2
        ]
        return 2 * sum(votes) > len(votes) and sum(votes) >= min(FEWEST, max(1, len(votes)))

    def forget(self, subject: str) -> None:
        """Drop the verdicts on a subject and those on what it observed."""
        self._pairs = {pair: record for pair, record in self._pairs.items() if subject not in pair}

    def _contradictions(self) -> dict[tuple[str, str], bool]:
        """For each two robots that were judged often enough, whether they contradict each other."""
        found: dict[tuple[str, str], bool] = {}
        for (observer, subject), (against, number) in self._pairs.items():
            if number >= FIRM and subject.startswith("robot/"):
                first, second = sorted((observer, subject))
                found[first, second] = found.get((first, second), False) or against > 0.5
        return found


def camps_of(names: Collection[str], agreeing: Iterable[tuple[str, str]]) -> list[frozenset[str]]:
    """The largest groups of names that are connected by pairs that agree, where there are two or more of one size, at least 2."""
    group = {name: frozenset({name}) for name in names}
    for one, other in agreeing:
        if one in group and other in group and group[one] is not group[other]:
            joined = group[one] | group[other]
            group |= dict.fromkeys(joined, joined)
    groups = sorted(set(group.values()), key=lambda it: (-len(it), sorted(it)))
    camps = [it for it in groups if len(it) == len(groups[0]) > 1]
    return camps if len(camps) > 1 else []


def _opposed(camps: list[frozenset[str]], contradictions: dict[tuple[str, str], bool]) -> bool:
    """Whether members of different camps contradict each other."""
    camp = {name: number for number, members in enumerate(camps) for name in members}
    return any(
        contradicts and a in camp and b in camp and camp[a] != camp[b] for (a, b), contradicts in contradictions.items()
    )
