"""A team whose boards keep a joint belief: the same everywhere, whatever the network does, and beside robots that send beliefs only."""

import numpy as np
import pytest

from blackboard.board.service import board_of
from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import Forward
from robot_agent.service import AgentService
from robot_agent.team import robot_of
from tests import scenarios
from tests.heard import Agreed, Heard, played
from tests.scenarios import SCENARIO

JOINT = scenarios.JOINT.changed("time", seconds=3.0)


@pytest.fixture(scope="module")
def calm() -> tuple[str, Agreed]:
    return played(InProcessTeam(JOINT))


def test_the_joint_says_whose_evidence_it_took(calm: tuple[str, Agreed]) -> None:
    for (_, subject), consensus in calm[1]["a"].items():
        if subject.startswith("robot/"):
            assert consensus.rule == "joint"
            assert set(consensus.ancestors) == {"r1", "r2", "r3"}
            assert sum(used.weight for used in consensus.used) == pytest.approx(1.0) or not consensus.used
            assert {used.source for used in consensus.used} <= {"r1", "r2", "r3"}
    assert any(len(c.used) > 1 for c in calm[1]["a"].values()), "somebody was seen by a mate"


def test_what_is_said_twice_counts_once(calm: tuple[str, Agreed]) -> None:
    team = InProcessTeam(JOINT)
    echoes: set[bytes] = set()

    def echo(envelope: Envelope) -> None:
        if ("/forward/" in envelope.key or "/report/" in envelope.key) and envelope.payload not in echoes:
            echoes.add(envelope.payload)
            team.bus.send(envelope)

    team.bus.spies.append(echo)
    _, agreed = played(team)
    for name, consensus in calm[1]["a"].items():
        assert consensus.belief == agreed["a"][name].belief


def plain(name: str) -> AgentService:
    """A robot that sends beliefs only."""
    return robot_of(SCENARIO, name)


def test_a_robot_that_sends_beliefs_only_is_pooled_beside_the_joint() -> None:
    team = InProcessTeam(JOINT)
    team.leave(team.robots["r2"])
    team.join(plain("r2"))
    _, agreed = played(team)
    rules: dict[str, set[str]] = {}
    for (_, subject), consensus in agreed["b"].items():
        rules.setdefault(subject, set()).add(consensus.rule)
    assert rules["robot/r1"] == rules["robot/r3"] == {"joint"}
    assert rules["robot/r2"] == {"coalition"}


def test_a_board_that_pools_opinions_only_is_not_waited_for() -> None:
    """As a board of the version before, which forwards nothing."""
    team = InProcessTeam(JOINT)
    team.leave(team.boards["b"])
    team.join(board_of(SCENARIO, "b"))
    _, agreed = played(team)
    assert team.boards["a"].counters["late"] == 0
    assert {c.rule for (_, subject), c in agreed["a"].items() if subject == "robot/r1"} == {"joint"}
    assert {c.rule for (_, subject), c in agreed["b"].items() if subject == "robot/r1"} == {"coalition"}


def test_evidence_from_another_time_is_refused() -> None:
    team = InProcessTeam(JOINT)
    team.run_until(lambda: team.world.tick == 2)
    for time in (1e12, -1e12):
        forward = Forward(board="board-b", sub_team="b", tick=2, time=time)
        team.bus.send(Envelope("cop/t/b/forward/board-b", encode(forward)))
    team.run()
    assert (team.boards["a"].refused["future"], team.boards["a"].refused["past"]) == (1, 1)


def test_a_robot_that_dies_is_believed_less_and_less_and_then_no_more() -> None:
    team = InProcessTeam(JOINT.changed("board", max_age=1.7))
    team.run_until(lambda: team.world.tick == 2)
    team.leave(team.robots["r2"])
    _, agreed = played(team)
    by_tick = {t: c for (t, subject), c in agreed["a"].items() if subject == "robot/r2" and c.rule == "joint"}
    spread = {tick: float(np.trace(unpack(c.belief).covariance())) for tick, c in by_tick.items()}
    last = max(spread)
    assert last < team.world.tick
    assert spread[last] > spread[3]


def test_no_evidence_ends_a_board() -> None:
    """A member whose numbers are absurd: the joint may begin anew, and the boards go on."""
    team = InProcessTeam(JOINT)

    def spoil(envelope: Envelope) -> None:
        if envelope.key == "cop/t/a/forward/board-a" and envelope.payload not in spoilt:
            forward = decode(Forward, envelope.payload)
            worse = []
            for said in forward.evidence:
                far = said.evidence.travelled.model_copy(update={"distance": 1e12, "turn": -1e12, "heading": 1e12})
                absurd = said.evidence.model_copy(update={"travelled": far, "state": None})
                worse.append(said.model_copy(update={"tick": said.tick + 1, "evidence": absurd}))
            payload = encode(forward.model_copy(update={"evidence": worse}))
            spoilt.add(payload)
            team.bus.send(Envelope(envelope.key, payload))

    spoilt: set[bytes] = set()
    team.bus.spies.append(spoil)
    _, agreed = played(team)
    assert max(tick for tick, _ in agreed["b"]) == team.world.tick


def test_processes_that_are_started_again_do_not_break_the_joint() -> None:
    """What a robot says after it began anew is not taken for the continuation of what it said before."""
    team = InProcessTeam(JOINT.changed("time", seconds=5.5))
    heard = Heard(team.bus)

    def wait(ticks: int) -> None:
        until = team.world.tick + ticks
        team.run_until(lambda: team.world.tick >= until)

    wait(4)
    team.leave(team.robots["r1"])  # killed
    team.leave(team.boards["b"])
    wait(2)
    team.join(robot_of(JOINT, "r1"))
    team.boards["b"] = board_of(JOINT, "b")
    team.join(team.boards["b"])
    team.leave(team.robots["r2"])  # without network
    wait(3)
    team.join(team.robots["r2"])
    team.run()
    assert team.world.why == ""
    assert not any(board.refused["backwards"] or board.counters["joint_restarts"] for board in team.boards.values())
    truth = {shown.tick: shown.positions for shown in heard.of(keys.TRUTH)}
    for by in heard.agreed().values():
        for (tick, subject), consensus in by.items():
            if subject.startswith("robot/"):
                belief = unpack(consensus.belief)
                apart = belief.mean() - truth[tick][subject]
                squared = float(apart @ np.linalg.solve(belief.covariance(), apart))
                assert squared < 25.0, f"{subject} in tick {tick}: {squared:.0f} (chi-squared, 2 degrees of freedom)"
