"""What the exchange between boards holds on to, and what it lets go."""

import pytest

from blackboard.lab.team import InProcessTeam
from blackboard.wire import keys
from tests.board.reports import at, new_board, said_by
from tests.heard import Heard
from tests.scenarios import SCENARIO


def test_what_another_board_lists_no_longer_is_not_agreed_any_more() -> None:
    board = new_board()
    for subject in ("robot/r1", "object/ball"):
        board.hear_consensus(said_by("b", at(10, 10, 2), subject=subject, time=0.2, tick=1), 0.2)
    board.withdraw_consensuses("b", 2, ["object/ball"])
    assert [c.subject for c in board.exchange(2, 0.4)] == ["object/ball"]
    board.withdraw_consensuses("c", 3, [])
    assert [c.subject for c in board.exchange(3, 0.6)] == ["object/ball"]
    board.withdraw_consensuses("b", 1, [])  # an old list takes nothing back that is newer
    assert [c.subject for c in board.exchange(3, 0.6)] == ["object/ball"]


@pytest.mark.team
def test_a_sighting_of_another_sub_teams_robot_is_agreed_on_only_while_it_is_in_view() -> None:
    """Three robots: what the board of `b` believes about r1, by the sightings of r3, is gone once r3 sees it no longer."""
    scenario = SCENARIO.changed("grid", shape=[30, 30]).changed("time", seconds=15.0)
    team = InProcessTeam(scenario.changed("board", feedback="off"))
    heard = Heard(team.bus)
    team.run()
    settled = [status for status in heard.of(keys.STATUS, process="board-b") if status.phase == "consensus"]
    in_view = {status.tick: "robot/r1" in status.subjects for status in settled}
    assert set(in_view.values()) == {True, False}, "r1 comes into view and leaves it"
    for agreed in heard.of(keys.AGREED, sub_team="a", subject="robot/r1"):
        assert ("b" in {opinion.source for opinion in agreed.used}) == in_view[agreed.tick], agreed.tick
