"""A team among people whom nobody names: every board tells of the same tracks, whatever the network does."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.lab.team import InProcessTeam
from blackboard.wire.arrays import unpack
from tests.heard import Agreed, Heard
from tests.scenarios import JOINT

PEOPLE = (
    JOINT.changed("grid", shape=[20, 20])
    .changed("time", seconds=12.0)
    .changed("world", seed=4, objects={}, people={"count": 2, "speed": 0.5}, detector={"missed": 0.1, "clutter": 0.1})
)

TEAM = ("robot/r1", "robot/r2", "robot/r3")


@cache
def played(scenario: Scenario = PEOPLE, shuffle: int | None = None) -> tuple[Agreed, dict[str, Any]]:
    """What was agreed on about all but the robots of the team, and how the tracks of people are judged."""
    team = InProcessTeam(scenario, None if shuffle is None else np.random.default_rng(shuffle))
    heard = Heard(team.bus)
    card = team.run()
    tracks = {
        s: {name: track for name, track in its.items() if name[1] not in TEAM} for s, its in heard.agreed().items()
    }
    return tracks, card["tracks"]["person"]


def test_people_become_tracks_near_where_they_are() -> None:
    tracks, judged = played()
    assert {subject for _, subject in tracks["a"]} >= {"person/1", "person/2"}
    assert all(track.existence is not None and track.existence > 0.5 for track in tracks["a"].values())
    assert judged["missed_share"] < 0.5
    assert judged["false_tracks"] == 0


def test_a_board_that_was_started_again_calls_people_as_the_other_board_does() -> None:
    team = InProcessTeam(PEOPLE.changed("time", seconds=20.0))
    heard = Heard(team.bus)
    team.run_until(lambda: team.world.tick == 18)
    team.leave(team.boards["a"])
    team.run_until(lambda: team.world.tick == 20)
    team.boards["a"] = board_of(team.scenario, "a")
    team.join(team.boards["a"])
    team.run()
    agreed = heard.agreed()
    mine, its = (
        {name: unpack(track.belief).mean() for name, track in agreed[s].items() if track.existence} for s in "ab"
    )
    both = [name for name in mine if name[0] > 20 and name in its]
    assert len(both) > 0.7 * sum(tick > 20 for tick, _ in mine)
    assert sum(float(np.hypot(*(mine[name] - its[name]))) < 2.0 for name in both) > 0.9 * len(both)
    assert len({subject for _, subject in both}) >= 2


@pytest.mark.parametrize("fusion", ["joint", "opinions"])
def test_boards_that_were_all_started_again_give_no_name_that_was_given_before(fusion: str) -> None:
    team = InProcessTeam(PEOPLE.changed("time", seconds=20.0).changed("board", fusion=fusion))
    heard = Heard(team.bus)
    team.run_until(lambda: team.world.tick == 18)
    for board in list(team.boards.values()):
        team.leave(board)
    for name in team.boards:
        team.boards[name] = board_of(team.scenario, name)
        team.join(team.boards[name])
    team.run()
    tracks = [name for its in heard.agreed().values() for name, track in its.items() if track.existence is not None]
    before, after = ({name for tick, name in tracks if (tick > 18) == late} for late in (False, True))
    assert before
    assert after
    assert not before & after


#: Two people and an opponent, whom nobody names, in a team that knows where it is and keeps no joint.
OPINIONS = PEOPLE.changed("board", fusion="opinions").changed(
    "world", detector={"anonymous": ["person", "robot"], "missed": 0.1, "clutter": 0.1}
)


def test_boards_of_opinions_have_tracks_that_are_near_people() -> None:
    tracks, judged = played(OPINIONS)
    people = {name: track for name, track in tracks["a"].items() if name[1].startswith("person/")}
    assert people
    assert all(track.existence is not None and track.existence > 0.5 for track in people.values())
    assert any({opinion.source for opinion in track.used} == {"a", "b"} for track in people.values())
    assert judged["missed_share"] < 0.6
    assert judged["false_tracks"] <= 1


@pytest.mark.parametrize("scenario", [PEOPLE, OPINIONS], ids=["joint", "opinions"])
def test_boards_agree_on_tracks_to_the_bit_in_whichever_order_messages_come(scenario: Scenario) -> None:
    tracks, shuffled = played(scenario)[0], played(scenario, 1)[0]
    assert tracks["a"].keys() == tracks["b"].keys()
    for name, track in tracks["a"].items():
        others = tracks["b"][name], shuffled["a"][name], shuffled["b"][name]
        assert all((track.belief, track.existence) == (other.belief, other.existence) for other in others), name
