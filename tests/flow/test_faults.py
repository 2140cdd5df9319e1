"""Whole teams with faults: the same seed is the same run, who lies is named, the honest are scored alone, and names are no votes."""

from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.faults import without_faults
from blackboard.judge.card import text
from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Report, Status
from tests.heard import Heard

#: Five robots in a small room see each other often; their sensors are good.
TABLES: dict[str, Any] = {
    "team": {"name": "t", "sub_teams": {"a": ["r1", "r2", "r3", "r4", "r5"]}},
    "grid": {"shape": [20, 20]},
    "time": {"tick": 0.5, "seconds": 8.0},
    "world": {"seed": 2, "objects": {}, "speed": 0.5, "turn_rate": 1.0, "odometry": {"reset_after": 1.0, "fix": 0.5}},
}
LIE = {"kind": "lie", "robot": "r5", "offset": [-7, 5]}
FAULTS: list[dict[str, Any]] = [
    LIE,
    {"kind": "collude", "robots": ["r4", "r5"], "offset": [-7, 5]},
    {"kind": "overconfident", "robot": "r5", "factor": 4},
    {"kind": "skew", "robot": "r5", "seconds": -3},
    {"kind": "lose", "robot": "r5", "share": 0.4},
    {"kind": "drift", "robot": "r5", "rate": 0.5, "sensor": "fix"},
    {"kind": "freeze", "robot": "r5", "start": 1, "end": 2},
]


def new_scenario(*faults: dict[str, Any], fusion: str = "opinions", seconds: float | None = None) -> Scenario:
    scenario = Scenario({**TABLES, "fault": list(faults)}).changed("board", fusion=fusion)
    return scenario.changed("time", seconds=seconds)


class Said:
    """A run, and the newest status of its board and consensuses by level and subject."""

    def __init__(self, scenario: Scenario, shuffle: int | None = None) -> None:
        self.team = InProcessTeam(scenario, None if shuffle is None else np.random.default_rng(shuffle))
        heard = Heard(self.team.bus)
        self.card = self.team.run()
        assert self.team.world.why == ""
        self.status: Status = heard.of(keys.STATUS, process="board-a")[-1]
        self.settled: list[Consensus] = heard.of(keys.CONSENSUS)
        said: list[Consensus] = self.settled + heard.of(keys.AGREED)
        self.consensuses = {(consensus.level, consensus.subject): consensus for consensus in said}


@pytest.fixture(scope="module")
def calm() -> Said:
    return Said(new_scenario())


@pytest.fixture(scope="module")
def short() -> Said:
    return Said(new_scenario(seconds=2.5))


@pytest.fixture(scope="module")
def lied_to() -> Said:
    return Said(new_scenario(LIE))


@pytest.fixture(scope="module")
def lied_to_joint() -> Said:
    return Said(new_scenario(LIE, fusion="joint"))


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: str(fault["kind"]))
def test_the_same_seed_is_the_same_run_in_any_order_and_another_one_than_without(
    short: Said, fault: dict[str, Any]
) -> None:
    first, second = (Said(new_scenario(fault, seconds=2.5), shuffle) for shuffle in (None, 4))
    assert first.card["hash"] == second.card["hash"]
    assert first.card["hash"] != short.card["hash"]


@pytest.mark.parametrize("fusion", ["opinions", "joint"])
def test_a_liar_is_named_in_status_and_consensus_and_the_others_are_not(
    lied_to: Said, lied_to_joint: Said, fusion: str
) -> None:
    said = lied_to if fusion == "opinions" else lied_to_joint
    assert {named.source for named in said.status.dissent} == {"r5"}
    levels = {named.level for named in said.status.dissent}
    assert ("agreed" if fusion == "joint" else "consensus") in levels
    for named in said.status.dissent:
        assert named.since < 8.0
        assert named.sigmas > 3.0
        assert named.weight < 0.6
    assert {named.source for named in said.consensuses["consensus", "robot/r5"].dissent} <= {"r5"}
    assert any("r5" in {named.source for named in c.dissent} for c in said.consensuses.values())


def test_without_its_faults_a_run_is_the_one_without(short: Said) -> None:
    assert Said(without_faults(new_scenario(LIE, seconds=2.5))).card["hash"] == short.card["hash"]


def test_the_honest_are_scored_alone_and_the_liar_beside_them(calm: Said, lied_to: Said) -> None:
    said = lied_to
    assert list(said.card["scores"]) == ["robots", "objects", "faulty"]
    assert list(said.card["scores"]["robots"]["by_name"]) == ["r1", "r2", "r3", "r4"]
    assert list(said.card["scores"]["faulty"]["by_name"]) == ["r5"]
    assert "faulty" not in calm.card["scores"]
    assert "faulty agreed" in text(said.card)
    misled, alone = (played.card["scores"]["robots"]["agreed"]["rmse"] for played in (said, calm))
    assert alone < misled


def test_a_silent_process_is_waited_for_and_then_no_longer_and_takes_part_again() -> None:
    scenario = new_scenario({"kind": "freeze", "what": "process", "robot": "r5", "start": 2, "end": 4}, seconds=6.0)
    said = Said(scenario)
    assert said.card["counters"]["given_up"] == 1
    assert said.team.world.members.given_up == set()
    assert said.card["missing"]["robot/r5"]["solo"] >= 3


def test_a_skewed_robot_is_refused_by_its_stamp_and_says_so_in_the_board_s_status() -> None:
    said = Said(new_scenario({"kind": "skew", "robot": "r5", "seconds": 3}, seconds=4.0))
    assert said.status.refused["future"] > 0


def test_names_without_a_token_do_not_vote(short: Said) -> None:
    """One process speaks for ten robots that hold no token, all at one wrong place: no bit changes, although guests may vote."""
    team = InProcessTeam(new_scenario(seconds=2.5).changed("team", guests="vote"))
    busy = False

    def invent(envelope: Envelope) -> None:
        nonlocal busy
        if busy or "/report/r5/robot/r5" not in envelope.key:
            return
        busy = True
        said = decode(Report, envelope.payload)
        for k in range(10):
            wrong = said.model_copy(update={"source": f"x{k}", "subject": "robot/r1"})
            team.bus.send(Envelope(f"cop/t/a/report/x{k}/robot/r1", encode(wrong)))
        busy = False

    team.bus.spies.append(invent)
    assert team.run()["hash"] == short.card["hash"]
    assert team.boards["a"].refused["unregistered"] > 0


def test_one_token_is_one_opinion_on_a_subject_however_often_it_speaks(calm: Said) -> None:
    """What a robot reports under its own name replaces what it said before, and never adds to it."""
    assert calm.settled
    for consensus in calm.settled:
        sources = [used.source for used in consensus.used if used.how == "independent"]
        assert len(sources) == len(set(sources))


def test_what_is_agreed_about_a_liar_is_not_what_the_joint_has_from_the_liar_alone(lied_to_joint: Said) -> None:
    said = lied_to_joint
    rules = {subject: consensus.rule for (level, subject), consensus in said.consensuses.items() if level == "agreed"}
    assert rules.pop("robot/r5") != "joint"
    assert set(rules.values()) == {"joint"}
    assert said.card["scores"]["faulty"]["agreed"]["log_score"] > -8.0  # -17 where it is told by the joint
