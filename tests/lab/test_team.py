"""A team in one process as a tool: its scorecard, its time, and who joins and leaves. What the team does is in tests/flow."""

from pathlib import Path

import pytest

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.errors import RunFailed, UserError
from blackboard.lab.team import InProcessTeam
from blackboard.net.scheduler import BEGIN
from blackboard.opinion.gaussian.once import settle_alone
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.types import Message
from tests.scenarios import JOINT, LEARNS, SCENARIO
from tests.sim_world.datasets import write


def test_a_run_gives_the_scorecard_with_what_everybody_sent_and_received() -> None:
    team = InProcessTeam(SCENARIO)
    envelopes: list[Envelope] = []
    team.bus.spies.append(envelopes.append)
    card = team.run()
    assert card["ticks"] == 5
    assert card["hash"] == team.world.referee.hash
    assert set(card["scores"]["robots"]["by_name"]) == {"r1", "r2", "r3"}
    assert 0 < card["messages"]["sent"] <= len(envelopes)
    assert card["messages"]["dropped"] == 0
    assert card["messages"]["refused"] == {}


@pytest.mark.parametrize(
    "scenario",
    [
        SCENARIO,
        LEARNS,
        JOINT.changed("robot", send={"budget": 2000.0}),
        JOINT.changed("world", people={"count": 2, "speed": 0.5}, detector={"anonymous": ["person"]}),
    ],
)
def test_what_is_heard_in_one_process_is_what_the_bytes_say(scenario: Scenario) -> None:
    team = InProcessTeam(scenario)
    envelopes: list[Envelope] = []
    team.bus.spies.append(envelopes.append)
    team.run()
    for envelope in envelopes:  # after the run, so that nobody changed what others had heard
        assert isinstance(envelope.message, Message)
        assert decode(type(envelope.message), envelope.payload) == envelope.message


def test_boards_that_are_settled_once_say_what_each_says_alone() -> None:
    assert InProcessTeam(JOINT).run()["hash"] == InProcessTeam(JOINT, settle=settle_alone).run()["hash"]


def test_time_moves_only_while_nothing_is_left_to_deliver() -> None:
    team = InProcessTeam(SCENARIO)
    assert team.now == BEGIN
    team.run_until(lambda: team.world.done)
    assert team.now - BEGIN < 1.0  # in lockstep nobody waits: everybody answers at once


def test_what_never_comes_about_is_given_up_after_its_seconds() -> None:
    team = InProcessTeam(SCENARIO)
    with pytest.raises(RunFailed, match="has not ended"):
        team.run_until(lambda: False, seconds=20.0)
    assert team.now < BEGIN + 21.0


def test_who_leaves_hears_nothing_more_and_may_come_back() -> None:
    team = InProcessTeam(SCENARIO)
    left = team.boards["b"]
    team.run_until(lambda: team.world.tick == 2)
    team.leave(left)
    heard = left.counters["heard"]
    team.join(board_of(SCENARIO, "b"))
    card = team.run()
    assert left.counters["heard"] == heard
    assert card["ticks"] == 5
    with pytest.raises(KeyError):
        team.leave(left)


def test_a_recorded_team_runs_too(tmp_path: Path) -> None:
    write(tmp_path)
    tables = {"kind": "mrclam", "dir": str(tmp_path), "start": 1001.0}
    grid = {"shape": [70, 120], "cell": 0.1, "origin": [-1.0, -5.5], "unit": "m"}
    scenario = Scenario(
        {
            "team": {"sub_teams": {"a": ["r1", "r2"]}},
            "world": tables,
            "time": {"seconds": 3.0, "tick": 1.0},
            "grid": grid,
        }
    )
    card = InProcessTeam(scenario).run()
    assert (card["unit"], card["ticks"]) == ("m", 3)


def test_a_mistake_in_a_scenario_is_a_user_error() -> None:
    with pytest.raises(UserError, match="robot.localizer"):
        InProcessTeam(Scenario({"robot": {"localizer": "gps"}}))
