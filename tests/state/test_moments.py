"""Moments: bounded in number and bytes, and the same when they are old as when they were new."""

from blackboard.state.moments import About, Moment, Timeline
from tests.present import present
from tests.view.recorded import team_of


def test_moments_keep_to_their_bytes_and_their_number() -> None:
    about = next(about for moment in team_of().moments for about in moment.subjects.values() if about.reports)
    kept = Timeline(most=10)
    for tick in range(30):
        kept.add(Moment("r", tick, 0.0, 0.0, {"object/x": about}))
    assert [moment.tick for moment in kept] == list(range(20, 30))
    assert kept.at(25) is not None
    assert kept.at(5) is None
    tight = Timeline(most_bytes=1)
    for tick in range(3):
        tight.add(Moment("r", tick, 0.0, 0.0, {"object/x": About()}))
    assert [moment.tick for moment in tight] == [0, 1, 2]  # of those that are looked at most nothing is dropped
    for tick in range(3, 10):
        tight.add(Moment("r", tick, 0.0, 0.0, {"object/x": About()}))
    assert [moment.tick for moment in tight] == [6, 7, 8, 9]


def test_an_old_moment_says_what_it_said_when_it_was_new() -> None:
    moments, packed = list(team_of().moments), Timeline()
    for moment in moments:
        packed.add(moment)
    unpacked = present(packed.at(moments[0].tick))
    assert unpacked is not moments[0]
    assert packed.bytes < sum(
        received.size for about in moments[0].subjects.values() for received in about.all()
    ) * len(moments)
    for name, about in moments[0].subjects.items():
        again = unpacked.subjects[name]
        assert [received.message for received in again.all()] == [received.message for received in about.all()]
        assert again.scores == about.scores
        assert present(again.best).drawn == present(about.best).drawn
