"""Messages of every type for this team, with every field said, from names that hold a token in it and from others: what the fuzz begins with."""

from typing import Any

from blackboard.wire.messages import Camp, Consensus, Dissent, Learned, Report, Status
from blackboard.wire.types import Message
from tests.wire.messages import CONSENSUS, EVIDENCE, EXAMPLES, REPORT

DISSENT = [Dissent(level="agreed", source="r2", since=0.2, sigmas=3.5, weight=0.5)]
LEARNED = [Learned(level="consensus", source="r1", samples=3.0, variance=2.0, correlation=0.4, echo="r2", since=0.2)]
CAMPS = [Camp(sources=["r1"], weight=0.5), Camp(sources=["r2"], weight=0.5)]


def status(process: str, kind: Any, **more: Any) -> Status:
    """A status that says everything, of a robot or of a board that leads, follows, or says that it has for long."""
    return Status(
        process=process,
        kind=kind,
        tick=3,
        time=1.5,
        phase="reported" if kind == "robot" else "agreed",
        subjects=["robot/r1", "object/ball"],
        counters={"sent": 4},
        refused={"mass": 1},
        ages={"r2": 0.1},
        settings={"rule": "cooperative", "fusion": "joint"},
        since=0.0,
        speed=2.0,
        sent=1e6,
        echo={"a/board-a": (1e6, 0.1)},
        clocks={"r1": 2.0, "b/board-b": -3.0},
        dissent=DISSENT,
        learned=LEARNED,
    ).model_copy(update=more)


def consensus(sub_team: str, level: Any) -> Consensus:
    said = {"dissent": DISSENT, "learned": LEARNED, "camps": CAMPS, "ahead": 2.0}
    return CONSENSUS.model_copy(update={"sub_team": sub_team, "board": f"board-{sub_team}", "level": level, **said})


def _rich() -> list[tuple[str, dict[str, str], Message]]:
    examples: list[tuple[str, dict[str, str], Message]] = [(name, *EXAMPLES[name]) for name in sorted(EXAMPLES)]
    for sub_team, process, kind in (
        ("a", "r1", "robot"),
        ("a", "board-a", "board"),
        ("b", "board-b", "board"),
        ("a", "x", "board"),
    ):
        where = {"team": "t", "sub_team": sub_team, "process": process}
        for more in ({}, {"follows": True}, {"term": 2**53 - 1, "since": -1e12}):
            examples.append(("status", where, status(process, kind, **more)))
    for sub_team in ("a", "b"):
        for level in ("consensus", "agreed"):
            where = {"team": "t", "sub_team": sub_team, "subject": "object/ball"}
            examples.append((level, where, consensus(sub_team, level)))
    own: Report = REPORT.model_copy(update={"subject": "robot/r1", "evidence": EVIDENCE})
    examples.append(("report", {"team": "t", "sub_team": "a", "source": "r1", "subject": "robot/r1"}, own))
    return examples


#: Topic, parts of the key, message.
RICH = _rich()
