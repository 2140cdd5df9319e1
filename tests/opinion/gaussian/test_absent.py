"""Things that were out of sight: which new track is of which of them."""

from collections.abc import Sequence

import numpy as np
import pytest

from blackboard.opinion.gaussian.absent import Absent, bounded, found_again
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.rolling import Rolling
from blackboard.opinion.gaussian.tracks import MAX_TRACKS, ROOM

AREA, FASTEST, KIND = 2500.0, 1.0, "person/?"
ANYBODY = frozenset({"robot/r1", "robot/r2"})


def lost(place: Sequence[float], velocity: Sequence[float], unseen: float, kind: str = KIND) -> Absent:
    then = Moments(np.array([*place, *velocity]), np.diag([0.5, 0.5, 0.1, 0.1]))
    return Absent(kind, then, FASTEST, ANYBODY, unseen)


def begun(place: Sequence[float], velocity: Sequence[float] = (0.0, 0.0), sigma: float = FASTEST) -> Rolling:
    """A new track, whose velocity is known with some sigma; `FASTEST` is all that is known without sightings."""
    mean, covariance = np.array([*place, *velocity]), np.diag([0.5, 0.5, sigma**2, sigma**2])
    return Rolling(0.5, np.ones(1), mean[np.newaxis], covariance[np.newaxis], FASTEST)


def found(new: dict[str, Rolling], absent: dict[str, Absent], age: float = 0.2) -> dict[str, str]:
    return found_again({block: (KIND, its, age) for block, its in new.items()}, absent, AREA)


def test_who_comes_back_where_its_way_leads_is_the_same() -> None:
    absent = {"person/1": lost([10.0, 10.0], [1.0, 0.0], 8.0), "person/2": lost([10.0, 10.0], [-1.0, 0.0], 8.0)}
    assert found({"person/?7": begun([18.0, 10.0])}, absent) == {"person/?7": "person/1"}
    assert found({"person/?7": begun([2.0, 10.0])}, absent) == {"person/?7": "person/2"}


def test_who_comes_from_where_nobody_can_have_gone_is_somebody_else() -> None:
    absent = {"person/1": lost([10.0, 10.0], [1.0, 0.0], 3.0)}
    assert found({"person/?7": begun([40.0, 40.0])}, absent) == {}


def test_what_was_seen_since_a_track_began_is_something_else() -> None:
    absent, new = {"person/1": lost([10.0, 10.0], [1.0, 0.0], 2.0)}, {"person/?7": begun([12.0, 10.0])}
    assert found(new, absent, age=1.9) == {"person/?7": "person/1"}
    assert found(new, absent, age=2.0) == {}


def test_of_two_that_may_be_it_neither_is() -> None:
    absent = {name: lost([10.0, 10.0], [0.0, 0.0], 10.0) for name in ("person/1", "person/2")}
    assert found({"person/?7": begun([12.0, 10.0])}, absent) == {}


def test_how_a_track_goes_tells_two_apart_that_may_be_at_one_place() -> None:
    absent = {"person/1": lost([4.0, 10.0], [1.0, 0.0], 6.0), "person/2": lost([16.0, 10.0], [-1.0, 0.0], 6.0)}
    assert found({"person/?7": begun([10.0, 10.0])}, absent) == {}
    assert found({"person/?7": begun([10.0, 10.0], [0.9, 0.0], 0.3)}, absent) == {"person/?7": "person/1"}
    assert found({"person/?7": begun([10.0, 10.0], [-0.9, 0.0], 0.3)}, absent) == {"person/?7": "person/2"}


def test_one_thing_is_one_track() -> None:
    absent = {"person/1": lost([10.0, 10.0], [1.0, 0.0], 5.0)}
    both = {"person/?7": begun([15.0, 10.0]), "person/?8": begun([19.0, 10.0])}
    assert found(both, absent) == {"person/?7": "person/1"}


def test_what_is_of_another_class_is_something_else() -> None:
    absent = {"object/ball1": lost([10.0, 10.0], [1.0, 0.0], 5.0, "object/ball?")}
    assert found({"person/?7": begun([15.0, 10.0])}, absent) == {}


def test_who_was_away_for_so_long_that_it_may_be_anywhere_is_not_known_again() -> None:
    for unseen, again in ((10.0, {"person/?7": "person/1"}), (50.0, {})):
        assert found({"person/?7": begun([25.0, 30.0])}, {"person/1": lost([25.0, 25.0], [0.3, 0.0], unseen)}) == again


@pytest.mark.parametrize("number", [ROOM, MAX_TRACKS])
def test_what_one_alone_has_seen_costs_the_others_no_room(number: int) -> None:
    ghosts = {
        f"person/{k}": Absent(KIND, lost([1.0, 1.0], [0.0, 0.0], 0.0).then, FASTEST, frozenset({"robot/r9"}), 0.1 * k)
        for k in range(2 * number)
    }
    real = {f"person/9{k}": lost([1.0, 1.0], [0.0, 0.0], 50.0) for k in range(ROOM)}
    assert bounded({**ghosts, **real}, ()).keys() == {*list(ghosts)[:ROOM], *real}
    assert bounded({**ghosts, **real}, {"robot/r9"}).keys() == real.keys()
    assert len(bounded({f"person/{k}": lost([1.0, 1.0], [0.0, 0.0], 0.1 * k) for k in range(200)}, ())) == MAX_TRACKS
