"""What rolls is followed by its velocity, what walks at random is not, whatever was told of it."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.rolling import FAST, STAY, WILDNESS, Habits, Rolling, moved
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import HEADING, Motion, Nuisance, entering
from blackboard.opinion.gaussian.walks import Model, Walks
from tests.present import present

BALL, DT, SIGMA = "object/ball", 0.1, 0.1  # seconds, units


def rolled(seconds: float) -> np.ndarray:
    """Place and velocity of a ball between two pairs of walls, shape (n, 4)."""
    steps = np.arange(round(seconds / DT))[:, np.newaxis] * DT
    angle = np.array([0.4, 0.4 + math.pi / 2])
    way = (3.0 + steps * np.cos(angle)) % 16.0
    back = way > 8.0
    return np.hstack([np.where(back, 16.0 - way, way), np.where(back, -1, 1) * np.cos(angle)])


def follow(walks: Walks, places: np.ndarray, drift: float, model: Model = "learn") -> list[Moments | None]:
    """The velocity after each step, of a ball that is seen in two of five."""
    rng, velocities = np.random.default_rng(1), []
    for place in places:
        walks.pass_time(BALL, drift, DT, model)
        if rng.random() < 0.4:
            walks.judge(BALL, Moments(place[:2] + SIGMA * rng.normal(size=2), SIGMA**2 * np.eye(2)))
        velocities.append(walks.velocity(BALL))
    return velocities


@pytest.mark.parametrize("drift", [0.1, 0.3, 1.0])
def test_a_ball_that_rolls_and_bounces_is_known_by_its_velocity_honestly(drift: float) -> None:
    truth = rolled(60.0)
    velocities = follow(Walks(), truth, drift)[100:]
    errors = [
        (velocity.mean - there[2:], velocity.covariance)
        for velocity, there in zip(velocities, truth[100:], strict=True)
        if velocity
    ]
    assert len(errors) > 0.9 * len(velocities)
    held = [error @ np.linalg.solve(covariance, error) < 5.99 for error, covariance in errors]
    assert 0.85 <= np.mean(held) <= 1.0  # one run, whose errors are alike for seconds
    assert np.median([np.hypot(*error) for error, _ in errors]) < 0.35


@pytest.mark.parametrize("drift", [0.0, 0.3])
def test_what_stands_or_walks_at_random_has_no_velocity(drift: float) -> None:
    rng = np.random.default_rng(3)
    places = np.cumsum(drift * math.sqrt(DT) * rng.normal(size=(600, 2)), axis=0)
    velocities = follow(Walks(), places, 0.3)
    assert sum(velocity is not None for velocity in velocities) < 0.02 * len(velocities)


def test_what_is_said_to_have_no_drift_neither_walks_nor_rolls() -> None:
    walks, there = Walks(), Moments(np.array([1.0, 2.0]), SIGMA**2 * np.eye(2))
    for _ in range(10):
        way = walks.pass_time(BALL, 0.0, DT)
        assert (way.mean == 0.0).all()
        assert (way.covariance == 0.0).all()
        walks.judge(BALL, there)
    assert walks.velocity(BALL) is None


def test_the_scenario_may_say_which_it_is() -> None:
    still, rolls = np.zeros((100, 2)), rolled(20.0)
    assert follow(Walks(), rolls, 0.3, "walk")[-1] is None
    assert follow(Walks(), still, 0.3, "roll")[-1] is not None


def test_what_is_stopped_stands_again() -> None:
    truth = np.vstack([rolled(20.0), np.tile([*rolled(20.0)[-1, :2], 0.0, 0.0], (600, 1))])
    velocities = follow(Walks(), truth, 0.3)
    assert velocities[199] is not None
    assert velocities[-1] is None or np.hypot(*velocities[-1].mean) < 0.1


def test_a_copy_goes_its_own_way() -> None:
    walks = Walks()
    follow(walks, rolled(10.0), 0.3)
    before = present(walks.velocity(BALL))
    follow(walks.copy(), np.zeros((50, 2)), 0.3)
    after = present(walks.velocity(BALL))
    assert np.array_equal(before.mean, after.mean)


SIGHTINGS = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.05, 3), st.floats(0.01, 2)), min_size=1, max_size=8
)


def exponential(matrix: np.ndarray) -> np.ndarray:
    """A matrix as an exponent of e: the series of a small part of it, which is squared again and again."""
    halvings = max(0, math.ceil(math.log2(np.abs(matrix).sum() + 1e-9)) + 4)
    total, term = np.eye(len(matrix)), np.eye(len(matrix))
    for n in range(1, 16):
        term = term @ matrix / 2**halvings / n
        total = total + term
    return np.linalg.matrix_power(total, 2**halvings)


def passes(walk: float, fastest: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """The step and its noise, both (4, 4), of a velocity that walks so fast and whose sigma is `fastest` in the long run."""
    rate, noise = np.zeros((4, 4)), np.zeros((4, 4))
    rate[0, 2] = rate[1, 3] = 1.0
    rate[2, 2] = rate[3, 3] = -walk / (2 * fastest**2)
    noise[2, 2] = noise[3, 3] = walk
    both = exponential(dt * np.block([[-rate, noise], [np.zeros((4, 4)), rate.T]]))
    step: np.ndarray = both[4:, 4:].T
    return step, step @ both[:4, 4:]


@given(st.floats(0.1, 3.0), st.floats(0.5, 2.0), st.floats(0.0, 60.0))
@settings(max_examples=60, deadline=None)
def test_out_of_sight_a_velocity_becomes_any_velocity_and_no_more(told: float, speed: float, dt: float) -> None:
    """At once or step by step: what was known of it fades, and its sigma goes to that of an unknown one."""
    seen = Moments(np.zeros(2), SIGMA**2 * np.eye(2))
    there = Moments(np.array([speed * told, 0.0]), SIGMA**2 * np.eye(2))
    rolling = Rolling.begun(seen, told).passed(1.0).seen(there)
    before, after = rolling.moments(), rolling.passed(dt).moments()
    assert abs(after.mean[2]) <= abs(before.mean[2]) + 1e-9
    for member in rolling.passed(dt).covariances:
        assert np.linalg.eigvalsh(member).min() > 0.0
        widest = rolling.covariances[:, 2, 2].max() + np.ptp(rolling.means[:, 2]) ** 2
        assert member[2, 2] <= max((8 * told) ** 2, widest) * (1 + 1e-9)
    for _ in range(200):
        rolling = rolling.passed(5.0)
    late = rolling.moments()
    assert np.hypot(*late.mean[2:]) < 0.05 * np.hypot(*before.mean[2:])
    assert math.sqrt(late.covariance[2, 2]) == pytest.approx(8 * told, rel=0.05)


@given(SIGHTINGS, st.floats(0.05, 2))
@settings(max_examples=60, deadline=None)
def test_the_bank_mixes_and_weighs_filters_as_the_textbook_does(
    sightings: list[tuple[float, float, float, float]], drift: float
) -> None:
    """The oracle: one member at a time, and time passes by Van Loan's method (IEEE TAC 23(3), 1978)."""
    k = len(WILDNESS)
    rolling = Rolling.begun(Moments(np.zeros(2), np.eye(2)), drift)
    weights, members = (
        rolling.weights,
        [(m.copy(), c.copy()) for m, c in zip(rolling.means, rolling.covariances, strict=True)],
    )
    for x, y, sigma, dt in sightings:
        rolling = rolling.passed(dt)
        stays = math.exp(-dt / STAY)
        mixed = []
        after = np.array(
            [sum(weights[i] * (stays if i == j else (1 - stays) / (k - 1)) for i in range(k)) for j in range(k)]
        )
        for j, wild in enumerate(WILDNESS):
            shares = [weights[i] * (stays if i == j else (1 - stays) / (k - 1)) / after[j] for i in range(k)]
            mean = sum(share * m for share, (m, _) in zip(shares, members, strict=True))
            spread = sum(
                share * (c + np.outer(m - mean, m - mean)) for share, (m, c) in zip(shares, members, strict=True)
            )
            step, noise = passes((wild * drift) ** 2, 8 * drift, dt)
            mixed.append((step @ mean, step @ spread @ step.T + noise))
        at, logs, members = np.array([x, y]), [], []
        for weight, (mean, covariance) in zip(after, mixed, strict=True):
            spread = covariance[:2, :2] + sigma**2 * np.eye(2)
            apart = at - mean[:2]
            logs.append(
                math.log(weight) - 0.5 * apart @ np.linalg.solve(spread, apart) - 0.5 * math.log(np.linalg.det(spread))
            )
            gain = covariance[:, :2] @ np.linalg.inv(spread)
            members.append((mean + gain @ apart, covariance - gain @ covariance[:2]))
        weights = np.maximum(np.exp(np.array(logs) - max(logs)) / np.exp(np.array(logs) - max(logs)).sum(), 1e-9)
        weights /= weights.sum()
        rolling = rolling.seen(Moments(at, sigma**2 * np.eye(2)))
        assert rolling.weights == pytest.approx(weights, rel=1e-6)
        assert rolling.means == pytest.approx(np.array([m for m, _ in members]), rel=1e-6, abs=1e-6)
        assert rolling.covariances == pytest.approx(np.array([c for _, c in members]), rel=1e-5, abs=1e-6)


#: How often a thing goes over from the member of a row to that of a column (1 / s).
RATES = np.array([[0.0, 0.1, 0.7], [0.3, 0.0, 0.2], [2.0, 0.5, 0.0]])


def probabilities(rates: np.ndarray, dt: float) -> np.ndarray:
    """Of each member after some time, by the one before, where a member of a row is left once at most."""
    stays = np.exp(-dt * rates.sum(axis=1))
    goes: np.ndarray = ((1 - stays) / rates.sum(axis=1))[:, np.newaxis] * rates
    return goes + np.diag(stays)


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.05, 0.3)), min_size=1, max_size=5))
@settings(max_examples=40, deadline=None)
def test_a_course_is_what_all_sightings_say_of_it(sightings: list[tuple[float, float, float]]) -> None:
    """The oracle: every way through the members, by how likely it is after the last sighting."""
    rolling, members = Rolling.begun(Moments(np.zeros(2), np.eye(2)), 0.5), range(len(WILDNESS))
    before, likelihoods = rolling.weights, []
    for x, y, dt in sightings:
        rolling = rolling.passed(dt, RATES)
        expected = rolling.weights
        rolling = rolling.seen(Moments(np.array([x, y]), 0.1 * np.eye(2)))
        likelihoods.append(rolling.weights / expected)
    transitions, total = np.zeros_like(RATES), 0.0
    for path in itertools.product(members, repeat=len(sightings) + 1):
        chance, steps = float(before[path[0]]), np.zeros_like(RATES)
        for (_, _, dt), likely, (i, j) in zip(sightings, likelihoods, itertools.pairwise(path), strict=True):
            chance *= probabilities(RATES, dt)[i, j] * likely[j]
            steps[i, i] += dt
            steps[i, j] += i != j
        transitions, total = transitions + chance * steps, total + chance
    assert rolling.transitions() == pytest.approx(transitions / total, rel=1e-6, abs=1e-9)
    assert rolling.told_all().transitions() == pytest.approx(np.zeros_like(RATES), abs=1e-12)


def habits_of(rates: np.ndarray, seconds: float) -> Habits:
    """What is learned of a thing that goes over at these rates, and is seen well."""
    chance, habits, member, dt = np.random.default_rng(5), Habits(), 0, 0.2
    there, told = np.zeros(4), 1.0
    rolling = Rolling.begun(Moments(there[:2], 0.01 * np.eye(2)), told, habits)
    for _ in range(round(seconds / dt)):
        member = int(chance.choice(len(WILDNESS), p=probabilities(rates, dt)[member]))
        velocity = there[2:] + WILDNESS[member] * told * math.sqrt(dt) * chance.normal(size=2)
        velocity = np.clip(velocity, -FAST * told, FAST * told)
        there = np.concatenate([there[:2] + dt * (there[2:] + velocity) / 2, velocity])
        seen = Moments(there[:2] + 0.1 * chance.normal(size=2), 0.01 * np.eye(2))
        rolling = rolling.passed(dt, habits.rates()).seen(seen)
        habits = habits.plus(rolling)
        rolling = rolling.told_all()
    return habits


def test_how_often_things_of_a_kind_go_over_is_learned() -> None:
    often = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [2.0, 0.0, 0.0]])
    seldom, assumed = often / 20, Habits().rates().sum(axis=1)
    assert assumed == pytest.approx(1 / STAY)
    turns, rolls = (habits_of(rates, 200.0).rates() for rates in (often, seldom))
    assert turns[0].sum() > 1.5 * assumed[0]
    assert turns[2].sum() > 3.0 * assumed[2]
    assert rolls[0].sum() < 0.7 * assumed[0]


def test_a_way_adds_no_negative_variance() -> None:
    wide, narrow = Moments(np.zeros(4), np.diag([2.0, 1, 1, 1])), Moments(np.ones(4), np.diag([1.0, 3, 1, 1]))
    way = moved(wide, narrow)
    assert way.mean.tolist() == [1.0, 1.0]
    assert way.covariance == pytest.approx(np.diag([0.0, 2.0]))


@pytest.mark.parametrize("speed", [0.25, 0.5, 1.0, 2.0])
def test_a_robot_that_alone_sees_something_roll_does_not_turn_with_it(speed: float) -> None:
    """How far its wheels turn is known to 15 %. Before, it took the ball to stand, and was .4 to 1.3 rad off after 4 s, believed to .08."""
    off, sigma = turned_by_a_ball(speed)
    assert abs(off) <= 2.0 * sigma
    assert abs(off) <= 0.1


def test_a_robot_that_alone_sees_something_stand_knows_better_how_far_it_turned() -> None:
    off, sigma = turned_by_a_ball(0.0)
    assert abs(off) <= 2.0 * sigma
    assert sigma <= 0.2


def turned_by_a_ball(speed: float) -> tuple[float, float]:
    """How far off a robot takes its heading to be (rad) after 4 s, and its sigma, if it turns on the spot and sees a ball roll by."""
    rng, rate = np.random.default_rng(1), 1.0
    team, nuisance = TeamJoint(Objects(0.3)), Nuisance(sigmas=(0.1, 0.15, 0.0, 0.0, 0.0, 0.0))
    belief = entering(Moments(np.zeros(3), np.diag([0.01, 0.01, 0.0025])), nuisance)
    for tick in range(41):
        time = tick * DT
        travelled = Motion(turn=rate * time, dt=time, moving=time, heading=0.0025 * time)
        away = np.array([2.5, speed * time])
        bearing = math.atan2(away[1], away[0]) - rate * time + 0.03 * rng.normal()
        seen = Relative("robot/r1", BALL, float(np.hypot(*away)) + SIGMA * rng.normal(), bearing, SIGMA**2, 0.03**2)
        mate = Evidence("robot/r2", 0, tick, Motion(dt=time), nuisance, belief, None, (), time)
        news = [Evidence("robot/r1", 0, tick, travelled, nuisance, belief, None, (seen,), time), mate]
        team.settle(tick, DT, news)
    believed = team.joint.moments("robot/r1")
    off = math.remainder(float(believed.mean[HEADING]) - rate * time, math.tau)
    return off, math.sqrt(believed.covariance[HEADING, HEADING])
