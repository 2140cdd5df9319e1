"""The result of a run with something in every part of its card."""

from typing import Any

from blackboard.judge.card import RunResult
from blackboard.judge.referee import Judgement


def block(n: int = 2, rmse: float | None = 0.5) -> dict[str, Any]:
    """The scorecard's block S."""
    numbers = {"rmse": rmse, "mean": 0.4, "p95": 0.9, "max": 1.0, "entropy": 3.0, "log_score": -2.5}
    if not n:
        return {"n": 0, **dict.fromkeys(numbers), "coverage": dict.fromkeys(("50", "90", "95"))}
    return {"n": n, **numbers, "coverage": {"50": 0.5, "90": 0.875, "95": 1.0}}


SCORES = {
    "robots": {"solo": block(rmse=1.25), "consensus": block(rmse=0.75), "agreed": block(rmse=0.5), "by_name": {}},
    "objects": {"solo": block(0), "consensus": block(0), "agreed": block(0), "by_name": {}},
}


JUDGEMENT = Judgement(
    passed=True,
    reasons=["robots: fine"],
    scores=SCORES,
    missing={"robot/r2": {"solo": 3}},
    hash="abc",
    unit="m",
    refused={"shape": 1},
    honesty={
        "robots": {"agreed": {"word": "over-cautious", "coverage": {"50": {"share": 0.6, "low": 0.55, "high": 0.65}}}}
    },
    causes=["r3 is off"],
)


RESULT = RunResult(
    judgement=JUDGEMENT,
    stopped="",
    seed=7,
    rule="coalition",
    fusion="joint",
    mode="lockstep",
    protocol="C_blind12",
    ticks=7,
    tick_seconds=0.1,
    wall_seconds=1.23456,
    messages={"sent": 10, "received": 9, "dropped": 1, "late": 0},
    refused={"version": 2, "shape": 1},
    bytes=1000,
    counters={"sent": 5, "late": 1},
)
