"""What counts as settled again, and from when on."""

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


def test_all_is_settled_where_each_board_has_every_robot_fresh() -> None:
    sight = sight_of(clock(10.0), *everything(10.0, r1=9.8, r2=9.8))
    assert sight.look(0.0).missing == ()
    assert sight.look(0.0).of == 4


def test_a_belief_that_rests_on_an_old_report_is_not_settled() -> None:
    sight = sight_of(clock(10.0), *everything(10.0, r1=10.0 - FRESH - 0.1, r2=9.8))
    assert sight.look(0.0).missing == (("a", "robot/r1"), ("b", "robot/r1"))
    assert sight.look(0.0, away={"r1"}).missing == ()


def test_an_old_belief_is_not_settled_whatever_it_rests_on() -> None:
    sight = sight_of(clock(10.0), *everything(10.0, r1=10.0, r2=10.0), agreed("b", "object/ball", 10.0 - FRESH - 0.1))
    assert sight.look(0.0).missing == (("a", "object/ball"), ("b", "object/ball"))


def test_team_time_goes_on_while_no_clock_is_heard() -> None:
    sight = sight_of(clock(10.0), *everything(10.0, r1=10.0, r2=10.0))
    assert len(sight.look(FRESH + 0.1).missing) == 4


def test_nothing_is_expected_of_a_sub_team_without_its_board() -> None:
    sight = sight_of(clock(10.0), agreed("a", "robot/r1", 10.0, r1=10.0))
    assert len(sight.look(0.0).missing) == 3
    assert sight.look(0.0, away={"board-b"}).missing == ()


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


def looks(missing: dict[float, int], until: float = 20.0) -> list[Look]:
    pairs = [("a", f"robot/r{i}") for i in range(9)]
    times = [0.5 * i for i in range(int(2 * until) + 1)]
    return [Look(t, t, tuple(pairs[: missing.get(t, 0)]), 9) for t in times]


def test_a_recovery_is_counted_from_the_end_of_the_trouble() -> None:
    assert recovery(looks({6.0: 1, 7.0: 3, 8.5: 1}), 5.0, 7.5) == 1.0


def test_a_recovery_lasts_until_nothing_is_missing_for_a_while() -> None:
    assert recovery(looks({8.0: 1, 9.5: 1, 12.0: 1}), 5.0, 7.5) == 2.0


def test_what_was_missing_before_does_not_count() -> None:
    assert recovery(looks({3.0: 5}), 5.0, 7.5) == 0.0


def test_what_is_missing_to_the_end_never_recovers() -> None:
    assert recovery(looks({0.5 * i: 1 for i in range(10, 41)}), 5.0, 7.5) is None


def test_the_share_that_was_settled() -> None:
    assert settled(looks({5.0: 9, 5.5: 9}), 5.0, 6.5) == 0.5
    assert settled([], 0.0, 1.0) == 1.0
