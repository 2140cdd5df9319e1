"""The referee on things that nobody names: what was agreed on is compared with whatever is there."""

from dataclasses import replace

import pytest

from blackboard.judge.card import scorecard, text
from blackboard.judge.referee import Referee
from blackboard.wire.messages import UnnamedSighting
from tests.judge.instants import at, both, new_instant, referee
from tests.judge.results import RESULT

PLACES = {"robot/r1": (2.5, 2.5), "robot/r9": (9.5, 2.5), "object/ball": (5.5, 5.5), "person/p1": (8.5, 8.5)}


def shown(judge: Referee) -> list[str]:
    """The lines of the scorecard that are about tracks."""
    card = scorecard(replace(RESULT, judgement=judge.judgement()))
    return [line for line in text(card).splitlines() if line.startswith("tracks of")]


def test_tracks_are_compared_with_things_of_their_kind_alone() -> None:
    judge = referee(unnamed=["person"])
    instant = new_instant(PLACES)
    both(instant, "a", "person/1", at(8, 8), at(8, 8))
    both(instant, "a", "object/ball", at(5, 5), at(5, 5))
    judge.judge_instant(instant, judged=True)
    (summary,) = judge.judgement().tracks.values()
    assert (summary["gospa"], summary["missed"], summary["false"]) == (0.0, 0.0, 0.0)


def test_of_robots_those_of_the_team_are_no_tracks_and_strangers_are() -> None:
    judge = referee(unnamed=["robot"])
    instant = new_instant(PLACES)
    both(instant, "a", "robot/r1", at(2, 2), at(2, 2))
    both(instant, "a", "robot/1", at(0, 9), at(0, 9))
    judge.judge_instant(instant, judged=True)
    summary = judge.judgement().tracks["robot"]
    assert (summary["missed_share"], summary["false_tracks"]) == (1.0, 1), "r9 is of no team, and nobody is at (0, 9)"


def test_a_track_of_a_robot_of_no_team_is_judged_as_a_robot_and_so_is_its_existence() -> None:
    judge = referee(unnamed=["robot", "object"])
    instant = new_instant(PLACES)
    both(instant, "a", "object/robot-1", at(9, 2), at(9, 2), existence=0.9)
    judge.judge_instant(instant, judged=True)
    tracks = judge.judgement().tracks
    assert (tracks["robot"]["missed"], tracks["robot"]["false"]) == (0.0, 0.0)
    assert tracks["robot"]["existence"]["brier"] == pytest.approx(0.01)
    assert tracks["object"]["false"] == 0.0


def test_an_unnamed_object_is_missing_nowhere() -> None:
    for unnamed, missing in ((["object"], False), (["person"], True)):
        judge = referee(unnamed=unnamed)
        judge.judge_instant(new_instant(PLACES, tick=100), judged=True)
        assert ("object/ball" in judge.missing()) == missing


def test_whom_a_sighting_was_taken_for_is_compared_with_whom_it_shows() -> None:
    judge = referee(unnamed=["robot"])
    instant = new_instant(
        {"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)}, unnamed={"r1": ["robot/r2", "robot/r2", ""]}
    )

    def said(mark: int, probability: float, time: float = instant.truth.time) -> UnnamedSighting:
        return UnnamedSighting(source="r1", time=time, mark=mark, probability=probability, taken=probability > 0.95)

    both(
        instant,
        "a",
        "robot/r2",
        at(5, 5),
        at(5, 5),
        unnamed=[said(0, 0.97), said(1, 0.4), said(2, 1.0), said(0, 1.0, 9.0)],
    )
    both(instant, "b", "robot/r2", at(5, 5), at(5, 5), unnamed=[said(0, 0.97)])  # of the same sighting
    judge.judge_instant(instant, judged=True)
    identities = judge.judgement().identities
    assert (identities["n"], identities["taken"], identities["wrong"]) == (3, 2, 1)
    assert identities["odds"]["brier"] == pytest.approx((0.03**2 + 0.6**2 + 1.0) / 3)


def test_of_a_track_nobody_says_that_it_is_a_wrong_person() -> None:
    judge = referee(unnamed=["person"])
    instant = new_instant(PLACES, unnamed={"r1": ["person/p1"]})
    said = UnnamedSighting(source="r1", time=instant.truth.time, mark=0, probability=1.0, taken=True)
    both(instant, "a", "person/1", at(8, 8), at(8, 8), unnamed=[said])
    judge.judge_instant(instant, judged=True)
    assert judge.judgement().identities == {"n": 1, "taken": 0, "wrong": 0, "odds": {}}


def test_where_all_is_named_there_is_no_entry_and_no_line() -> None:
    judge = referee(unnamed=["person"])
    judge.judge_instant(new_instant({"robot/r1": (2.5, 2.5)}), judged=True)
    assert judge.judgement().tracks == {}
    assert shown(judge) == []


def test_the_line_has_the_distance_and_its_parts() -> None:
    judge = referee(unnamed=["person"])
    judge.judge_instant(new_instant(PLACES), judged=True)
    (line,) = shown(judge)
    assert "tracks of person: GOSPA 2.121 cell (its square is localisation 0.000, missed 4.500, false 0.000)" in line
    assert line.endswith("0 switches, 0 false tracks")
