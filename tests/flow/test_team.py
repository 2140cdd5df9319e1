"""A whole team in one process: real services and bytes, any order of arrival, losses, deaths and liars."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.raw import MAX_BYTES
from tests.flow.streams import lose_some
from tests.heard import Agreed, played
from tests.scenarios import JOINT, SCENARIO

both = pytest.mark.parametrize("scenario", [SCENARIO, JOINT], ids=["opinions", "joint"])


@cache
def calm(scenario: Scenario = SCENARIO) -> tuple[str, Agreed]:
    return played(InProcessTeam(scenario))


@both
def test_the_order_of_arrival_changes_no_bit(scenario: Scenario) -> None:
    assert played(InProcessTeam(scenario, np.random.default_rng(1)))[0] == calm(scenario)[0]


@both
def test_what_is_lost_is_asked_for_again(scenario: Scenario) -> None:
    """Every 17th message disappears; the world repeats its tick until everybody has answered."""
    team = InProcessTeam(scenario)
    lose_some(team)
    _, agreed = played(team)
    assert team.world.counters["repeated"] > 0
    assert max(tick for tick, _ in agreed["a"]) == team.world.tick


@both
def test_after_the_exchange_every_board_has_the_same_to_the_bit(scenario: Scenario) -> None:
    mine, theirs = (calm(scenario)[1][sub_team] for sub_team in "ab")
    assert mine.keys() == theirs.keys() >= {(tick, f"robot/r{n}") for tick in range(6) for n in (1, 2, 3)}
    for name, consensus in mine.items():
        assert (consensus.belief, consensus.state) == (theirs[name].belief, theirs[name].state), name


def test_other_seeds_and_feedback_are_other_runs() -> None:
    others = [SCENARIO.changed("board", feedback=feedback) for feedback in ("paper", "off")]
    others.append(SCENARIO.changed("world", seed=4))
    assert len({calm(scenario)[0] for scenario in (SCENARIO, *others)}) == 4


def test_hostile_bytes_change_no_consensus() -> None:
    """An attacker answers every report with garbage in all its forms; all of it is counted, none changes a bit."""
    team = InProcessTeam(SCENARIO)

    def attack(envelope: Envelope) -> None:
        if "/report/r" not in envelope.key or envelope.payload in bad:
            return
        for payload in bad:
            team.bus.send(dataclasses.replace(envelope, payload=payload))
        team.bus.send(dataclasses.replace(envelope, key=envelope.key.replace("/report/r", "/report/x")))

    bad = [b"", b"\xff" * 10, b"\x81\xa7version\x02", b"\x81\xa7version\x01", bytes(2 * MAX_BYTES)]
    team.bus.spies.append(attack)
    assert played(team)[0] == calm()[0]
    for attacked in team.boards.values():
        assert min(attacked.refused[r] for r in ("not-msgpack", "version", "fields", "too-large", "impostor")) > 0


def test_robots_survive_hostile_boards() -> None:
    team = InProcessTeam(SCENARIO)
    team.bus.send(Envelope(keys.AGREED.key(team="t", sub_team="a", subject="robot/r1"), b"\x00"))
    team.bus.send(Envelope(keys.CLOCK.key(team="t"), b"nonsense"))
    assert played(team)[0] == calm()[0]
    assert sum(team.robots["r1"].refused.values()) == 2


def test_a_board_that_is_started_again_takes_up_its_work() -> None:
    team = InProcessTeam(SCENARIO)
    team.run_until(lambda: team.world.tick == 2)
    team.leave(team.boards["b"])
    team.run_until(lambda: team.world.tick == 4)
    team.join(board_of(SCENARIO, "b"))
    _, agreed = played(team)
    assert max(tick for tick, _ in agreed["b"]) == 5
