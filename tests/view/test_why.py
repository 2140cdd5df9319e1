"""Why: what is computed again is what was published, what is left out is really left out, and the sentences say it."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from blackboard.board.fusion import fuse_opinions
from blackboard.config import BoardSection
from blackboard.errors import UserError
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import gaussian
from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.provenance import Opinion
from blackboard.state.fold import Fold
from blackboard.state.moments import Moment
from blackboard.state.team import TeamFold
from blackboard.view.feed import TapeFeed
from blackboard.view.summary import summary, text
from blackboard.view.why import explain
from blackboard.view.words import LITTLE, sentences
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Camp, Consensus, Dissent, Report, Status
from tests.present import present
from tests.scenarios import LEARNS, SCENARIO
from tests.view.recorded import record, recorded, team_of

#: What quantised logarithms on the wire cost: reports are read back before they are fused, the consensus is read back once more.
QUANTISED = 2e-3  # nats


def newest(team: TeamFold | None = None) -> tuple[TeamFold, Moment]:
    """A team [default: that of the recorded run], and its newest moment."""
    team = team_of() if team is None else team
    return team, present(team.moments.newest)


def folded_with(change: Callable[[Consensus], dict[str, Any]]) -> Fold:
    """A fold of the recorded run, in which what was agreed on says something else."""
    fold = Fold()
    for envelope, now in recorded():
        payload = envelope.payload
        if "/agreed/" in envelope.key and envelope.kind is Kind.PUT:
            said = decode(Consensus, payload)
            payload = encode(said.model_copy(update=change(said)))
        fold.hear_envelope(replace(envelope, payload=payload), now)
    return fold


def test_every_pooled_belief_is_computed_again_as_it_was_published() -> None:
    team, checked = team_of(), 0
    for moment in team.moments:
        for subject in moment.subjects:
            for level in explain(team, moment, subject)["levels"]:
                assert present(level["recomputed"]) < QUANTISED
                checked += 1
    assert checked > 20


def test_an_agreed_belief_that_cannot_be_read_has_sentences() -> None:
    team, moment = newest(
        folded_with(lambda said: {"belief": said.belief.model_copy(update={"data": b"x"})}).teams["t"]
    )
    told = explain(team, moment, "robot/r1")
    assert told["levels"][0]["mean"] is None
    assert any(line.startswith("Sub-team a by itself: at (") for line in sentences(told))


def test_a_belief_of_which_no_source_is_named_has_sentences() -> None:
    told = explain(*newest(folded_with(lambda said: {"used": []}).teams["t"]), "robot/r1")
    assert sentences(told)[0].endswith("because its board says so, and not who said it.")


def test_a_belief_that_is_impossible_by_its_sources_is_json() -> None:
    """Where they are certain that it is not."""
    fold = Fold()
    here, elsewhere = (pack(gaussian(SCENARIO.grid, place, 0.1)) for place in ((5, 5), (20, 20)))
    for envelope, now in recorded():
        payload = envelope.payload
        if keys.REPORT.match(envelope.key):
            report = decode(Report, payload)
            certain = here.model_copy(update={"rest": 0.0})
            payload = encode(report.model_copy(update={"belief": certain, "informed": None}))
        elif keys.CONSENSUS.match(envelope.key):
            said = decode(Consensus, payload)
            payload = encode(said.model_copy(update={"belief": elsewhere, "firsthand": None}))
        fold.hear_envelope(replace(envelope, payload=payload), now)
    told = explain(*newest(fold.teams["t"]), "robot/r1")
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert {level["recomputed"] for level in told["levels"] if level["level"] == "consensus"} == {None}


def test_what_a_board_learned_is_computed_again_as_well() -> None:
    """After 10 s the weights in force are no longer those of the settings, and everything that is needed is published."""
    fold, powers, independences, checked = Fold(), set[float](), set[object](), 0
    for envelope, now in record(LEARNS):
        fold.hear_envelope(envelope, now)
    team = fold.teams["t"]
    assert team.moments.newest is not None
    for subject in team.moments.newest.subjects:
        for level in explain(team, team.moments.newest, subject)["levels"]:
            assert level["recomputed"] < QUANTISED
            powers |= {source["power"] for source in level["sources"]}
            independences.add(level["parameters"]["independence"])
            checked += 1
    assert checked > 5
    assert min(powers) < 0.95
    assert max(independences) > 0.3  # type: ignore[type-var, operator]


def test_old_reports_are_computed_again_with_the_speeds_that_their_robots_gave() -> None:
    """On a poor link most reports of a tick are from earlier ones, and boards let them spread by the robots' speeds."""
    fold, ages = Fold(), list[float]()
    team = SCENARIO.changed("team", sub_teams={"a": ["r1", "r2", "r3"]})
    for envelope, now in record(team.changed("robot", send={"budget": 400.0})):
        fold.hear_envelope(envelope, now)
    for moment in fold.teams["t"].moments:
        for subject, about in moment.subjects.items():
            for level in explain(fold.teams["t"], moment, subject)["levels"] if about.best is not None else ():
                assert level["recomputed"] < QUANTISED, (moment.tick, subject)
                ages += [source["age"] for source in level["sources"] if subject.startswith("robot/")]
    assert sum(age > 0.4 for age in ages) > 10


def behind_by_a_tick() -> tuple[TeamFold, Moment]:
    """A tape of two boards, and a moment that board a has not agreed on: what it agreed on comes too late, as in real time."""

    def is_late(envelope: Envelope) -> bool:
        if envelope.key == "cop/t/a/status/board-a" and envelope.kind is Kind.PUT:
            status = decode(Status, envelope.payload)
            return (status.tick, status.phase) == (4, "agreed")
        return envelope.key.startswith("cop/t/a/agreed/") and decode(Consensus, envelope.payload).tick == 4

    tape = TapeFeed((at, envelope) for envelope, at in recorded() if not is_late(envelope))
    while not tape.done:
        tape.hear_envelopes(tape.receive())
    moment = tape.fold.teams["t"].moments.at(4)
    return tape.fold.teams["t"], present(moment)


def test_boards_are_compared_in_one_tick() -> None:
    """A board that was a tick behind was said to have agreed on something else, and what the other had was shown as its own."""
    team, moment = behind_by_a_tick()
    explained = explain(team, moment, "robot/r1")
    assert (explained["agreed_by"], explained["agreed_before"], explained["same"]) == (["b"], {"a": 3}, True)
    assert [explained["levels"][0][name] for name in ("level", "sub_team", "tick")] == ["agreed", "b", 4]
    said = sentences(explained)
    assert "Agreed by b; a agreed last in tick 3." in said
    assert not any("not quite the same" in line for line in said)


def test_a_power_that_no_board_would_say_ends_nothing() -> None:
    for power in (0.0, 1e12):

        def used(consensus: Consensus, power: float = power) -> dict[str, Any]:
            return {"used": [opinion.model_copy(update={"power": power}) for opinion in consensus.used]}

        assert sentences(explain(*newest(folded_with(used).teams["t"]), "robot/r1"))


def test_without_a_source_it_is_what_the_others_would_have_made() -> None:
    """The same by hand: first-hand and informed reports but those of r1, fused as the board does."""
    team, moment = newest()
    subject = next(
        name
        for name, about in moment.subjects.items()
        if {opinion.source for opinion in about.consensus["a"].message.used} == {"r1", "r2"}
    )
    about = moment.subjects[subject]
    level = next(
        explained
        for explained in explain(team, moment, subject)["levels"]
        if explained["sub_team"] == "a" and explained["level"] == "consensus"
    )
    opinions = {}
    for name, received in about.reports.items():
        report = received.message
        opinions[name] = [Opinion(name, unpack(report.belief), {name: report.time})]
        if report.informed is not None:
            opinions[name].append(Opinion(name, unpack(report.informed.belief), report.informed.ancestors))
    grid = opinions["r1"][0].belief.grid
    in_force = BoardSection.model_validate(level["parameters"])  # what the board had learned until then
    powers = {(source["source"], source["how"]): source["power"] for source in level["sources"]}
    both = fuse_opinions(opinions["r1"] + opinions["r2"], grid, in_force, subject, powers=powers).belief
    alone = fuse_opinions(opinions["r2"], grid, in_force, subject, powers=powers).belief
    assert level["without"]["r1"]["nats"] == pytest.approx(kullback_leibler(both.p, alone.p))
    assert level["without"]["r1"]["shift"] == pytest.approx(math.dist(both.mean(), alone.mean()))


def test_in_a_joint_it_is_said_who_was_used_and_nobody_gets_a_weight() -> None:
    team, moment = newest(team_of(joint=True))
    level = explain(team, moment, "robot/r1")["levels"][0]
    assert level["rule"] == "joint"
    assert level["without"] == {}
    said = " ".join(sentences(explain(team, moment, "robot/r1")))
    assert "one joint belief of the whole team, without weights" in said
    best = present(moment.subjects["robot/r1"].best)
    assert level["heading"] == present(best.message.state).mean[HEADING]
    assert 0 < level["heading_sigma"] < 1
    assert explain(team, moment, "object/ball")["levels"][0]["heading"] is None


def test_the_first_sentence_answers_and_the_others_have_the_numbers() -> None:
    team, moment = newest()
    for subject in moment.subjects:
        explained = explain(team, moment, subject)
        first, *rest = sentences(explained)
        agreed = explained["levels"][0]
        assert first.startswith(f"{subject} is believed to be at (")
        assert f"give or take {agreed['sigma']:.2f}, because " in first
        assert any(source["source"] in first for source in agreed["sources"]) or set(agreed["ancestors"])
        said = " ".join(rest)
        assert f"entropy {agreed['entropy']:.2f} nats" in said
        assert f"log score {agreed['truth']['log_score']:.2f} nats" in said
        for name, change in agreed["without"].items():
            if change and change["nats"] is not None:
                is_told = f"Without {name} it would be {change['shift']:.2f}" in said
                assert is_told == (change["nats"] >= LITTLE)


def test_coalitions_are_told_by_what_they_assume() -> None:
    level = {**explain_one(), "components": [0.03, 0.97]}
    assert "97 % of this belief assumes that both sources are right, 3 % that 1 of 2 is right." in who(level)
    level["components"] = [0.0, 0.25, 0.75]
    assert "75 % of this belief assumes that all 3 sources are right, 25 % that 2 of 3 are right." in who(level)


def test_what_changed_nothing_is_left_out() -> None:
    level = explain_one()
    level["without"] = {"r1": {"nats": 0.5, "shift": 1.0}, "r2": {"nats": 1e-6, "shift": 0.0}}
    level["learned"] = [
        LEARNED,
        {**LEARNED, "source": "r2", "variance": 4.0},
        {**LEARNED, "source": "r3", "echo": "r2"},
    ]
    said = who(level)
    assert "r2 changed nothing." in said
    assert not any("Without r2" in line or "errors of r1" in line for line in said)
    assert "The errors of r2 are 2.0 times what it claims (from 60 comparisons)." in said
    assert "r3 is an echo of r2 (from 60 comparisons)." in said


LEARNED = {"source": "r1", "variance": 1.05, "correlation": 0.0, "samples": 60.0, "echo": None, "since": None}


def explain_one() -> dict[str, Any]:
    """The explanation of a sub-team's belief of two robots."""
    team = team_of()
    for moment in team.moments:
        for subject in moment.subjects:
            levels: list[dict[str, Any]] = explain(team, moment, subject)["levels"]
            for level in levels:
                if level["level"] == "consensus" and len(level["without"]) == 2:
                    return level
    raise AssertionError("no belief of two robots")


def who(level: dict[str, Any]) -> list[str]:
    """What is said of a belief alone."""
    explained = {
        "subject": "x",
        "tick": 1,
        "time": 1.0,
        "unit": "cell",
        "absent": None,
        "truth": None,
        "agreed_by": ["a"],
        "agreed_before": {},
        "same": True,
    }
    return sentences({**explained, "levels": [{**level, "level": "agreed"}]})


def test_large_regions_are_plain_numbers_and_sub_teams_are_called_so() -> None:
    team, moment = newest()
    told = explain(team, moment, "robot/r1")
    told["levels"][0] |= {"area": 1100.4, "without": {}, "rule": "eq12"}
    source = {"how": "independent", "power": 1.0, "age": 0.1, "entropy": 1.0, "contains": []}
    told["levels"][0]["sources"] = [{"source": "a", "weight": 0.7, **source}, {"source": "b", "weight": 0.3, **source}]
    told |= {"same": False, "agreed_by": ["a", "b"], "agreed_before": {}}
    said = sentences(told)
    assert "because sub-team a said so, and what sub-team b said counted less" in said[0]
    assert any("Agreed by a and b, not quite the same: the numbers here are those of a." in line for line in said)
    assert any("95 % region 1100 cell^2" in line for line in said)


def test_an_unknown_subject_is_a_person_s_mistake() -> None:
    team, moment = newest()
    with pytest.raises(UserError, match="known are object/ball"):
        explain(team, moment, "object/nothing")


def test_a_robot_that_is_gone_is_not_taken_for_a_mistyped_one() -> None:
    team, moment = newest()
    token = Envelope(keys.MEMBER.key(team="t", sub_team="a", robot="r1"), kind=Kind.GONE)
    fold = folded_with(lambda said: {})
    fold.hear_envelope(token, moment.at + 1.0)
    team, later = fold.teams["t"], replace(moment, at=moment.at + 219.0)
    assert sentences(explain(team, later, "robot/r1"))[0].endswith("; r1 is gone, for 218 s.")
    assert "r1 is gone" not in " ".join(sentences(explain(team, moment, "robot/r1")))
    forgotten = replace(later, subjects={name: about for name, about in moment.subjects.items() if name != "robot/r1"})
    with pytest.raises(UserError) as told:
        explain(team, forgotten, "robot/r1")
    assert f"; r1 is gone, for 218 s, and was believed last in tick {moment.tick} ({moment.time:.1f} s)" in str(
        told.value
    )
    assert "did you mean" not in str(told.value)


def test_a_robot_of_the_scenario_that_never_came_is_named_by_why() -> None:
    fold = folded_with(lambda said: {})
    fold.expect("t", {"a": ["r9"]})
    with pytest.raises(UserError, match="in tick [0-9]+; r9 was never heard$"):
        explain(*newest(fold.teams["t"]), "robot/r9")


def test_who_keeps_disagreeing_and_opposed_camps_are_told() -> None:
    """As a board tells them: the messages of a run, re-sent with what its consensuses would say."""
    off = Dissent(level="agreed", source="r3", since=1.0, sigmas=4.2, weight=0.1)
    camps = [Camp(sources=["r1", "r2"], weight=0.6), Camp(sources=["r3", "r4"], weight=0.4)]
    fold = folded_with(lambda consensus: {"dissent": [off], "camps": camps, "conflict": True})
    team, moment = newest(fold.teams["t"])
    said = "\n".join(sentences(explain(team, moment, "robot/r1")))
    assert (
        f"r3 keeps disagreeing with the others, for {moment.time - 1.0:.0f} s now, by 4.2 sigmas: it counts by 10 %."
        in said
    )
    assert "r1 and r2 with 60 % of the weight; r3 and r4 with 40 % of the weight." in said
    shown = text(summary(fold, 1_000_001.0))
    assert "conflict r1,r2 against r3,r4; r3 keeps disagreeing" in shown
    assert any("r3 keeps disagreeing about robot/r1, by 4.2 sigmas" in event.text for event in team.events)


def test_sensors_that_err_by_more_than_they_were_told_to_are_told() -> None:
    told = {"bearing bias found (rad)": 0.2, "way scale found": "x"}
    team, moment = newest(folded_with(lambda said: {"parameters": told}).teams["t"])
    said = sentences(explain(team, moment, "robot/r1"))
    assert any("more than it was told: bearing bias found (rad) 0.2;" in sentence for sentence in said)


def test_odometry_that_is_not_believed_is_told() -> None:
    team, moment = newest(folded_with(lambda said: {"parameters": {"odometry distrusted": 1.0}}).teams["t"])
    assert any("than its odometry led" in sentence for sentence in sentences(explain(team, moment, "robot/r1")))
