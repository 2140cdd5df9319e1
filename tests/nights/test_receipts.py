"""Evidence that is lost on its way is noticed, wherever that happens; a team at work loses none."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from blackboard.board.joint.desk import JointDesk
from blackboard.board.joint.queue import EvidenceQueue
from blackboard.opinion.gaussian import team as joints
from tests.nights.faults import FullDisk
from tests.nights.night import Night, Team
from tests.nights.oracles import Oracle
from tests.nights.receipts import EvidenceReachesAll, HeardIsSettled, RobotsAreKnown
from tests.nights.run import KNOWN, known, lived

TEAM = Team({"a": ("r1", "r2"), "b": ("r3",)}, "realtime", tick=1.0, latency=0.02, fusion="joint")
NIGHT = Night(TEAM, seed=2)
ALL = HeardIsSettled, EvidenceReachesAll, RobotsAreKnown


@pytest.mark.parametrize("mode", ["lockstep", "realtime", "free"])
def test_a_team_at_work_loses_nothing(mode: Any) -> None:
    outcome = lived(replace(NIGHT, team=replace(TEAM, mode=mode, latency=0.1)), ALL)
    assert outcome.broken is None
    assert outcome.sums["known n"] == 6
    assert known(outcome.sums) < KNOWN


def without_last(function: Callable[..., list[Any]]) -> Callable[..., list[Any]]:
    return lambda *arguments: function(*arguments)[:-1]


@pytest.mark.parametrize(
    ("oracle", "owner", "name", "why"),
    [
        (HeardIsSettled, EvidenceQueue, "pop", "settles without ('robot/r"),
        (HeardIsSettled, JointDesk, "forward", "and not passed it on"),
        (EvidenceReachesAll, JointDesk, "forward", "lacks ('robot/r"),
    ],
)
def test_evidence_that_is_dropped_is_noticed(
    oracle: type[Oracle], owner: type, name: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(owner, name, without_last(getattr(owner, name)))
    assert why in str(lived(NIGHT, [oracle]).broken)


def test_evidence_that_is_not_multiplied_in_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    longer = replace(NIGHT, faults=(FullDisk(2.0, 8.5),))
    monkeypatch.setattr(joints, "multiply", lambda team, evidence: None)
    assert known(lived(longer, [RobotsAreKnown]).sums) > KNOWN
    monkeypatch.setattr(joints, "see", lambda *arguments, **options: None)
    assert "times the variance of its own filter" in str(lived(longer, [RobotsAreKnown]).broken)
