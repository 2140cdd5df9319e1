"""The scorecard: what a run showed, as JSON (docs/design.md fixes its names) and as text for people."""

from __future__ import annotations

from collections import Counter
from typing import Any

from sim_world.referee import LEVELS
from sim_world.service import WorldService


def scorecard(service: WorldService) -> dict[str, Any]:
    """The scorecard of a run that ended, or was stopped. Errors in `unit`, entropies and log scores in nats."""
    scores = service.referee.scores()
    passed, reasons = service.referee.verdict(scores)
    if service.why:
        passed, reasons = False, [service.why, *(reasons if not passed else [])]
    settings, time = service.settings, service.time
    ticks = max(0, service.tick)
    return {
        "verdict": "PASS" if passed else "FAIL",
        "reasons": reasons,
        "hash": service.referee.hash,
        "seed": settings.seed,
        "rule": service.rule,
        "ticks": ticks,
        "simulated_s": round(ticks * time.tick, 6),
        "wall_s": round(service.wall, 3),
        **traffic(service),
        "scores": scores,
        "unit": service.referee.grid.unit,
        "protocol": settings.protocol if settings.kind == "mrclam" else None,
        "mode": time.mode,
        "team_rmse": {level: scores["robots"][level]["rmse"] for level in LEVELS},
        "missing": service.referee.missing(),
        "counters": dict(sorted(service.counters.items())),
    }


def traffic(service: WorldService) -> dict[str, Any]:
    """Messages and bytes of the whole team: the world's own, and what the others' newest statuses count."""
    counts, refused = Counter(service.counters), service.refused + service.referee.refused
    counts["dropped"] += service.link.get("dropped", 0)
    for status in service.others:
        counts.update(status.counters)
        refused.update(status.refused)
    messages = {name: counts[name] for name in ("sent", "received", "dropped")}
    return {"messages": {**messages, "refused": dict(sorted(refused.items()))}, "bytes": counts["bytes"]}


def text(card: dict[str, Any]) -> str:
    """The scorecard for people: a table of levels, then the verdict and why."""
    names = (f"RMSE {card['unit']}", "p95", "entropy", "log score", "50 %", "90 %", "95 %")
    lines = [f"{'':<18}{'n':>7}" + "".join(f"{name:>10}" for name in names)]
    for group in ("robots", "objects"):
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
        f"rule {card['rule']}, seed {card['seed']}, consensuses {card['hash']}",
        f"{messages['received']} messages received, {messages['dropped']} dropped, {refused} refused",
        card["verdict"],
        *(f"  {reason}" for reason in card["reasons"]),
    ]
    return "\n".join(lines)
