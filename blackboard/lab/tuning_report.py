"""What tuning found, as JSON and as text. Pure; the random generator is an argument."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import reduce
from typing import Any

import numpy as np

from blackboard.judge.intervals import means, shown
from blackboard.lab.comparison import merged
from blackboard.lab.estimates import RuleScores, difference, estimates
from blackboard.lab.team_size import TeamSizeScores
from blackboard.lab.tuning import board_table, enough, recommended
from blackboard.opinion.rules import Rule
from blackboard.process.columns import columns

NONE = " [-]"  # too few runs were made to give an interval


def tuned(
    choices: Mapping[str, Mapping[str, Any]],
    best: Mapping[str, Any],
    judged: Mapping[str, Rule],
    checks: Sequence[tuple[dict[str, RuleScores], dict[str, TeamSizeScores]]],
    *,
    coverage: float,
    gain: float,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """The choice with its spreads, how it and others did on held-out runs, what is recommended, and what one more robot gains.

    `board` is the table of what is recommended: the choice, or the default where the choice does not beat it.
    """
    scores = merged([by_rule for by_rule, _ in checks])
    by_size = reduce(TeamSizeScores.merge, (sizes["tuned"] for _, sizes in checks))
    log_scores = by_size.means(np.array(by_size.log_scores))
    gains = means(np.diff(log_scores, axis=1), rng)
    over_default = difference(scores["tuned"], scores["default"], rng)
    which, why = recommended(over_default, best["honest"])
    return {
        "asked": {"coverage_95": coverage, "gain": gain},
        "choices": {
            name: {key: value for key, value in choice.items() if key != "setting"} for name, choice in choices.items()
        },
        "chosen": {**best["setting"].in_force(), "honest": best["honest"]},
        "recommended": {"which": which, "why": why, **judged[which].in_force()},
        "board": board_table(judged[which]),
        "held_out": {
            name: {"rule": of_rule.in_force, **{column: asdict(e) for column, e in estimates(of_rule, rng).items()}}
            for name, of_rule in scores.items()
        },
        "gain_over_default": asdict(over_default),
        "gain_over_paper": asdict(difference(scores["tuned"], scores["paper"], rng)),
        "team": {
            "log_score": [asdict(e) for e in means(log_scores, rng)],
            "gains": [asdict(e) for e in gains],
            "enough": enough([e.value for e in gains], gain),
        },
    }


def text(table: Mapping[str, Any]) -> str:
    asked, lines = table["asked"], []
    for name, choice in table["choices"].items():
        intervals = ", ".join(f"{p} {shown(e, 2, without=NONE)}" for p, e in choice["parameters"].items())
        share = f"95 % coverage {choice['coverage_95']:.3f}" + ("" if choice["honest"] else ": LESS THAN ASKED")
        lines.append(f"{name}: {intervals}; log score {choice['log_score']:.3f}, {share}")
    rows: list[tuple[str, ...]] = [("on held-out runs", "RMSE", "log score", "95 % coverage", "entropy")]
    for name, row in table["held_out"].items():
        log, cover = (shown(row[name], without=NONE) for name in ("log_score", "coverage_95"))
        rows.append((name, f"{row['rmse']['value']:.3f}", log, cover, f"{row['entropy']['value']:.2f}"))
    lines += ["", *columns(rows, numbers=range(1, 5))]
    for other in ("default", "paper"):
        lines.append(
            f"the choice's log score less the {other}'s: {shown(table[f'gain_over_{other}'], without=NONE)} nats"
        )
    lines += ["", "one robot more gains (nats of log score)"]
    for n, gain in enumerate(table["team"]["gains"], start=2):
        lines.append(f"  {n - 1} -> {n}: {shown(gain, without=NONE)}")
    size, least = table["team"]["enough"], f"{asked['gain']:g} nats"
    most = size > len(table["team"]["gains"])
    lines.append(
        f"the last of {size} robots still gains {least}" if most else f"after {size} no robot more gains {least}"
    )
    which, why = table["recommended"]["which"], table["recommended"]["why"]
    lines += ["", f"{'keep the default' if which == 'default' else 'take the choice'}: {why}", "", table["board"]]
    return "\n".join(lines)
