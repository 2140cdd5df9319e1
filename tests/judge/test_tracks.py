"""Tracks against things: what each mistake of a tracker costs, and in which number it is seen."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from blackboard.judge.tracks import Place, TrackAt, TrackJudge

CUT = 3.0


def judged(
    *ticks: tuple[Mapping[str, Place], Mapping[str, Place]], existence: float | None = None
) -> dict[str, object]:
    judge = TrackJudge(CUT)
    for things, tracks in ticks:
        judge.judge_instant(things, {name: TrackAt(place, existence) for name, place in tracks.items()})
    return judge.summary()


def passing(at: Sequence[float]) -> list[dict[str, Place]]:
    """Two people who walk towards each other along two lines, one unit apart, and on."""
    return [{"person/anna": (x, 0.0), "person/ben": (-x, 1.0)} for x in at]


def test_a_perfect_tracker_errs_in_nothing() -> None:
    ways = passing(np.linspace(-8, 8, 33).tolist())
    summary = judged(*[(way, {"person/1": way["person/anna"], "person/2": way["person/ben"]}) for way in ways])
    errors = ("gospa", "localisation", "missed", "false", "missed_share", "switches", "false_tracks")
    assert {name: summary[name] for name in errors} == dict.fromkeys(errors, 0)


def test_tracks_that_exchange_their_people_have_switched_once_each() -> None:
    ways = passing(np.linspace(-8, 8, 33).tolist())
    names = ("person/anna", "person/ben")
    before, after = names, names[::-1]
    ticks = []
    for way in ways:
        first, second = before if way["person/anna"][0] < 0 else after
        ticks.append((way, {"person/1": way[first], "person/2": way[second]}))
    summary = judged(*ticks)
    assert summary["switches"] == 2
    assert summary["gospa"] == 0.0, "at each time some track is where each person is"


def test_two_who_pass_in_the_noise_have_not_switched() -> None:
    """The best pairing of a tick changes to and fro where both are near to both."""
    rng = np.random.default_rng(1)
    ticks = []
    for way in passing(np.linspace(-8, 8, 161).tolist()):
        noisy = {name: (x + rng.normal(0, 0.7), y + rng.normal(0, 0.7)) for name, (x, y) in way.items()}
        ticks.append((way, {"person/1": noisy["person/anna"], "person/2": noisy["person/ben"]}))
    assert judged(*ticks)["switches"] == 0


def test_a_track_that_dies_and_comes_back_under_another_name_is_a_switch() -> None:
    there = {"person/anna": (0.0, 0.0)}
    summary = judged((there, {"person/1": (0.0, 0.0)}), (there, {}), (there, {"person/2": (0.0, 0.0)}))
    assert summary["switches"] == 1
    assert summary["missed_share"] == pytest.approx(1 / 3)
    assert judged((there, {"person/1": (0.0, 0.0)}), (there, {}), (there, {"person/1": (0.0, 0.0)}))["switches"] == 0


def test_who_loses_a_track_to_another_and_gets_theirs_later_has_switched() -> None:
    near, far = {"person/anna": (0.0, 0.0)}, {"person/ben": (9.0, 0.0)}
    apart = {"person/1": (0.0, 0.0), "person/2": (9.0, 0.0)}
    summary = judged(
        (near | far, apart),
        (near | far, {"person/1": (9.0, 0.0)}),
        (near | far, dict(zip(apart, reversed(apart.values()), strict=True))),
    )
    assert summary["switches"] == 2


def test_a_ghost_counts_once_however_long_it_lives() -> None:
    there = {"person/anna": (0.0, 0.0)}
    both = {"person/1": (0.0, 0.0), "person/2": (9.0, 9.0)}
    alone = {"person/1": (0.0, 0.0)}
    assert judged((there, both), (there, both), (there, alone), (there, both))["false_tracks"] == 2
    assert judged((there, both), (there, both))["false"] == pytest.approx(CUT**2 / 2)


def test_a_track_that_was_once_of_somebody_is_no_ghost() -> None:
    there = {"person/anna": (0.0, 0.0)}
    summary = judged((there, {"person/1": (0.0, 0.0)}), ({}, {"person/1": (0.0, 0.0)}))
    assert summary["false_tracks"] == 0
    assert summary["false"] == pytest.approx(CUT**2 / 2 / 2)


def test_the_parts_are_those_of_the_square() -> None:
    summary = judged(
        ({"person/anna": (0.0, 0.0), "person/ben": (9.0, 0.0)}, {"person/1": (0.0, 2.0), "person/2": (-9.0, 0.0)}),
        ({}, {}),
    )
    assert (summary["localisation"], summary["missed"], summary["false"]) == (2.0, 2.25, 2.25)
    assert summary["gospa"] == pytest.approx(np.sqrt(6.5))


def test_existence_is_judged_by_whether_somebody_is_there() -> None:
    there = {"person/anna": (0.0, 0.0)}
    summary = judged((there, {"person/1": (0.0, 0.0), "person/2": (9.0, 9.0)}), existence=0.8)
    assert summary["existence"]["brier"] == pytest.approx((0.04 + 0.64) / 2)  # type: ignore[index]


def test_nothing_to_judge_is_nothing() -> None:
    assert judged(({}, {})) == {}
