"""What each fault does to a team, seen from outside: by what was said, and by the tokens and clocks of the processes."""

import math
from dataclasses import replace

import pytest

from blackboard.wire.messages import Consensus, Report, Status
from tests.nights import faults
from tests.nights.events import Began, Died, Ended, Event, Said, Unsound
from tests.nights.faults import Fault
from tests.nights.night import Night, Team
from tests.nights.stage import Stage

TEAM = Team({"a": ("r1", "r2"), "b": ("r3",)}, "realtime", boards=2, tick=1.0, latency=0.02)


class Played:
    """A night, or its first seconds, and the events."""

    def __init__(self, *night_faults: Fault, until: float = math.inf, team: Team = TEAM, record: bool = False) -> None:
        self.events: list[Event] = []
        self.stage = Stage(Night(team, night_faults), self.events.append, record=record)
        self.stage.play(until)

    def said(self, process: str, begin: float = 0.0, end: float = 1e9) -> list[Said]:
        return [e for e in self.events if isinstance(e, Said) and e.process == process and begin < e.at < end]

    def sources(self, begin: float, end: float, sub_team: str = "a") -> set[str]:
        """Of whom it was agreed where they are."""
        messages = [event.message for event in self.events if isinstance(event, Said) and begin < event.at < end]
        agreed = [
            message
            for message in messages
            if isinstance(message, Consensus) and (message.level, message.sub_team) == ("agreed", sub_team)
        ]
        return {used.source for consensus in agreed for used in consensus.used}


@pytest.fixture(scope="module")
def calm() -> Played:
    return Played()


def test_a_calm_night_is_a_team_at_work(calm: Played) -> None:
    assert calm.sources(3, 9) == {"a", "b"}
    reports = [event for event in calm.said("robot/r1") if isinstance(event.message, Report)]
    assert len({event.message.tick for event in reports if isinstance(event.message, Report)}) > 4
    assert {event.process for event in calm.events if isinstance(event, Began)} == set(TEAM.processes)


def test_the_same_night_is_the_same_to_the_bit() -> None:
    night = (
        faults.Lost(2.0, 6.0, "*", 0.3),
        faults.Late(3.0, 7.0, "robot/r1", 0.5),
        faults.Killed(4.0, 5.0, "robot/r2"),
    )
    runs = [
        [(e.at, e.process, e.envelope) for e in Played(*night, until=8.0).events if isinstance(e, Said)]
        for _ in range(2)
    ]
    assert runs[0] == runs[1]


def test_what_is_lost_one_way_leaves_the_other_way_open() -> None:
    both = [faults.OneWay(2.5, 8.0, "robot/r3", board) for board in ("board/b/board-b", "board/b/board-b2")]
    played = Played(*both, until=14.0)
    ages = [used.age for event in played.said("board/b/board-b", 6.0, 8.0) if isinstance(event.message, Consensus)
            if event.message.level == "consensus" for used in event.message.used]  # fmt: skip
    assert min(ages) > 3.0
    assert all(used.age < 1.5 for event in played.said("board/b/board-b", 12.0) if isinstance(event.message, Consensus)
               if event.message.level == "consensus" for used in event.message.used)  # fmt: skip


def test_a_process_that_is_killed_is_silent_and_starts_anew() -> None:
    played = Played(faults.Killed(3.0, 5.0, "robot/r2"), until=7.0)
    assert not played.said("robot/r2", 3.0, 5.0)
    assert played.said("robot/r2", 5.0, 7.0)
    lives = [event for event in played.events if isinstance(event, Began | Ended) and event.process == "robot/r2"]
    assert [(type(event), event.at) for event in lives[:3]] == [(Began, 0.0), (Ended, 3.0), (Began, 5.0)]
    assert lives[0].service is not lives[2].service


def test_a_process_that_is_frozen_says_all_that_it_missed_afterwards() -> None:
    played = Played(faults.Frozen(3.0, 5.0, "robot/r2"), until=5.2)
    assert not played.said("robot/r2", 3.0, 5.0)
    assert played.said("robot/r2", 5.0, 5.1)


def test_a_slow_process_acts_now_and_then() -> None:
    times = [event.at for event in Played(faults.Slow(3.0, 7.0, "robot/r2", 1.0), until=7.0).said("robot/r2", 3.0)]
    assert times
    assert all(at % 1.0 <= 0.1 + 1e-3 for at in times)


def boards_that_lead(played: Played, begin: float, end: float) -> set[str]:
    """The boards of sub-team a whose statuses say that they lead."""
    said = [event for board in ("board-a", "board-a2") for event in played.said(f"board/a/{board}", begin, end)]
    return {event.process for event in said if isinstance(event.message, Status) and not event.message.follows}


def test_parted_boards_both_lead_until_they_meet_again(calm: Played) -> None:
    played = Played(faults.Parted(3.0, 7.0, ((), ("board/a/board-a2", "robot/r2"))), until=12.0)
    assert boards_that_lead(calm, 3.0, 12.0) == {"board/a/board-a"}
    assert boards_that_lead(played, 5.0, 7.0) == {"board/a/board-a", "board/a/board-a2"}
    assert len(boards_that_lead(played, 9.0, 12.0)) == 1


def test_a_hidden_token_is_a_death_to_the_others() -> None:
    played = Played(faults.Flapping(3.0, 5.0, "board/a/board-a", 4.0), until=5.0)
    assert "board/a/board-a2" in boards_that_lead(played, 4.0, 5.0)


@pytest.mark.parametrize("fault", [faults.Routerless(3.0, 6.0), faults.Lost(3.0, 6.0, "*", 1.0)])
def test_without_a_router_nobody_hears_anybody(fault: Fault) -> None:
    played = Played(fault, until=6.0)
    used = [
        used
        for event in played.said("board/b/board-b", 5.0, 6.0)
        if isinstance(event.message, Consensus)
        for used in event.message.used
    ]
    assert all(opinion.age > 1.0 for opinion in used if opinion.source != "b")


def test_a_clock_is_off_for_a_life_of_its_process() -> None:
    team = replace(TEAM, mode="free")
    played = Played(faults.ClockOff(3.0, 7.0, "robot/r2", 5.0), until=9.0, team=team)
    stamps = [(e.at, e.message.time - e.at) for e in played.said("robot/r2") if isinstance(e.message, Report)]
    off = {at: round(stamp - stamps[0][1], 1) for at, stamp in stamps}
    assert {ahead for at, ahead in off.items() if 3.5 < at < 6.9} == {5.0}
    assert {ahead for at, ahead in off.items() if at > 7.5} == {0.0}
    assert sum(isinstance(event, Began) and event.process == "robot/r2" for event in played.events) == 3


@pytest.mark.parametrize(("begin", "end"), [(7.82, 8.12), (2.87, 3.17), (4.01, 6.51)])
def test_a_clock_never_jumps_while_its_process_runs(begin: float, end: float) -> None:
    played = Played(
        faults.ClockOff(begin, end, "board/a/board-a", 40.0), until=end + 2.0, team=replace(TEAM, mode="free")
    )
    ahead: list[set[float]] = []  # of each life of the board
    for event in played.events:
        if isinstance(event, Began) and event.process == "board/a/board-a":
            ahead.append(set())
        elif isinstance(event, Said) and event.process == "board/a/board-a" and isinstance(event.message, Status):
            assert event.message.sent is not None
            ahead[-1].add(round(event.message.sent - played.stage.began - event.at, 1))
    assert ahead == [{0.0}, {40.0}, {0.0}]


def test_the_clock_of_a_machine_that_slept_stays_behind() -> None:
    team = replace(TEAM, mode="free")
    played = Played(faults.Suspended(3.0, 5.0, "robot/r2"), until=7.0, team=team)
    stamps = [event.message.time - event.at for event in played.said("robot/r2") if isinstance(event.message, Report)]
    assert stamps[0] - stamps[-1] == pytest.approx(2.0, abs=0.1)


def test_liars_say_something_else() -> None:
    team = replace(TEAM, mode="free")
    honest = Played(until=4.5, team=team)
    liar = Played(faults.Lies(3.0, 5.0, "robot/r2", "off-8"), until=4.5, team=team)

    def payloads(played: Played, begin: float, end: float) -> list[bytes]:
        return [
            event.envelope.payload for event in played.said("robot/r2", begin, end) if isinstance(event.message, Report)
        ]

    assert payloads(honest, 0.0, 3.0) == payloads(liar, 0.0, 3.0)
    assert payloads(honest, 3.0, 4.5) != payloads(liar, 3.0, 4.5)


def test_people_start_and_stop_boards_and_worlds() -> None:
    played = Played(faults.AnotherBoard(3.0, 6.0, "b", "z-last"), faults.SecondWorld(4.0, 5.0), until=9.0)
    names = {event.process: event.at for event in played.events if isinstance(event, Began) and event.at > 0}
    assert names == {"board/b/z-last": 3.0, "world/2": 4.0}
    assert not played.said("board/b/z-last", 6.0)


def test_a_full_disk_costs_the_tape_nothing_that_has_room_in_memory() -> None:
    same = faults.Lost(3.0, 5.0, "*", 0.0)
    whole, full = (Played(fault, until=7.0, record=True) for fault in (same, faults.FullDisk(3.0, 5.0)))
    assert full.stage.writer.missing == 0
    assert full.stage.writer.messages == whole.stage.writer.messages


def test_a_program_that_gives_readings_by_calls_is_a_robot_as_any_other() -> None:
    team, seen = replace(TEAM, mode="free", fusion="joint", driven=("r1",)), []
    for silent in ((), (faults.Silent(3.0, 8.0, "robot/r1", "sightings"),)):
        played = Played(*silent, faults.Frozen(10.0, 12.5, "robot/r1"), team=team, until=16.0)
        said = [(event.at, event.message) for event in played.said("robot/r1") if isinstance(event.message, Report)]
        evidence = [(at, report.evidence) for at, report in said if report.evidence is not None]
        spans = (3, 8), (8, 10), (10, 12.5), (12.5, 16)
        seen.append([[len(told.relatives) > 0 for at, told in evidence if b < at < e] for b, e in spans])
        assert not [event for event in played.events if isinstance(event, Died | Unsound)]
    assert [any(some) for some in seen[0]] == [True, True, False, True]
    assert [any(some) for some in seen[1]] == [False, True, False, True]
    assert [len(some) > 0 for some in seen[1]] == [True, True, False, True]
