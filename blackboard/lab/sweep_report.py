"""What a sweep found: the mean of each measure over the seeds, and how each combination differs from the first. Pure.

A run of one seed is one observation. Differences are paired: between runs of the same seed, so that what a seed makes easy or
hard for every combination drops out. Intervals are those of `blackboard.judge.intervals`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from blackboard.judge.intervals import means, shown
from blackboard.judge.samples import GROUPS, LEVELS, READERS
from blackboard.lab.sweep_plan import Planned, label
from blackboard.opinion.scores import LEVELS as SHARES
from blackboard.process.columns import columns

Card = Mapping[str, Any]  # a scorecard, with "cpu_s"
MEASURES = ("rmse", "log_score", "entropy", *(f"coverage_{level}" for level in SHARES))
NO_LIMITS = (-math.inf, math.inf)
#: What intervals are cut off at, by the first word of a name.
LIMITS = {
    "rmse": (0.0, math.inf),
    "entropy": (0.0, math.inf),
    "coverage": (0.0, 1.0),
    **dict.fromkeys(("gospa", "localisation", "missed", "false", "switches"), (0.0, math.inf)),
    "brier": (0.0, 1.0),
}
#: Of tracks of unnamed things, by kind.
TRACKED = ("gospa", "localisation", "missed", "false", "missed_share", "switches", "false_tracks", "brier")
NUMBERS = ("n", "rmse", "mean", "p95", "max", "entropy", "log_score")


def measure(card: Card, group: str, level: str, name: str) -> float:
    """One number of a scorecard; NaN where nothing was judged."""
    block = card["scores"][group][level]
    value = block["coverage"][name.removeprefix("coverage_")] if name.startswith("coverage_") else block[name]
    return float("nan") if value is None else float(value)


def tracked(card: Card, kind: str, name: str) -> float:
    """One number about the tracks of a kind; NaN where there was neither a thing nor a track."""
    block = card.get("tracks", {}).get(kind, {})
    value = block.get("existence", {}).get("brier") if name == "brier" else block.get(name)
    return float("nan") if value is None else float(value)


def report(planned: Sequence[Planned], cards: Sequence[Card], rng: np.random.Generator) -> dict[str, Any]:
    """The result as JSON: for each combination its runs, scores and differences from the first one, with 95 % intervals."""
    runs: dict[int, dict[int, Card]] = {}
    for one, card in zip(planned, cards, strict=True):
        runs.setdefault(one.combination, {})[one.seed] = card
    settings = {one.combination: one.settings for one in planned}
    kinds = sorted({kind for card in cards for kind in card.get("tracks", {})})
    rows = []
    for number, by_seed in sorted(runs.items()):
        scores, differences, missing = {}, {}, {}
        for group in GROUPS:
            missing[group] = {level: _not_judged(by_seed, group, level) for level in LEVELS}
            scores[group] = {level: _means(by_seed.values(), group, level, rng) for level in LEVELS}
            if number:
                both = [(runs[0][seed], card) for seed, card in by_seed.items()]
                differences[group] = {level: _differences(both, group, level, rng) for level in LEVELS}
        rows.append(
            {
                "label": label(settings[number]),
                "settings": dict(settings[number]),
                "runs": len(by_seed),
                "passed": sum(card["verdict"] == "PASS" for card in by_seed.values()),
                "judged": {
                    group: {level: len(by_seed) - len(seeds) for level, seeds in levels.items()}
                    for group, levels in missing.items()
                },
                "not_judged": missing,
                "scores": scores,
                "difference": differences,
                "tracks": {kind: _tracks(by_seed, kind, rng) for kind in kinds},
                "tracks_difference": {kind: _tracks(by_seed, kind, rng, runs[0]) for kind in kinds} if number else {},
                "hashes": {str(seed): card["hash"] for seed, card in by_seed.items()},
                "cpu_s": sum(card["cpu_s"] for card in by_seed.values()) / len(by_seed),
            }
        )
    return {
        "scenario": planned[0].scenario.name,
        "seconds": planned[0].scenario.time.seconds,
        "unit": cards[0]["unit"],
        "seeds": sorted({one.seed for one in planned}),
        "combinations": rows,
    }


def rows(planned: Sequence[Planned], cards: Sequence[Card]) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """The table of all runs: its columns, one of each setting among them, and a row for each run, group and level."""
    settings = {key: _kind([one.settings[key] for one in planned]) for key in planned[0].settings}
    numbers = [*NUMBERS[1:], *(f"coverage_{level}" for level in SHARES)]
    kinds = sorted({kind for card in cards for kind in card.get("tracks", {})})
    of_tracks = {(kind, name): f"{kind}_{name}" for kind in kinds for name in TRACKED}
    columns = {
        **{_identifier(key): kind for key, kind in settings.items()},
        **{"seed": "int", "group": "str", "level": "str", "n": "int"},
        **dict.fromkeys([*numbers, *of_tracks.values()], "float"),
        **{"verdict": "str", "hash": "str", "cpu_s": "float"},
    }
    rows = []
    for one, card in zip(planned, cards, strict=True):
        run = {
            **{_identifier(key): READERS[kind](one.settings[key]) for key, kind in settings.items()},
            **{"seed": one.seed, **{name: card[name] for name in ("verdict", "hash", "cpu_s")}},
        }
        run |= {column: tracked(card, *names) for names, column in of_tracks.items()}
        for group in GROUPS:
            for level in LEVELS:
                values = {name: measure(card, group, level, name) for name in numbers}
                n = card["scores"][group][level]["n"]
                rows.append({**run, "group": group, "level": level, "n": n, **values})
    return columns, rows


def text(report: Mapping[str, Any]) -> str:
    """The result as text: what was agreed in each combination, then the paired differences from the first."""
    combinations, seeds = report["combinations"], report["seeds"]
    head = (f"RMSE {report['unit']} (smaller)", "log score nats (larger)", "in 95 % (0.95)", "PASS", "CPU s")
    names = ("rmse", "log_score", "coverage_95")
    lines = [
        f"{report['scenario']}, {report['seconds']:g} s, {len(seeds)} seeds; agreed beliefs, mean over seeds [95 % interval]"
    ]
    for group in GROUPS:
        rows: list[tuple[str, ...]] = [(group, *head)]
        for one in combinations:
            values = (shown(one["scores"][group]["agreed"][name]) for name in names)
            rows.append((one["label"], *values, f"{one['passed']}/{one['runs']}", f"{one['cpu_s']:.1f}"))
        for one in combinations[1:]:
            values = (shown(one["difference"][group]["agreed"][name], sign="+") for name in names)
            rows.append((one["label"], *values, "", ""))
        lines += ["", *_compared(rows, combinations)]
        lines += [line for one in combinations for line in _left_out(one, group, len(combinations) > 1)]
    return "\n".join(
        [*lines, *(line for kind in combinations[0]["tracks"] for line in ("", *_of_tracks(combinations, kind)))]
    )


def _of_tracks(combinations: Sequence[Mapping[str, Any]], kind: str) -> list[str]:
    names = ("gospa", "switches", "false_tracks", "brier")
    rows: list[tuple[str, ...]] = [(f"tracks of {kind}", "GOSPA", "switches", "false tracks", "Brier of existence")]
    rows += [(one["label"], *(shown(one["tracks"][kind][name]) for name in names)) for one in combinations]
    for one in combinations[1:]:
        rows.append((one["label"], *(shown(one["tracks_difference"][kind][name], sign="+") for name in names)))
    return _compared(rows, combinations)


def _compared(rows: Sequence[tuple[str, ...]], combinations: Sequence[Mapping[str, Any]]) -> list[str]:
    """Rows in columns, with a line before those of the differences."""
    table = columns(rows, numbers=range(1, len(rows[0])))
    if len(combinations) > 1:
        table.insert(1 + len(combinations), f"minus {combinations[0]['label']}, in pairs of runs of the same seed:")
    return table


def _left_out(one: Mapping[str, Any], group: str, several: bool) -> list[str]:
    """The line that says in which seeds nothing was agreed on, which the means leave out; none where the group is not there."""
    seeds, there = one["not_judged"][group]["agreed"], any(one["judged"][group].values())
    if not seeds or not there:
        return []
    where = f"seed{'s' if len(seeds) > 1 else ''} {', '.join(str(seed) for seed in seeds)}"
    whose = f"{group}, {one['label']}" if several else group
    count = f"{one['judged'][group]['agreed']} of {one['runs']} seeds"
    return [f"{whose}: {count} (in {where} none was agreed on)"]


def _not_judged(by_seed: Mapping[int, Card], group: str, level: str) -> list[int]:
    """The seeds that the means leave out, because something could not be measured."""
    return sorted(
        seed
        for seed, card in by_seed.items()
        if any(math.isnan(measure(card, group, level, name)) for name in MEASURES)
    )


def _means(cards: Iterable[Card], group: str, level: str, rng: np.random.Generator) -> dict[str, Any]:
    return _estimates([[measure(card, group, level, name) for name in MEASURES] for card in cards], rng)


def _tracks(
    by_seed: Mapping[int, Card], kind: str, rng: np.random.Generator, first: Mapping[int, Card] | None = None
) -> dict[str, Any]:
    """The means of what is judged of the tracks of a kind; or of how they differ from those of the `first` combination."""
    table = [
        [tracked(card, kind, name) - (tracked(first[seed], kind, name) if first else 0.0) for name in TRACKED]
        for seed, card in by_seed.items()
    ]
    return _estimates(table, rng, paired=first is not None, names=TRACKED)


def _differences(both: Sequence[tuple[Card, Card]], group: str, level: str, rng: np.random.Generator) -> dict[str, Any]:
    table = [
        [measure(other, group, level, name) - measure(first, group, level, name) for name in MEASURES]
        for first, other in both
    ]
    return _estimates(table, rng, paired=True)


def _estimates(
    table: list[list[float]], rng: np.random.Generator, paired: bool = False, names: Sequence[str] = MEASURES
) -> dict[str, Any]:
    """Each measure's mean over the runs in which something was judged; null where there is none."""
    numbers = np.array(table)
    known = numbers[~np.isnan(numbers).any(axis=1)]
    if not len(known):
        return {name: {"value": None, "low": None, "high": None} for name in names}
    told = {}
    for name, column in zip(names, known.T, strict=True):
        limits = NO_LIMITS if paired else LIMITS.get(name.split("_")[0], NO_LIMITS)
        told[name] = asdict(means(column[:, np.newaxis], rng, *limits)[0])
    return told


def _identifier(key: str) -> str:
    return re.sub(r"\W+", "_", key)


def _kind(values: Sequence[object]) -> str:
    return "float" if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values) else "str"
