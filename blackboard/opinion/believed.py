"""How far a source is believed: the records of agreement, whom a majority contradicts, and the constants of both.

Two kinds of records are kept, because each loses what the other is for:

- *Verdicts*: the share of them that are against a source. One large distance weighs no more than any other. They say who counts
for
  less, or is left out: a source of opinions (`board/dissent.py`), a pair in a joint (`gaussian/trust.py`).
- *Distances*: squared ones, relative to what was claimed. They say how wide a claim is to be read, by their median
  (`board/learning.py`, `gaussian/innovations.py`), and by their sum whether two robots can both be honest (`gaussian/contacts.py`).
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

Pair = tuple[str, str]  # sorted

# --- what is remembered, of whom --------------------------------------------------------------------------------------------

SPACING = 1.0  # seconds of team time between two samples of a subject, or verdicts on a source: what follows sooner is hardly new
MAX_SOURCES = 64  # of a board, and on one subject; beyond that a record forgets who was silent the longest
MAX_SUBJECTS = 256  # of a board

# --- verdicts ---------------------------------------------------------------------------------------------------------------

REMEMBERED = 10.0  # verdicts that count, and independent distances of a contact
#: What the past counts beside a verdict: a mean with exponential weights (Roberts, Technometrics 1, 1959).
ACCUSED = 1 - 1 / REMEMBERED
REDEEMED = 0.97  # the same beside a second that speaks for a source: half of a full share is gone after 23 s
REDEEMED_PAIR = 0.96  # the same beside a verdict for a pair that contradicts: from all against it takes 17 until it counts as agreeing
UNMET = 60.0  # seconds without a verdict after which a contradiction of two robots is forgotten: one may be gone
FIRM = 5  # verdicts before they count: coins would fall five times on one side in 3 % of cases
FEWEST = 2  # who must contradict a robot: of two that contradict each other it is not known which is right
LEAST_WEIGHT = 0.01  # of an opinion: its sigmas are then ten times as wide

# --- distances --------------------------------------------------------------------------------------------------------------

WINDOW = 60  # of a robot's evidence: of so many exponential numbers the median is known within 19 % (one sigma, 1 / (ln 2 sqrt n))
ENOUGH = 20  # before it counts: within 32 %
PAIR_WINDOW = 50  # of a pair of opinions, within 20 %; those of eight robots fill the 12 kB of a Memory
MOST_NOISE = 100.0  # the largest factor of a claimed variance: sigmas are then ten times as wide


@dataclass(frozen=True)
class Verdicts:
    """The verdicts on a source: the share against it, the mean distance (sigmas), the newest counting most, and their number."""

    share: float = 0.0
    number: int = 0
    sigmas: float = 0.0

    def plus(self, against: bool, keep: float = ACCUSED, sigmas: float = 0.0) -> "Verdicts":
        """With one more, beside which `keep` of the past counts; at first the plain mean."""
        keep = min(keep, self.number / (self.number + 1))
        share, far = keep * self.share + (1 - keep) * against, keep * self.sigmas + (1 - keep) * sigmas
        return Verdicts(share, self.number + 1, far)

    @property
    def against(self) -> bool:
        """Whether most verdicts are against the source."""
        return self.share > 0.5

    @property
    def firm(self) -> bool:
        """Whether there are enough verdicts to act on."""
        return self.number >= FIRM


def is_due(time: float, before: float) -> bool:
    """Whether a sample at a team time is new after the one before, both in seconds."""
    return abs(time - before) >= SPACING * (1 - 1e-6)


def silent_longest(heard: Mapping[str, float]) -> list[str]:
    """Who is to be forgotten, of those who were heard at these times, beyond MAX_SOURCES."""
    return sorted(heard, key=lambda name: (-heard[name], name))[MAX_SOURCES:]


# --- whom a majority contradicts --------------------------------------------------------------------------------------------


def accusers(pairs: Mapping[Pair, bool], out: Collection[str]) -> tuple[dict[str, int], dict[str, set[str]]]:
    """Of everybody in pairs without those who are `out`: by how many more it is contradicted than confirmed, and by whom.

    A pair is True where the two contradict each other.
    """
    excess, by = defaultdict[str, int](int), defaultdict[str, set[str]](set)
    for pair, contradicts in pairs.items():
        if out and not set(pair).isdisjoint(out):
            continue
        for one, other in (pair, pair[::-1]):
            excess[one] += 1 if contradicts else -1
            if contradicts:
                by[one].add(other)
    return excess, by


def camps_of(names: Collection[str], agreeing: Iterable[Pair]) -> list[frozenset[str]]:
    """The largest groups of names that are connected by pairs that agree, where there are two or more of one size, at least 2."""
    group = {name: frozenset({name}) for name in names}
    for one, other in agreeing:
        if one in group and other in group and group[one] is not group[other]:
            joined = group[one] | group[other]
            group |= dict.fromkeys(joined, joined)
    groups = sorted(set(group.values()), key=lambda members: (-len(members), sorted(members)))
    camps = [members for members in groups if len(members) == len(groups[0]) > 1]
    return camps if len(camps) > 1 else []
