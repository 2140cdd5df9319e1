"""A whole team in one process: real services and bytes, any order of arrival, losses, deaths and liars."""

import dataclasses

import numpy as np
import pytest

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.raw import MAX_BYTES
from tests.flow.streams import lose_some
from tests.heard import Heard
from tests.scenarios import SCENARIO


def team_of(scenario: Scenario = SCENARIO, shuffle: int | None = None) -> InProcessTeam:
    """The team of a scenario, its envelopes shuffled by a seed."""
    return InProcessTeam(scenario, None if shuffle is None else np.random.default_rng(shuffle))


def run(team: InProcessTeam) -> str:
    """Run to the end, which must be the regular one; the hash over all consensuses."""
    team.run()
    assert team.world.why == ""
    return team.world.referee.hash


@pytest.fixture(scope="module")
def calm() -> str:
    return run(team_of())


def test_the_order_of_arrival_changes_no_bit(calm: str) -> None:
    assert run(team_of(shuffle=1)) == calm


def test_another_seed_is_another_run(calm: str) -> None:
    assert run(team_of(SCENARIO.changed("world", seed=4))) != calm


def test_what_is_lost_is_asked_for_again(calm: str) -> None:
    """Every 17th message disappears; the world repeats its tick until everybody has answered."""
    team = team_of()
    lose_some(team)
    assert run(team)
    assert team.world.counters["repeated"] > 0


def test_hostile_bytes_change_no_consensus(calm: str) -> None:
    """An attacker answers every report with garbage in all its forms; all of it is counted, none changes a bit."""
    team = team_of()

    def attack(envelope: Envelope) -> None:
        if "/report/r" not in envelope.key or envelope.payload in bad:
            return
        for payload in bad:
            team.bus.send(dataclasses.replace(envelope, payload=payload))
        team.bus.send(dataclasses.replace(envelope, key=envelope.key.replace("/report/r", "/report/x")))

    bad = [b"", b"\xff" * 10, b"\x81\xa7version\x02", b"\x81\xa7version\x01", bytes(2 * MAX_BYTES)]
    team.bus.spies.append(attack)
    assert run(team) == calm
    for attacked in team.boards.values():
        assert min(attacked.refused[r] for r in ("not-msgpack", "version", "fields", "too-large", "impostor")) > 0


def test_robots_survive_hostile_boards(calm: str) -> None:
    team = team_of()
    team.bus.send(Envelope(keys.AGREED.key(team="t", sub_team="a", subject="robot/r1"), b"\x00"))
    team.bus.send(Envelope(keys.CLOCK.key(team="t"), b"nonsense"))
    assert run(team) == calm
    assert sum(team.robots["r1"].refused.values()) == 2


def test_a_dead_robot_does_not_stop_the_team() -> None:
    team = team_of()
    team.run_until(lambda: team.world.tick == 2)
    team.leave(team.robots["r2"])
    run(team)
    assert team.world.referee.hash


def test_a_board_that_is_started_again_takes_up_its_work() -> None:
    team = team_of()
    heard = Heard(team.bus)
    team.run_until(lambda: team.world.tick == 2)
    team.leave(team.boards["b"])
    team.run_until(lambda: team.world.tick == 4)
    team.join(board_of(SCENARIO, "b"))
    run(team)
    assert heard.of(keys.AGREED, sub_team="b")[-1].tick == 5


def test_feedback_settings_give_different_teams(calm: str) -> None:
    hashes = {feedback: run(team_of(SCENARIO.changed("board", feedback=feedback))) for feedback in ("paper", "off")}
    assert len({calm, *hashes.values()}) == 3


def test_after_the_exchange_both_sub_teams_agree() -> None:
    team = team_of()
    heard = Heard(team.bus)
    run(team)
    first, second = (
        {(consensus.tick, consensus.subject): consensus.belief for consensus in heard.of(keys.AGREED, sub_team=s)}
        for s in "ab"
    )
    assert first == second
    assert {tick for tick, _ in first} == set(range(6))
