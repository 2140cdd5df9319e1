"""The bench: what runs of a recorded team were worth, robot by robot, beside what the robots believed alone. Pure.

Everything is computed from the samples that the referee judged (`blackboard.judge.samples`), by the definitions in `DEFINITIONS`.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blackboard.judge.intervals import Estimate, share_of_blocks
from blackboard.judge.samples import Sample, held_by
from blackboard.lab.comparison import IDEAL
from blackboard.opinion.scores import LEVELS, errors
from blackboard.process.columns import columns, markdown_table

FUSIONS = ("opinions", "joint")
RUNS = (*FUSIONS, IDEAL)  # of a protocol
TEAM = "team"
OBJECTS = "objects"
SOLO = {"opinions": "solo", "joint": "solo (joint)"}  # fusion -> the name of what its robots believe alone

BLOCK = 30.0  # seconds: what happens in blocks that are not neighbours is taken as independent
FOUND, HOLD = 0.5, 10.0  # metres, seconds: a robot is localised once its error stays below, for so long
GAP = 2.0  # seconds: the longest time between two judged samples that follow each other
NO_LANDMARK = 5.0  # seconds without a landmark sighting: after that a robot has no landmark access

DEFINITIONS = (
    "solo: what a robot believes on its own readings, on grids where boards pool opinions; solo (joint): by its Gaussian filter,"
    " where boards keep a joint; opinions, joint: what the team agreed on, by [board] fusion; ideal: what one"
    " extended Kalman filter believes that has the readings of all robots, but for sightings without a name. All on the same samples:"
    " each robot at each whole second.",
    "50/90/95 %: share of samples whose highest-density region of that mass holds the truth (the cells on its border count in part,"
    " as far as the mass needs them), with a 95 % Wilson interval. It"
    f" assumes that blocks of {BLOCK:g} s of the whole team share errors with their neighbours at most, and nothing about samples in"
    " a block: it counts as many independent samples as would make a share spread like the blocks' shares, and one for each block"
    " where these are all 0 or all 1.",
    f"found: first time (s) from which the error stays below {FOUND:g} m for {HOLD:g} s on end; the team's is its last robot's.",
    "RMSE -lm: over the samples without landmark access, that is without an allowed landmark sighting in the last"
    f" {NO_LANDMARK:g} s; in brackets their share of all.",
    "log score: mean log-probability of the true cell, nats; area: median area of the 95 % region.",
)


@dataclass(frozen=True)
class Run:
    """One run of a protocol: its samples, and the world's scorecard where a team ran."""

    protocol: str
    fusion: str  # one of RUNS
    samples: Sequence[Sample]
    card: Mapping[str, Any] | None  # None: of the ideal, which is no team
    asked_ticks: int
    recording: str  # its folder
    start: float | None  # Unix time; None: the first second that all files cover

    @property
    def complete(self) -> bool:
        """Whether it reached its last tick."""
        return self.card is None or bool(self.card["ticks"] == self.asked_ticks)


def coverage(samples: Sequence[Sample], level: int) -> Estimate:
    """The share of samples whose `level` % region holds the truth, with its interval (DEFINITIONS)."""
    _, block = np.unique([block_of(sample.time) for sample in samples], return_inverse=True)
    return share_of_blocks(np.bincount(block, weights=held_by(samples, level)), np.bincount(block))


def block_of(time: float) -> int:
    """The number of the block (k BLOCK, (k + 1) BLOCK] that a time is in: samples are about the time that led to them."""
    return math.ceil(time / BLOCK) - 1


def localised_at(samples: Sequence[Sample]) -> float | None:
    """The first time from which one robot's error stays below FOUND for HOLD seconds on end; None: never.

    `samples` are in order of time. After more than GAP seconds without a judged sample the count begins anew.
    """
    since = before = None
    for sample in samples:
        if sample.error >= FOUND:
            since = None
        elif since is None or (before is not None and sample.time - before > GAP):
            since = sample.time
        before = sample.time
        if since is not None and sample.time - since >= HOLD:
            return since
    return None


def measure(samples: Sequence[Sample]) -> dict[str, Any]:
    """Every number of one robot at one level, or of several robots together, from at least one sample."""
    by_robot: dict[str, list[Sample]] = {}
    for sample in samples:
        by_robot.setdefault(sample.robot, []).append(sample)
    localised = [localised_at(one) for one in by_robot.values()]
    starved = [sample.error for sample in samples if sample.landmark_age >= NO_LANDMARK]
    return {
        "n": len(samples),
        **errors([sample.error for sample in samples]),
        "coverage": {str(level): vars(coverage(samples, level)) for level in LEVELS},
        "log_score": float(np.mean([sample.log_score for sample in samples])),
        "area": float(np.median([sample.area for sample in samples])),
        "localised_s": None if None in localised else max(time for time in localised if time is not None),
        "without_landmark": {"n": len(starved), "rmse": errors(starved)["rmse"] if starved else None},
    }


def way_of(fusion: str, level: str) -> str:
    """The way (DEFINITIONS) that a sample of a run with this fusion comes from, by the sample's level."""
    return SOLO[fusion] if level == "solo" else fusion


def own_places(run: Run) -> Iterator[tuple[str, Sample]]:
    """The samples of a run that are about the robots' own places, with the way that they come from (DEFINITIONS)."""
    for sample in run.samples:
        if sample.subject == f"robot/{sample.robot}" and sample.level != "consensus":
            yield way_of(run.fusion, sample.level), sample


def objects(run: Run) -> Iterator[tuple[str, Sample]]:
    """The samples of a run that are about objects, in the same way; what a sub-team agreed on counts once, not for each robot."""
    once = set()
    for sample in run.samples:
        if not sample.subject.startswith("object/") or sample.level == "consensus":
            continue
        name = (run.protocol, sample.tick, sample.subject, sample.sub_team)
        if sample.level == "solo":
            yield SOLO[run.fusion], sample
        elif name not in once:
            once.add(name)
            yield run.fusion, sample


def together(name: str, runs: Sequence[Run]) -> Run:
    """Runs of several protocols with one fusion, at least one, under the name of their family."""
    first, cards = runs[0], {run.protocol: run.card for run in runs if run.card is not None}
    card = first.card and {
        **first.card,
        "verdict": "PASS" if all(card["verdict"] == "PASS" for card in cards.values()) else "FAIL",
        "reasons": [f"{protocol}: {reason}" for protocol, card in cards.items() for reason in card["reasons"]],
        "ticks": sum(card["ticks"] for card in cards.values()),
        "wall_s": sum(card["wall_s"] for card in cards.values()),
    }
    samples = [sample for run in runs for sample in run.samples]
    return Run(name, first.fusion, samples, card, sum(run.asked_ticks for run in runs), first.recording, first.start)


def ways(runs: Sequence[Run], about: Callable[[Run], Iterator[tuple[str, Sample]]]) -> dict[str, list[Sample]]:
    """Of the runs of one protocol: each way, with its samples."""
    ways: dict[str, list[Sample]] = {}
    for run in runs:
        for way, sample in about(run):
            ways.setdefault(way, []).append(sample)
    return ways


def report(runs: Sequence[Run]) -> dict[str, Any]:
    """All numbers of some runs, at least one: by protocol how each run ended, and by robot and way what `measure` finds.

    The team comes first, objects last. ValueError: the runs are of several recordings, or begin at different times.
    """
    ((recording, start),) = {(run.recording, run.start) for run in runs}
    protocols: dict[str, Any] = {}
    for name in dict.fromkeys(run.protocol for run in runs):
        mine = [run for run in runs if run.protocol == name]
        scores: dict[str, dict[str, Any]] = {}
        for way, samples in ways(mine, own_places).items():
            robots = sorted({sample.robot for sample in samples})
            for who in (TEAM, *robots):
                part = [sample for sample in samples if who in (TEAM, sample.robot)]
                scores.setdefault(who, {})[way] = measure(part)
        for way, samples in ways(mine, objects).items():
            scores.setdefault(OBJECTS, {})[way] = measure(samples)
        endings = {run.fusion: _ending(run.card) for run in mine if run.card is not None}
        protocols[name] = {"runs": endings, "scores": scores}
    return {"recording": recording, "start": start, "definitions": list(DEFINITIONS), "protocols": protocols}


def _ending(card: Mapping[str, Any]) -> dict[str, Any]:
    kept = {key: card[key] for key in ("verdict", "reasons", "hash", "ticks", "wall_s", "missing")}
    return {**kept, "refused": card["messages"]["refused"]}


# --- the tables ------------------------------------------------------------------------------------------------------

HEADER = ("protocol", "who", "way", "n", "RMSE", "mean", "p95", "max",
          *(f"{level} %" for level in LEVELS), "log score", "area", "found", "RMSE -lm")  # fmt: skip


def lines(table: Mapping[str, Any]) -> Iterator[tuple[str, str, str, Mapping[str, Any]]]:
    """Every line of a report's table: protocol, who, way, and what `measure` found."""
    for protocol, one in table["protocols"].items():
        for who, by_way in one["scores"].items():
            for way, s in by_way.items():
                yield protocol, who, way, s


def records(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A report as flat rows for a machine: every number in a column of its own, None where there is none."""
    return [
        {"protocol": protocol, "who": who, "way": way}
        | {key: value for key, value in s.items() if key not in ("coverage", "without_landmark")}
        | {f"coverage_{level}_{key}": v for level, c in s["coverage"].items() for key, v in c.items()}
        | {f"without_landmark_{key}": value for key, value in s["without_landmark"].items()}
        for protocol, who, way, s in lines(table)
    ]


def rows(table: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """A report as lines of text cells under HEADER, for people."""
    return [(protocol, who, way, *_cells(s)) for protocol, who, way, s in lines(table)]


def _cells(s: Mapping[str, Any]) -> Iterator[str]:
    yield str(s["n"])
    yield from (f"{s[name]:.3f}" for name in ("rmse", "mean", "p95", "max"))
    yield from (f"{c['value']:.3f} ({c['low']:.2f} {c['high']:.2f})" for c in s["coverage"].values())
    yield from (f"{s['log_score']:.2f}", f"{s['area']:.2f}")
    yield "never" if s["localised_s"] is None else f"{s['localised_s']:g} s"
    starved = s["without_landmark"]
    yield f"{starved['rmse']:.3f} ({100 * starved['n'] / s['n']:.0f} %)" if starved["n"] else "-"


def markdown(table: Mapping[str, Any]) -> str:
    """A report as a Markdown table, the definitions below it."""
    return "\n".join([*markdown_table([HEADER, *rows(table)]), "", *(f"- {line}" for line in DEFINITIONS)]) + "\n"


def text(table: Mapping[str, Any]) -> str:
    """A report as text: a table for each protocol with how its runs ended, then the definitions."""
    since = "its first second" if table["start"] is None else f"{table['start']:.1f}"
    out = [f"{table['recording']} from {since} on", ""]
    for protocol, one in table["protocols"].items():
        runs = one["runs"].items()
        ended = (f"{fusion}: {run['verdict']}, {run['ticks']} ticks in {run['wall_s']:.0f} s" for fusion, run in runs)
        out.append(f"{protocol}  ({'; '.join(ended)})")
        mine = [row[1:] for row in rows(table) if row[0] == protocol]
        out += columns([HEADER[1:], *mine], numbers=range(2, len(HEADER)))
        failed = ((fusion, run["reasons"]) for fusion, run in runs if run["verdict"] != "PASS")
        out += [f"  {fusion}: {reason}" for fusion, reasons in failed for reason in reasons]
        out.append("")
    return "\n".join([*out, *DEFINITIONS])
