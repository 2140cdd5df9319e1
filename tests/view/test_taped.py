"""The one fold on a tape: the golden one gives the same moments as its messages, and `why` and `status` look at it without a network."""

import json
import pickle
from pathlib import Path

import pytest

from blackboard.errors import RunFailed, UserError
from blackboard.state.fold import Fold
from blackboard.state.moments import When
from blackboard.tape.file import create, read
from blackboard.tape.table import rows
from blackboard.view.feed import Feed, TapeFeed, newest
from blackboard.view.source import open_tape
from blackboard.wire.envelope import Envelope, Kind
from tests.commands import call
from tests.files import GOLDEN
from tests.view.recorded import Deaf, recorded


def test_the_fold_takes_a_tape_and_finds_every_settled_tick() -> None:
    feed = TapeFeed(read(GOLDEN))
    while not feed.done:
        feed.hear_envelopes(feed.receive())
    team = feed.fold.teams["demo"]
    assert [moment.tick for moment in team.moments] == list(range(16))
    assert feed.fold.refused == {}
    assert {process.name for process in team.processes.values()} == {"world", "board-a", "board-b", "r1", "r2", "r3"}
    from blackboard.tape.content import load_tape

    errors = {
        (row["tick"], row["subject"]): row["error"] for row in rows(load_tape(GOLDEN)) if row["level"] == "agreed"
    }
    for moment in team.moments:
        for subject, about in moment.subjects.items():
            if about.agreed:
                assert about.scores["agreed"].error == pytest.approx(errors[moment.tick, subject])


def test_why_on_a_tape_is_of_any_tick(capsys: pytest.CaptureFixture[str]) -> None:
    for tick in (0, 7, 15):
        assert call("why", "robot/r1", GOLDEN, "--at", tick, "--json") == 0
        explained = json.loads(capsys.readouterr().out)
        assert (explained["tick"], explained["subject"], explained["team"]) == (tick, "robot/r1", "demo")
        assert explained["truth"] is not None
    assert call("why", "robot/r1", GOLDEN) == 0
    assert capsys.readouterr().out.startswith("robot/r1 is believed to be at (")


@pytest.mark.parametrize(("at", "tick"), [("7", 7), ("1.4s", 7), ("1.5s", 7), ("0s", 0), ("3s", 15)])
def test_a_moment_is_named_by_its_tick_or_by_team_time(at: str, tick: int) -> None:
    assert open_tape(GOLDEN, None).moment(When.of(at)).tick == tick


@pytest.mark.parametrize("wrong", ["x", "-1s", "s", "nans", "2.5"])
def test_a_moment_that_is_neither_is_a_mistake(wrong: str) -> None:
    with pytest.raises(UserError, match="give a tick as 200, or seconds"):
        call("why", "robot/r1", GOLDEN, f"--at={wrong}")


def test_a_moment_is_found_without_unpacking_all_at_each_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """It took minutes on a tape of 30 s, which has a thousand looks and 150 ticks."""
    unpacked: list[bytes] = []
    loads = pickle.loads

    def count(packed: bytes) -> object:
        unpacked.append(packed)
        return loads(packed)

    monkeypatch.setattr(pickle, "loads", count)
    taped = open_tape(GOLDEN, None)
    assert taped.moment(When(tick=3)).tick == 3
    assert len(unpacked) <= len(taped.fold.moments)


def test_status_of_a_tape_is_how_it_ends(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("status", GOLDEN, "--json") == 0
    team = json.loads(capsys.readouterr().out)["teams"][0]
    assert (team["team"], team["tick"]) == ("demo", 15)
    assert team["age"] < 5.0  # by the times on the tape, not by those of today


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["why", "robot/r1", GOLDEN, "--at", "99"], "tick 99 was not settled; the last tick is 15"),
        (["why", "robot/r1", GOLDEN, "--at", "99s"], "second 99 was not settled; the last tick is 15"),
        (["why", "robot/r9", GOLDEN], "no board has a belief about it in tick 15"),
        (["why", "robot/r1", GOLDEN, "--team", "other"], "team other has settled nothing; there is demo"),
        (["why", "robot/r1", GOLDEN, "-e", "tcp/127.0.0.1:1"], "without a network"),
        (["status", GOLDEN, "--watch"], "--watch: a tape does not change"),
        (["status", "nowhere.mcap"], "cannot be read"),
        (["view", "nowhere.mcap", "--port", "0"], "cannot be read"),
    ],
)
def test_a_mistake_is_one_line(arguments: list[object], says: str) -> None:
    with pytest.raises((UserError, RunFailed), match=says):
        call(*arguments)


def test_a_tape_without_messages_is_a_mistake(tmp_path: Path) -> None:
    from blackboard.tape.file import TapeWriter

    with create(tmp_path / "empty.mcap") as out:
        TapeWriter(out, {}).close()
    with pytest.raises(UserError, match="no message on this tape"):
        call("status", tmp_path / "empty.mcap")


def test_of_plenty_the_newest_of_each_key_settle_the_newest_tick() -> None:
    envelopes = [envelope for envelope, _ in recorded()]
    kept = newest(envelopes)
    assert len(kept) < len(envelopes) / 1.5
    assert [each for each in kept if each.kind is not Kind.PUT] == [
        each for each in envelopes if each.kind is not Kind.PUT
    ]
    whole, thinned = Fold(), Fold()
    for fold, some in ((whole, envelopes), (thinned, kept)):
        for envelope in some:
            fold.hear_envelope(envelope, 1_000_000.0)
    all_kept, newest_kept = whole.teams["t"].moments.newest, thinned.teams["t"].moments.newest
    assert all_kept is not None
    assert newest_kept is not None
    assert newest_kept.tick == all_kept.tick
    for name, about in all_kept.subjects.items():
        assert [received.message for received in newest_kept.subjects[name].all()] == [
            received.message for received in about.all()
        ]


class Flood(Deaf):
    """A link on which more comes at once than is taken in."""

    def receive(self, timeout: float) -> list[Envelope]:
        return [envelope for envelope, _ in recorded()] * 20


def test_a_feed_counts_what_it_left_out() -> None:
    feed = Feed(Flood(), lambda: 1_000_000.0)
    taken = feed.receive()
    assert feed.skipped > 0
    puts = {envelope.key for envelope, _ in recorded()}
    assert {envelope.key for _, envelope in taken} == puts
