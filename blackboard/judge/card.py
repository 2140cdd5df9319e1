"""The scorecard: what a run showed, as JSON (docs/design.md fixes its names) and as text for people."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from blackboard.judge.calibration import BLOCK, CONSISTENT, FEWEST, SHORT, kind
from blackboard.judge.forecasts import OUTSIDE
from blackboard.judge.intervals import Estimate
from blackboard.judge.referee import Judgement
from blackboard.judge.samples import LEVELS
from blackboard.opinion.scores import LEVELS as SHARES
from blackboard.process.columns import columns

WIDE = 0.5  # of an interval: whose share may be anything between 0.2 and 0.7 is not judged yet


COUNTED = ("sent", "received", "dropped", "late")


@dataclass(frozen=True)
class RunResult:
    """All that a scorecard needs of a run, live or recorded, that ended or was stopped."""

    judgement: Judgement
    stopped: str  # why not all ticks were done; empty if they were
    seed: int
    rule: str  # of [board]
    fusion: str  # of [board]
    mode: str  # "lockstep" or "realtime"
    protocol: str | None  # of the replay; None in a simulated world
    ticks: int
    tick_seconds: float  # of team time
    wall_seconds: float
    messages: Mapping[str, int]  # of the whole team: `COUNTED`
    refused: Mapping[str, int]  # of the whole team: reason -> messages and beliefs
    bytes: int  # of the whole team
    counters: Mapping[str, int]  # of the world alone


def scorecard(result: RunResult) -> dict[str, Any]:
    """The scorecard as JSON. Errors in `unit`, entropies and log scores in nats. A run that was stopped is a FAIL."""
    judgement = result.judgement
    reasons = (
        judgement.reasons if not result.stopped else [result.stopped, *([] if judgement.passed else judgement.reasons)]
    )
    return {
        "verdict": "PASS" if judgement.passed and not result.stopped else "FAIL",
        "reasons": reasons,
        "hash": judgement.hash,
        "seed": result.seed,
        "rule": result.rule,
        "ticks": result.ticks,
        "simulated_s": round(result.ticks * result.tick_seconds, 6),
        "wall_s": round(result.wall_seconds, 3),
        "messages": {**result.messages, "refused": dict(sorted(result.refused.items()))},
        "bytes": result.bytes,
        "scores": judgement.scores,
        "unit": judgement.unit,
        "protocol": result.protocol,
        "mode": result.mode,
        "fusion": result.fusion,
        "team_rmse": {level: judgement.scores["robots"][level]["rmse"] for level in LEVELS},
        "missing": judgement.missing,
        "counters": dict(sorted(result.counters.items())),
        **{name: getattr(judgement, name) for name in ("honesty", "motion", "lost", "tracks", "identities", "causes")},
    }


#: Name of a column, its unit ("": that of the errors), and what is better in it.
COLUMNS = (
    ("RMSE", "", "smaller"),
    ("p95", "", "smaller"),
    ("entropy", "nats", "smaller"),
    ("log score", "nats", "larger"),
    *((f"in {level} %", "share", f"{level / 100:g}") for level in SHARES),
)
SAME_PROCESSOR = "the same scenario and seed give the same hash on the same kind of processor only"
NOT_AGAIN = "waits ended before all had come (late), so the same scenario and seed may give another hash"


def text(card: dict[str, Any]) -> str:
    """The scorecard as text: a table of levels, whether the beliefs are honest, then the verdict, its reasons and their causes."""
    rows: list[tuple[str, ...]] = [
        ("", "n", *(name for name, _, _ in COLUMNS), ""),
        ("unit", "", *(unit or card["unit"] for _, unit, _ in COLUMNS), ""),
        ("better is", "", *(better for _, _, better in COLUMNS), ""),
    ]
    for group in card["scores"]:
        for level in LEVELS:
            s = card["scores"][group][level]
            if s["n"]:
                numbers = (s["rmse"], s["p95"], s["entropy"], s["log_score"], *s["coverage"].values())
                shown = (f"{x:.3f}" for x in numbers)
                rows.append((f"{group} {level}", str(s["n"]), *shown, _word(card, group, level)))
    messages = card["messages"]
    refused = sum(messages["refused"].values())
    lines = [
        *columns(rows, numbers=range(1, 2 + len(COLUMNS))),
        *_moving(card),
        *_tracked(card),
        *_dishonest(card),
        "",
        f"{card['ticks']} ticks, {card['simulated_s']:g} s of team time in {card['wall_s']:.1f} s",
        f"rule {card['rule']}, fusion {card['fusion']}, seed {card['seed']}, consensuses {card['hash']}",
        f"({NOT_AGAIN if messages['late'] else SAME_PROCESSOR})",
        f"{messages['received']} messages received, {messages['dropped']} dropped, {messages['late']} late, {refused} refused",
        card["verdict"] + _too_short(card),
        *(f"  {reason}" for reason in card["reasons"]),
        *(f"  likely cause: {cause}" for cause in card["causes"]),
    ]
    return "\n".join(lines)


def _word(card: dict[str, Any], group: str, level: str) -> str:
    """What the regions of a row are called; "consistent" with the interval of its 50 % regions, because it is a wide word."""
    honesty = card["honesty"].get(group, {}).get(level, {})
    word = str(honesty.get("word", ""))
    at = honesty.get("coverage", {}).get("50")
    return f"{word} ({at['low']:.2f} to {at['high']:.2f} in 50 %)" if word == CONSISTENT and at else word


def _moving(card: dict[str, Any]) -> list[str]:
    """A line for each kind of heading and velocity that was judged."""
    units = {"headings": "rad", "velocities": f"{card['unit']}/s"}
    lines = [
        f"{what} of {group}: RMSE {judged['rmse']:.3f} {units[what]}, in 95 % {judged['coverage']['95']:.3f} (n {judged['n']})"
        for what, groups in card["motion"].items()
        for group, judged in groups.items()
    ]
    # An honest belief misses its own region by chance, and those who are missed so cannot be foretold.
    if (lost := card["lost"]) and lost["auroc"] is not None and lost["share"] > 2 * (1 - OUTSIDE):
        lines.append(
            f"robots were lost {100 * lost['share']:.1f} % of the time: forecast with an AUROC of {lost['auroc']:.3f}, "
            f"Brier score {lost['brier']:.4f}"
        )
    return ["", *lines] if lines else []


def _tracked(card: dict[str, Any]) -> list[str]:
    """One line about unnamed sightings, and one for each kind of unnamed thing."""
    lines = []
    if identities := card["identities"]:
        odds = f", Brier score of the odds {identities['odds']['brier']:.4f}" if identities["odds"] else ""
        lines.append(
            f"sightings without a name: {identities['n']}, taken for a known subject {identities['taken']}, "
            f"wrongly {identities['wrong']}{odds}"
        )
    for what, tracks in card["tracks"].items():
        parts = ", ".join(f"{name} {tracks[name]:.3f}" for name in ("localisation", "missed", "false"))
        sure = f", existence Brier score {tracks['existence']['brier']:.4f}" if tracks["existence"] else ""
        lines.append(
            f"tracks of {what}: GOSPA {tracks['gospa']:.3f} {card['unit']} (its square is {parts}), "
            f"{tracks['switches']} switches, {tracks['false_tracks']} false tracks{sure}"
        )
    return ["", *lines] if lines else []


def _too_short(card: dict[str, Any]) -> str:
    """Behind a PASS: of whom nothing can be said of the regions, or next to nothing; of those who were judged at all."""
    levels = [
        (f"{group} {level}", honesty)
        for group, found in card["honesty"].items()
        for level, honesty in found.items()
        if card["scores"].get(group, {}).get(level, {}).get("n")
    ]
    short = [row for row, honesty in levels if honesty.get("word") == SHORT]
    wide = [row for row, honesty in levels if (at := honesty["coverage"].get("50")) and at["high"] - at["low"] > WIDE]
    told = {
        f"judged in fewer than {FEWEST} blocks of {BLOCK:g} s": short,
        f"the 95 % interval of their 50 % regions is wider than {100 * WIDE:.0f} points": wide,
    }
    said = [f"of {', '.join(rows)}: {why}" for why, rows in told.items() if rows and card["verdict"] == "PASS"]
    return f", but too short to judge the regions {'; and '.join(said)}" if said else ""


def _dishonest(card: dict[str, Any]) -> list[str]:
    """A line for each row whose regions do not hold the truth as often as they claim, beyond doubt."""
    lines = []
    for group, levels in card["honesty"].items():
        for level, found in levels.items():
            told = []
            for name, at in found["coverage"].items():
                what = kind(int(name), Estimate(at["share"], at["low"], at["high"]))
                if what != CONSISTENT:
                    spans = f"({100 * at['low']:.0f} to {100 * at['high']:.0f})"
                    told.append(f"{what} at {name} %: holds the truth in {100 * at['share']:.0f} % {spans}")
            lines += [f"  {group} {level}: {'; '.join(told)}"] if told else []
    return (
        ["", "regions that hold the truth more or less often than they claim (95 % intervals):", *lines]
        if lines
        else []
    )
