"""The ledger notices what counts twice, and boards that differ; and it is quiet about a team at work."""

from dataclasses import replace
from typing import Any

import pytest

from blackboard.board.service import BoardService, board_of
from blackboard.config import Scenario
from blackboard.wire.messages import Consensus, Report
from tests.nights.events import Event, Said, Stepped
from tests.nights.ledger import SAMPLED, EvidenceCountsOnce, SameEvidenceSameBits, SightingsAreToldOnce
from tests.nights.night import RATE, Night, Team
from tests.nights.oracles import Oracle
from tests.nights.run import differs, judged, played
from tests.nights.stage import ALONE, Stage

NIGHT = Night(Team({"a": ("r1", "r2"), "b": ("r3",)}, "lockstep", tick=1.0, latency=0.2, fusion="joint"), seed=2)


@pytest.fixture(scope="module")
def events() -> list[Event]:
    return played(NIGHT)


def test_boards_that_settle_a_step_once_say_what_each_says_that_settles_alone() -> None:
    night = replace(NIGHT, team=replace(NIGHT.team, boards=2))
    both = list[list[Event]]()
    for steps_alone in (ALONE, 1):
        both.append([])
        Stage(night, both[-1].append, alone=steps_alone).play()
    together, alone = ([(e.at, e.process, e.envelope) for e in events if isinstance(e, Said)] for events in both)
    assert together == alone
    assert len(steps(both[0])) == len(steps(both[1])) > 2 * SAMPLED


def steps(events: list[Event]) -> list[Stepped]:
    return [event for event in events if isinstance(event, Stepped)]


@pytest.mark.parametrize("oracle", [EvidenceCountsOnce, SameEvidenceSameBits])
def test_a_team_at_work_breaks_nothing(oracle: type[Oracle], events: list[Event]) -> None:
    assert len(steps(events)) > 2 * SAMPLED
    assert not judged(oracle(NIGHT), events)


def test_evidence_that_is_taken_in_two_steps_is_noticed(events: list[Event]) -> None:
    first, *_, last = [step for step in steps(events) if step.batch]
    again = replace(last, number=last.number + 1, board=first.board, batch=first.batch)
    assert "takes ('robot/r" in judged(EvidenceCountsOnce(NIGHT), [*events, again])


def test_a_step_that_failed_may_be_made_again_with_less(events: list[Event]) -> None:
    last = steps(events)[-1]
    assert not judged(EvidenceCountsOnce(NIGHT), [*events, replace(last, batch=last.batch[1:])])


def test_a_joint_that_knows_more_than_its_evidence_tells_is_noticed(events: list[Event]) -> None:
    sound, reasons = steps(events), []
    for number, last in enumerate(sound[-8:], len(sound) - 8):
        after = last.after.copy()
        after.covariance *= 0.5
        before = [step for step in sound[:number] if step.board is last.board]
        replayed: list[Event] = [*before[-(SAMPLED - 1) :], replace(last, after=after)]
        reasons.append(judged(EvidenceCountsOnce(NIGHT), replayed))
    assert any("of the variance that its evidence leaves" in reason for reason in reasons)


def test_a_sighting_that_a_robot_tells_again_is_noticed() -> None:
    night = replace(NIGHT, team=replace(NIGHT.team, rate=RATE))
    events = played(night)
    told = [event for event in reports(events) if event.process == "robot/r1" and event.message.evidence.relatives]
    assert len(told) < night.end / night.team.tick
    assert not judged(SightingsAreToldOnce(night), events)
    before, last = told[-2:]
    seen = last.message.evidence.relatives[0].model_copy(update={"age": last.message.time - before.message.time})
    evidence = last.message.evidence.model_copy(update={"relatives": [seen]})
    again = replace(last, message=last.message.model_copy(update={"evidence": evidence}))
    assert "robot/r1 tells" in judged(SightingsAreToldOnce(night), [*events[: events.index(last)], again])


def reports(events: list[Event]) -> list[Any]:
    """What is said with evidence."""
    said = [event for event in events if isinstance(event, Said) and isinstance(event.message, Report)]
    return [event for event in said if event.message.evidence is not None]  # type: ignore[union-attr]


def test_boards_that_differ_after_the_same_evidence_are_noticed(events: list[Event]) -> None:
    said = [event for event in events if isinstance(event, Said) and isinstance(event.message, Consensus)]
    last = next(event for event in reversed(said) if event.message is not None and event.message.rule == "joint")  # type: ignore[attr-defined]
    assert isinstance(last.message, Consensus)
    other = last.message.model_copy(update={"state": None, "belief": said[0].message.belief})  # type: ignore[union-attr]
    reason = judged(SameEvidenceSameBits(NIGHT), [*events, replace(last, message=other)])
    assert "agree on two beliefs about" in reason


def test_the_tape_of_a_night_replays_and_boards_of_other_settings_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(NIGHT, lambda event: None, record=True)
    stage.play()
    assert differs(stage) is None

    def otherwise(scenario: Scenario, sub_team: str, board: str | None = None) -> BoardService:
        return board_of(scenario.changed("board", feedback="off", fusion="opinions"), sub_team, board)

    monkeypatch.setattr("blackboard.tape.replay.board_of", otherwise)
    assert "otherwise in the replay" in str(differs(stage))
