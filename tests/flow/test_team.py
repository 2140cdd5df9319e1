"""A whole team in one process: real services and bytes, any order of arrival, losses, deaths and liars."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.service import BoardService
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import MAX_BYTES, Consensus
from robot_agent.config import RobotSection
from robot_agent.service import AgentService
from sim_world.__main__ import source
from sim_world.referee import Referee
from sim_world.scenario import WorldSection
from sim_world.service import WorldService
from tests.team import Bus

SCENARIO = Scenario(
    {
        "team": {"name": "t", "sub_teams": {"a": ["r1", "r2"], "b": ["r3"]}},
        "grid": {"shape": [24, 24]},
        "time": {"tick": 0.5, "seconds": 2.5},
        "world": {"seed": 3},
    }
)


class Team:
    """The processes of a scenario on a bus."""

    def __init__(self, scenario: Scenario = SCENARIO, shuffle: int | None = None) -> None:
        team, settings = scenario.team, scenario.section("world", WorldSection)
        self.world = WorldService(scenario, source(scenario), Referee(scenario.grid, settings.check, team.robots))
        self.boards = {s: self.board(scenario, s) for s in team.sub_teams}
        self.robots = {r: self.robot(scenario, r) for r in team.robots}
        rng = None if shuffle is None else np.random.default_rng(shuffle)
        self.bus = Bus([*self.boards.values(), *self.robots.values(), self.world], rng)

    @staticmethod
    def board(scenario: Scenario, sub_team: str) -> BoardService:
        name = scenario.team.name
        return BoardService(team=name, sub_team=sub_team, board=sub_team, grid=scenario.grid, settings=scenario.board)

    @staticmethod
    def robot(scenario: Scenario, robot: str) -> AgentService:
        return AgentService(
            team=scenario.team.name,
            sub_teams=[s for s, names in scenario.team.sub_teams.items() if robot in names],
            robot=robot,
            grid=scenario.grid,
            settings=scenario.section("robot", RobotSection),
            feedback=scenario.board.feedback,
        )

    def run(self) -> str:
        """To the end; the hash over all consensuses."""
        self.bus.run(lambda: self.world.done)
        assert self.world.why == ""
        return self.world.referee.hash


@pytest.fixture(scope="module")
def calm() -> str:
    return Team().run()


@pytest.mark.parametrize("shuffle", [1, 2])
def test_the_order_of_arrival_changes_no_bit(calm: str, shuffle: int) -> None:
    assert Team(shuffle=shuffle).run() == calm


def test_another_seed_is_another_run(calm: str) -> None:
    assert Team(SCENARIO.changed("world", seed=4)).run() != calm


def test_what_is_lost_is_asked_for_again(calm: str) -> None:
    """Every 17th message disappears; the world repeats its tick until everybody has answered."""
    team = Team()
    count = 0

    def lose(envelope: Envelope) -> bool:
        nonlocal count
        count += 1
        return count % 17 == 0 and "/world/" not in envelope.key

    team.bus.lose = lose
    assert team.run()
    assert team.world.counters["repeated"] > 0


def test_hostile_bytes_change_no_consensus(calm: str) -> None:
    """An attacker answers every report with garbage in all its forms; all of it is counted, none changes a bit."""
    team = Team()

    def attack(envelope: Envelope) -> None:
        if "/report/r" not in envelope.key or envelope.payload in bad:
            return
        for payload in bad:
            team.bus.send(dataclasses.replace(envelope, payload=payload))
        team.bus.send(dataclasses.replace(envelope, key=envelope.key.replace("/report/r", "/report/x")))

    bad = [b"", b"\xff" * 10, b"\x81\xa7version\x02", b"\x81\xa7version\x01", bytes(2 * MAX_BYTES)]
    team.bus.spies.append(attack)
    assert team.run() == calm
    for board in team.boards.values():
        assert min(board.refused[r] for r in ("not-msgpack", "version", "fields", "too-large", "impostor")) > 0


def test_robots_survive_hostile_boards(calm: str) -> None:
    team = Team()
    team.bus.send(Envelope(keys.AGREED.key(team="t", sub_team="a", subject="robot/r1"), b"\x00"))
    team.bus.send(Envelope(keys.CLOCK.key(team="t"), b"nonsense"))
    assert team.run() == calm
    assert sum(team.robots["r1"].refused.values()) == 2


def test_a_dead_robot_does_not_stop_the_team() -> None:
    team = Team()
    team.bus.run(lambda: team.world.tick == 2)
    team.bus.leave(team.robots["r2"])
    team.run()
    assert team.world.referee.hash


def test_a_board_that_is_started_again_takes_up_its_work() -> None:
    team = Team()
    heard: list[Consensus] = []
    team.bus.run(lambda: team.world.tick == 2)
    team.bus.leave(team.boards["b"])
    team.bus.run(lambda: team.world.tick == 4)
    team.bus.join(Team.board(SCENARIO, "b"))
    team.bus.spies.append(lambda e: heard.append(decode(Consensus, e.payload)) if "/t/b/agreed/" in e.key else None)
    team.run()
    assert heard[-1].tick == 5


def test_feedback_settings_give_different_teams(calm: str) -> None:
    hashes = {feedback: Team(SCENARIO.changed("board", feedback=feedback)).run() for feedback in ("paper", "off")}
    assert len({calm, *hashes.values()}) == 3


def test_after_the_exchange_both_sub_teams_agree() -> None:
    team = Team()
    agreed: dict[tuple[int, str], set[bytes]] = {}

    def note(envelope: Envelope) -> None:
        if "/agreed/" in envelope.key:
            c = decode(Consensus, envelope.payload)
            agreed.setdefault((c.tick, c.subject), set()).add(repr(c.belief).encode())

    team.bus.spies.append(note)
    team.run()
    assert agreed
    assert all(len(beliefs) == 1 for beliefs in agreed.values())
