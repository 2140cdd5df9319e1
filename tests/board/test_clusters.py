"""Sightings of a class on a board without a joint: clustered by their overlap, pooled as opinions are, under names that last."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from blackboard.board.board import Board
from blackboard.opinion.belief import Belief
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus, Report
from tests.board.reports import at, new_board, report, sees
from tests.holdings import holdings

Place = tuple[float, float]
HOMES = {"r1": (5.0, 5.0), "r2": (35.0, 5.0), "r3": (20.0, 25.0)}


def frame(robot: str, tick: int, places: Sequence[Place], rng: np.random.Generator, kind: str = "person/?") -> Report:
    """A robot's tick: it sees what is at some places, with an error of 0.5."""
    sightings = []
    for x, y in places:
        off_x, off_y = 0.5 * rng.standard_normal(2)
        sightings.append((kind, at(x + off_x, y + off_y, 0.7)))
    return sees(robot, at(*HOMES[robot], 0.5), sightings, tick)


def settled(board: Board, tick: int, reports: Sequence[Report]) -> dict[str, Consensus]:
    """What is agreed after the reports of a tick, without what is about robots of the team."""
    for message in reports:
        board.hear(message, float(tick))
    board.settle(tick, float(tick))
    return {c.subject: c for c in board.exchange(tick, float(tick)) if not c.subject.startswith("robot/")}


def where(agreed: Mapping[str, Consensus]) -> dict[str, Place]:
    means = {subject: unpack(consensus.belief).mean() for subject, consensus in agreed.items()}
    return {subject: (float(x), float(y)) for subject, (x, y) in means.items()}


def test_what_two_robots_see_of_two_people_is_two_tracks_that_rest_on_both() -> None:
    board, rng, people = new_board(), np.random.default_rng(1), [(12.0, 10.0), (25.0, 18.0)]
    for tick in range(4):
        agreed = settled(board, tick, [frame(robot, tick, people, rng) for robot in ("r1", "r2")])
    assert set(agreed) == {"person/a-1", "person/a-2"}
    assert sorted(where(agreed).values()) == [pytest.approx(place, abs=1.0) for place in people]
    for track in agreed.values():
        assert track.existence is not None
        assert track.existence > 0.99
        assert {robot.source for robot in track.used} == {"a"}
    assert all(set(track.ancestors) == {"r1", "r2"} for track in agreed.values())


def test_a_single_sighting_of_nothing_is_told_of_by_nobody() -> None:
    board, rng = new_board(), np.random.default_rng(2)
    for tick in range(8):
        agreed = settled(board, tick, [frame("r1", tick, [tuple(rng.uniform(2, 28, 2))], rng)])
        assert not agreed


@pytest.mark.parametrize("seed", range(3))
def test_the_order_in_which_reports_come_changes_nothing(seed: int) -> None:
    calm, mixed = new_board(), new_board()
    rng, order = np.random.default_rng(seed), np.random.default_rng(100 + seed)
    people = rng.uniform(4, 26, (4, 2))
    for tick in range(6):
        people = people + 0.3 * rng.standard_normal(people.shape)
        reports = [frame(robot, tick, [tuple(place) for place in people], rng) for robot in HOMES]
        shuffled = [reports[i] for i in order.permutation(len(reports))]
        agreed, again = settled(calm, tick, reports), settled(mixed, tick, [*shuffled, shuffled[0]])
        assert agreed == {s: track.model_copy(update={"board": agreed[s].board}) for s, track in again.items()}
    assert len(agreed) >= 3


@pytest.mark.parametrize("seed", range(5))
def test_people_who_cross_each_others_ways_keep_their_names(seed: int) -> None:
    board, rng = new_board(), np.random.default_rng(seed)
    names: dict[str, int] = {}
    for tick in range(20):
        people = [(8.0 + 1.2 * tick, 12.0), (32.0 - 1.2 * tick, 17.0)]
        places = where(settled(board, tick, [frame(robot, tick, people, rng) for robot in ("r1", "r2")]))
        for subject, place in places.items():
            nearest = min(range(2), key=lambda i: float(np.hypot(*np.subtract(place, people[i]))))
            assert names.setdefault(subject, nearest) == nearest
    assert len(names) == 2


def test_who_is_not_seen_any_more_is_forgotten_and_has_its_name_again_when_it_comes_back() -> None:
    board, rng, there = new_board(max_age=3.0, drift=0.3), np.random.default_rng(3), [(20.0, 12.0)]
    for tick in range(30):
        is_seen = tick < 6 or tick > 20
        agreed = settled(board, tick, [frame("r1", tick, there if is_seen else [], rng)])
        assert is_seen or tick < 9 or not agreed
    assert set(agreed) == {"person/a-1"}


def ghosts(tick: int, rng: np.random.Generator) -> Report:
    """A liar's tick: of 64 ghosts the 16 that a report can hold, each always at the same place."""
    places = [(2.0 + 2 * (i % 8), 16.0 + 1.6 * (i // 8)) for i in range(64)]
    some = [places[(16 * tick + i) % 64] for i in range(16)]
    return sees("r9", at(5, 20, 0.5), [("person/?", at(*place, 0.4)) for place in some], tick)


def test_a_robot_that_invents_64_ghosts_costs_the_others_nothing() -> None:
    calm, lied_to = new_board(), new_board()
    people = [(28.0, 5.0), (35.0, 12.0), (34.0, 25.0)]
    rng, liar = np.random.default_rng(4), np.random.default_rng(5)
    for tick in range(20):
        reports = [frame(robot, tick, people, rng) for robot in ("r2", "r3")]
        agreed = settled(calm, tick, reports)
        among = settled(lied_to, tick, [ghosts(tick, liar), *reports])
        honest = {s: track for s, track in among.items() if "r9" not in track.ancestors}
        assert sorted(track.belief.data for track in agreed.values()) == sorted(
            track.belief.data for track in honest.values()
        )
    assert len(agreed) == 3
    assert len(among) - len(honest) <= 16


def test_a_robot_without_a_name_that_is_where_a_mate_is_is_that_mate() -> None:
    board, rng = new_board(), np.random.default_rng(6)
    for tick in range(4):
        for message in (frame("r1", tick, [HOMES["r2"]], rng, "robot/?"), frame("r2", tick, [], rng)):
            board.hear(message, float(tick))
        agreed = {consensus.subject: consensus for consensus in board.settle(tick, float(tick))}
    assert set(agreed) == {"robot/r1", "robot/r2"}
    assert {opinion.source for opinion in agreed["robot/r2"].used} == {"r1", "r2"}
    assert [(share.source, share.mark, share.taken) for share in agreed["robot/r2"].unnamed] == [("r1", 0, True)]
    assert agreed["robot/r2"].existence is None


def test_an_opponent_is_an_object_and_no_member() -> None:
    board, rng = new_board(), np.random.default_rng(7)
    for tick in range(4):
        message = frame("r1", tick, [HOMES["r2"], (15.0, 20.0)], rng, "robot/?")
        agreed = settled(board, tick, [message, frame("r2", tick, [], rng)])
    assert set(agreed) == {"object/robot-a-1"}


def played(
    boards: Mapping[str, Board], tick: int, reports: Mapping[str, Sequence[Report]]
) -> list[dict[str, Consensus]]:
    """What the boards of two sub-teams agree on in a tick, each after the consensuses of both."""
    said: list[Consensus] = []
    for name, board in boards.items():
        for message in reports[name]:
            board.hear(message, float(tick))
        said += board.settle(tick, float(tick))
    for name, board in boards.items():
        for consensus in said:
            if consensus.sub_team != name:
                board.hear_consensus(consensus, float(tick))
        for other in boards.keys() - {name}:
            board.withdraw_consensuses(other, tick, [c.subject for c in said if c.sub_team == other])
    return [
        {c.subject: c for c in board.exchange(tick, float(tick)) if c.subject.startswith("person/")}
        for board in boards.values()
    ]


def test_two_sub_teams_have_one_name_for_what_both_see() -> None:
    boards, rng = {"a": new_board("a"), "b": new_board("b")}, np.random.default_rng(8)
    people = [(12.0, 10.0), (25.0, 18.0)]
    for tick in range(12):
        both = {"a": [frame("r1", tick, people, rng)], "b": [frame("r2", tick, people, rng)]}
        mine, its = played(boards, tick, both)
    assert set(mine) == set(its) == {"person/a-1", "person/a-2"}
    assert all({opinion.source for opinion in track.used} == {"a", "b"} for track in mine.values())
    assert {s: track.belief for s, track in mine.items()} == {s: track.belief for s, track in its.items()}


def test_a_board_that_was_started_again_takes_the_names_that_the_other_one_knows() -> None:
    boards, rng = {"a": new_board("a"), "b": new_board("b")}, np.random.default_rng(9)
    people = [(12.0, 10.0), (25.0, 18.0)]
    for tick in range(24):
        if tick == 12:
            before = where(played(boards, tick, {"a": [], "b": []})[1])
            boards["a"] = new_board("a")
            continue
        both = {"a": [frame("r1", tick, people, rng)], "b": [frame("r2", tick, people, rng)]}
        mine, its = played(boards, tick, both)
    assert set(mine) == set(its) == set(before) == {"person/a-1", "person/a-2"}
    assert all(place == pytest.approx(before[name], abs=2.0) for name, place in where(mine).items())
    assert all({opinion.source for opinion in track.used} == {"a", "b"} for track in mine.values())


def test_a_detector_that_is_hardly_sure_is_believed_later() -> None:
    def first(confidence: float) -> int:
        board = new_board()
        for tick in range(20):
            message = sees("r1", at(*HOMES["r1"], 0.5), [("person/?", at(20, 12, 0.7))], tick)
            unsure = [unnamed.model_copy(update={"confidence": confidence}) for unnamed in message.unnamed]
            if settled(board, tick, [message.model_copy(update={"unnamed": unsure})]):
                return tick
        return 20

    assert first(1.0) < first(0.2)


def test_a_board_with_a_joint_leaves_them_alone() -> None:
    board, rng = new_board(fusion="joint"), np.random.default_rng(10)
    for tick in range(4):
        assert not settled(board, tick, [frame("r1", tick, [(12.0, 10.0)], rng)])


def test_a_name_that_a_robot_gives_stands_beside_what_has_none() -> None:
    board, rng, ball = new_board(), np.random.default_rng(11), (18.0, 14.0)
    own: Belief = at(*ball, 0.7)
    for tick in range(4):
        named = report("r2", own, float(tick), tick=tick)
        agreed = settled(board, tick, [named, frame("r1", tick, [ball], rng, "object/ball?")])
    assert set(agreed) == {"object/ball"}


def test_a_robot_that_invents_classes_leaves_little_behind_and_nobody_forgets_a_class_for_it() -> None:
    board, rng = new_board(), np.random.default_rng(12)
    sizes = []
    for tick in range(40):
        invented = [(f"object/x{16 * tick + i}?", at(5 + i, 25, 0.5)) for i in range(16)]
        agreed = settled(
            board, tick, [sees("r9", at(5, 20, 0.5), invented, tick), frame("r1", tick, [(12.0, 10.0)], rng)]
        )
        sizes.append(sum(holdings(board, "board").values()))
    assert set(agreed) == {"person/a-1"}
    assert sizes[-1] <= sizes[20]
