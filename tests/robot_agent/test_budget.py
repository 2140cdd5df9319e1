"""A robot on a poor link: what is sent stays within the budget, nothing is left unsaid for ever, and without limits nothing changes."""

import math
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.board.service import board_of
from blackboard.judge.traffic import Traffic
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.gaussian.increment import likelihood
from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.vehicle import AXES, correct, drive
from blackboard.opinion.grid import Grid
from blackboard.state.fold import Fold
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.messages import Consensus, Report, Status
from robot_agent.budget import STATE_EVERY, Bucket, Budget
from robot_agent.coarse import coarser
from robot_agent.config import RobotSection, SendSection
from robot_agent.gaussian.agent import JointAgent
from robot_agent.worth import TeamKnowledge
from tests.heard import Heard
from tests.present import present
from tests.robot_agent.robots import GRID as AGENT_GRID
from tests.robot_agent.robots import readings
from tests.scenarios import SCENARIO

GRID = Grid((20, 20))
SUBJECTS = ("robot/r1", "robot/r2", "object/ball", "object/can")
LONGER = SCENARIO.changed("time", seconds=4.0)


def size(report: Report) -> int:
    return len(encode(report)) + len(keys.REPORT.key(team="t", sub_team="a", source="r1", subject=report.subject))


def new_budget(rate: float, burst: float = 2.0, longest: float = 4.0) -> Budget:
    return Budget(SendSection(budget=rate, burst=burst, longest=longest), GRID, "r1", 1.0, size)


def new_reports(rng: np.random.Generator, time: float, count: int = 4) -> list[Report]:
    """What a robot could say: Gaussians anywhere, of any width."""
    reports = []
    for subject in SUBJECTS[:count]:
        belief = pack(gaussian(GRID, rng.uniform(2, 18, 2), float(rng.uniform(0.4, 4.0))))
        reports.append(Report(source="r1", subject=subject, tick=0, time=time, belief=belief, ancestors={"r1": time}))
    return reports


def divergence(p: Belief, q: Belief) -> float:
    return float((p.p * np.log(np.maximum(p.p, 1e-12) / np.maximum(q.p, 1e-12))).sum())


# --- the bucket and the choice -------------------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(20.0, 20_000.0), st.floats(0.1, 5.0))
def test_any_span_of_time_has_at_most_its_budget_and_a_burst(seed: int, rate: float, burst: float) -> None:
    rng, budget, sent, time = np.random.default_rng(seed), new_budget(rate, burst), list[tuple[float, int]](), 0.0
    largest = 0
    for _ in range(30):
        time += float(rng.choice([0.05, 0.2, 1.0]))
        said = budget.choose(new_reports(rng, time, int(rng.integers(1, 5))), time, 1.0, {})
        sent += [(time, size(report)) for report in said.reports]
        largest = max([largest, *(size(report) for report in said.reports)])
    for i, (begin, _) in enumerate(sent):
        for j in range(i, len(sent)):
            span = sum(n for _, n in sent[i : j + 1])
            assert span <= rate * (sent[j][0] - begin) + max(rate * burst, largest) + 1e-6


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(200.0, 3000.0))
def test_nothing_is_left_unsaid_for_ever(seed: int, rate: float) -> None:
    """At worst all four subjects wait for each other: each costs at most 500 bytes here."""
    rng, budget, said_at = np.random.default_rng(seed), new_budget(rate), dict.fromkeys(SUBJECTS, 0.0)
    most = budget.settings.longest + 4 * 500 / rate + 2 * 500 / rate + 0.4
    for tick in range(60):
        time = 0.2 * tick
        still = new_reports(np.random.default_rng(seed), time)  # no news: worth nothing but for their age
        for report in budget.choose(still if rng.random() < 0.8 else new_reports(rng, time), time, 0.0, {}).reports:
            said_at[report.subject] = time
        assert all(time - at <= most for at in said_at.values()), said_at


def test_what_is_said_or_kept_is_all_that_was_ever_said() -> None:
    rng, budget = np.random.default_rng(1), new_budget(800.0)
    known = set[str]()
    for tick in range(40):
        said = budget.choose(new_reports(rng, 0.2 * tick), 0.2 * tick, 1.0, {})
        subjects = {report.subject for report in said.reports}
        known |= subjects
        assert not subjects & said.kept.keys()
        assert subjects | said.kept.keys() == known


def test_without_a_limit_or_with_room_for_all_reports_are_as_they_were() -> None:
    rng = np.random.default_rng(2)
    for rate in (math.inf, 1e6):
        budget = new_budget(rate)
        for tick in range(10):
            mine = new_reports(rng, 0.2 * tick)
            said = budget.choose(mine, 0.2 * tick, 1.0, {})
            assert said.reports == mine
            assert said.kept == {}


def test_what_moved_comes_before_what_did_not_and_before_what_the_team_knows_better() -> None:
    budget = new_budget(400.0, burst=2.0, longest=100.0)
    still, moved = gaussian(GRID, (5, 5), 1.0), gaussian(GRID, (15, 15), 1.0)

    def about(subject: str, belief: Belief, time: float) -> Report:
        return Report(source="r1", subject=subject, tick=0, time=time, belief=pack(belief))

    first = [about(subject, still, 0.0) for subject in SUBJECTS[1:]]
    for tick in range(10):
        budget.choose(first, float(tick), 0.0, {})
    budget.bucket.level, budget.price = -50.0, 1e-7  # 350 bytes, after the second that comes: room for one
    news = [about("robot/r2", moved, 10.0), about("object/ball", still, 10.0), about("object/can", moved, 10.0)]
    team = {"robot/r2": TeamKnowledge(0.1, joint=False)}  # the team knows where it is far better
    assert [report.subject for report in budget.choose(news, 10.0, 0.0, team).reports] == ["object/can"]


def test_a_bucket_that_goes_back_in_time_gains_nothing() -> None:
    bucket = Bucket(100.0, 200.0)
    bucket.refill(10.0)
    assert bucket.level == 200.0
    bucket.spend(200)
    bucket.refill(5.0)
    assert bucket.level == 0.0
    bucket.refill(6.0)
    assert bucket.level == pytest.approx(100.0)


def test_what_is_seen_of_a_mate_is_no_news_for_its_noise_and_more_with_age_and_where_the_team_knows_little() -> None:
    """Two sightings that follow each other differ by their noise; that was taken for two nats of news."""
    budget, rng = new_budget(300.0, longest=100.0), np.random.default_rng(4)

    def worth(time: float, entropy: float) -> float:
        belief = gaussian(GRID, tuple(10 + rng.normal(size=2)), 1.0)
        said = [Report(source="r1", subject="robot/r2", tick=0, time=time, belief=pack(belief))]
        stale = {"robot/r2": budget.aged("robot/r2", time, 1.0)}
        return budget.options(said, stale, time, {"robot/r2": TeamKnowledge(entropy, joint=False)})["robot/r2"][0].worth

    first = Report(source="r1", subject="robot/r2", tick=0, time=0.0, belief=pack(gaussian(GRID, (10, 10), 1.0)))
    budget.choose([first], 0.0, 1.0, {})
    known = math.log(2 * math.pi * math.e)  # as sharp as a sighting
    worths = [worth(time, known) for time in (0.0, 0.2, 1.0, 4.0)]
    assert worths == sorted(worths)
    assert worths[0] < 0.01
    assert worths[-1] < math.log(2) + 0.01  # at most what one sighting adds to the team's knowledge
    assert worth(4.0, known + 2) > worths[-1] > worth(4.0, known - 2)


# --- coarser beliefs -----------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 20), st.floats(0, 20), st.floats(0.05, 8.0), st.sampled_from([(0.2, 8.0), (0.5, 7.0), (1.0, 3.0)]))
def test_a_coarser_belief_is_valid_smaller_and_near(
    x: float, y: float, sigma: float, precision: tuple[float, float]
) -> None:
    belief = gaussian(GRID, (x, y), sigma)
    fine = pack(belief)
    coarse = coarser(belief, fine, *precision)
    coarser_belief = unpack(coarse, GRID)
    assert coarser_belief.p.sum() == pytest.approx(1.0)
    assert math.prod(coarse.box) <= math.prod(fine.box) or precision[1] > 12
    assert divergence(belief, coarser_belief) < {0.2: 0.02, 0.5: 0.06, 1.0: 0.6}[precision[0]]


def test_a_belief_that_knows_nothing_stays_one() -> None:
    even = uniform(GRID)
    assert unpack(coarser(even, pack(even), 0.5, 7.0), GRID).p == pytest.approx(even.p)


# --- a team ----------------------------------------------------------------------------------------------------------------


class Run(NamedTuple):
    """A run whose world ended in order, and how often a board was late."""

    card: dict[str, Any]
    late: int
    statuses: dict[str, list[Status]]  # by robot
    reports: list[Report]


@cache
def run(fusion: str, budget: float | None = None, again: int = 0) -> Run:
    """A run without limits, or with a budget; `again` is another one that has to be the same."""
    scenario = LONGER.changed("board", fusion=fusion)
    team = InProcessTeam(scenario if budget is None else scenario.changed("robot", send={"budget": budget}))
    heard = Heard(team.bus)
    card = team.run()
    assert team.world.why == ""
    late = sum(board.counters["late"] for board in team.boards.values())
    statuses = {name: heard.of(keys.STATUS, process=name) for name in team.robots}
    return Run({name: card[name] for name in ("hash", "missing")}, late, statuses, heard.of(keys.REPORT))


both = pytest.mark.parametrize("fusion", ["opinions", "joint"])


@both
def test_an_infinite_budget_is_the_stream_without_one(fusion: str) -> None:
    assert run(fusion, math.inf) == run(fusion)


@both
def test_silence_makes_no_board_wait_and_a_run_repeats_to_the_bit(fusion: str) -> None:
    first, everything = run(fusion, 700.0), run(fusion)
    assert first == run(fusion, 700.0, again=1)
    assert first.late == 0
    assert first.card["hash"] != everything.card["hash"]
    assert sum(len(encode(report)) for report in first.reports) < 0.6 * sum(
        len(encode(report)) for report in everything.reports
    )
    assert any(status.kept for status in first.statuses["r1"])
    for status in first.statuses["r1"]:
        assert not set(status.kept) & set(status.subjects)


@both
def test_what_a_robot_is_silent_about_is_still_agreed_on(fusion: str) -> None:
    """Boards keep what it said before: no sample is missing that is there without a budget."""
    missing = [finished.card["missing"] for finished in (run(fusion), run(fusion, 700.0))]
    robots = [{s: n for s, n in samples.items() if s.startswith("robot/")} for samples in missing]
    assert robots[0] == robots[1]


def test_evidence_that_was_not_sent_is_gathered_into_the_next() -> None:
    """Where a robot was, moved by the sum of its motions and multiplied by what it then sends, is what it believes."""
    own = JointAgent("r1", RobotSection(), AGENT_GRID).filter
    nuisance = own.sensors.wheels.nuisance
    for tick in range(3):
        before = own.step(readings(tick, fix=(10, 10) if tick == 0 else None))
    for tick in range(3, 6):
        result = own.step(readings(tick, fix=(10 + 0.5 * tick, 10.2)))
        if tick < 5:
            own.silent()
    assert result.unsent is not None
    assert np.trace(result.unsent.information) > 1.5 * np.trace(present(result.increment).information)
    joint = Joint()
    joint.add(own.robot, present(before.belief))
    drive(joint, own.robot, result.travelled.since(before.travelled), nuisance)
    gained = likelihood(joint, own.robot, result.unsent)
    correct(joint, present(gained))
    now = present(own.belief)
    assert joint.moments(own.robot).mean[AXES] == pytest.approx(now.mean[AXES], abs=0.02)
    assert np.diag(joint.moments(own.robot).covariance)[AXES] == pytest.approx(np.diag(now.covariance)[AXES], rel=0.05)


# --- evidence ------------------------------------------------------------------------------------------------------------


def said_of_itself(
    time: float, budget: Budget, agent: JointAgent, joint: bool = True, tick: int = 0
) -> PackedEvidence | None:
    """The evidence that a robot sends in a tick, where its boards have it in their joint or not."""
    reports, _ = agent.tick(readings(tick, fix=(10, 10)), {})
    known = {"robot/r1": TeamKnowledge(3.0, joint=joint)}
    stamped = [report.model_copy(update={"time": time}) for report in reports]
    said = budget.choose(stamped, time, 1.0, known)
    return next((report.evidence for report in said.reports if report.subject == "robot/r1"), None)


def test_a_whole_state_is_repeated_rarely_until_a_board_needs_one() -> None:
    budget, agent = (
        Budget(SendSection(budget=2500.0), AGENT_GRID, "r1", 1.0, size),
        JointAgent("r1", RobotSection(), AGENT_GRID),
    )
    budget.bucket.refill(0.0)
    states_sent = list[tuple[float, bool]]()
    for tick in range(60):
        budget.bucket.level = 0.5 * budget.bucket.burst  # room for a report, and not for everything
        if tick == 30:
            budget.repeat_state()
        if (evidence := said_of_itself(0.5 * tick, budget, agent, tick=tick)) is not None:
            states_sent.append((0.5 * tick, evidence.state is not None))
    states = [time for time, state in states_sent if state]
    assert len(states_sent) > 30
    assert states[0] == states_sent[0][0]
    assert all(later - earlier >= STATE_EVERY for earlier, later in pairwise(t for t in states if t < 15.0))
    assert min(time for time in states if time > states_sent[0][0]) <= 15.0 + STATE_EVERY
    assert any(15.0 <= time <= 16.0 for time in states)
    budget.bucket.level = 0.5 * budget.bucket.burst
    outside = said_of_itself(30.5, budget, agent, joint=False, tick=60)
    assert outside is None or outside.state is not None


def test_a_robot_enters_the_joint_of_a_board_that_was_started_again() -> None:
    scenario = LONGER.changed("board", fusion="joint").changed("robot", send={"budget": 700.0})
    scenario = scenario.changed("time", seconds=12.0)
    team = InProcessTeam(scenario)
    known = list[tuple[float, bool]]()

    def spy(envelope: Envelope) -> None:
        parsed = keys.parse(envelope.key)
        if (
            parsed is not None
            and parsed[0] is keys.AGREED
            and parsed[1] | {"subject": "robot/r1", "sub_team": "a"} == parsed[1]
        ):
            agreed = decode(Consensus, envelope.payload)
            known.append((agreed.time, agreed.rule == "joint"))

    team.bus.spies.append(spy)
    team.run_until(lambda: bool(known) and known[-1][0] >= 6.0)
    assert known[-1][1]
    team.leave(team.boards["a"])
    team.boards["a"] = board_of(scenario, "a")
    team.join(team.boards["a"])
    begun = known[-1][0]
    team.run_until(lambda: known[-1][0] >= min(11.5, begun + 3.0))
    assert known[-1][1]


# --- the status ----------------------------------------------------------------------------------------------------------


def test_most_statuses_leave_out_what_only_operators_read_and_those_keep_it() -> None:
    team = InProcessTeam(LONGER.changed("robot", send={"budget": 700.0}))
    heard, fold, tallied = Heard(team.bus), Fold(), Traffic()
    team.bus.spies.append(lambda envelope: fold.hear_envelope(envelope, team.now))
    team.run()
    statuses = heard.of(keys.STATUS, process="r1")
    full = [status for status in statuses if status.settings]
    assert 1 <= len(full) <= 4
    assert statuses[-1] not in full
    for status in statuses:
        tallied.hear_status("a", status)
    assert tallied.counters({})["ticks"] == full[-1].counters["ticks"]
    shown = present(fold.teams["t"].processes["robot", "r1"].status)
    assert shown.tick == statuses[-1].tick
    assert shown.settings == full[-1].settings
    assert shown.counters == full[-1].counters


@pytest.mark.parametrize("entropy", [-1e12, 1e12])
def test_an_entropy_that_no_belief_has_stops_nothing(entropy: float) -> None:
    budget = new_budget(50.0)
    team = {subject: TeamKnowledge(entropy, joint=False) for subject in SUBJECTS}
    belief = pack(gaussian(GRID, (5, 5), 1.0))
    for tick in range(5):
        said = [Report(source="r1", subject=s, tick=tick, time=float(tick), belief=belief) for s in SUBJECTS]
        assert len(budget.choose(said, float(tick), 0.0, team).reports) <= len(SUBJECTS)
