"""A robot with a filter of its own: what its posteriors gained is told once, and what came from the team is noticed."""

import math

import numpy as np
import pytest

from blackboard.opinion.gaussian.increment import likelihood
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import POSE, correct, drive
from blackboard.wire.messages import Odometry
from robot_agent.config import OdometrySection
from robot_agent.gaussian.filter import FilterResult
from robot_agent.gaussian.own import FEWEST, Given, Independence, of_particles
from robot_agent.gaussian.sensors import Sensors, wheels_of
from tests.present import present
from tests.robot_agent.robots import measured

ROBOT = "robot/r1"
SENSORS = Sensors(wheels_of(OdometrySection()))


class Own:
    """A linear filter along x that drives ahead, with noise of its own in each step, and sees its place now and then."""

    def __init__(self, noise: float = 1e-4) -> None:
        self.mean, self.covariance = np.array([1.0, 2.0, 0.0]), np.diag([0.04, 0.04, 0.01])
        self.noise = np.diag([noise, noise, noise])
        self.given, self.tick = Given(ROBOT, SENSORS), 0

    def drive(self, distance: float = 0.1) -> None:
        by = np.eye(3)
        by[1, 2] = distance
        self.mean = self.mean + [distance, 0, 0]
        self.covariance = by @ self.covariance @ by.T + self.noise

    def measure(self, z: np.ndarray, noise: np.ndarray) -> None:
        gain = self.covariance @ np.linalg.inv(self.covariance + noise)
        self.mean = self.mean + gain @ (z - self.mean)
        self.covariance = (np.eye(3) - gain) @ self.covariance

    def tell(self, distance: float = 0.1, *, silent: bool = False, **sigmas: float) -> FilterResult:
        """`silent`: with the odometry alone."""
        self.tick += 1
        if not silent:
            self.given.give(Moments(self.mean.copy(), self.covariance.copy()))
        odometry = Odometry(distance=distance, turn=0.0, dt=0.1, **sigmas)
        return self.given.step(measured(self.tick, time=0.1 * self.tick, odometry=odometry))


def test_what_took_nothing_in_gains_nothing_and_its_noise_is_learned() -> None:
    own = Own(noise=3e-3)
    assert own.tell().increment is None  # the first
    for _ in range(10):
        own.drive()
        result = own.tell()
        assert result.increment is None
        assert result.motion.heading == pytest.approx(3e-3)


def test_the_noise_of_a_filter_that_is_slower_than_its_odometry_is_learned() -> None:
    """Before, the steps without a posterior had no noise in turn, and what they had lost was taken for gains."""
    own, told = Own(noise=3e-3), list[FilterResult]()
    own.tell()
    for number in range(1, 31):
        own.drive()
        told.append(own.tell(silent=number % 5 > 0))
    assert all(result.increment is None for result in told)
    assert [result.motion.heading for result in told[5:]] == pytest.approx([3e-3] * 25)


def test_a_posterior_is_moved_on_by_what_was_driven_after_it() -> None:
    """As one of a step that ends later, so what it took in is not lost where odometry follows in the same step."""
    results = list[FilterResult]()
    for late in (False, True):
        own = Own(noise=3e-3)
        for _ in range(5):
            own.drive()
            own.tell()
        own.drive()
        own.measure(own.mean, np.diag([0.01, 0.01, 1.0]))
        if not late:
            own.drive()
        newest = Moments(own.mean.copy(), own.covariance.copy())
        own.given.give(newest, Odometry(distance=0.1, turn=0.0, dt=0.1) if late else None)
        odometry = Odometry(distance=0.2, turn=0.0, dt=0.2)
        results.append(own.given.step(measured(9, time=0.8, odometry=odometry)))
    whole, moved = results
    assert present(moved.belief).mean == pytest.approx(present(whole.belief).mean)
    assert present(moved.increment).information == pytest.approx(present(whole.increment).information, rel=0.05)


def test_a_filter_that_knows_its_heading_badly_and_takes_nothing_in_gains_nothing() -> None:
    """An extended Kalman filter with wheels alone: predictions that are wider than its own made each step a gain."""
    random, given, results = np.random.default_rng(5), Given(ROBOT, SENSORS), []
    mean, covariance, along, heading = np.array([1.0, 2.0, 0.3]), np.diag([0.01, 0.01, 0.1]), 1e-4, 1e-4
    for number in range(200):
        turn, odometry = float(random.normal(0, 0.1)), Odometry(distance=0.0, turn=0.0, dt=0.1)
        if number:
            odometry = Odometry(distance=0.05, turn=turn, dt=0.1)
            c, s = math.cos(mean[2] + turn / 2), math.sin(mean[2] + turn / 2)
            by = np.array([[1.0, 0, -0.05 * s], [0, 1, 0.05 * c], [0, 0, 1]])
            noise = np.zeros((3, 3))
            noise[:2, :2], noise[2, 2] = along * np.outer([c, s], [c, s]), heading
            mean, covariance = mean + [0.05 * c, 0.05 * s, turn], by @ covariance @ by.T + noise
        given.give(Moments(mean.copy(), covariance.copy()))
        results.append(given.step(measured(number, time=0.1 * number, odometry=odometry)))
    assert all(result.increment is None for result in results)
    assert sum(result.motion.heading for result in results) == pytest.approx(199 * heading, rel=0.05)
    assert sum(result.motion.along for result in results) == pytest.approx(199 * along, rel=0.05)


def test_a_filter_that_knows_its_heading_badly_tells_of_a_fix_as_much_as_it_took_in() -> None:
    """Over a prediction wider than the filter's own, a fix would count for more than the filter gained by it."""
    own = Own(noise=1e-4)
    own.covariance = np.diag([1.0, 1.0, 0.1])
    own.tell(0.0)
    for _ in range(3):
        own.drive(0.1)
        own.tell(0.1)
    own.drive(0.1)
    own.measure(own.mean, np.diag([0.01, 0.01, 1e6]))
    increment = present(own.tell(0.1).increment)
    assert np.diag(increment.information)[:2] == pytest.approx([100.0, 100.0], rel=0.01)


def test_a_filter_that_takes_something_in_at_every_step_gains_at_every_step_if_it_tells_its_noise() -> None:
    """In its steady state it is no sharper than before. It was taken for one that takes nothing in, and told the team nothing."""
    own = Own(noise=1e-4)
    for number in range(100):
        if number:
            own.drive(0.0)
            own.measure(own.mean, np.diag([0.005, 0.005, 0.005]))
        result = own.tell(0.0, distance_sigma=0.01, turn_sigma=0.01)
        assert (result.increment is not None) == (number > 0)


def test_a_joint_of_its_increments_is_its_posterior() -> None:
    """So each gain is counted once, and none is lost."""
    own, board = Own(), Joint()
    result = own.tell()
    board.add(ROBOT, present(result.belief))
    for number in range(30):
        own.drive()
        if number % 4 == 3:
            own.measure(own.mean + [0.1, -0.1, 0.02], np.diag([0.05, 0.02, 0.01]))
        result = own.tell()
        drive(board, ROBOT, result.motion, SENSORS.wheels.nuisance, bent=False)
        if result.increment is not None:
            factor = likelihood(board, ROBOT, result.increment)
            correct(board, present(factor))
        else:
            assert number % 4 != 3
    moments = board.moments(ROBOT)
    assert moments.mean[POSE] == pytest.approx(own.mean, abs=0.01)
    assert np.diag(moments.covariance)[POSE] == pytest.approx(np.diag(own.covariance), rel=0.03)


def test_a_posterior_that_jumps_begins_anew() -> None:
    own = Own()
    epoch = own.tell().epoch
    own.mean = own.mean + [5.0, 0, 0]
    result = own.tell()
    assert result.epoch > epoch
    assert result.increment is None
    assert present(result.belief).mean[0] == pytest.approx(6.0)


def test_without_a_posterior_the_odometry_counts() -> None:
    own = Own()
    own.tell()
    own.given.give(None)
    result = own.given.step(measured(9, time=0.9, odometry=Odometry(distance=0.5, turn=0.0, dt=0.1)))
    assert present(result.belief).mean[0] == pytest.approx(1.5)
    assert result.increment is None


def judged(fed_back: bool, seed: int = 1) -> Independence:
    random, independence, own = np.random.default_rng(seed), Independence(), Own()
    own.tell()
    truth = own.mean.copy()
    for _ in range(2 * FEWEST):
        shown = present(own.given.belief)
        noise = shown.covariance[POSE, POSE].copy() if fed_back else np.diag([0.02, 0.02, 0.005])
        own.drive()
        truth = truth + [0.1, 0, 0]
        z = shown.mean[POSE] if fed_back else truth + random.multivariate_normal(np.zeros(3), noise)
        own.measure(z, noise)
        result = own.tell()
        ahead = Joint()
        ahead.add(ROBOT, shown)
        drive(ahead, ROBOT, result.motion, SENSORS.wheels.nuisance)
        if own.given.gain is not None:
            independence.judge(ROBOT, own.given.gain, shown, ahead.moments(ROBOT))
    return independence


@pytest.mark.parametrize("seed", range(5))
def test_independent_measurements_are_not_taken_for_the_team_s(seed: int) -> None:
    independence = judged(fed_back=False, seed=seed)
    assert independence.gains >= FEWEST
    assert 0.2 < present(independence.ratio) < 5.0
    assert not independence.fed_back


def test_what_came_from_the_team_is_noticed() -> None:
    independence = judged(fed_back=True)
    assert independence.ratio == pytest.approx(0.0, abs=0.01)
    assert independence.fed_back


def claiming(share: float, seed: int) -> tuple[Own, list[FilterResult]]:
    """A filter that claims so small a share of all its true variances, and measures its place in each fifth step."""
    own, random, truth, told = (
        Own(noise=2e-3),
        np.random.default_rng(seed),
        np.array([1.0, 2.0, 0.0]),
        list[FilterResult](),
    )
    truth = random.multivariate_normal(truth, own.covariance)
    own.noise, noise = np.diag([2e-3, 2e-3, 1e-4]), np.diag([0.04, 0.04, 0.02])
    for number in range(300):
        truth = truth + [0.1, 0.1 * truth[2], 0.0] + random.multivariate_normal(np.zeros(3), own.noise)
        ahead = own.mean[2]
        own.drive()
        own.mean[1] += 0.1 * ahead
        if number % 5 == 0:
            own.measure(random.multivariate_normal(truth, noise), noise)
        honest, own.covariance = own.covariance, share * own.covariance
        told.append(own.tell())
        own.covariance = honest
    return own, told


@pytest.mark.parametrize("seed", range(4))
def test_a_filter_that_claims_too_small_variances_counts_less(seed: int) -> None:
    """By how far its posteriors move: a step in which they lose the variance v moves them by N(0, v), if they are right."""
    (honest, said), (sure, claimed) = (claiming(share, seed) for share in (1.0, 0.25))
    assert honest.given.independence.too_small <= 1.2
    assert 2.5 <= sure.given.independence.too_small <= 5.0
    counted = [present(results[295].increment).information.max() for results in (said, claimed)]
    assert 0.7 <= counted[1] / counted[0] <= 1.6, "four times as much, if it were believed"


def test_particles_are_one_hypothesis_or_none() -> None:
    random = np.random.default_rng(1)
    cloud = random.multivariate_normal([3.0, 4.0, math.pi], np.diag([0.1, 0.2, 0.05]), 4000)
    cloud[:, 2] = (cloud[:, 2] + math.pi) % (2 * math.pi) - math.pi  # on both sides of the seam
    moments = present(of_particles(cloud))
    assert moments.mean[:2] == pytest.approx((3, 4), abs=0.05)
    assert abs(math.remainder(moments.mean[2] - math.pi, math.tau)) < 0.05
    assert np.diag(moments.covariance) == pytest.approx((0.1, 0.2, 0.05), rel=0.15)
    assert of_particles(np.vstack([cloud, cloud + [3.0, 0, 0]])) is None
    assert of_particles(cloud[:1]) is not None
    half = of_particles(np.vstack([cloud, cloud + [3.0, 0, 0]]), np.r_[np.ones(4000), np.zeros(4000)])
    assert present(half).mean[0] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("seed", [*range(10), 54])
def test_odometry_that_nobody_can_have_driven_ends_no_robot(seed: int) -> None:
    """With seed 54 the covariance of a prediction was not positive definite, by rounding."""
    random, given = np.random.default_rng(seed), Given(ROBOT, SENSORS)
    for tick in range(10):
        distance, turn, dt, size = (10.0 ** random.uniform(-3, 6) for _ in range(4))
        root = size * random.normal(size=(3, 3))
        given.give(Moments(np.array([1.0, 2.0, 0.0]), root @ root.T + 1e-9 * np.eye(3)))
        odometry = Odometry(distance=distance, turn=turn, dt=dt)
        assert given.step(measured(tick, time=0.1 * tick, odometry=odometry)).belief is not None
