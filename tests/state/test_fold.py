"""The fold: what a whole run leaves in it, and that nothing which arrives breaks it or makes it grow without bound."""

import itertools
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.errors import Refused
from blackboard.opinion.scores import Score
from blackboard.state.fold import MAX_TEAMS, Fold
from blackboard.state.processes import MAX_PROCESSES
from blackboard.state.store import MAX_SOURCES, MAX_SUBJECTS
from blackboard.state.team import MAX_TRUTHS, TeamFold
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Report, Status, Truth
from tests.holdings import holdings
from tests.view.recorded import recorded, team_of
from tests.wire.envelopes import put, token


def of(model: type, name: str, joint: bool = False) -> list[Any]:
    """The messages of a run on the topic of a name."""
    parsed_keys = ((keys.parse(envelope.key), envelope) for envelope, _ in recorded(joint) if envelope.kind is Kind.PUT)
    return [decode(model, envelope.payload) for parsed, envelope in parsed_keys if parsed and parsed[0].name == name]


@pytest.mark.parametrize("joint", [False, True])
def test_every_settled_tick_is_a_moment_with_all_that_was_published_in_it(joint: bool) -> None:
    team = team_of(joint)
    agreed = of(Consensus, "agreed", joint)
    assert [moment.tick for moment in team.moments] == sorted({consensus.tick for consensus in agreed})
    for moment in team.moments:
        published = [(consensus.subject, consensus.sub_team) for consensus in agreed if consensus.tick == moment.tick]
        shown = [(subject, name) for subject, about in moment.subjects.items() for name in about.agreed]
        assert sorted(shown) == sorted(published)
        assert all(
            received.message.tick == moment.tick for about in moment.subjects.values() for received in about.all()
        )


def test_the_truth_and_the_scores_are_those_of_the_tick() -> None:
    team, truths = team_of(), {truth.tick: truth for truth in of(Truth, "truth")}
    for moment in team.moments:
        for subject, about in moment.subjects.items():
            assert about.truth == truths[moment.tick].positions[subject]
            if about.agreed and about.best is not None:
                score = Score()
                score.add(unpack(about.best.message.belief), about.truth)
                scored = about.scores["agreed"]
                assert [scored.error, scored.log_score, scored.denser, scored.held] == [
                    score.errors[0],
                    score.log_scores[0],
                    score.levels[0],
                    score.held(95)[0],
                ]


def test_processes_their_ticks_and_who_is_there() -> None:
    team = team_of()
    assert set(team.processes) == {
        ("board", "board-a"),
        ("board", "board-b"),
        ("robot", "r1"),
        ("robot", "r2"),
        ("robot", "r3"),
        ("world", "world"),
    }
    last = max(clock.tick for clock in of(Clock, "clock"))
    assert {process.tick for process in team.processes.values()} == {last}
    assert all(process.alive for process in team.processes.values())
    assert team.processes["robot", "r3"].sub_teams == {"b"}


def test_a_token_that_vanishes_is_noted_with_its_time() -> None:
    fold = Fold()
    fold.hear_envelope(token(keys.MEMBER, "r1"), 1.0)
    fold.hear_envelope(token(keys.MEMBER, "r1", kind=Kind.GONE), 3.0)
    team = fold.teams["t"]
    process = team.processes["robot", "r1"]
    assert not process.alive
    assert process.gone_at == 3.0
    assert [(event.what, event.who, event.at) for event in team.events] == [("here", "r1", 1.0), ("gone", "r1", 3.0)]
    assert team.changes == 2


def test_what_a_robot_sees_is_a_sighting_until_it_sees_something_else() -> None:
    for moment in team_of(joint=True).moments:
        assert all(observer.startswith("robot/") and observer != subject for observer, subject in moment.sightings)
    assert any(moment.sightings for moment in team_of(joint=True).moments)


def test_another_run_begins_with_nothing() -> None:
    fold = Fold()
    for envelope, now in recorded():
        fold.hear_envelope(envelope, now)
    fold.hear_envelope(put(Clock(run="another", tick=0, time=0.0, mode="lockstep")), 5.0)
    assert len(fold.teams["t"].moments) == 0
    assert fold.teams["t"].processes


def test_a_dead_board_holds_no_moment_up() -> None:
    """Board b has a token and stays silent: its tick is shown when the other board has settled the next one."""
    fold, ticks = Fold(), []
    for envelope, now in recorded():
        if "/b/" not in envelope.key or envelope.kind is Kind.ALIVE:
            fold.hear_envelope(envelope, now)
        moment = fold.teams["t"].moments.newest
        if moment is not None and moment.tick not in ticks:
            ticks.append(moment.tick)
    assert ticks == sorted(ticks)
    assert len(ticks) == len(team_of().moments) - 1


def test_the_order_of_arrival_of_different_senders_changes_no_belief() -> None:
    """Within a tick, and the status of each sender behind what it settles."""
    envelopes = [envelope for envelope, _ in recorded()]
    begun = [i for i, sent in enumerate(envelopes) if sent.key.endswith("/world/clock")] + [len(envelopes)]
    fold, chance = Fold(), random.Random(1)
    for envelope in envelopes[: begun[0]]:
        fold.hear_envelope(envelope, 0.0)
    for begin, end in itertools.pairwise(begun):
        senders: dict[str, list[Envelope]] = {}
        for envelope in envelopes[begin:end]:
            parsed = keys.parse(envelope.key)
            assert parsed is not None
            senders.setdefault("board-" + parsed[1]["sub_team"] if "sub_team" in parsed[1] else "", []).append(envelope)
        queues = list(senders.values())
        while queues:
            queue = chance.choice(queues)
            fold.hear_envelope(queue.pop(0), 0.0)
            queues = [waiting for waiting in queues if waiting]
    moments = [
        (moment.tick, subject, sorted(about.agreed), sorted(about.consensus))
        for moment in fold.teams["t"].moments
        for subject, about in moment.subjects.items()
        if about.best
    ]
    assert moments == [
        (moment.tick, subject, sorted(about.agreed), sorted(about.consensus))
        for moment in team_of().moments
        for subject, about in moment.subjects.items()
        if about.best
    ]


# --- whatever arrives -----------------------------------------------------------------------------------------------------

KEYS = st.deferred(lambda: st.sampled_from(sorted({envelope.key for envelope, _ in recorded()})))
PAYLOADS = st.deferred(lambda: st.sampled_from([envelope.payload for envelope, _ in recorded()][::7]))


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(KEYS | st.text(max_size=30), PAYLOADS | st.binary(max_size=40), st.sampled_from(list(Kind))),
        max_size=40,
    )
)
def test_nothing_that_arrives_raises(sent: list[tuple[str, bytes, Kind]]) -> None:
    fold = Fold()
    for n, (key, payload, kind) in enumerate(sent):
        fold.hear_envelope(Envelope(key, payload, kind), float(n))
        for team in fold.teams.values():
            team.check()


def test_a_tick_that_cannot_have_begun_hides_nothing() -> None:
    fold = Fold()
    for envelope, now in recorded():
        fold.hear_envelope(envelope, now)
        parsed = keys.parse(envelope.key)
        if parsed is not None and parsed[0] is keys.STATUS and envelope.kind is Kind.PUT:
            status = decode(Status, envelope.payload)
            liar = status.model_copy(update={"tick": (1 << 53) - 1, "time": 1e15, "kind": "board", "phase": "agreed"})
            fold.hear_envelope(Envelope(envelope.key, encode(liar)), now)
    ticks = [moment.tick for moment in fold.teams["t"].moments]
    assert ticks == [moment.tick for moment in team_of().moments]


def test_names_without_end_are_refused() -> None:
    fold = Fold()
    for n in range(1000):
        fold.hear_envelope(token(keys.MEMBER, "r1", team=f"t{n}"), 0.0)
    assert len(fold.teams) == MAX_TEAMS
    for n in range(2000):
        fold.hear_envelope(token(keys.MEMBER, f"r{n}", team="t0", sub_team=f"s{n}"), 0.0)
    assert len(fold.teams["t0"].processes) == MAX_PROCESSES
    assert fold.refused["too-many"] > 1000


def test_subjects_sources_and_truths_are_bounded() -> None:
    report = next(message for message in of(Report, "report"))
    team = TeamFold("t")
    parts = {"sub_team": "a"}
    for n in range(MAX_SUBJECTS + 5):
        made = report.model_copy(update={"subject": f"object/o{n}"})
        if n < MAX_SUBJECTS:
            team.hear_message(parts, made, 1, 0.0)
        else:
            with pytest.raises(Refused, match="subjects"):
                team.hear_message(parts, made, 1, 0.0)
    for n in range(MAX_SOURCES - 1):
        team.hear_message(parts, report.model_copy(update={"subject": "object/o0", "source": f"x{n}"}), 1, 0.0)
    with pytest.raises(Refused, match="sources"):
        team.hear_message(parts, report.model_copy(update={"subject": "object/o0", "source": "y"}), 1, 0.0)
    held = []
    for n in range(3 * MAX_TRUTHS):
        team.hear_message({}, Truth(run="r", tick=n, time=0.0, positions={"robot/r1": (0.0, 0.0)}), 1, 0.0)
        held.append(holdings(team, "team"))
    assert held[MAX_TRUTHS - 2] != held[MAX_TRUTHS - 1] == held[-1]


def test_refusals_and_conflicts_are_events() -> None:
    team = TeamFold("t")
    status = Status(process="b", kind="board", tick=1, time=0.0)
    team.hear_message({"sub_team": "a"}, status, 1, 0.0)
    team.hear_message({"sub_team": "a"}, status.model_copy(update={"refused": {"future": 3}}), 1, 1.0)
    assert [event.text for event in team.events] == ["b refuses messages: future"]


def test_another_process_of_the_same_name_is_an_event() -> None:
    team = TeamFold("t")
    status = Status(process="r1", kind="robot", tick=1, time=0.0)
    counted = status.model_copy(update={"counters": {"namesakes": 1}})
    for at, said in enumerate((status, counted, counted)):
        team.hear_message({"sub_team": "a"}, said, 1, float(at))
    assert [(event.what, event.text) for event in team.events] == [
        ("namesake", "r1: another process sends under this name, too")
    ]
