"""A robot learns why its reports are refused; the status of a board places the team's grid; frames are compared by name."""

from dataclasses import replace

import pytest

from blackboard.board.service import BoardService
from blackboard.config import BoardSection, Scenario
from blackboard.errors import Refused, UserError
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Anchor, Grid
from blackboard.process.refusals import in_words
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack, unpacked_grid
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import PackedAnchor, Refusal, Status
from tests.board.desk import GRID, Desk, ball, board_of, leading, report


def refusals(said: list[Envelope]) -> list[Refusal]:
    return [decode(Refusal, e.payload) for e in said if keys.REFUSED.match(e.key)]


def free(*robots: str) -> Desk:
    desk = Desk(world=False)
    desk.tell(board_of("a"))
    desk.register(*robots)
    return desk


def test_a_robot_is_told_what_of_it_was_refused_and_why() -> None:
    desk = free("r1")
    desk.tell(report("r1", 1, gaussian(Grid((9, 9)), (3, 3), 1.0), time=desk.now))
    (refusal,) = refusals(desk.said)
    assert (refusal.board, refusal.sub_team, refusal.robot, refusal.subject, refusal.reason, refusal.count) == (
        "a", "a", "r1", "object/ball", "grid", 1,
    )  # fmt: skip
    assert "(9, 9)" in refusal.text
    assert in_words(refusal).startswith("a refused the report about object/ball of r1 (grid: a belief on (9, 9) cells")
    (envelope,) = [e for e in desk.said if keys.REFUSED.match(e.key)]
    assert envelope.key == "cop/t/a/refused/r1"


def test_a_robot_without_a_token_is_told_once_it_had_time_to_come() -> None:
    desk = free()
    desk.tell(report("r1", 1, time=desk.now))
    desk.wait(0.5)
    assert refusals(desk.said) == []
    desk.wait(1.0)
    assert [refusal.reason for refusal in refusals(desk.said)] == ["unregistered"]


def test_a_robot_whose_token_came_later_than_its_report_is_told_nothing() -> None:
    desk = free()
    desk.tell(report("r1", 1, time=desk.now))
    desk.register("r1")
    for _ in range(4):
        desk.wait(1.0)
    assert refusals(desk.said) == []


def test_of_two_boards_the_one_that_follows_is_silent() -> None:
    desk = free("r1")
    desk.tell(board_of("a", name="0a"), leading("0a"))
    desk.tell(report("r1", 1, gaussian(Grid((9, 9)), (3, 3), 1.0), time=desk.now))
    desk.wait(5.0)
    assert refusals(desk.said) == []
    assert desk.status().refused == {"grid": 1}


# --- frames ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("theirs", "ours", "taken"), [
    ("map", "map", True), ("", "map", True), ("odom", "", True), ("odom", "map", False),
])  # fmt: skip
def test_a_belief_in_another_frame_is_refused_where_both_name_one(theirs: str, ours: str, taken: bool) -> None:
    packed = pack(gaussian(replace(GRID, frame=theirs), (3, 3), 1.0))
    team = replace(GRID, frame=ours)
    if taken:
        assert unpack(packed, team).grid == team
    else:
        with pytest.raises(Refused, match="^frame: a belief in frame 'odom', the team's is 'map'$"):
            unpack(packed, team)


def test_a_grid_without_a_frame_costs_no_byte_on_the_wire() -> None:
    assert "frame" not in pack(ball()).model_dump(exclude_defaults=True)["grid"]


def test_the_status_of_a_board_places_the_team_s_grid() -> None:
    section = {
        "shape": [30, 20],
        "unit": "m",
        "frame": "map",
        "anchor": {"latitude": 59.3, "longitude": 18.1, "bearing": 45},
    }
    grid = Scenario({"grid": section}).grid
    assert grid == Grid((30, 20), unit="m", frame="map")
    assert grid.anchor == Anchor(59.3, 18.1, 45.0)
    board = BoardService(team="t", sub_team="a", board="a", grid=grid, settings=BoardSection())
    status = [decode(Status, e.payload) for e in board.wake(100.0) if "/status/" in e.key][-1]
    assert status.grid is not None
    assert unpacked_grid(status.grid) == grid
    assert status.anchor == PackedAnchor(latitude=59.3, longitude=18.1, bearing=45.0)


@pytest.mark.parametrize(("section", "names"), [
    ({"frame": "x" * 65}, "grid.frame"),
    ({"anchor": {"latitude": 91, "longitude": 0}}, "grid.anchor.latitude"),
    ({"anchor": {"latitude": 1}}, "grid.anchor.longitude"),
])  # fmt: skip
def test_a_frame_or_anchor_that_is_none_is_one_line(section: dict[str, object], names: str) -> None:
    with pytest.raises(UserError, match=names):
        _ = Scenario({"grid": section}).grid
