"""Who is believed: what the gate said of each pair lately, and whom the majority of its partners contradicts.

The joint alone cannot tell which end of a contradiction is wrong. A robot that most of the partners who saw it, or whom it
saw, contradict is left out (as coalitions leave out the smaller one), and an object that most observers contradict was
entered at a wrong place.
"""

from __future__ import annotations

from dataclasses import dataclass, field

MEMORY = 0.9  # of the share of verdicts that were against a pair; the newest counts a tenth
FIRM = 5  # verdicts before a pair counts
FEWEST = 2  # partners that must contradict


@dataclass
class Trust:
    """Mutable; `judge` once per relative belief, in the order in which they are settled."""

    _pairs: dict[tuple[str, str], tuple[float, int]] = field(default_factory=dict)  # share against, number of verdicts

    def judge(self, observer: str, subject: str, agrees: bool) -> None:
        """Take a verdict of the gate on what an observer says of a subject."""
        against, number = self._pairs.get((observer, subject), (0.0, 0))
        keep = min(MEMORY, number / (number + 1))  # the plain mean at first
        self._pairs[observer, subject] = keep * against + (1 - keep) * (not agrees), number + 1

    def left_out(self) -> frozenset[str]:
        """The robots that more partners contradict than confirm, at least `FEWEST`.

        The most contradicted one goes first, and what concerned it no longer counts: else a liar in a small team would
        take honest partners with it.
        """
        out: set[str] = set()
        while True:
            votes: dict[str, list[bool]] = {}
            for (a, b), contradicts in self._contradictions().items():
                if a not in out and b not in out:
                    votes.setdefault(a, []).append(contradicts)
                    votes.setdefault(b, []).append(contradicts)
            accused = [(2 * sum(v) - len(v), name) for name, v in votes.items() if sum(v) >= FEWEST]
            excess, name = max(accused, default=(0, ""))
            if excess <= 0:
                return frozenset(out)
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
