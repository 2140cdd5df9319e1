"""What bridges show: each settled tick once, in order, each event once, and the masses of a belief as they are."""

import pytest

from blackboard.bridges.stream import TeamStream, agreed, corner, masses
from blackboard.state.moments import Moment
from blackboard.state.team import Event, TeamFold
from blackboard.tape.file import read
from blackboard.view.feed import TapeFeed
from blackboard.wire.arrays import unpack
from tests.files import GOLDEN


class Shown:
    def __init__(self) -> None:
        self.moments, self.events = list[Moment](), list[Event]()

    def show(self, team: TeamFold, moment: Moment) -> None:
        self.moments.append(moment)

    def note(self, event: Event) -> None:
        self.events.append(event)


@pytest.fixture(scope="module")
def golden() -> Shown:
    feed, sink = TapeFeed(read(GOLDEN)), Shown()
    stream = TeamStream(feed, "demo")
    assert TeamStream(feed, "another").new(sink) == 0
    while not feed.done:
        feed.hear_envelopes(feed.receive())
        stream.new(sink)
    assert stream.new(sink) == 0
    assert sink.events == list(feed.fold.teams["demo"].events)
    return sink


def test_each_tick_is_shown_once_in_its_order(golden: Shown) -> None:
    run = golden.moments[-1].run
    assert [moment.tick for moment in golden.moments if moment.run == run] == list(range(16))


def test_the_masses_are_those_of_the_belief_at_its_place(golden: Shown) -> None:
    shown = list(agreed(golden.moments[-1]))
    assert shown
    for name, about, drawn in shown:
        assert about.best is not None
        belief = unpack(about.best.message.belief)
        (i, j), (n, m) = drawn.lo, drawn.box
        p = belief.p[i : i + n, j : j + m]
        assert masses(drawn) == pytest.approx(p, rel=0.03, abs=2e-4 * float(p.max()))
        assert corner(golden.moments[-1], name, drawn) == (i, j, 1.0)
