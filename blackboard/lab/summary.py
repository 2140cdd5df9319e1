"""What tuning found, as JSON and for people. Pure; chance is an argument."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import reduce
from typing import Any

import numpy as np

from blackboard.config import RuleSection
from blackboard.fusion import in_force
from blackboard.lab.contest import merged
from blackboard.lab.growth import Growth
from blackboard.lab.tally import Tally, difference, estimates, means
from blackboard.lab.tuning import board_table, enough


def tuned(
    choices: Mapping[str, Mapping[str, Any]],
    best: Mapping[str, Any],
    judged: Mapping[str, RuleSection],
    checks: Sequence[tuple[dict[str, Tally], dict[str, Growth]]],
    *,
    coverage: float,
    gain: float,
    chance: np.random.Generator,
) -> dict[str, Any]:
    """The choice with its intervals, how it and others did on held-out runs, and what one more robot gains."""
    tallies = merged([tally for tally, _ in checks])
    growth = reduce(Growth.merge, (grown["tuned"] for _, grown in checks))
    log_scores = growth.means(np.array(growth.log_scores))
    gains = means(np.diff(log_scores, axis=1), chance)
    return {
        "asked": {"coverage_95": coverage, "gain": gain},
        "choices": {
            name: {key: value for key, value in choice.items() if key != "setting"} for name, choice in choices.items()
        },
        "chosen": {"rule": best["setting"].rule, **in_force(best["setting"]), "honest": best["honest"]},
        "board": board_table(best["setting"]),
        "held_out": {
            name: {
                "rule": {"rule": judged[name].rule, **in_force(judged[name])},
                **{column: asdict(e) for column, e in estimates(tally, chance).items()},
            }
            for name, tally in tallies.items()
        },
        "gain_over_paper": asdict(difference(tallies["tuned"], tallies["paper"], chance)),
        "team": {
            "log_score": [asdict(e) for e in means(log_scores, chance)],
            "gains": [asdict(e) for e in gains],
            "enough": enough([e.value for e in gains], gain),
        },
    }


def text(found: Mapping[str, Any]) -> str:
    """The same for people."""
    asked, lines = found["asked"], []
    for name, choice in found["choices"].items():
        told = ", ".join(f"{p} {_span(e)}" for p, e in choice["parameters"].items())
        share = f"95 % coverage {choice['coverage_95']:.3f}" + ("" if choice["honest"] else ": LESS THAN ASKED")
        lines.append(f"{name}: {told}; log score {choice['log_score']:.3f}, {share}")
    lines += ["", f"on held-out runs {'RMSE':>9}{'log score':>25}{'95 % coverage':>22}{'entropy':>9}"]
    for name, row in found["held_out"].items():
        log, cover = _span(row["log_score"], 3), _span(row["coverage_95"], 3)
        lines.append(f"  {name:14}{row['rmse']['value']:9.3f}{log:>25}{cover:>22}{row['entropy']['value']:9.2f}")
    lines.append(f"the choice's log score is higher than the paper's by {_span(found['gain_over_paper'], 3)} nats")
    lines += ["", "one robot more gains (nats of log score)"]
    for n, gain in enumerate(found["team"]["gains"], start=2):
        lines.append(f"  {n - 1} -> {n}: {_span(gain, 3)}")
    size, least = found["team"]["enough"], f"{asked['gain']:g} nats"
    most = size > len(found["team"]["gains"])
    lines.append(
        f"the last of {size} robots still gains {least}" if most else f"after {size} no robot more gains {least}"
    )
    lines += ["", found["board"]]
    return "\n".join(lines)


def _span(estimate: Mapping[str, float], places: int = 2) -> str:
    value, low, high = (f"{estimate[key]:.{places}f}" for key in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"
