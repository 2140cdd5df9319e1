"""The scorecard: what a run showed, as JSON (docs/design.md fixes its names) and as text for people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim_world.referee import LEVELS, Judgement


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
    messages: Mapping[str, int]  # of the whole team: sent, received, dropped
    refused: Mapping[str, int]  # of the whole team: reason -> messages and beliefs
    bytes: int  # of the whole team
    counters: Mapping[str, int]  # of the world alone


def scorecard(result: RunResult) -> dict[str, Any]:
    """The scorecard as JSON. Errors in `unit`, entropies and log scores in nats. A run that was stopped is a FAIL."""
    found = result.judgement
    reasons = found.reasons if not result.stopped else [result.stopped, *([] if found.passed else found.reasons)]
    return {
        "verdict": "PASS" if found.passed and not result.stopped else "FAIL",
        "reasons": reasons,
        "hash": found.hash,
        "seed": result.seed,
        "rule": result.rule,
        "ticks": result.ticks,
        "simulated_s": round(result.ticks * result.tick_seconds, 6),
        "wall_s": round(result.wall_seconds, 3),
        "messages": {**result.messages, "refused": dict(sorted(result.refused.items()))},
        "bytes": result.bytes,
        "scores": found.scores,
        "unit": found.unit,
        "protocol": result.protocol,
        "mode": result.mode,
        "fusion": result.fusion,
        "team_rmse": {level: found.scores["robots"][level]["rmse"] for level in LEVELS},
        "missing": found.missing,
        "counters": dict(sorted(result.counters.items())),
    }


def text(card: dict[str, Any]) -> str:
    """The scorecard as text: a table of levels, then the verdict and its reasons."""
    names = (f"RMSE {card['unit']}", "p95", "entropy", "log score", "50 %", "90 %", "95 %")
    lines = [f"{'':<18}{'n':>7}" + "".join(f"{name:>10}" for name in names)]
    for group in card["scores"]:
        for level in LEVELS:
            s = card["scores"][group][level]
            if s["n"]:
                numbers = (s["rmse"], s["p95"], s["entropy"], s["log_score"], *s["coverage"].values())
                lines.append(f"{group + ' ' + level:<18}{s['n']:>7}" + "".join(f"{x:>10.3f}" for x in numbers))
    messages = card["messages"]
    refused = sum(messages["refused"].values())
    lines += [
        "",
        f"{card['ticks']} ticks, {card['simulated_s']:g} s of team time in {card['wall_s']:.1f} s",
        f"rule {card['rule']}, fusion {card['fusion']}, seed {card['seed']}, consensuses {card['hash']}",
        f"{messages['received']} messages received, {messages['dropped']} dropped, {refused} refused",
        card["verdict"],
        *(f"  {reason}" for reason in card["reasons"]),
    ]
    return "\n".join(lines)
