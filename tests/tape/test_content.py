"""What is on a tape: its parts, its table, its summary, what a cut leaves, and who is played into a network."""

from pathlib import Path
from typing import Any

import pytest

from blackboard.errors import UserError
from blackboard.judge.card import scorecard
from blackboard.tape.compare import side_by_side, verdict_lines
from blackboard.tape.content import Tape, cut, load_tape, summary
from blackboard.tape.judge import Match, course, judge, match, recorded
from blackboard.tape.player import Part, Player
from blackboard.tape.replay import Replay, is_consensus, replay
from blackboard.tape.table import rows
from blackboard.wire.envelope import Envelope, Kind
from tests.present import present
from tests.tape.teams import SMALL, from_tick, recorded_run
from tests.tape.written import ENVELOPES, written


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Tape, Path]:
    path = tmp_path_factory.mktemp("tape") / "x.mcap"
    return *recorded_run(path), path


def test_a_scenario_comes_from_the_tape_or_from_who_asks(
    tmp_path: Path, run: tuple[dict[str, Any], Tape, Path]
) -> None:
    assert load_tape(run[2]).scenario.team == SMALL.team
    assert load_tape(str(run[2])).scenario.team == SMALL.team
    assert load_tape(run[2], "demo").scenario.name == "demo"
    path = tmp_path / "x.mcap"
    path.write_bytes(written().replace(b'{"name": "x"}', b'{"nome": "x"}'))
    with pytest.raises(UserError, match="unknown section or key 'nome'"):
        load_tape(path)
    path.write_bytes(written().replace(b'{"name": "x"}', b'["name", "x"]'))
    with pytest.raises(UserError, match="without a scenario; give the team's with --scenario"):
        load_tape(path)


def test_a_tape_without_journals_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(written())
    with pytest.raises(UserError, match="no board on the tape kept a journal"):
        replay(load_tape(path))


def test_the_table_has_the_errors_of_the_scorecard(run: tuple[dict[str, Any], Tape, Path]) -> None:
    card, tape, _ = run
    by_row = {(row["tick"], row["level"], row["by"], row["subject"]): row for row in rows(tape)}
    errors = [
        row["error"] for (tick, level, by, s), row in by_row.items() if level == "solo" and s == f"robot/{by}" and tick
    ]
    scores = card["scores"]["robots"]["solo"]
    assert len(errors) == scores["n"]
    assert (sum(e**2 for e in errors if e is not None) / len(errors)) ** 0.5 == pytest.approx(scores["rmse"])
    levels = {row["level"] for row in by_row.values()}
    assert levels == {"solo", "consensus", "agreed"}
    blind = Tape(tape.scenario, [e for e in tape.envelopes if "/truth" not in e[1].key], tape.about)
    bare = list(rows(blind))
    assert len(bare) == len(list(rows(tape)))
    assert {row[name] for row in bare for name in ("error", "truth_x", "log_score", "region")} == {None}
    assert {row["entropy"] for row in bare} == {row["entropy"] for row in rows(tape)}


def test_the_summary_counts_everything(run: tuple[dict[str, Any], Tape, Path]) -> None:
    tape = run[1]
    counts = summary(tape)
    assert (counts["team"], counts["scenario"], counts["runs"]) == ("t", True, tape.runs)
    assert (
        sum(c["messages"] + c["events"] for c in counts["topics"].values()) == counts["messages"] == len(tape.envelopes)
    )
    assert counts["bytes"] == sum(len(envelope.payload) for _, envelope in tape.envelopes)
    assert [(b["board"], b["gaps"], b["whole"]) for b in counts["boards"]] == [
        ("a/board-a", 0, True), ("b/board-b", 0, True),
    ]  # fmt: skip


def test_a_cut_keeps_its_time_its_keys_and_the_tokens_held_then() -> None:
    kept = list(cut(iter(ENVELOPES), 0.3, 0.9, lambda key: "report" not in key))
    assert kept == [(1e9 + 0.25 + 0.3, Envelope("cop/t/world/alive", kind=Kind.ALIVE))] or kept[0][1].kind is Kind.ALIVE
    assert list(cut(iter(ENVELOPES), 0.0, 99.0, lambda key: True)) == ENVELOPES
    assert list(cut(iter(ENVELOPES), 0.0, 0.1, lambda key: True)) == ENVELOPES[:1]
    assert list(cut(iter(ENVELOPES), 0.0, 99.0, lambda key: "report" in key)) == ENVELOPES[2:5]
    gone = [*ENVELOPES, (1e9 + 9.0, Envelope("x", b"1"))]
    assert list(cut(iter(gone), 5.0, 99.0, lambda key: True)) == gone[-1:]


def test_a_recorder_that_came_late_is_told_and_all_is_the_same_after_a_while(
    run: tuple[dict[str, Any], Tape, Path],
) -> None:
    late = from_tick(run[1], 2)
    again = replay(late)
    matched = match(late.runs[-1], recorded(late), again.output)
    assert again.late == ["a/board-a", "b/board-b"]
    assert present(matched.exact_from) <= 3
    assert any("came after the beginning" in line for line in verdict_lines(again, matched))


def test_what_a_replay_lacks_is_told() -> None:
    lines = verdict_lines(Replay(missing=2, gaps=1), Match(1, 2, 3, 4, "tick 7", 9))
    assert "NOT as recorded" in lines[0]
    assert lines[1] == "from tick 9 on all are the same"
    assert [line.split()[0] for line in lines[2:]] == ["2", "the"]
    assert verdict_lines(Replay(), Match(5, 0, 0, 0, "", 0)) == ["as recorded, to the bit: 5 consensuses"]


def test_a_gap_and_a_message_that_is_not_there_are_counted(run: tuple[dict[str, Any], Tape, Path]) -> None:
    tape = run[1]
    journals = [i for i, (_, e) in enumerate(tape.envelopes) if "/journal/" in e.key]
    reports = [i for i, (_, e) in enumerate(tape.envelopes) if "/report/" in e.key]
    report = tape.envelopes[reports[9]][1]
    lost = {journals[5], *(i for i in reports if tape.envelopes[i][1] == report)}
    holey = Tape(tape.scenario, [e for i, e in enumerate(tape.envelopes) if i not in lost], tape.about)
    again = replay(holey)
    assert (again.gaps, again.missing) == (1, 1)
    assert not match(holey.runs[0], recorded(holey), again.output).exact


def test_scorecards_stand_side_by_side(run: tuple[dict[str, Any], Tape, Path]) -> None:
    card, tape, _ = run
    other = scorecard(judge(tape.scenario, course(tape, tape.runs[0]), recorded(tape)))
    lines = side_by_side({"recorded": card, "what if": other}).splitlines()
    assert lines[0].split() == ["recorded", "what", "if"]
    assert lines[1].split()[-2:] == [f"{card['scores']['robots']['solo']['rmse']:.3f}"] * 2
    assert lines[-1].split()[-2:] == [card["hash"][:12]] * 2


@pytest.mark.parametrize("parts", [("world",), ("robots", "boards"), ("world", "robots", "boards")])
def test_a_player_sends_what_was_recorded_when_it_was_due(
    run: tuple[dict[str, Any], Tape, Path], parts: tuple[Part, ...]
) -> None:
    tape = run[1]
    player = Player(tape, 2.0, parts)
    sent: list[Envelope] = []
    now = 100.0
    while not player.done:
        due = present(player.wake_at(now))
        now = max(now, due)
        sent += player.wake(now)
    assert now - 100.0 <= (tape.envelopes[-1][0] - tape.envelopes[0][0]) / 2 + 1e-6
    tokens = {envelope.key for _, envelope in tape.envelopes if envelope.kind is Kind.ALIVE}
    wanted = [e for _, e in tape.envelopes if e.kind is Kind.PUT and "/journal/" not in e.key]
    if parts == ("world",):
        wanted, tokens = [e for e in wanted if "/world/" in e.key], {"cop/t/world/alive"}
    elif parts == ("robots", "boards"):
        wanted, tokens = [e for e in wanted if "/world/" not in e.key], tokens - {"cop/t/world/alive"}
    assert sent == wanted
    assert set(player.tokens) == tokens


def test_a_player_needs_a_speed_and_something_to_send(run: tuple[dict[str, Any], Tape, Path]) -> None:
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(UserError, match="--speed"):
            Player(run[1], speed, ("world",))
    with pytest.raises(UserError, match="nothing on the tape is from boards"):
        Player(Tape(run[1].scenario, run[1].envelopes[:3], run[1].about), 1.0, ("boards",))


def test_a_tape_that_breaks_off_between_a_journal_and_what_it_explains_is_as_recorded_up_to_there(
    run: tuple[dict[str, Any], Tape, Path],
) -> None:
    """A recorder that was killed has the journal of a board's last step, and not all of the consensuses behind it."""
    tape = run[1]
    journals = [i for i, (_, e) in enumerate(tape.envelopes) if "/journal/board-a" in e.key]
    consensuses = [i for i, (_, e) in enumerate(tape.envelopes) if is_consensus(e)]
    at = next(i for i in reversed(journals) if any(i < c < journals[-1] for c in consensuses))
    broken = Tape(tape.scenario, tape.envelopes[: at + 1], tape.about)
    again = replay(broken)
    matched = match(broken.runs[0], recorded(broken), again.output, ended=False)
    assert matched.exact
    assert matched.cut_off > 0
    assert f"breaks off before the last {matched.cut_off} consensuses" in verdict_lines(Replay(), matched)[1]
    assert not match(broken.runs[0], recorded(broken), again.output).exact
    lost = next(c for c in consensuses if "agreed/robot" in tape.envelopes[c][1].key)
    holey = Tape(tape.scenario, [e for i, e in enumerate(broken.envelopes) if i != lost], tape.about)
    assert not match(holey.runs[0], recorded(holey), replay(holey).output, ended=False).exact, "one from the middle"
