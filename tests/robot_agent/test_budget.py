"""A robot on a poor link: what is sent stays within the budget, nothing is left unsaid for ever, and without limits nothing changes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.config import Scenario
from blackboard.lab.team import Team
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.gaussian.increment import likelihood
from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.vehicle import AXES, drive
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Report, Status
from robot_agent.budget import Bucket, Budget, Known
from robot_agent.coarse import coarser
from robot_agent.config import RobotSection, SendSection
from robot_agent.gaussian.agent import JointAgent
from tests.robot_agent.test_agent import GRID as AGENT_GRID
from tests.robot_agent.test_agent import readings

GRID = Grid((20, 20))
SUBJECTS = ("robot/r1", "robot/r2", "object/ball", "object/can")
SCENARIO = Scenario(
    {
        "team": {"name": "t", "sub_teams": {"a": ["r1", "r2"], "b": ["r3"]}},
        "grid": {"shape": [24, 24]},
        "time": {"tick": 0.5, "seconds": 4.0},
        "world": {"seed": 3},
    }
)


def size(report: Report) -> int:
    return len(encode(report)) + len(keys.REPORT.key(team="t", sub_team="a", source="r1", subject=report.subject))


def budget(rate: float, burst: float = 2.0, longest: float = 4.0) -> Budget:
    return Budget(SendSection(budget=rate, burst=burst, longest=longest), GRID, "r1", 1.0, size)


def reports(rng: np.random.Generator, time: float, count: int = 4) -> list[Report]:
    """What a robot could say: Gaussians anywhere, of any width."""
    found = []
    for subject in SUBJECTS[:count]:
        belief = pack(gaussian(GRID, rng.uniform(2, 18, 2), float(rng.uniform(0.4, 4.0))))
        found.append(Report(source="r1", subject=subject, tick=0, time=time, belief=belief, ancestors={"r1": time}))
    return found


def divergence(p: Belief, q: Belief) -> float:
    return float((p.p * np.log(np.maximum(p.p, 1e-12) / np.maximum(q.p, 1e-12))).sum())


# --- the bucket and the choice -------------------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(20.0, 20_000.0), st.floats(0.1, 5.0))
def test_any_span_of_time_has_at_most_its_budget_and_a_burst(seed: int, rate: float, burst: float) -> None:
    rng, it, sent, time = np.random.default_rng(seed), budget(rate, burst), list[tuple[float, int]](), 0.0
    largest = 0
    for _ in range(30):
        time += float(rng.choice([0.05, 0.2, 1.0]))
        said = it.choose(reports(rng, time, int(rng.integers(1, 5))), time, 1.0, {})
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
    rng, it, said_at = np.random.default_rng(seed), budget(rate), dict.fromkeys(SUBJECTS, 0.0)
    most = it.settings.longest + 4 * 500 / rate + 2 * 500 / rate + 0.4
    for tick in range(60):
        time = 0.2 * tick
        still = reports(np.random.default_rng(seed), time)  # no news: worth nothing but for their age
        for report in it.choose(still if rng.random() < 0.8 else reports(rng, time), time, 0.0, {}).reports:
            said_at[report.subject] = time
        assert all(time - at <= most for at in said_at.values()), said_at


def test_what_is_said_or_kept_is_all_that_was_ever_said() -> None:
    rng, it = np.random.default_rng(1), budget(800.0)
    known = set[str]()
    for tick in range(40):
        said = it.choose(reports(rng, 0.2 * tick), 0.2 * tick, 1.0, {})
        told = {report.subject for report in said.reports}
        known |= told
        assert not told & said.kept.keys()
        assert told | said.kept.keys() == known


def test_without_a_limit_or_with_room_for_all_reports_are_as_they_were() -> None:
    rng = np.random.default_rng(2)
    for rate in (math.inf, 1e6):
        it = budget(rate)
        for tick in range(10):
            mine = reports(rng, 0.2 * tick)
            said = it.choose(mine, 0.2 * tick, 1.0, {})
            assert said.reports == mine
            assert said.kept == {}


def test_what_moved_comes_before_what_did_not_and_before_what_the_team_knows_better() -> None:
    it = budget(400.0, burst=2.0, longest=100.0)
    still, moved = gaussian(GRID, (5, 5), 1.0), gaussian(GRID, (15, 15), 1.0)

    def about(subject: str, belief: Belief, time: float) -> Report:
        return Report(source="r1", subject=subject, tick=0, time=time, belief=pack(belief))

    first = [about(subject, still, 0.0) for subject in SUBJECTS[1:]]
    for tick in range(10):
        it.choose(first, float(tick), 0.0, {})
    it.bucket.level, it.price = -50.0, 1e-7  # 350 bytes, after the second that comes: room for one
    news = [about("robot/r2", moved, 10.0), about("object/ball", still, 10.0), about("object/can", moved, 10.0)]
    team = {"robot/r2": Known(0.1, joint=False)}  # the team knows where it is far better
    assert [report.subject for report in it.choose(news, 10.0, 0.0, team).reports] == ["object/can"]


def test_a_bucket_that_goes_back_in_time_gains_nothing() -> None:
    bucket = Bucket(100.0, 200.0)
    bucket.refill(10.0)
    assert bucket.level == 200.0
    bucket.take(200)
    bucket.refill(5.0)
    assert bucket.level == 0.0
    bucket.refill(6.0)
    assert bucket.level == pytest.approx(100.0)


# --- coarser beliefs -----------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 20), st.floats(0, 20), st.floats(0.05, 8.0), st.sampled_from([(0.2, 8.0), (0.5, 7.0), (1.0, 3.0)]))
def test_a_coarser_belief_is_valid_smaller_and_near(
    x: float, y: float, sigma: float, precision: tuple[float, float]
) -> None:
    belief = gaussian(GRID, (x, y), sigma)
    fine = pack(belief)
    coarse = coarser(belief, fine, *precision)
    told = unpack(coarse, GRID)
    assert told.p.sum() == pytest.approx(1.0)
    assert math.prod(coarse.box) <= math.prod(fine.box) or precision[1] > 12
    assert divergence(belief, told) < {0.2: 0.02, 0.5: 0.06, 1.0: 0.6}[precision[0]]


def test_a_belief_that_knows_nothing_stays_one() -> None:
    even = uniform(GRID)
    assert unpack(coarser(even, pack(even), 0.5, 7.0), GRID).p == pytest.approx(even.p)


# --- a team ----------------------------------------------------------------------------------------------------------------


def run(scenario: Scenario) -> tuple[str, int, dict[str, list[Status]], list[Report]]:
    """The hash of a run, how often a board was late, the robots' statuses, and their reports."""
    team, statuses, said = Team(scenario), dict[str, list[Status]](), list[Report]()

    def spy(envelope: Envelope) -> None:
        found = keys.parse(envelope.key)
        if found is not None and found[0] is keys.STATUS:
            status = decode(Status, envelope.payload)
            if status.kind == "robot":
                statuses.setdefault(status.process, []).append(status)
        elif found is not None and found[0] is keys.REPORT:
            said.append(decode(Report, envelope.payload))

    team.bus.spies.append(spy)
    team.run()
    assert team.world.why == ""
    return team.world.referee.hash, sum(it.counters["late"] for it in team.boards.values()), statuses, said


@pytest.fixture(params=["opinions", "joint"])
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return SCENARIO.changed("board", fusion=request.param)


def test_an_infinite_budget_is_the_stream_without_one(scenario: Scenario) -> None:
    assert run(scenario.changed("robot", send={"budget": math.inf})) == run(scenario)


def test_silence_makes_no_board_wait_and_a_run_repeats_to_the_bit(scenario: Scenario) -> None:
    poor = scenario.changed("robot", send={"budget": 700.0})
    first = run(poor)
    assert first == run(poor)
    hash_, late, statuses, said = first
    everything = run(scenario)
    assert late == 0
    assert hash_ != everything[0]
    assert sum(len(encode(it)) for it in said) < 0.6 * sum(len(encode(it)) for it in everything[3])
    assert any(status.kept for status in statuses["r1"])
    for status in statuses["r1"]:
        assert not set(status.kept) & set(status.subjects)


def test_what_a_robot_is_silent_about_is_still_agreed_on(scenario: Scenario) -> None:
    """Boards keep what it said before: no sample is missing that is there without a budget."""
    cards = [Team(it).run() for it in (scenario, scenario.changed("robot", send={"budget": 700.0}))]
    robots = [{s: n for s, n in card["missing"].items() if s.startswith("robot/")} for card in cards]
    assert robots[0] == robots[1]


def test_evidence_that_was_not_sent_is_gathered_into_the_next() -> None:
    """Where a robot was, moved by the sum of its motions and multiplied by what it then sends, is what it believes."""
    it = JointAgent("r1", RobotSection(), AGENT_GRID).filter
    nuisance = it.sensors.wheels.nuisance
    for tick in range(3):
        before = it.step(readings(tick, fix=(10, 10) if tick == 0 else None))
    assert before.belief is not None
    for tick in range(3, 6):
        told = it.step(readings(tick, fix=(10 + 0.5 * tick, 10.2)))
        if tick < 5:
            it.silent()
    assert told.increment is not None
    assert told.unsent is not None
    assert np.trace(told.unsent.information) > 1.5 * np.trace(told.increment.information)
    joint = Joint()
    joint.add(it.robot, before.belief)
    drive(joint, it.robot, told.travelled.since(before.travelled), nuisance)
    gained = likelihood(joint, it.robot, told.unsent)
    assert gained is not None
    gained.multiply(joint)
    now = it.belief
    assert now is not None
    assert joint.moments(it.robot).mean[AXES] == pytest.approx(now.mean[AXES], abs=0.02)
    assert np.diag(joint.moments(it.robot).covariance)[AXES] == pytest.approx(np.diag(now.covariance)[AXES], rel=0.05)
