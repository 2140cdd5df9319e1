"""What counts as settled again, and from when on."""

import pytest

from blackboard.chaos.sight import FRESH, Look, Sight, recovery, settled
from blackboard.config import TeamSection
from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Status
from tests.wire.envelopes import consensus, put, token

BELIEF = uniform(Grid((4, 4)))
TEAM = TeamSection(name="t", sub_teams={"a": ["r1"], "b": ["r2"]})


def clock(time: float) -> Envelope:
    return put(Clock(run="1", tick=round(5 * time), time=time, mode="realtime"))


def agreed(sub_team: str, subject: str, time: float, **ancestors: float) -> Envelope:
    return put(consensus(BELIEF, subject, board=f"board-{sub_team}", sub_team=sub_team, time=time, ancestors=ancestors))


def sight_of(*envelopes: Envelope) -> Sight:
    sight = Sight(TEAM)
    for envelope in envelopes:
        sight.hear_envelope(envelope, 0.0)
    return sight


def everything(time: float, **ancestors: float) -> list[Envelope]:
    return [agreed(s, f"robot/{r}", time, **ancestors) for s in "ab" for r in ("r1", "r2")]


OLD = 10.0 - FRESH - 0.1
STALE = [("a", "object/ball"), ("b", "object/ball")]


@pytest.mark.parametrize(
    ("heard", "missing"),
    [
        (everything(10.0, r1=9.8, r2=9.8), []),
        (everything(10.0, r1=OLD, r2=9.8), [("a", "robot/r1"), ("b", "robot/r1")]),  # rests on an old report
        ([*everything(10.0, r1=10.0, r2=10.0), agreed("b", "object/ball", OLD)], STALE),  # whatever it rests on
        ([agreed("a", "robot/r1", 10.0, r1=10.0)], [("a", "robot/r2"), ("b", "robot/r1"), ("b", "robot/r2")]),
    ],
    ids=["all is fresh", "an old report", "an old belief", "no belief"],
)
def test_what_is_not_settled_is_missing(heard: list[Envelope], missing: list[tuple[str, str]]) -> None:
    look = sight_of(clock(10.0), *heard).look(0.0)
    assert (list(look.missing), look.of) == (missing, 6 if missing == STALE else 4)


def test_nothing_is_expected_of_who_is_away_nor_of_a_sub_team_without_its_board() -> None:
    assert sight_of(clock(10.0), *everything(10.0, r1=OLD, r2=9.8)).look(0.0, away={"r1"}).missing == ()
    assert sight_of(clock(10.0), agreed("a", "robot/r1", 10.0, r1=10.0)).look(0.0, away={"board-b"}).missing == ()


def test_team_time_goes_on_while_no_clock_is_heard() -> None:
    sight = sight_of(clock(10.0), *everything(10.0, r1=10.0, r2=10.0))
    assert len(sight.look(FRESH + 0.1).missing) == 4


def test_messages_are_counted_by_whom_they_are_from() -> None:
    status = Status(process="r1", kind="robot", tick=1, time=1.0, counters={"sent": 7})
    sight = sight_of(
        Envelope(keys.REPORT.key(team="t", sub_team="a", source="r1", subject="robot/r1"), b"?"),
        Envelope(keys.SOLO.key(team="t", robot="r1"), b"?"),
        Envelope(keys.SOLO.key(team="t", robot="r2"), b"?"),
        put(status),
    )
    assert sight.statuses == {"r1": (status, 3)}


def test_who_holds_a_token() -> None:
    sight = sight_of(token(keys.MEMBER, "r1"))
    assert (sight.holds("r1"), sight.holds("r2")) == (True, False)
    sight.hear_envelope(token(keys.MEMBER, "r1", kind=Kind.GONE), 1.0)
    assert not sight.holds("r1")


# --- recovery --------------------------------------------------------------------------------------------------------


def looks(missing: dict[float, int]) -> list[Look]:
    pairs = [("a", f"robot/r{i}") for i in range(9)]
    times = [0.5 * i for i in range(41)]
    return [Look(t, t, tuple(pairs[: missing.get(t, 0)]), 9) for t in times]


@pytest.mark.parametrize(
    ("missing", "seconds"),
    [
        ({6.0: 1, 7.0: 3, 8.5: 1}, 1.0),  # from the end of the trouble, at 7.5 s
        ({8.0: 1, 9.5: 1, 12.0: 1}, 2.0),  # until nothing is missing for a while
        ({3.0: 5}, 0.0),  # before the trouble
        ({0.5 * i: 1 for i in range(10, 41)}, None),  # to the end
    ],
)
def test_a_recovery_lasts_until_all_is_settled_for_a_while(missing: dict[float, int], seconds: float | None) -> None:
    assert recovery(looks(missing), 5.0, 7.5) == seconds


def test_the_share_that_was_settled() -> None:
    assert settled(looks({5.0: 9, 5.5: 9}), 5.0, 6.5) == 0.5
    assert settled([], 0.0, 1.0) == 1.0
