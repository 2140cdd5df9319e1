"""Other boards on a tape: without a change the recorded consensuses, with one what it changes, and nobody waits for ever."""

from pathlib import Path

import numpy as np
import pytest

from blackboard.errors import UserError
from blackboard.judge.paired import paired, text
from blackboard.judge.samples import Sample
from blackboard.tape.content import Tape
from blackboard.tape.judge import course, judge, match, recorded
from blackboard.tape.lies import lying, parse_lies
from blackboard.tape.replay import Output
from blackboard.tape.whatif import what_if
from blackboard.wire import keys
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.falsified import displaced
from blackboard.wire.messages import Consensus, Report
from tests.tape.teams import SMALL, RecordedTeam, recorded_run


@pytest.fixture(scope="module")
def tape(tmp_path_factory: pytest.TempPathFactory) -> Tape:
    return recorded_run(tmp_path_factory.mktemp("tape") / "x.mcap", SMALL.changed("board", fusion="joint"))[1]


def consensuses(output: Output) -> list[Consensus]:
    return [message for _, e in output.sent if isinstance(message := open_envelope(e)[2], Consensus)]


def test_without_a_change_lockstep_comes_out_as_recorded(tape: Tape) -> None:
    assert match(tape.runs[0], recorded(tape), what_if(tape, tape.scenario)).exact


def test_a_board_that_was_started_again_is_started_again(tmp_path: Path) -> None:
    def story(team: RecordedTeam) -> None:
        team.run_until(lambda: team.world.tick == 1)
        team.kill("b")
        team.run_until(lambda: team.world.tick == 3)
        team.restart("b")

    _, tape = recorded_run(tmp_path / "x.mcap", story=story)
    matched = match(tape.runs[0], recorded(tape), what_if(tape, tape.scenario))
    assert (matched.only_recorded, matched.only_replayed) == (0, 0)
    assert matched.different <= 5  # the agreed beliefs of the tick in which it came back: there the order counts


def test_another_rule_is_in_force(tape: Tape) -> None:
    output = what_if(tape, tape.scenario.with_rule("linear").changed("board", fusion="opinions"))
    assert {c.rule for c in consensuses(output)} == {"linear"}
    recorded_judgement, replayed_judgement = (
        judge(tape.scenario, course(tape, tape.runs[0]), o).judgement for o in (recorded(tape), output)
    )
    assert recorded_judgement.hash != replayed_judgement.hash
    assert recorded_judgement.scores["robots"]["agreed"]["n"] == replayed_judgement.scores["robots"]["agreed"]["n"]
    assert recorded_judgement.scores["robots"]["solo"] == replayed_judgement.scores["robots"]["solo"]


def test_without_a_robot_nobody_knows_it_and_nobody_waits_for_it(tape: Tape) -> None:
    output = what_if(tape, tape.scenario, without=["r2"])
    assert {c.tick for c in consensuses(output)} == set(range(5))
    assert "r2" not in {used.source for c in consensuses(output) for used in c.used}
    judgement = judge(tape.scenario, course(tape, tape.runs[0]), output, without=["r2"]).judgement
    assert set(judgement.scores["robots"]["by_name"]) == {"r1", "r3"}
    assert "r2 was never judged" not in judgement.reasons


@pytest.mark.parametrize("loss", [0.3, 1.0])
def test_what_is_lost_is_waited_for_no_longer_than_patience(tape: Tape, loss: float) -> None:
    rng = np.random.default_rng(1)
    output = what_if(tape, tape.scenario, lose=lambda envelope: rng.random() < loss)
    ticks = {c.tick for c in consensuses(output)}
    assert ticks == (set(range(5)) if loss < 1 else set())
    rng = np.random.default_rng(1)
    again = what_if(tape, tape.scenario, lose=lambda envelope: rng.random() < loss)
    assert [e for _, e in output.sent] == [e for _, e in again.sent]


def test_a_clock_is_never_lost(tape: Tape) -> None:
    asked = []
    what_if(tape, tape.scenario, lose=lambda envelope: asked.append(envelope.key) is not None)
    assert asked
    assert keys.CLOCK.key(team="t") not in asked


def test_in_real_time_boards_settle_every_tick(tmp_path: Path) -> None:
    _, tape = recorded_run(tmp_path / "x.mcap", SMALL.changed("time", mode="realtime"))
    assert {c.tick for c in consensuses(what_if(tape, tape.scenario))} == set(range(5))


# --- a robot that lies: what it reports is moved, and what is not about its place is left as it is -------------------------


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
