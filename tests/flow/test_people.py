"""A team among people whom nobody names: every board tells of the same tracks, whatever the network does."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.lab.team import Team
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus
from tests.heard import Heard

PEOPLE = Scenario(
    {
        "team": {"name": "t", "sub_teams": {"a": ["r1", "r2"], "b": ["r3"]}},
        "grid": {"shape": [20, 20]},
        "time": {"tick": 0.5, "seconds": 12.0},
        "board": {"fusion": "joint"},
        "world": {
            "seed": 4,
            "objects": {},
            "people": {"count": 2, "speed": 0.5},
            "detector": {"missed": 0.1, "clutter": 0.1},
        },
    }
)

Told = dict[str, dict[tuple[int, str], Consensus]]  # sub-team -> (tick, track) -> what was agreed on


@cache
def played(shuffle: int | None) -> tuple[Told, dict[str, Any]]:
    team = Team(PEOPLE, None if shuffle is None else np.random.default_rng(shuffle))
    heard = Heard(team.bus)
    card = team.run()
    agreed = {s: heard.of(keys.AGREED, sub_team=s) for s in "ab"}
    told = {
        s: {(it.tick, it.subject): it for it in its if it.subject.startswith("person/")} for s, its in agreed.items()
    }
    return told, card["tracks"]["person"]


def test_people_become_tracks_near_where_they_are() -> None:
    told, judged = played(None)
    assert {subject for _, subject in told["a"]} >= {"person/1", "person/2"}
    assert all(it.existence is not None and it.existence > 0.5 for it in told["a"].values())
    assert judged["missed_share"] < 0.5
    assert judged["false_tracks"] == 0


def test_every_board_tells_of_the_same_tracks_to_the_bit() -> None:
    told, _ = played(None)
    assert told["a"].keys() == told["b"].keys()
    for name, it in told["a"].items():
        assert (it.belief, it.existence) == (told["b"][name].belief, told["b"][name].existence), name


def test_the_order_in_which_messages_come_changes_no_track() -> None:
    calm, shuffled = played(None)[0], played(1)[0]
    for sub_team, told in calm.items():
        assert {name: it.existence for name, it in told.items()} == {
            name: it.existence for name, it in shuffled[sub_team].items()
        }


def test_a_board_that_was_started_again_calls_people_as_the_other_board_does() -> None:
    team = Team(PEOPLE.changed("time", seconds=20.0))
    heard = Heard(team.bus)
    team.run_until(lambda: team.world.tick == 18)
    team.leave(team.boards["a"])
    team.run_until(lambda: team.world.tick == 20)
    team.boards["a"] = board_of(team.scenario, "a")
    team.join(team.boards["a"])
    team.run()
    mine, its = (
        {
            (it.tick, it.subject): unpack(it.belief).mean()
            for it in heard.of(keys.AGREED, sub_team=sub_team)
            if it.existence
        }
        for sub_team in "ab"
    )
    both = [name for name in mine if name[0] > 20 and name in its]
    assert len(both) > 0.7 * sum(tick > 20 for tick, _ in mine)
    assert sum(float(np.hypot(*(mine[name] - its[name]))) < 2.0 for name in both) > 0.9 * len(both)
    assert len({subject for _, subject in both}) >= 2


@pytest.mark.parametrize("fusion", ["joint", "opinions"])
def test_boards_that_were_all_started_again_give_no_name_that_was_given_before(fusion: str) -> None:
    team = Team(PEOPLE.changed("time", seconds=20.0).changed("board", fusion=fusion))
    heard = Heard(team.bus)
    team.run_until(lambda: team.world.tick == 18)
    for board in list(team.boards.values()):
        team.leave(board)
    for name in team.boards:
        team.boards[name] = board_of(team.scenario, name)
        team.join(team.boards[name])
    team.run()
    told = [(it.tick, it.subject) for s in "ab" for it in heard.of(keys.AGREED, sub_team=s) if it.existence is not None]
    before, after = ({name for tick, name in told if (tick > 18) == late} for late in (False, True))
    assert before
    assert after
    assert not before & after


#: Two people and an opponent, whom nobody names, in a team that knows where it is and keeps no joint.
OPINIONS = Scenario(
    {
        **PEOPLE.tables,
        "board": {"fusion": "opinions"},
        "world": {
            "seed": 4,
            "objects": {},
            "people": {"count": 2, "speed": 0.5},
            "detector": {"anonymous": ["person", "robot"], "missed": 0.1, "clutter": 0.1},
        },
    }
)


@cache
def pooled(shuffle: int | None) -> tuple[Told, dict[str, Any]]:
    team = Team(OPINIONS, None if shuffle is None else np.random.default_rng(shuffle))
    heard = Heard(team.bus)
    card = team.run()
    agreed = {s: heard.of(keys.AGREED, sub_team=s) for s in "ab"}
    told = {s: {(it.tick, it.subject): it for it in its} for s, its in agreed.items()}
    return told, card["tracks"]["person"]


def test_boards_of_opinions_have_tracks_that_are_near_people() -> None:
    told, judged = pooled(None)
    people = {name: it for name, it in told["a"].items() if name[1].startswith("person/")}
    assert people
    assert all(it.existence is not None and it.existence > 0.5 for it in people.values())
    assert any({one.source for one in it.used} == {"a", "b"} for it in people.values())
    assert judged["missed_share"] < 0.6
    assert judged["false_tracks"] <= 1


def test_boards_of_opinions_agree_on_tracks_to_the_bit_in_whichever_order_messages_come() -> None:
    told, shuffled = pooled(None)[0], pooled(1)[0]
    assert told["a"].keys() == told["b"].keys()
    for name, it in told["a"].items():
        others = told["b"][name], shuffled["a"][name], shuffled["b"][name]
        assert all((it.belief, it.existence) == (other.belief, other.existence) for other in others), name
