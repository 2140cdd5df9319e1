"""Who claims to know better than any sensor of the team could: a whole team with real bytes."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario, load
from blackboard.wire.evidence import PackedEvidence, PackedIncrement, PackedState
from blackboard.wire.messages import Report
from tests.hostile.attack import Attack, report_key
from tests.present import present

pytestmark = pytest.mark.hostile

#: The demo for ten seconds; r2, who may lie, is scored by itself.
TABLES = load("demo").changed("time", seconds=10.0).changed("team", name="t").changed("world", seed=3).tables
DEMO = Scenario({**TABLES, "fault": [{"kind": "lie", "robot": "r2", "offset": [1, 0], "active": False}]})


@cache
def calm() -> dict[str, Any]:
    attack = Attack(DEMO)
    attack.goes_on()
    return attack.card


def packed(matrix: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in matrix[np.triu_indices(len(matrix))])


def off(evidence: PackedEvidence, cells: float) -> tuple[float, ...]:
    x, *rest = present(evidence.state).mean
    return (x + cells, *rest)


def certain(evidence: PackedEvidence, time: float) -> PackedEvidence:
    """Its place to a millionth of a cell, three cells off, in every tick."""
    there = off(evidence, 3.0)
    information = np.zeros((len(there),) * 2)
    information[:2, :2] = np.eye(2) * 1e12
    increment = PackedIncrement(reference=there, information=packed(information), vector=(0.0,) * len(there))
    return evidence.model_copy(update={"increment": increment})


def anew(evidence: PackedEvidence, time: float) -> PackedEvidence:
    """Its place, one cell off, as the belief of an epoch that begins in this tick."""
    there = off(evidence, 1.0)
    state = PackedState(mean=there, covariance=packed(np.eye(len(there)) * 1e-9))
    return evidence.model_copy(update={"state": state, "increment": None, "epoch": int(1000 * time) + 1})


@pytest.mark.parametrize("lie", [certain, anew])
def test_who_claims_to_be_certain_counts_for_no_more_than_its_share(lie: Any) -> None:
    attack = Attack(DEMO)

    def change(said: Report) -> list[tuple[str, Report]]:
        return [(key, said.model_copy(update={"evidence": lie(present(said.evidence), said.time)}))]

    key = report_key("r2", "robot/r2")
    attack.instead(key, change)
    attack.goes_on()
    honest, before = attack.card["scores"]["robots"]["agreed"], calm()["scores"]["robots"]["agreed"]
    assert honest["rmse"] <= 1.25 * before["rmse"]
    assert honest["coverage"]["95"] >= 0.90
