"""A robot that lies in a replay: what it reports is moved, and what is not about its place is left as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from blackboard.errors import UserError
from blackboard.tape.content import Tape
from blackboard.tape.judge import course, judge
from blackboard.tape.lies import lying, parse_lies
from blackboard.tape.paired import BLOCKS, paired, text
from blackboard.tape.whatif import what_if
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import PackedBelief, Report
from sim_world.series import Sample
from tests.tape.teams import SMALL, recorded_run


@pytest.fixture(scope="module")
def tape(tmp_path_factory: pytest.TempPathFactory) -> Tape:
    return recorded_run(tmp_path_factory.mktemp("tape") / "x.mcap", SMALL.changed("board", fusion="joint"))[1]


def reports(tape: Tape) -> list[tuple[Envelope, Report]]:
    found = ((e, open_envelope(e)[2]) for _, e in tape.envelopes if e.kind is Kind.PUT and keys.REPORT.match(e.key))
    return [(envelope, report) for envelope, report in found if isinstance(report, Report)]


def test_everything_that_the_liar_reports_is_moved(tape: Tape) -> None:
    change = lying({"r2": 3.0})
    moved = 0
    for envelope, report in reports(tape):
        after = open_envelope(change(envelope))[2]
        assert isinstance(after, Report)
        if report.source != "r2":
            assert change(envelope) is envelope
            continue
        pairs = [(report.belief, after.belief)]
        if report.informed is not None and after.informed is not None:
            pairs.append((report.informed.belief, after.informed.belief))
        for before, now in pairs:
            check_moved(before, now)
            moved += 1
        if report.evidence is not None and after.evidence is not None:
            assert after.evidence.relatives == report.evidence.relatives
            if report.evidence.increment is not None and after.evidence.increment is not None:
                gained = np.subtract(after.evidence.increment.reference, report.evidence.increment.reference)
                assert gained == pytest.approx([3.0, *[0.0] * 8])
    assert moved > 5


def check_moved(before: PackedBelief, now: PackedBelief) -> None:
    p, q = unpack(before).p, unpack(now).p
    assert q[3:-1] == pytest.approx(p[:-4], rel=0.06, abs=1e-4)  # the wire rounds
    assert q[-1].sum() == pytest.approx(p[-4:].sum(), rel=0.06, abs=1e-3)


def test_a_liar_changes_what_the_boards_believe(tape: Tape) -> None:
    story = course(tape, tape.runs[0])
    ones, others = list[Sample](), list[Sample]()
    judge(tape.scenario, story, what_if(tape, tape.scenario), record=ones.append)
    judge(tape.scenario, story, what_if(tape, tape.scenario, change=lying({"r2": 5.0})), record=others.append)
    found = paired(ones, others)
    assert found["robots"]["consensus"]["error"]["value"] > 0.2
    assert found["robots"]["consensus"]["error"]["low"] is None  # a run of five ticks is too short
    assert "too short" in text(found, "cell")


def sample(tick: int, mean_x: float, log_score: float = 0.0) -> Sample:
    return Sample(
        tick=tick, time=0.2 * tick, robot="r1", sub_team="a", subject="robot/r1", level="agreed", truth_x=0.0, truth_y=0.0,
        mean_x=mean_x, mean_y=0.0, log_score=log_score, region=0.5, border=0.1, area=1.0, landmark_age=0.0,
    )  # fmt: skip


def test_the_interval_is_that_of_the_means_of_blocks() -> None:
    rng = np.random.default_rng(1)
    shift = np.repeat(rng.normal(0.5, 0.1, BLOCKS), 10)
    ones = [sample(tick, 1.0) for tick in range(10 * BLOCKS)]
    others = [sample(tick, 1.0 + shift[tick], -shift[tick]) for tick in range(10 * BLOCKS)]
    found = paired(ones, [*others, sample(5000, 9.0)])["robots"]["agreed"]
    assert found["n"] == 10 * BLOCKS
    blocks = shift[::10]
    half = 2.262 * blocks.std(ddof=1) / np.sqrt(BLOCKS)
    assert found["error"] == pytest.approx(
        {"value": blocks.mean(), "low": blocks.mean() - half, "high": blocks.mean() + half}
    )
    assert found["log_score"]["value"] == pytest.approx(-blocks.mean())
    assert "robots agreed: error +0." in text(paired(ones, others), "cell")


@pytest.mark.parametrize("given", ["r2", "r9=3", "r2=far", "r2=nan", "r2=1e9", "=3"])
def test_a_mistake_is_one_line(given: str) -> None:
    with pytest.raises(UserError, match=r"--lie .*: (say|no such robot)"):
        parse_lies([given], ["r1", "r2"])


def test_the_tape_is_not_changed(tape: Tape, tmp_path: Path) -> None:
    before = [envelope.payload for _, envelope in tape.envelopes]
    what_if(tape, tape.scenario, change=lying({"r1": 5.0}))
    assert [envelope.payload for _, envelope in tape.envelopes] == before
