"""The agent of a robot whose boards keep a joint: what it believes alone, what it sends as evidence, what it takes from the team."""

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.config import load
from blackboard.lab.team import played
from blackboard.opinion.belief import gaussian
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import triangle
from blackboard.opinion.gaussian.vehicle import AXES, CURVED_TURN, HEADING, STATES, TURN
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import PackedState, Seen
from blackboard.wire.messages import Report, Sighting
from robot_agent.agent import TeamBelief
from robot_agent.config import RobotSection, settings_of
from robot_agent.gaussian.agent import JointAgent
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import Sensors
from tests.present import present
from tests.robot_agent.robots import BALL, GRID, by_subject, readings, standing

MATE = Sighting(subject="robot/r2", range=6.0, bearing=-0.2)


def new_agent() -> JointAgent:
    return JointAgent("r1", RobotSection(), GRID)


def state(x: float, y: float, sigma: float = 0.2) -> Moments:
    mean = np.zeros(STATES)
    mean[:5] = x, y, 0.0, 1.0, 1.0
    return Moments(mean, np.diag([sigma**2, sigma**2, *[1e-6] * (STATES - 2)]))


def agreed(until: float, x: float, y: float) -> dict[str, TeamBelief]:
    """The team says that after the readings stamped `until` (s) the robot was at (x, y)."""
    ancestors = {"r1": until, "r2": until}
    return {"robot/r1": TeamBelief(0, until, gaussian(GRID, (x, y), 0.5), ancestors, state(x, y))}


def mean(report: Report) -> np.ndarray:
    return np.asarray(unpack(report.belief).mean())


def informed(report: Report) -> np.ndarray:
    return np.asarray(unpack(present(report.informed).belief).mean())


def test_it_reports_itself_what_it_saw_and_its_evidence() -> None:
    agent = new_agent()
    for tick in range(3):
        reports, solo = agent.tick(readings(tick, BALL, MATE, fix=(10, 10) if tick == 0 else None), {})
        reported = by_subject(reports)
        assert set(reported) == {"robot/r1", "robot/r2", "object/ball"}
        assert set(solo.beliefs) == {"robot/r1", "object/ball"}, "a mate is for the mate itself to judge"
        assert all(r.ancestors == {"r1": 0.5 * tick} and r.informed is None for r in reports)
        assert reported["object/ball"].evidence is None
        evidence = present(reported["robot/r1"].evidence)
        assert evidence.state is not None
        assert evidence.travelled.distance == pytest.approx(0.5 * tick)
        assert [relative.subject for relative in evidence.relatives] == ["object/ball", "robot/r2"]
    place = np.array([11.0, 10.0])
    assert mean(reported["robot/r1"]) == pytest.approx(place, abs=0.2)
    for subject, sighting in (("object/ball", BALL), ("robot/r2", MATE)):
        at = place + sighting.range * np.array([math.cos(sighting.bearing), math.sin(sighting.bearing)])
        assert mean(reported[subject]) == pytest.approx(at, abs=0.7)


def test_every_sighting_of_a_class_is_evidence_and_nobody_is_placed_by_it() -> None:
    unnamed_mate = Sighting(subject="robot/?", range=6.0, bearing=-0.2, confidence=0.9)
    other = Seen(subject="object/?", kind="position", values=(1.0, 2.0), covariance=(0.1, 0.0, 0.1))
    taken = readings(0, unnamed_mate, MATE, unnamed_mate, fix=(10, 10)).model_copy(update={"seen": [other]})
    reported = by_subject(new_agent().tick(taken, {})[0])
    assert set(reported) == {"robot/r1", "robot/r2"}
    evidence = present(reported["robot/r1"].evidence)
    unnamed = [
        (relative.subject, relative.mark, relative.confidence)
        for relative in evidence.relatives
        if relative.mark is not None
    ]
    assert unnamed == [("robot/?", 0, 0.9), ("robot/?", 1, 0.9)]
    assert [(relative.subject, relative.mark) for relative in evidence.seen] == [("object/?", 2)]


def test_what_it_believes_alone_never_depends_on_the_team() -> None:
    """Except for how large the noise of its wheels is, which shows where the team has it; here it has driven too little for that."""
    helped, alone = new_agent(), new_agent()
    for tick in range(3):
        said = readings(tick, BALL, fix=(10, 10) if tick == 0 else None)
        team = agreed(0.5 * (tick - 1), 14, 12) if tick else {}
        (with_team, solo), (without, same) = helped.tick(said, team), alone.tick(said, {})
        assert solo == same
        assert [r.belief for r in with_team] == [r.belief for r in without]


def test_where_the_team_has_it_moves_what_it_believes_alone_by_nothing_but_the_noise_of_its_wheels() -> None:
    helped, alone = new_agent(), new_agent()
    for tick in range(30):
        said = readings(tick, BALL, fix=(10, 10) if tick == 0 else None)
        team = agreed(0.5 * (tick - 1), 12 + 0.5 * tick, 12) if tick else {}
        (with_team, _), (without, _) = helped.tick(said, team), alone.tick(said, {})
    for report, same in zip(with_team, without, strict=True):
        assert mean(report) == pytest.approx(mean(same), abs=0.02)


def test_an_object_is_known_no_better_than_the_place_it_is_seen_from() -> None:
    """Seen again and again from one place, what both have in common does not average out."""
    agent = new_agent()
    for tick in range(12):
        reports, _ = agent.tick(readings(tick, BALL, fix=(10, 10) if tick == 0 else None, distance=0.0), {})
    ball = unpack(by_subject(reports)["object/ball"].belief).covariance()
    own = agent.own.marginal("robot/r1").covariance
    assert np.trace(ball) > np.trace(own)


def test_the_team_s_word_is_moved_on_by_what_was_measured_since() -> None:
    prompt, late = new_agent(), new_agent()
    for tick in range(4):
        said = readings(tick, fix=(10, 10) if tick == 0 else None)
        first, _ = prompt.tick(said, agreed(0.5, 13, 12) if tick == 2 else {})
        second, _ = late.tick(said, agreed(0.5, 13, 12) if tick == 3 else {})
    for reports in (first, second):
        own = by_subject(reports)["robot/r1"]
        assert informed(own) == pytest.approx((14.0, 12.0), abs=0.3), "two ticks of half a cell since"
        assert present(own.informed).ancestors == {"r1": 1.5, "r2": 0.5}
    assert informed(by_subject(first)["robot/r1"]) == pytest.approx(informed(by_subject(second)["robot/r1"]), abs=1e-6)


def test_without_network_a_compass_that_is_askew_tells_how_far_it_turned_and_not_how_it_is_turned() -> None:
    """As an increment, it turned what the team had told by .3 rad."""
    agent = JointAgent("r1", RobotSection(), GRID, sensors=Sensors())
    for tick in range(80):
        said = readings(tick, fix=(10, 10) if tick == 0 else None, distance=0.0, compass=0.3)
        agent.tick(said, agreed(0.5, 13, 12) if tick == 2 else {})
    known = present(agent.team)
    assert known.mean[HEADING] == pytest.approx(0.0, abs=0.02)
    assert math.sqrt(known.covariance[HEADING, HEADING]) <= 0.1
    sent = present(by_subject(agent.tick(said, {})[0])["robot/r1"].evidence)
    assert present(sent.compass).heading == pytest.approx(0.3)
    assert sent.increment is None


def test_a_compass_that_counts_its_turns_is_told_within_one_and_one_that_says_nothing_is_not_told() -> None:
    """Boards refuse angles above 1000 rad, and with them would refuse all evidence of a robot that has turned 160 times."""
    robot = FirstHand("robot/r1", Sensors())
    robot.step(readings(0, fix=(10, 10)))
    assert present(robot.step(readings(1, compass=0.3 + 1000 * math.tau)).compass).heading == pytest.approx(0.3)
    vague = readings(2).model_copy(update={"compass_sigma": 1e4})
    assert robot.step(vague).compass is None


def returned(agent: JointAgent, tick: int, team: dict[str, TeamBelief] | None = None) -> PackedState | None:
    reports, _ = agent.tick(readings(tick, fix=(10, 10) if tick == 0 else None), team or {})
    return present(by_subject(reports)["robot/r1"].evidence).returned


def test_it_returns_what_the_team_knew_of_it_while_a_board_is_new() -> None:
    agent = new_agent()
    assert returned(agent, 0) is returned(agent, 1) is returned(agent, 2, agreed(0.5, 13, 12)) is None
    agent.on_board()
    for tick in range(3, 10):
        state = present(returned(agent, tick))
        shown = present(agent.team)
        assert state.mean[:2] == pytest.approx(shown.mean[AXES])
        covariance = triangle(state.covariance)
        assert covariance[AXES, AXES] == pytest.approx(2 * shown.covariance[AXES, AXES]), "r2's place errs with it"
    assert returned(agent, 10) is None


ALONE = replace(agreed(0.5, 13, 12)["robot/r1"], ancestors={"r1": 0.5})
VAGUE = replace(agreed(0.5, 11, 10)["robot/r1"], state=state(11, 10, 30.0))


@pytest.mark.parametrize("team", [ALONE, VAGUE])
def test_it_returns_nothing_that_is_of_itself_alone_or_says_no_more_than_it_knows(team: TeamBelief) -> None:
    agent = new_agent()
    for tick in range(3):
        returned(agent, tick, {"robot/r1": team} if tick == 2 else {})
    agent.on_board()
    assert returned(agent, 3) is None


def test_it_says_of_its_wheels_what_its_team_knows() -> None:
    """A robot that sees no landmark said of its scales what it began with, though the team knew them."""
    agent, team = (
        JointAgent("r1", RobotSection.model_validate({"vision": {"kind": "range-bearing"}}), GRID),
        state(12, 12),
    )
    team.mean[TURN], team.mean[CURVED_TURN] = 1.0, -0.4
    for tick in range(3):
        place = replace(agreed(0.5, 12, 12)["robot/r1"], state=team)
        agent.tick(readings(tick, fix=(10, 10) if tick == 0 else None), {"robot/r1": place} if tick == 2 else {})
    assert agent.found()["curve turn scale"] == pytest.approx(0.6, abs=0.01)
    assert agent.found()["curve turn scale sigma"] < 0.05


def test_an_older_word_of_the_team_is_not_taken_for_a_newer_one() -> None:
    agent = new_agent()
    agent.tick(readings(0, fix=(10, 10)), {})
    agent.tick(readings(1), {})
    agent.tick(readings(2), agreed(0.5, 13, 12))
    reports, _ = agent.tick(readings(3), agreed(0.0, 3, 3))
    assert informed(by_subject(reports)["robot/r1"]) == pytest.approx((14.0, 12.0), abs=0.3)


@pytest.mark.parametrize("absurd", [1e8, 1e12])
def test_odometry_of_a_million_units_ends_a_belief_and_not_the_robot(absurd: float) -> None:
    agent = new_agent()
    for tick in range(3):
        agent.tick(readings(tick, BALL, fix=(10, 10) if tick == 0 else None), {})
    agent.tick(readings(3, BALL, distance=absurd), {})
    assert agent.searching is not None
    for tick in range(4, 7):
        reports, _ = agent.tick(readings(tick, BALL, fix=(10, 10), distance=0.0), {})
    assert mean(by_subject(reports)["robot/r1"]) == pytest.approx((10, 10), abs=0.3)


def test_a_ball_that_was_seen_long_ago_tells_a_robot_without_network_nothing() -> None:
    """It was away for so long that its belief began anew. Before, it was 20 cells off without a fix, and sure of it: by the old ball."""
    agent = new_agent()
    for tick in range(4):
        agent.tick(readings(tick, BALL, fix=(10, 10) if tick == 0 else None), {})
    for tick in range(10000, 10003):
        reports, _ = agent.tick(readings(tick, BALL), {})
    assert np.trace(unpack(by_subject(reports)["robot/r1"].belief).covariance()) > 0.8 * 2 * 30**2 / 12


def test_a_robot_of_the_demo_that_had_no_network_for_40_seconds_goes_on_and_is_found_by_its_next_fix() -> None:
    demo = load("demo").changed("time", seconds=65.0)
    agent = JointAgent("r1", settings_of(demo, "r1"), demo.grid)
    fixed = False
    for tick in played(demo):
        taken = next(taken for taken in tick.readings if taken.robot == "r1")
        if 10.0 < taken.time <= 50.0:
            continue
        _, solo = agent.tick(taken, {})
        fixed = fixed or (taken.time > 50.0 and taken.fix is not None)
        if fixed:
            assert math.dist(unpack(solo.beliefs["robot/r1"]).mean(), tick.truth.positions["robot/r1"]) <= 5.0
    assert fixed
    assert agent.filter.epoch == 0


def test_feedback_off_listens_to_nobody() -> None:
    agent = JointAgent("r1", RobotSection(), GRID, "off")
    agent.tick(readings(0, fix=(10, 10)), {})
    reports, _ = agent.tick(readings(1), agreed(0.0, 13, 12))
    assert by_subject(reports)["robot/r1"].informed is None


# --- lost and found -----------------------------------------------------------------------------------------------------

ARENA = Grid((40, 40), 0.1, (-2.0, -2.0), "m")
MARKS = {"landmark/1": (1.5, 1.0), "landmark/2": (0.2, -1.6), "landmark/3": (-1.7, 0.4), "landmark/4": (-0.5, 1.8)}


def test_a_robot_that_knows_nothing_looks_on_a_grid_and_hands_over_and_back() -> None:
    settings = RobotSection.model_validate(
        {"localizer": "pose", "headings": 36, "vision": {"kind": "range-bearing"}, "odometry": {"turn": 0.02}}
    )
    agent = JointAgent("r1", settings, ARENA)
    there, elsewhere = (0.3, 0.2, 0.7), (-0.8, -0.9, -2.0)
    reported = []
    for tick in range(24):
        reports, _ = agent.tick(standing(tick, there if tick < 9 else elsewhere, MARKS), {})
        own = by_subject(reports)["robot/r1"]
        assert own.evidence is not None
        reported.append((own.evidence.epoch, own.evidence.state, mean(own)))
    epochs = [epoch for epoch, _, _ in reported]
    known = [state is not None for _, state, _ in reported]
    assert not known[0], "the first readings were taken by the grid"
    assert known[8], "and then there was one hypothesis"
    assert reported[8][2] == pytest.approx(there[:2], abs=0.05)
    lost = epochs.index(epochs[-1])
    assert 9 <= lost < 20, "it was carried away, and noticed"
    assert not known[lost]
    assert known[-1], "and found itself again"
    assert agent.searching is None
    assert reported[-1][2] == pytest.approx(elsewhere[:2], abs=0.1)
    assert present(agent.filter.belief).mean[AXES] == pytest.approx(elsewhere[:2], abs=0.1)
