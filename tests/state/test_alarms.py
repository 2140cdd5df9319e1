"""Alarms: they stay after what raised them is over, keep their beginning, and are bounded."""

import math
from functools import cache
from typing import Any

import pytest

from blackboard.state.alarms import MAX_ALARMS, QUIET, Alarms
from blackboard.state.fold import Fold
from blackboard.state.team import TeamFold
from blackboard.view.summary import alarm_lines, summary, team_summary, text
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Dissent, LeftOut, Refusal, Status
from tests.view.recorded import folded, recorded
from tests.wire.envelopes import put, token, world

BOARD = token(keys.BOARD, "board-a")


def of_r1(kind: Kind) -> Envelope:
    return token(keys.MEMBER, "r1", kind=kind)


def said(**fields: Any) -> Envelope:
    """A status of the board, in its first tick if nothing else is said."""
    return put(Status(**{"process": "board-a", "kind": "board", "tick": 0, "time": 0.0, **fields}))


@cache
def agreed() -> Consensus:
    return next(decode(Consensus, e.payload) for e, _ in recorded() if e.kind is Kind.PUT and "/agreed/" in e.key)


def test_what_comes_and_goes_is_one_alarm_until_it_stays_away() -> None:
    alarms = Alarms()
    for now in range(10):
        alarms.raise_all({("liar", "r2"): "r2 lies"} if now % 2 == 0 else {}, float(now))
    (alarm,) = alarms.all()
    assert (alarm.since, alarm.until) == (0.0, None)
    alarms.raise_all({}, 8.0 + QUIET + 0.1)
    (alarm,) = alarms.all()
    assert alarm.until == 8.0
    alarms.raise_all({("liar", "r2"): "again"}, 30.0)
    assert [(alarm.since, alarm.until) for alarm in alarms.all()] == [(30.0, None)]


def test_what_lasts_stands_before_what_is_over_and_the_oldest_that_are_over_go() -> None:
    alarms = Alarms()
    for n in range(2 * MAX_ALARMS):
        alarms.raise_("gone", f"r{n}", "gone", float(n))
        if n:
            alarms.end("gone", f"r{n}", float(n))
        alarms.check()
    assert alarms.all()[0].who == "r0"


def test_a_robot_that_goes_and_comes_back_is_told_for_a_minute() -> None:
    fold = folded()
    fold.hear_envelope(of_r1(Kind.GONE), 1_000_010.0)
    team = summary(fold, 1_000_022.0)["teams"][0]
    assert ("gone", "r1", 12.0, None) in [
        (alarm["what"], alarm["who"], alarm["for"], alarm["over"]) for alarm in team["alarms"]
    ]
    assert "! r1 is gone, for 12 s" in text(summary(fold, 1_000_022.0))
    fold.hear_envelope(of_r1(Kind.ALIVE), 1_000_030.0)
    assert "! r1 is gone, for 20 s; over since 10 s" in text(summary(fold, 1_000_040.0))
    assert not any("r1 is gone" in line for line in alarm_lines(team_summary(fold.teams["t"], 1_000_200.0)))


@pytest.mark.parametrize("token_first", [False, True])
def test_the_world_at_the_end_of_its_run_is_no_alarm(token_first: bool) -> None:
    fold, gone = Fold(), world(Kind.GONE)
    fold.hear_envelope(world(), 1.0)
    clock = Clock(run="x", tick=3, time=1.0, mode="realtime")
    fold.hear_envelope(put(clock), 2.0)
    last = put(clock.model_copy(update={"end": True}))
    for envelope in (gone, last) if token_first else (last, gone):
        fold.hear_envelope(envelope, 3.0)
    assert fold.teams["t"].alarms.all() == []
    assert text(summary(fold, 3.0)).startswith("team t: no world, ")


def test_a_robot_that_went_before_anybody_looked_is_known_by_its_board() -> None:
    fold = Fold()
    for envelope in (BOARD, of_r1(Kind.ALIVE), said(ages={"r1": 0.1, "r3": 12.0, "r4": 500.0})):
        fold.hear_envelope(envelope, 100.0)
    rows = {process["name"]: process for process in summary(fold, 100.0)["teams"][0]["processes"]}
    assert (rows["r3"]["state"], rows["r3"]["age"]) == ("gone", 12.0)
    assert "r4" not in rows
    assert "gone 12 s" in text(summary(fold, 100.0))
    assert "! r3 is gone, for 12 s" in text(summary(fold, 100.0))


@pytest.mark.parametrize("named_first", [False, True])
def test_a_robot_of_the_scenario_that_its_board_heard_long_ago_is_gone_since_then(named_first: bool) -> None:
    fold = Fold()
    if named_first:
        fold.expect("t", {"a": ["r2"]})
    for envelope in (BOARD, said(ages={"r2": 218.2, "r4": 218.2})):
        fold.hear_envelope(envelope, 1000.0)
    if not named_first:
        fold.expect("t", {"a": ["r2"]})
    shown = text(summary(fold, 1000.0))
    assert "gone 218 s" in shown
    assert "! r2 is gone, for 218 s" in shown
    assert "r4" not in shown


def test_a_robot_of_the_scenario_that_a_board_waits_for_is_an_alarm_until_it_comes() -> None:
    fold = Fold()
    fold.expect("t", {"a": ["r1", "r2"]})
    fold.hear_envelope(said(lacks=["robot/r1", "robot/r7", "board/b/x"]), 100.0)
    assert alarm_lines(summary(fold, 107.0)["teams"][0]) == ["! r1 is waited for and was never heard, for 7 s"]
    fold.hear_envelope(of_r1(Kind.ALIVE), 110.0)
    assert [alarm.until for alarm in fold.teams["t"].alarms.all()] == [110.0]


def test_a_robot_that_a_board_hears_again_is_gone_no_longer() -> None:
    """Before, only the first age that a board told was used. So a robot that came back was still shown as gone."""
    fold = Fold()
    fold.expect("t", {"a": ["r1", "r2"]})
    fold.hear_envelope(said(ages={"r2": 218.2}, lacks=["robot/r1"]), 1000.0)
    fold.hear_envelope(said(ages={"r1": 0.5, "r2": 0.5}), 1010.0)
    assert "gone 218 s" not in text(summary(fold, 1010.0))
    assert all(alarm.until is not None for alarm in fold.teams["t"].alarms.all())


def test_since_when_a_robot_is_gone_is_the_same_in_its_row_and_its_alarm() -> None:
    fold = folded()
    fold.hear_envelope(of_r1(Kind.GONE), 1_000_010.0)
    shown = text(summary(fold, 1_000_022.0))
    assert "gone 12 s" in shown
    assert "! r1 is gone, for 12 s" in shown


def test_robots_of_the_scenario_are_shown_although_they_never_came() -> None:
    fold = folded()
    fold.expect("t", {"a": ["r1", "r9"]})
    rows = {process["name"]: process for process in summary(fold, 1_000_001.0)["teams"][0]["processes"]}
    assert (rows["r9"]["state"], rows["r9"]["age"]) == ("gone", None)
    assert "never heard" in text(summary(fold, 1_000_001.0))


def settled(ticks: int, **changes: Any) -> TeamFold:
    """A team whose board settles the same belief in every tick, 0.5 s each; in every second one there is a conflict."""
    team = TeamFold("t")
    for n in range(ticks):
        at = {"tick": n, "time": 0.5 * n}
        consensus = agreed().model_copy(update={**at, "conflict": n % 2 == 0, **changes})
        said = Status(process="b", kind="board", phase="agreed", subjects=[consensus.subject], **at)
        for message in (consensus, said):
            team.hear_message({"sub_team": consensus.sub_team}, message, 1, 0.5 * n)
    return team


def test_what_flaps_is_told_once() -> None:
    team = settled(30)
    assert [(event.what, event.severity) for event in team.events] == [("conflict", "warning")]
    for n in range(30, 60):
        calm = agreed().model_copy(update={"tick": n, "time": 0.5 * n, "conflict": False})
        said = Status(process="b", kind="board", tick=n, time=0.5 * n, phase="agreed", subjects=[calm.subject])
        for message in (calm, said):
            team.hear_message({"sub_team": calm.sub_team}, message, 1, 0.5 * n)
    assert [event.what for event in team.events] == ["conflict", "agreement"]


def test_what_ends_in_one_tick_is_one_event_of_each_kind() -> None:
    out = [LeftOut(source="r4", reason="off"), LeftOut(source="r6", reason="off")]
    team, other = settled(3, conflict=True, left_out=out), agreed().model_copy(update={"subject": "object/other"})
    assert [event.what for event in team.events] == ["left out", "left out", "conflict"]
    for n in range(3, 30):
        at = {"tick": n, "time": 0.5 * n}
        calm = [one.model_copy(update={**at, "conflict": n < 4}) for one in (agreed(), other)]
        said = Status(process="b", kind="board", phase="agreed", subjects=[one.subject for one in calm], **at)
        for message in (*calm, said):
            team.hear_message({"sub_team": agreed().sub_team}, message, 1, 0.5 * n)
    told = [event.text for event in team.events][3:]
    assert f"r4, r6 count again about {agreed().subject}" in told
    assert [event.what for event in team.events][3:].count("back in") == 1
    assert [text for text in told if text.startswith("no conflict")] == [
        f"no conflict about {agreed().subject}, object/other any more"
    ]


def test_a_prediction_that_is_ignored_is_no_robot_of_that_name() -> None:
    team = settled(1, conflict=False, left_out=[LeftOut(source="prediction", reason="too far off")])
    (event,) = team.events
    assert event.text == f"the prediction was ignored about {agreed().subject}: too far off"


def test_who_may_be_anywhere_is_lost_and_who_keeps_disagreeing_a_liar() -> None:
    assert [alarm.what for alarm in settled(9).alarms.all()] == []
    off = Dissent(level="consensus", source="r3", sigmas=5.6, weight=0.1, since=0.0)
    team = settled(9, entropy=math.log(0.5 * math.prod(agreed().belief.grid.shape)), dissent=[off])
    texts = {alarm.what: alarm.text for alarm in team.alarms.all()}
    assert texts["lost"] == f"{agreed().subject} is lost: it may be on 50 % of the map"
    assert texts["liar"] == f"r3 keeps disagreeing about {agreed().subject}, by 5.6 sigmas"


def test_who_is_probably_elsewhere_is_lost_too_and_not_for_a_moment_only() -> None:
    (alarm,) = settled(9, lost=0.45).alarms.all()
    assert alarm.text == f"{agreed().subject} is lost with 45 %: it may not be where the team believes"
    assert settled(3, lost=0.45).alarms.all() == []


def test_a_robot_that_is_refused_for_some_time_is_named_once() -> None:
    fold, team = Fold(), "t"
    for n in range(4):
        refusal = Refusal(board="b", sub_team="a", robot="r7", time=float(n), reason="guest", text="not named", count=n)
        status = Status(process="b", kind="board", tick=n, time=float(n), refused={"guest": 5 * n + 1})
        for message in (refusal, status):
            fold.hear_envelope(put(message), float(n))
        if n < 2:
            assert fold.teams[team].alarms.all() == []
    (alarm,) = fold.teams[team].alarms.all()
    assert (alarm.what, alarm.who, alarm.text) == ("refused", "r7", "b refuses what r7 sends (guest: not named)")
    assert [event.text for event in fold.teams[team].events] == ["b refuses messages: guest"]


@pytest.mark.parametrize(
    ("settings", "kinds"),
    [
        ({"stuck": 3.0}, ["stuck"]),
        ({"moved": 1.0}, ["moved"]),
        ({"jumped": 1.0}, ["jumped"]),
        ({"stuck": 0.0, "moved": 0.0}, []),
        ({"stuck": "x"}, []),
    ],
)
def test_a_robot_that_is_stuck_or_was_moved_says_so_itself(settings: dict[str, str | float], kinds: list[str]) -> None:
    team = TeamFold("t")
    said = Status(process="r1", kind="robot", tick=0, time=0.0, phase="reported", settings=settings)
    team.hear_message({"sub_team": "a"}, said, 1, 0.0)
    board = Status(process="b", kind="board", phase="agreed", tick=0, time=0.0, subjects=[agreed().subject])
    consensus = agreed().model_copy(update={"tick": 0, "time": 0.0})
    for message in (consensus, board):
        team.hear_message({"sub_team": consensus.sub_team}, message, 1, 0.1)
    assert [(alarm.what, alarm.who) for alarm in team.alarms.all()] == [(kind, "r1") for kind in kinds]


@pytest.mark.parametrize(
    ("subject", "value", "whom"),
    [("robot/r1", 1.0, ["r1"]), ("object/ball", 1.0, []), ("robot/r1", 1e12, []), ("robot/r1", "x", [])],
)
def test_a_robot_whose_odometry_its_team_does_not_believe_was_moved(
    subject: str, value: float | str, whom: list[str]
) -> None:
    """Other values, and an object's, are what no board of this version says: they raise no alarm."""
    team = settled(1, conflict=False, subject=subject, parameters={"gate": 3.7, "odometry distrusted": value})
    assert [alarm.who for alarm in team.alarms.all() if alarm.what == "moved"] == whom


@pytest.mark.parametrize(
    ("subject", "value", "whom"), [("robot/r1", 1.4, ["r1"]), ("object/ball", 1.4, []), ("robot/r1", "x", [])]
)
def test_a_robot_whose_sensors_err_by_more_than_it_was_told(subject: str, value: float | str, whom: list[str]) -> None:
    team = settled(1, conflict=False, subject=subject, parameters={"gate": 3.7, "way scale found": value})
    assert [alarm.who for alarm in team.alarms.all() if alarm.what == "sensors"] == whom


def test_a_moment_waits_for_a_belief_that_its_status_overtook() -> None:
    team = settled(3)
    consensus = agreed().model_copy(update={"tick": 3, "time": 1.5})
    said = Status(process="b", kind="board", phase="agreed", subjects=[consensus.subject], tick=3, time=1.5)
    parts = {"team": "t", "sub_team": consensus.sub_team, "board": "b"}
    team.hear_token(keys.BOARD, parts, token(keys.BOARD, "b", sub_team=consensus.sub_team), 1.0)
    team.hear_message({"sub_team": consensus.sub_team}, said, 1, 1.5)
    assert team.moments.newest is not None
    assert team.moments.newest.tick == 2
    team.hear_message({"sub_team": consensus.sub_team}, consensus, 1, 1.6)
    assert team.moments.newest.tick == 3
