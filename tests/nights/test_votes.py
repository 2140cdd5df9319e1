"""Honest robots count and boards agree: a team at work is right, and what is wrong is named; over many nights a lie moves by little."""

from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, LeftOut, Report, Truth
from tests.nights import faults
from tests.nights.events import Event, Said
from tests.nights.night import Night, Team
from tests.nights.oracles import Oracle
from tests.nights.run import ENOUGH_LIED, MOST, judged, moved, played, uncalibrated
from tests.nights.votes import BARRED, BoardsAgreeAgain, OneVote, TheHonestCount

TEAM = Team({"a": ("r1", "r2"), "b": ("r3",)}, "lockstep", boards=2, tick=1.0, latency=0.2, fusion="joint")
CALM = Night(TEAM, (faults.Lost(2.0, 3.0, "*", 0.0),), seed=5)


@pytest.fixture(scope="module")
def events() -> list[Event]:
    return played(CALM)


def changed(events: list[Event], **changes: object) -> list[Event]:
    """The events with other consensuses about r1 of sub-team a from 8 s on, by its leader."""

    def other(event: Event) -> Event:
        if not isinstance(event, Said) or not isinstance(event.message, Consensus) or event.at < 8.0:
            return event
        if (event.message.subject, event.process) != ("robot/r1", "board/a/board-a"):
            return event
        return replace(event, message=event.message.model_copy(update=changes))

    return [other(event) for event in events]


@pytest.mark.parametrize("oracle", [TheHonestCount, BoardsAgreeAgain])
def test_a_team_at_work_breaks_nothing(oracle: type[Oracle], events: list[Event]) -> None:
    assert not judged(oracle(CALM), events)


def test_an_honest_robot_that_is_barred_or_never_counts_is_named(events: list[Event]) -> None:
    barred = changed(events, left_out=[LeftOut(source="r1", reason=BARRED)])
    assert "board/a/board-a bars r1" in judged(TheHonestCount(CALM), barred)
    assert "r1 does not count in the" in judged(TheHonestCount(CALM), changed(events, used=[]))
    liar = replace(CALM, faults=(*CALM.faults, faults.Lies(2.0, 3.0, "robot/r1", "off-8")))
    assert not judged(TheHonestCount(liar), barred)


def test_boards_that_do_not_agree_again_are_named(events: list[Event]) -> None:
    elsewhere = pack(gaussian(CALM.team.scenario(5).grid, (1.0, 1.0), 0.5))
    assert "sigmas apart about robot/r1" in judged(BoardsAgreeAgain(CALM), changed(events, belief=elsewhere))


@pytest.mark.parametrize(
    "lie",
    [faults.Lies(3.0, 6.0, "robot/r1", "two-off", "robot/r2"), faults.LyingGuest(3.0, 6.0, "a", "g9", "guest-off")],
)
def test_two_robots_lie_and_so_does_a_guest(lie: faults.Fault) -> None:
    team = replace(TEAM, sub_teams={"a": ("r1", "r2"), "b": ("r3", "r4")}, boards=1)
    lived = played(Night(team, (lie,), seed=5), until=6.0)
    truths = {e.message.tick: e.message for e in lived if isinstance(e, Said) and isinstance(e.message, Truth)}
    off = defaultdict[str, float](float)
    for event in lived:
        if isinstance(event, Said) and isinstance(event.message, Report) and event.message.subject == event.process:
            truth = np.array(truths[event.message.tick].positions[event.process])
            off[event.process] += (
                float(np.linalg.norm(unpack(event.message.belief).mean() - truth)) if 4 < event.at < 6 else 0
            )
    assert set(sorted(off, key=off.__getitem__)[-len(lie.lies()) :]) == lie.lies().keys()


def test_how_far_a_lie_moves_the_honest_is_judged_over_enough_beliefs(events: list[Event]) -> None:
    oracle = OneVote(CALM)
    judged(oracle, events)
    assert oracle.sums()["calm n"] > 10
    calm = Counter({"calm n": 100, "calm off": 50})
    lied = Counter({"lied n": ENOUGH_LIED, "lied off": round(ENOUGH_LIED * 0.5 * MOST)})
    assert moved(calm) == 1.0
    assert moved(calm + lied) == pytest.approx(MOST)
    assert uncalibrated(calm + lied) == []
    assert "one liar moves the honest" in uncalibrated(calm + lied + lied + Counter({"lied off": 9000}))[0]
