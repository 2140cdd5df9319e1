"""What the page shows of a team: when a frame is due, what browsers share of it, and what can be gone back to."""

import json
from typing import Any

from blackboard.state.fold import Fold
from blackboard.view.frame import frame, line
from blackboard.view.web.frames import BEAT, LEAST_GAP, Frames
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus
from tests.present import present
from tests.view.recorded import folded, read, recorded, team_of


def remembered() -> Frames:
    """The frames of a run that was looked at after each envelope."""
    fold = folded()
    moments = list(fold.teams["t"].moments)
    frames = Frames(fold, "t")
    fold.teams["t"].moments.clear()
    for n, moment in enumerate(moments):
        fold.teams["t"].moments.add(moment)
        fold.teams["t"].processes["robot", "r1"].tick = 1000 + n
        frames.remember(moment.at)
    return frames


def past(frames: Frames, begin: int = 0) -> dict[str, Any]:
    header: dict[str, Any] = json.loads(frames.past(begin))
    return header


def test_frames_come_with_news_not_faster_than_can_be_seen_and_at_least_every_beat() -> None:
    fold = folded()
    frames = Frames(fold, "t")
    assert frames.look(100.0, 7.0)
    assert not frames.look(100.0 + BEAT / 2, 7.0)  # nothing new
    assert frames.look(100.0 + BEAT, 7.0)
    fold.teams["t"].changes += 1
    assert not frames.look(100.0 + BEAT + LEAST_GAP / 2, 7.0)  # too soon
    assert frames.look(100.0 + BEAT + LEAST_GAP + 1e-6, 7.0)
    assert frames.number == 3


def test_a_frame_has_all_beliefs_of_the_chosen_subject_and_one_of_the_others() -> None:
    frames = Frames(folded(), "t")
    frames.look(1.0, 1e9)
    whole, _ = read(frame(frames.team, frames.team.moments.newest, 1, 1e9))
    for chosen in ("robot/r1", "object/ball", "nothing"):
        header, cells = read(frames.newest(chosen))
        assert frames.newest(chosen) is frames.newest(chosen)  # made once
        assert len(cells) == sum(
            b["box"][0] * b["box"][1] for subject in header["subjects"].values() for b in subject["beliefs"]
        )
        for name, subject in header["subjects"].items():
            beliefs = whole["subjects"][name]["beliefs"]
            assert subject == {**whole["subjects"][name], "beliefs": beliefs if name == chosen else beliefs[:1]}


def test_a_frame_has_by_how_much_the_sensors_of_a_robot_are_found_to_err() -> None:
    fold = Fold()
    for envelope, now in recorded():
        told = envelope
        if envelope.kind is Kind.PUT and keys.AGREED.match(envelope.key) and envelope.key.endswith("/robot/r1"):
            changes = {"parameters": {"bearing bias found (rad)": 0.2}}
            told = Envelope(envelope.key, encode(decode(Consensus, envelope.payload).model_copy(update=changes)))
        fold.hear_envelope(told, now)
    team = fold.teams["t"]
    header, _ = read(frame(team, team.moments.newest, 0, 0.0))
    assert header["subjects"]["robot/r1"]["sensors"] == {"bearing bias found (rad)": 0.2}
    assert header["subjects"]["robot/r2"]["sensors"] == {}


def test_every_moment_has_a_line_and_late_askers_get_the_rest() -> None:
    frames, moments = remembered(), list(team_of().moments)
    header = past(frames)
    assert (header["first"], header["made"]) == (0, len(moments))
    assert header["lines"] == [json.loads(json.dumps(line(moment))) for moment in moments]
    assert past(frames, 2)["lines"] == header["lines"][2:]
    assert past(frames, 99) == {"first": 99, "made": len(moments), "lines": []}


def test_one_can_go_back_to_a_moment_with_the_processes_and_events_of_then() -> None:
    frames, moments = remembered(), list(team_of().moments)
    frames.team.clock = None  # the world has ended since
    for n, moment in enumerate(moments):
        shown = present(frames.at(moment.run, moment.tick, "robot/r1"))
        header, _ = read(shown)
        assert (header["tick"], header["mode"]) == (moment.tick, "lockstep")
        assert next(process["tick"] for process in header["processes"] if process["name"] == "r1") == 1000 + n
        assert all(event["at"] <= moment.at for event in header["events"])
        assert header["subjects"]["robot/r1"]["beliefs"][0]["tick"] == moment.tick
    assert frames.at(moments[0].run, 999, "") is None
    assert frames.at("another", moments[0].tick, "") is None


def test_what_the_moments_forget_the_past_forgets() -> None:
    frames = remembered()
    frames.team.moments.most_bytes = 0
    newest = present(frames.team.moments.newest)
    frames.team.moments.add(newest)
    frames.remember(newest.at)
    assert len(past(frames)["lines"]) == len(frames.team.moments)
    assert frames.at(newest.run, 0, "") is None


def test_another_run_begins_anew() -> None:
    frames = remembered()
    frames.team.hear_message({}, Clock(run="another", tick=0, time=0.0, mode="lockstep"), 1, 0.0)
    frames.remember(0.0)
    assert past(frames) == {"first": 0, "made": 0, "lines": []}


def test_a_team_that_nobody_heard_of_has_a_frame_too() -> None:
    frames = Frames(folded(), "another")
    assert frames.look(1.0, 1.0)
    header, cells = read(frames.newest(""))
    assert (header["tick"], header["processes"], cells) == (None, [], b"")
