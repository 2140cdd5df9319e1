"""What `status`, `echo` and `hz` print."""

import json
from dataclasses import replace

import pytest

from blackboard.errors import UserError
from blackboard.state.fold import Fold
from blackboard.state.moments import About
from blackboard.state.processes import Process
from blackboard.view.echo import Rates, in_order, key_expression, line
from blackboard.view.summary import subject, subject_lines, summary, text
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Status, UnnamedSighting
from tests.present import present
from tests.view.recorded import folded, recorded
from tests.wire.envelopes import put, token


def test_the_summary_is_json_and_its_text_names_everybody() -> None:
    fold = folded()
    shown = summary(fold, 1_000_001.0)
    assert json.loads(json.dumps(shown)) == shown
    team = shown["teams"][0]
    assert (team["team"], team["mode"], team["time"]) == ("t", "lockstep", team["tick"] * 0.5)
    said = text(shown)
    for name in ("board-a", "board-b", "r1", "r2", "r3", "world", "object/ball", "robot/r3", "lockstep"):
        assert name in said
    assert text(summary(Fold(), 0.0)) == "no team is heard of here"


def test_a_process_that_says_nothing_is_silent_and_one_without_a_token_gone() -> None:
    fold = folded()
    fold.hear_envelope(token(keys.MEMBER, "r1", kind=Kind.GONE), 1_000_001.0)
    states = {process["name"]: process["state"] for process in summary(fold, 1_000_100.0)["teams"][0]["processes"]}
    assert (states["r1"], states["r2"]) == ("gone", "silent")


def test_a_process_that_noticed_another_of_its_name_says_so() -> None:
    fold = Fold()
    said = Status(process="r1", kind="robot", tick=1, time=0.0, counters={"namesakes": 2})
    fold.hear_envelope(token(keys.MEMBER, "r1"), 1.0)
    fold.hear_envelope(put(said), 1.0)
    assert "alive, namesakes 2" in text(summary(fold, 1.0))


def test_a_rate_is_over_the_last_ticks_and_falls_in_silence() -> None:
    process = Process("board", "b")
    assert process.rate(0.0) == 0.0
    for tick in range(11):
        process.finished(tick, 0.0, 0.2 * tick)
        process.finished(tick, 0.0, 0.2 * tick)  # repeated
    assert process.rate(2.0) == pytest.approx(5.0)
    assert process.rate(20.0) == pytest.approx(11 / 20)


def test_a_line_is_decoded_or_says_why_not() -> None:
    lines = [line(envelope) for envelope, _ in recorded()]
    report = next(shown for shown in lines if "/report/r1/robot/r1 Report {" in shown)
    assert json.loads(report.split(" ", 2)[2])["belief"]["data"].endswith(" bytes>")
    assert lines[0].endswith(" alive")
    assert line(Envelope("cop/t/world/clock", b"x")).startswith("cop/t/world/clock refused: not-msgpack")


def test_a_short_line_has_the_numbers_and_fits_a_screen() -> None:
    lines = [line(envelope, short=True) for envelope, _ in recorded() if envelope.kind is Kind.PUT]
    report = next(shown for shown in lines if "/report/r1/robot/r1 Report: " in shown)
    assert "tick 0, " in report
    assert report.endswith(" bytes")
    assert max(len(shown) - shown.index(" ") for shown in lines) < 160


@pytest.mark.parametrize("wrong", ["", "a b", "a//b", "/a", "a/", "a*", "a/$*", "a#b"])
def test_a_wrong_key_expression_is_a_person_s_mistake(wrong: str) -> None:
    with pytest.raises(UserError, match="no key expression"):
        key_expression(wrong)


def test_good_key_expressions_are_taken() -> None:
    for good in ("cop/**", "cop/*/a/agreed/object/ball", "**"):
        assert key_expression(good) == good


def test_rates_count_by_key_and_in_all() -> None:
    rates = Rates()
    assert rates.text(2.0) == "nothing came in 2.0 s"
    for _ in range(4):
        rates.count(Envelope("a", b"12"))
    rates.count(Envelope("b", b""))
    assert [row.split() for row in rates.text(2.0).splitlines()] == [
        ["2.00", "Hz", "0.00", "kB/s", "a"],
        ["0.50", "Hz", "0.00", "kB/s", "b"],
        ["2.50", "Hz", "0.00", "kB/s", "all", "2", "keys"],
    ]


def test_the_newest_values_of_a_team_are_a_moment_once_they_are_in_order() -> None:
    newest = {envelope.key: envelope for envelope, _ in recorded() if envelope.kind is Kind.PUT}
    fold = Fold()
    for envelope in in_order(sorted(newest.values(), key=lambda newer: newer.key)):
        fold.hear_envelope(envelope, 0.0)
    moment, whole = fold.teams["t"].moments.newest, folded().teams["t"].moments.newest
    assert moment is not None
    assert whole is not None
    assert moment.tick == whole.tick
    assert moment.subjects.keys() == whole.subjects.keys()


def unclear(probability: float, *, taken: bool = False) -> UnnamedSighting:
    return UnnamedSighting(source="r1", time=0.0, mark=0, probability=probability, taken=taken)


def track(existence: float | None, *sightings: UnnamedSighting) -> About:
    """The ball, as if it were a track that some sightings may be of."""
    moment = present(folded().teams["t"].moments.newest)
    best = present(moment.subjects["object/ball"].best)
    said = best.message.model_copy(update={"existence": existence, "unnamed": list(sightings)})
    return About(agreed={"a": replace(best, message=said)})


def test_a_track_says_how_sure_it_is_there_and_who_may_have_seen_it() -> None:
    row_of = subject(track(0.9, unclear(0.4)))
    assert (row_of["existence"], row_of["unclear"]) == (0.9, [{"source": "r1", "mark": 0, "probability": 0.4}])
    (_, row) = subject_lines({"subjects": {"person/1": row_of}})
    assert "there with 90 %; r1 may have seen it (40 %)" in row
    named = subject(track(None))
    assert (named["existence"], named["unclear"]) == (None, [])


def test_what_one_sighting_may_be_of_is_drawn_faint_by_its_odds_and_what_may_be_gone_too() -> None:
    both = track(1.0, unclear(0.6)), track(1.0, unclear(0.4))
    assert [about.share for about in both] == [0.6, 0.4]
    assert track(1.0, unclear(0.4), unclear(0.99, taken=True)).share == 1.0
    assert track(0.7).share == 0.7
    assert track(None, unclear(0.4)).share == 1.0, "a mate is there whatever was seen"


def test_tracks_and_sightings_without_a_name_are_counted_once_for_all_boards() -> None:
    fold = Fold()
    assert "without a name" not in text(summary(fold, 1.0))
    for board, born in (("a", 3), ("b", 2)):
        counters = {"tracks_born": born, "tracks_died": 1, "unnamed_ambiguous": 7}
        said = Status(process=board, kind="board", tick=1, time=0.0, counters=counters)
        fold.hear_envelope(put(said, sub_team=board), 1.0)
    team = summary(fold, 1.0)["teams"][0]
    assert team["unnamed"] == {"born": 3, "died": 1, "taken": 0, "ambiguous": 7, "strange": 0}
    assert "without a name: 3 tracks began, 1 ended; sightings: 0 clear, 7 ambiguous" in text(summary(fold, 1.0))
