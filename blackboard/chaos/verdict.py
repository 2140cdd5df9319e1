"""What a soak must show, line by line. Pure."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from blackboard.chaos.gauges import Gauge
from blackboard.chaos.sight import Look
from blackboard.process.columns import columns

LIFE = 120.0  # seconds that a process must have lived to be judged by its memory
WARM = 60.0  # seconds at the beginning of a life that are left out: caches fill, and the allocator finds its size
#: MB that a process may have more in the second half of its life, however long that is: the allocator takes memory in steps, and
#: what is bounded fills up once (the world's distances, by 0.8). A limit that grew with time would let a leak pass.
GROWTH = 1.5
MORE = 2  # threads or descriptors by which two halves of a life may differ: a connection that ends while another one begins
AGAIN = 5.0  # seconds until a surviving subject is settled again
# Messages that may be on their way to the observer when a status is: it goes before reports and consensuses.
BEHIND = 50
HEARD = 0.9  # share of the soak in which the observer must have looked


@dataclass(frozen=True)
class Finding:
    """One thing that must be true, and what was found."""

    holds: bool
    what: str
    found: str


@dataclass(frozen=True)
class Sent:
    """What a process said that it had sent, and what the observer had of it, when its status came."""

    sent: int
    seen: int
    dropped: int  # by its own inbox


def lives(gauges: Iterable[Gauge]) -> dict[tuple[str, int], list[Gauge]]:
    """The gauges of each process from start to end, without the first `WARM` seconds; those that lived for `LIFE` seconds."""
    by_process = defaultdict[tuple[str, int], list[Gauge]](list)
    for gauge in gauges:
        by_process[gauge.name, gauge.pid].append(gauge)
    long = {who: mine for who, mine in by_process.items() if mine[-1].at - mine[0].at >= LIFE}
    return {who: [g for g in mine if g.at - mine[0].at >= WARM] for who, mine in long.items()}


def growth(mine: Sequence[Gauge]) -> tuple[float, float]:
    """How many MB more the second half of a life has than the first, by their medians, and how many minutes lie between these."""
    return _more(mine, "memory"), _more(mine, "at") / 60


def _more(mine: Sequence[Gauge], what: str) -> float:
    """How much more the second half of a life has of something than the first, by their medians."""
    half = len(mine) // 2
    first, second = (median(getattr(gauge, what) for gauge in part) for part in (mine[:half], mine[half:]))
    return float(second - first)


def longest(looks: Sequence[Look]) -> tuple[float, str]:
    """The longest time that one belief was not settled though all whom it needs were there, and whose it was."""
    since: dict[tuple[str, str], float] = {}
    worst, whose = 0.0, "-"
    for look in looks:
        since = {pair: since.get(pair, look.at) for pair in look.missing}
        for (sub_team, subject), begin in since.items():
            if look.at - begin > worst:
                worst, whose = look.at - begin, f"{subject} in {sub_team} at {look.team_time:.0f} s"
    return worst, whose


def verdict(
    gauges: Sequence[Gauge], looks: Sequence[Look], sent: Mapping[str, Sequence[Sent]], seconds: float
) -> list[Finding]:
    """The lines of a soak of so many seconds.

    `sent` has for each quiet time of a process, between two troubles of its own, its statuses in order.
    """
    judged = lives(gauges)
    lines = [_memory(judged, name) for name in sorted({_kind(name) for name, _ in judged})]
    if not judged:
        lines.append(Finding(False, f"some process lives for {LIFE:g} s", "none did: make the soak longer"))
    lines += [_flat(judged, "threads"), _flat(judged, "descriptors"), _again(looks, seconds), *_counted(sent)]
    return lines


def _memory(judged: Mapping[tuple[str, int], Sequence[Gauge]], kind: str) -> Finding:
    mine = [gauges for (name, _), gauges in judged.items() if _kind(name) == kind]
    (more, minutes), worst = max((growth(gauges), gauges[0].name) for gauges in mine)
    most = max(gauge.memory for gauges in mine for gauge in gauges)
    leak = GROWTH / max(growth(gauges)[1] for gauges in mine)  # of the longest life
    text = f"{worst} {more:+.1f} MB in {minutes:.1f} minutes, at most {most:.0f} MB; a leak of {leak:.1f} MB a minute would show"
    return Finding(
        more <= GROWTH, f"memory flat, {kind}: at most {GROWTH:g} MB more in the second half of a life", text
    )


def _flat(judged: Mapping[tuple[str, int], Sequence[Gauge]], what: str) -> Finding:
    grown: dict[str, float] = {}
    for (name, _), mine in judged.items():
        grown[name] = max(grown.get(name, -99.0), _more(mine, what))
    worst = max(grown, key=lambda name: grown[name], default="-")
    return Finding(
        bool(grown) and grown[worst] <= MORE,
        f"{what} flat: at most {MORE} more in the second half of a life",
        f"{worst} {grown.get(worst, 0):+.0f}",
    )


def _again(looks: Sequence[Look], seconds: float) -> Finding:
    worst, whose = longest(looks)
    seen = (looks[-1].at - looks[0].at) / seconds if looks else 0.0
    text = f"longest {worst:.1f} s, {whose}" if seen >= HEARD else f"looked on for {seen:.0%} of the time only"
    return Finding(worst <= AGAIN and seen >= HEARD, f"every surviving subject settled again within {AGAIN:g} s", text)


def _counted(sent: Mapping[str, Sequence[Sent]]) -> list[Finding]:
    """Between the first and the last status of each quiet time: what it sent, the observer had; and no inbox overflowed."""
    said = seen = dropped = 0
    lost: dict[str, int] = {}
    for quiet, statuses in sent.items():
        first, last = statuses[0], statuses[-1]
        said, seen = said + last.sent - first.sent, seen + last.seen - first.seen
        dropped += last.dropped
        lost[quiet] = (last.sent - first.sent) - (last.seen - first.seen)
    worst = max(lost, key=lambda quiet: abs(lost[quiet]), default="-")
    return [
        Finding(
            bool(lost) and abs(lost[worst]) <= BEHIND,
            f"counters add up: between troubles all that was sent came, but for {BEHIND}",
            f"{said} sent, {seen} received; most apart {worst} by {lost.get(worst, 0)}",
        ),
        Finding(dropped == 0, "no inbox overflowed", f"{dropped} dropped"),
    ]


def _kind(name: str) -> str:
    """Robots, and boards, are judged together."""
    first = name.partition("-")[0]
    return {"router": "router", "board": "boards", "world": "world"}.get(first, "robots")


def text(lines: Sequence[Finding]) -> str:
    return "\n".join(columns([("yes" if line.holds else "NO", line.what, line.found) for line in lines]))
