"""Nights of a seed, as `make nights` lives through thousands of them; and that a night is data."""

import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.files import ROOT
from tests.nights import faults, night
from tests.nights.faults import Fault, OnWay
from tests.nights.night import LAST, Night, Team, draw_night
from tests.nights.run import live

NIGHTS = 50  # of those that `.ci/run` lives through
PART = 2  # nights of one test


@pytest.mark.parametrize("first", range(0, NIGHTS, PART))
def test_nights(first: int) -> None:
    for number in range(first, first + PART):
        drawn = draw_night(1, number)
        assert live(drawn) is None, drawn


def test_robots_that_enter_again_count_no_evidence_twice() -> None:
    team = Team(
        {"a": ("r1", "r3"), "b": ("r2",)}, "lockstep", 2, tick=1.0, latency=0.2, fusion="joint", feedback="paper"
    )
    drawn = (
        faults.ClockOff(6.51, 6.56, "world", 3.0, -0.05),
        faults.AnotherBoard(0.0, 8.5, "b", "a-first", hangs=True),
    )
    assert live(Night(team, drawn, 1367784387)) is None


def test_a_robot_counts_whose_motion_alone_fits_its_link() -> None:
    team = Team({"a": ("r1",), "b": ("r1", "r2")}, "free", 1, 1.0, 1.0, 0.001, "joint", budget=600.0)
    assert live(Night(team, (), 1169596795)) is None


def test_what_boards_settled_of_one_tick_was_said_once_when_the_run_ends_there() -> None:
    team = Team({"a": ("r1",), "b": ("r2",)}, "realtime", 2, 1.0, 1.0, 0.02, "joint", "cooperative", feedback="paper")
    drawn = faults.SecondWorld(2.46, 2.54), faults.Routerless(2.38, 2.43)
    assert live(Night(team, drawn, 1130463444)) is None


def test_of_two_tracks_that_had_one_name_in_turn_nothing_older_is_told() -> None:
    team = Team(
        {"a": ("r1", "r3"), "b": ("r2",)}, "lockstep", 2, 1.0, 1.0, 0.2, "opinions", learns=True, unnamed="robot"
    )
    assert live(Night(team, (faults.Routerless(4.3, 4.6),), 1046586613)) is None


def test_a_board_that_is_started_again_at_once_hears_whole_states_on_a_poor_link() -> None:
    team = Team({"a": ("r1", "r2")}, "realtime", 2, tick=0.5, latency=0.02, fusion="joint", budget=600.0)
    assert live(Night(team, (faults.Killed(3.5, 3.6, "board/a/board-a2"),))) is None


def test_nobody_waits_for_what_a_board_passes_on_that_yielded_meanwhile() -> None:
    team = Team({"a": ("r1",), "b": ("r2",)}, "lockstep", 2, 2.0, 0.5, 0.1, "joint")
    assert live(Night(team, (faults.Routerless(3.05, 8.05),))) is None


def test_a_joint_that_honest_sightings_have_contradicted_by_chance_owes_no_place() -> None:
    team = Team({"a": ("r1", "r3"), "b": ("r2",)}, "free", 1, 1.0, 0.5, 0.001, "joint", "linear", learns=False)
    drawn = faults.Slow(5.74, 6.24, "robot/r1", 0.3), faults.Crowd(7.52, 7.59, "a", 1100)
    assert live(Night(team, drawn, 48751782)) is None


def test_a_tape_without_room_for_new_keys_is_replayed_until_it_misses_what_the_team_said() -> None:
    team = Team({"a": ("r1", "r3")}, "realtime", 1, 1.0, 1.0, 0.05, "joint", learns=False, max_age=3.0)
    drawn = faults.Crowd(2.0, 2.08, "a", 1100), faults.Crowd(7.15, 7.23, "b", 1100)
    assert live(Night(team, drawn, 715438800)) is None


@pytest.mark.long
def test_a_liar_about_all_that_its_team_sees_lists_no_more_than_a_message_holds() -> None:
    team = Team({"a": ("r1", "r2")}, "lockstep", boards=1, patience=1.0, tick=0.5, fusion="joint")
    lies = faults.Lies(3.0, 4.1, "robot/r1", "objects-always"), faults.Crowd(3.0, 4.0, "a", 260)
    assert live(Night(team, lies)) is None


@pytest.mark.long
def test_a_team_that_is_too_large_to_count_what_each_has_moved_lives_through_a_liar() -> None:
    """Drawn teams have eight robots at most."""
    names = [f"r{k + 1}" for k in range(21)]
    team = Team(
        {"a": tuple(names[:11]), "b": tuple(names[11:])}, "free", boards=1, patience=1.0, tick=1.0, fusion="joint"
    )
    assert live(Night(team, (faults.Lies(2.0, 8.0, "robot/r2", "off-8"),))) is None


def test_a_seed_and_a_number_are_always_the_same_night() -> None:
    nights = [draw_night(seed, number) for seed in (1, 2) for number in range(30)]
    assert nights == [draw_night(seed, number) for seed in (1, 2) for number in range(30)]
    assert len({repr(night) for night in nights}) == len(nights)


def test_a_night_is_the_python_that_makes_it() -> None:
    for number in range(100):
        drawn = draw_night(3, number)
        assert eval(repr(drawn), {**vars(faults), **vars(night)}) == drawn


def kinds(kind: type[Fault]) -> Iterator[type[Fault]]:
    yield kind
    for narrower in kind.__subclasses__():
        yield from kinds(narrower)


def test_faults_are_drawn_of_every_kind_and_end_in_time() -> None:
    drawn = [fault for number in range(400) for fault in draw_night(4, number).faults]
    assert {type(fault) for fault in drawn} == set(kinds(Fault)) - {Fault, OnWay}
    for fault in drawn:
        moments = list(fault.moments())
        assert min(moments) == fault.begin
        assert max(moments) == fault.end <= LAST


def test_teams_are_drawn_of_every_size_and_kind() -> None:
    teams = [draw_night(5, number).team for number in range(400)]
    assert {len(team.robots) for team in teams} == set(range(2, 9))
    assert {len(team.sub_teams) for team in teams} == {1, 2, 3, 4}
    assert {team.mode for team in teams} == {"lockstep", "realtime", "free"}
    assert any(sum(map(len, team.sub_teams.values())) > len(team.robots) for team in teams)  # a robot in two
    for team in teams:
        assert team.scenario(1).team.robots


@pytest.mark.system
def test_the_command_lives_through_nights_on_two_cores() -> None:
    command = [sys.executable, "-m", "tests.nights", "--count", "2", "--seed", "7", "--first", "143", "--workers", "2"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=240)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert done.stdout.startswith("2 nights of seed 7: 0 failed")
