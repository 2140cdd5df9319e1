"""A robot that lies in a replay: what it reports is moved, and what is not about its place is left as it is."""

from pathlib import Path

import pytest

from blackboard.errors import UserError
from blackboard.judge.paired import paired, text
from blackboard.judge.samples import Sample
from blackboard.tape.content import Tape
from blackboard.tape.judge import course, judge
from blackboard.tape.lies import lying, parse_lies
from blackboard.tape.whatif import what_if
from blackboard.wire import keys
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.falsified import displaced
from blackboard.wire.messages import Report
from tests.tape.teams import SMALL, recorded_run


@pytest.fixture(scope="module")
def tape(tmp_path_factory: pytest.TempPathFactory) -> Tape:
    return recorded_run(tmp_path_factory.mktemp("tape") / "x.mcap", SMALL.changed("board", fusion="joint"))[1]


def reports(tape: Tape) -> list[tuple[Envelope, Report]]:
    messages = ((e, open_envelope(e)[2]) for _, e in tape.envelopes if e.kind is Kind.PUT and keys.REPORT.match(e.key))
    return [(envelope, report) for envelope, report in messages if isinstance(report, Report)]


def test_everything_that_the_liar_reports_is_displaced_as_by_a_fault(tape: Tape) -> None:
    change = lying({"r2": 3.0})
    changes = [(report, envelope, change(envelope)) for envelope, report in reports(tape)]
    assert all(after is before for report, before, after in changes if report.source != "r2")
    lies = [(report, open_envelope(after)[2]) for report, _, after in changes if report.source == "r2"]
    assert len(lies) > 5
    assert any(report.evidence is not None for report, _ in lies)
    assert all(lie == displaced(report, (3.0, 0.0)) for report, lie in lies)


def test_what_cannot_be_read_stays_as_it_is(tape: Tape) -> None:
    change, (envelope, report) = lying({"r2": 3.0}), next(said for said in reports(tape) if said[1].source == "r2")
    other = Envelope(envelope.key, envelope.payload[:-1])
    assert change(other) is other
    belief = report.belief.model_copy(update={"data": b"x"})
    other = Envelope(envelope.key, encode(report.model_copy(update={"belief": belief})))
    assert change(other) is other


def test_a_liar_changes_what_the_boards_believe(tape: Tape) -> None:
    story = course(tape, tape.runs[0])
    ones, others = list[Sample](), list[Sample]()
    judge(tape.scenario, story, what_if(tape, tape.scenario), record=ones.append)
    judge(tape.scenario, story, what_if(tape, tape.scenario, change=lying({"r2": 5.0})), record=others.append)
    differences = paired(ones, others)
    assert differences["robots"]["consensus"]["error"]["value"] > 0.2
    assert differences["robots"]["consensus"]["error"]["low"] is None  # a run of five ticks is too short
    assert "too short" in text(differences, "cell")


@pytest.mark.parametrize("given", ["r2", "r9=3", "r2=far", "r2=nan", "r2=1e9", "=3"])
def test_a_mistake_is_one_line(given: str) -> None:
    with pytest.raises(UserError, match=r"--lie .*: (say|no such robot)"):
        parse_lies([given], ["r1", "r2"])


def test_the_tape_is_not_changed(tape: Tape, tmp_path: Path) -> None:
    before = [envelope.payload for _, envelope in tape.envelopes]
    what_if(tape, tape.scenario, change=lying({"r1": 5.0}))
    assert [envelope.payload for _, envelope in tape.envelopes] == before
