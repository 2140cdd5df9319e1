"""What the exchange between boards holds on to, and what it lets go."""

from __future__ import annotations

import pytest

from blackboard.config import Scenario
from blackboard.lab.team import Team
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Status
from tests.board.reports import at, board, said_by


def test_what_another_board_lists_no_longer_is_not_agreed_any_more() -> None:
    it = board()
    for subject in ("robot/r1", "object/ball"):
        it.hear_consensus(said_by("b", at(10, 10, 2), subject=subject, time=0.2, tick=1), 0.2)
    it.withdraw_consensuses("b", 2, ["object/ball"])
    assert [c.subject for c in it.exchange(2, 0.4)] == ["object/ball"]
    it.withdraw_consensuses("c", 3, [])
    assert [c.subject for c in it.exchange(3, 0.6)] == ["object/ball"]
    it.withdraw_consensuses("b", 1, [])  # an old list takes nothing back that is newer
    assert [c.subject for c in it.exchange(3, 0.6)] == ["object/ball"]


@pytest.mark.team
def test_a_sighting_of_another_sub_teams_robot_is_agreed_on_only_while_it_is_in_view() -> None:
    """Three robots: what the board of `b` believes about r1, by the sightings of r3, is gone once r3 sees it no longer."""
    scenario = Scenario(
        {
            "team": {"name": "t", "sub_teams": {"a": ["r1", "r2"], "b": ["r3"]}},
            "grid": {"shape": [30, 30]},
            "time": {"tick": 0.5, "seconds": 15.0},
            "board": {"feedback": "off"},
            "world": {"seed": 3},
        }
    )
    team = Team(scenario)
    listed: dict[int, set[str]] = {}
    used: list[tuple[int, set[str]]] = []

    def watch(envelope: Envelope) -> None:
        if envelope.key == "cop/t/b/status/board-b":
            status = decode(Status, envelope.payload)
            if status.phase == "consensus":
                listed[status.tick] = set(status.subjects)
        elif envelope.key == "cop/t/a/agreed/robot/r1":
            agreed = decode(Consensus, envelope.payload)
            used.append((agreed.tick, {one.source for one in agreed.used}))

    team.bus.spies.append(watch)
    team.run()
    assert {"robot/r1" in subjects for subjects in listed.values()} == {True, False}, "r1 comes into view and leaves it"
    for tick, sub_teams in used:
        assert ("b" in sub_teams) == ("robot/r1" in listed[tick]), tick
