"""The joint Gaussian and what is done to it: against numeric derivatives and plain Bayes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.increment import gained, likelihood
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import Bias, Relative, forget_biases
from blackboard.opinion.gaussian.vehicle import (
    AXES,
    BEARING,
    FLAT,
    FORWARD,
    HEADING,
    LAG,
    RANGE,
    STATES,
    Motion,
    Nuisance,
    X,
    Y,
    correct,
    drive,
    entering,
    wrap,
)
from blackboard.opinion.grid import Array, Grid
from tests.opinion.gaussian.driving import furthest_slope
from tests.present import present

SIGMAS = (0.05, 0.03, 0.003, 0.01, 0.2, 0.02, 0.1, 0.2, 0.2)
NUISANCE = Nuisance(0.9, 0.95, SIGMAS, (0.003, 0.001, 0.0002, 0.001, 0.001, 0.001), (60.0, 2.0, 300.0))
SEEDS = st.integers(0, 10_000)


def random_covariance(chance: np.random.Generator, n: int, scale: float = 0.1) -> Array:
    root = chance.normal(0, scale, (n, n + 3))
    return np.asarray(root @ root.T / n)


def team(seed: int, robots: int = 2, scale: float = 0.1) -> Joint:
    """Robots with a random, fully correlated belief."""
    chance = np.random.default_rng(seed)
    joint = Joint()
    for k in range(robots):
        mean = np.zeros(STATES)
        mean[[X, Y, HEADING, FORWARD]] = *chance.uniform(-3, 3, 2), chance.uniform(-3, 3), 0.9
        mean[4] = 0.95
        joint.add(f"robot/r{k}", Moments(mean, np.eye(STATES)))
    joint.covariance = random_covariance(chance, len(joint.mean), scale)
    return joint


def sighting(range_: float = 2.0, bearing: float = 0.3, **more: float) -> Relative:
    return Relative("robot/r0", "robot/r1", range_, bearing, 0.01, 0.0004, **more)  # type: ignore[arg-type]


# --- joint ---------------------------------------------------------------------------------------------------------------


@given(SEEDS)
def test_an_update_is_the_product_of_prior_and_likelihood(seed: int) -> None:
    chance, joint = np.random.default_rng(seed), team(seed)
    rows, noise, residual = chance.normal(size=(2, STATES)), random_covariance(chance, 2), chance.normal(size=2)
    whole = np.concatenate([np.zeros((2, STATES)), rows], axis=1)
    before = joint.copy()
    joint.update(Factor(residual, {"robot/r1": rows}, noise))
    information = np.linalg.inv(before.covariance) + whole.T @ np.linalg.solve(noise, whole)
    mean = before.mean + np.linalg.solve(information, whole.T @ np.linalg.solve(noise, residual))
    assert np.allclose(joint.covariance, np.linalg.inv(information), atol=1e-9)
    assert np.allclose(joint.mean, mean, atol=1e-8)


@given(SEEDS)
def test_a_correction_is_josephs_update_and_then_each_position_follows_its_heading(seed: int) -> None:
    chance, joint = np.random.default_rng(seed), team(seed, robots=4)
    joint.add("object/ball", Moments(chance.normal(size=2), np.eye(2)))
    rows = {"robot/r1": chance.normal(size=(2, STATES)), "object/ball": chance.normal(size=(2, 2))}
    noise, residual, before = random_covariance(chance, 2), chance.normal(size=2), joint.copy()
    correct(joint, Factor(residual, rows, noise))
    whole = np.zeros((2, len(before.mean)))
    for block, part in rows.items():
        whole[:, before.blocks[block]] = part
    gain = before.covariance @ whole.T @ np.linalg.inv(whole @ before.covariance @ whole.T + noise)
    left, turn = np.eye(len(before.mean)) - gain @ whole, np.eye(len(before.mean))
    for k in range(4):
        first = before.blocks[f"robot/r{k}"].start
        dx, dy = (gain @ residual)[first : first + 2]
        turn[first : first + 2, first + HEADING] = -dy, dx
    expected = turn @ (left @ before.covariance @ left.T + gain @ noise @ gain.T) @ turn.T
    assert np.allclose(joint.mean, before.mean + gain @ residual, atol=1e-9)
    assert np.allclose(joint.covariance, expected, atol=1e-9 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("sigma", [0.1, 1.0, 5.0])
def test_a_fix_leaves_a_place_as_sure_as_it_says_and_independent_of_an_unknown_heading(sigma: float) -> None:
    """Before, a fix of 0.3 left the place unsure by 1.7 where nothing was known of the heading, and mates were misled."""
    joint = Joint()
    joint.add("r", entering(Moments(np.zeros(3), np.diag([1.0, 1.0, sigma**2])), Nuisance()))
    for _ in range(10):
        correct(joint, Factor(np.array([0.8, -1.4]), {"r": np.eye(STATES)[AXES]}, np.eye(2), of_place=True))
    assert np.allclose(joint.covariance[AXES, HEADING], 0.0)
    assert np.allclose(joint.covariance[AXES, AXES], np.eye(2) / 11)


@pytest.mark.parametrize("turned", [0.02, 0.1])
def test_a_fix_at_the_end_of_a_way_turns_the_whole_way(turned: float) -> None:
    """The place then leans on the heading as the end of a way does that led there, and not where the heading was taken to be before."""
    joint, way = Joint(), 5.0
    joint.add("r", entering(Moments(np.zeros(3), np.diag([1e-6, 1e-6, 0.01])), Nuisance()))
    drive(joint, "r", Motion(distance=way, dt=1.0, moving=1.0), Nuisance(), bent=False)
    end = way * np.array([math.cos(turned), math.sin(turned)])
    correct(joint, Factor(end - joint.mean[AXES], {"r": np.eye(STATES)[AXES]}, np.diag([1e-4, 1e-4]), of_place=True))
    lever = joint.covariance[AXES, HEADING] / joint.variances[HEADING]
    assert joint.mean[HEADING] == pytest.approx(turned, rel=0.05)
    assert np.allclose(lever, [-end[1], end[0]], atol=0.06)


@given(SEEDS, st.floats(-6, 2))
def test_no_precision_makes_a_variance_negative(seed: int, exponent: float) -> None:
    chance, joint = np.random.default_rng(seed), Joint()
    for name in ("a", "b"):
        joint.add(name, Moments(np.zeros(3), np.eye(3) * 1e6))
    for _ in range(6):
        rows = {"a": chance.normal(size=(2, 3)), "b": chance.normal(size=(2, 3))}
        if chance.random() < 0.5:
            del rows["b"]
        joint.update(Factor(chance.normal(size=2), rows, np.eye(2) * 10.0**exponent))
        assert np.array_equal(joint.covariance, joint.covariance.T)
        assert (np.diag(joint.covariance) >= 0).all()


@pytest.mark.parametrize("sigma", [1e-6, 1e-5, 1e-3])
def test_a_precise_fix_of_a_flat_position_leaves_its_own_variance(sigma: float) -> None:
    joint = Joint()
    joint.add("robot/r1", entering(Moments(np.zeros(3), np.diag([1e6, 1e6, 1e-4])), NUISANCE))
    for _ in range(3):
        joint.update(Factor(np.array([3.0, -2.0]), {"robot/r1": np.eye(STATES)[AXES]}, np.eye(2) * sigma**2))
    assert np.diag(joint.covariance)[AXES] == pytest.approx(sigma**2 / 3, rel=1e-3)


def test_a_measurement_of_what_is_known_exactly_without_noise_changes_nothing() -> None:
    joint = Joint()
    joint.add("a", Moments(np.ones(2), np.zeros((2, 2))))
    joint.update(Factor(np.zeros(2), {"a": np.eye(2)}, np.zeros((2, 2))))
    assert np.array_equal(joint.mean, np.ones(2))
    assert not joint.covariance.any()


@given(SEEDS)
def test_a_covariance_stays_symmetric_to_the_bit(seed: int) -> None:
    chance, joint = np.random.default_rng(seed), team(seed, robots=3)
    for _ in range(8):
        robot = f"robot/r{chance.integers(3)}"
        motion = Motion(chance.uniform(), chance.normal(), 1.0, 1.0, 0.01, 0.01, 0.001)
        drive(joint, robot, motion, NUISANCE)
        factor = linearise(joint, sighting(biases=(Bias(0.1, 7.0),)), {robot: motion})  # type: ignore[arg-type]
        correct(joint, factor)
        forget_biases(joint, 1.0)
        assert np.array_equal(joint.covariance, joint.covariance.T)
        assert np.linalg.eigvalsh(joint.covariance).min() > -1e-12 * np.abs(joint.covariance).max()


@given(SEEDS)
def test_a_kept_sum_of_noise_is_found_by_what_is_seen_of_its_robot(seed: int) -> None:
    """As of a joint that has each noise as a block of its own, and is transformed at once."""
    chance, joint = np.random.default_rng(seed), team(seed)
    by, noise = chance.normal(size=(STATES, 3)), np.diag(chance.uniform(0.1, 1.0, 3))
    joint.add("sum", Moments(np.zeros(3), np.zeros((3, 3))))
    apart = joint.copy()
    apart.add("noise", Moments(np.zeros(3), noise))
    whole = np.eye(len(apart.mean))
    whole[apart.blocks["robot/r0"], apart.blocks["noise"]] = by
    whole[apart.blocks["sum"], apart.blocks["noise"]] = np.eye(3)
    expected = (whole @ apart.covariance @ whole.T)[: len(joint.mean), : len(joint.mean)]
    mean = joint.moments("robot/r0").mean
    joint.move("robot/r0", mean, np.eye(STATES), by @ noise @ by.T)
    joint.keep("robot/r0", by, noise, "sum")
    assert joint.covariance == pytest.approx(expected, abs=1e-9)
    assert (joint.covariance == joint.covariance.T).all()


def test_a_dropped_block_leaves_the_others_as_they_were() -> None:
    joint = team(3, robots=3)
    before = joint.moments("robot/r0", "robot/r2")
    joint.drop("robot/r1")
    after = joint.moments("robot/r0", "robot/r2")
    assert np.array_equal(before.mean, after.mean)
    assert np.array_equal(before.covariance, after.covariance)
    with pytest.raises(KeyError):
        joint.moments("robot/r1")
    with pytest.raises(ValueError, match="already"):
        joint.add("robot/r0", before)


def test_a_lasting_error_forgets_and_stays_of_the_same_size() -> None:
    joint = team(1)
    block = ("bias", "robot/r0", "robot/r1", 7.0)
    joint.begin({block: Moments(np.zeros(1), np.eye(1))})
    joint.update(Factor(np.array([1.0]), {block: np.ones((1, 1))}, np.array([[0.25]])))
    assert joint.moments(block).mean[0] == pytest.approx(0.8)
    forget_biases(joint, 7.0)
    assert joint.moments(block).mean[0] == pytest.approx(0.8 * math.exp(-1))
    forget_biases(joint, 700.0)
    assert joint.moments(block).covariance[0, 0] == pytest.approx(1.0)


# --- vehicle -------------------------------------------------------------------------------------------------------------


@given(SEEDS)
def test_a_drive_carries_the_covariance_by_its_numeric_derivative(seed: int) -> None:
    chance, joint = np.random.default_rng(seed), team(seed, robots=1)
    motion = Motion(chance.uniform(0, 0.2), chance.uniform(-1, 1), 1.0, 1.0, 0.0, 0.0, 0.0, *chance.normal(0, 0.1, 4))
    nuisance = Nuisance(memory=(60.0, 2.0, 300.0))  # without noise
    mean, covariance = joint.mean.copy(), joint.covariance.copy()

    def driven(state: Array) -> Array:
        moved = Joint()
        moved.add("r", Moments(state, np.zeros((STATES, STATES))))
        drive(moved, "r", motion, nuisance)
        return moved.mean

    columns = []
    for axis in np.eye(STATES) * 1e-6:
        change = driven(mean + axis) - driven(mean - axis)
        change[HEADING] = wrap(change[HEADING])
        columns.append(change / 2e-6)
    derivative = np.stack(columns, axis=1)
    drive(joint, "robot/r0", motion, nuisance)
    added = joint.covariance - derivative @ covariance @ derivative.T
    assert np.linalg.eigvalsh(added[AXES, AXES]).min() > -1e-7, "because its heading is known badly"
    added[AXES, AXES] = 0.0
    assert np.allclose(added, 0.0, atol=1e-7)


@pytest.mark.parametrize("sigma", [0.1, 0.5, 1.0, 2.0])
def test_a_heading_that_is_known_badly_is_no_reason_to_be_sure_of_the_way(sigma: float) -> None:
    """Twenty steps straight on: the squared errors of robots with every heading are no larger than the covariance says."""
    chance, joint = np.random.default_rng(1), Joint()
    joint.add("r", entering(Moments(np.zeros(3), np.diag([1e-4, 1e-4, sigma**2])), Nuisance()))
    for _ in range(20):
        drive(joint, "r", Motion(0.1, 0.0, 1.0, 1.0), Nuisance())
    headings = sigma * chance.normal(size=20_000)
    apart = 2.0 * np.stack([np.cos(headings), np.sin(headings)]) - joint.mean[AXES][:, None]
    assert (np.mean(apart**2, axis=1) < 1.05 * np.diag(joint.covariance)[AXES]).all()


def test_a_robot_that_lags_is_where_its_odometry_was() -> None:
    """Of a motion that begins, a lag of 0.3 s leaves 0.7 of the first second; of one that ends it makes up for that."""
    joint = Joint()
    state = entering(Moments(np.zeros(3), np.zeros((3, 3))), Nuisance())
    state.mean[LAG] = 0.3
    joint.add("r", state)
    drive(joint, "r", Motion(1.0, dt=1.0, moving=1.0, faster=1.0), Nuisance())
    assert joint.mean[X] == pytest.approx(0.7)
    drive(joint, "r", Motion(0.0, dt=1.0, faster=-1.0), Nuisance())
    assert joint.mean[X] == pytest.approx(1.0)


def test_sums_of_motions_give_back_their_parts() -> None:
    first, second = Motion(0.1, 0.2, 1.0, 1.0, 0.01, 0.02, 0.03), Motion(0.3, -0.1, 2.0, 0.0, 0.04, 0.05, 0.06)
    back = first.plus(second).since(first)
    assert all(getattr(back, n) == pytest.approx(getattr(second, n)) for n in Motion.__dataclass_fields__)


def test_a_standing_robot_with_sensors_without_errors_stays_exactly_where_it_is() -> None:
    joint = Joint()
    joint.add("r", entering(Moments(np.array([1.0, 2.0, 3.0]), np.eye(3)), Nuisance()))
    before = joint.moments("r")
    drive(joint, "r", Motion(dt=5.0), Nuisance())
    assert np.allclose(joint.mean, before.mean)
    assert np.allclose(joint.covariance, before.covariance)


@given(SEEDS)
def test_sightings_of_each_other_tell_nothing_about_where_the_team_is_or_how_it_is_turned(seed: int) -> None:
    chance, joint = np.random.default_rng(seed), team(seed, robots=3)

    def told_about_the_whole() -> Array:
        """The information on moving and turning all robots together."""
        moves = np.zeros((len(joint.mean), 3))
        for place in joint.blocks.values():
            if place.stop - place.start == STATES:
                x, y = joint.mean[place][AXES]
                moves[place.start : place.start + 3] = [[1, 0, -y], [0, 1, x], [0, 0, 1]]
        return np.asarray(moves.T @ np.linalg.solve(joint.covariance, moves))

    before = told_about_the_whole()
    for _ in range(6):
        observer, subject = chance.permutation(3)[:2]
        relative = Relative(
            f"robot/r{observer}", f"robot/r{subject}", chance.uniform(1, 3), chance.uniform(-1, 1), 0.05, 0.05
        )
        factor = linearise(joint, relative, {})
        correct(joint, factor)
    assert np.allclose(told_about_the_whole(), before, rtol=1e-5)


# --- relation ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wide", [False, True], ids=["polar", "cartesian"])
@given(seed=SEEDS)
def test_a_sighting_has_the_derivatives_that_it_says(wide: bool, seed: int) -> None:
    chance = np.random.default_rng(seed)
    joint = team(seed, scale=3.0 if wide else 0.01)
    joint.covariance[HEADING, HEADING] = 1e-4 if wide else 0.01
    joint.mean[joint.blocks["robot/r1"]][AXES] = joint.mean[AXES] + [2.0, 0.5]
    relative = sighting(2.0, chance.uniform(-1, 1), age=0.4, biases=(Bias(0.1, 7.0),))  # type: ignore[arg-type]
    factor = linearise(joint, relative, {})
    # Across the line of sight the polar residual is an angle times the distance: its size does not matter.
    slack = 1e-4 + 2.0 * float(np.abs(factor.residual).max()) * (not wide)
    assert furthest_slope(joint, relative, factor) < slack


@given(seed=SEEDS)
def test_a_sighting_is_compared_with_a_joint_and_leaves_it_as_it_was(seed: int) -> None:
    """Its lasting errors, and a subject that is new, count as they would in the joint, whether it has them or not."""
    chance, joint = np.random.default_rng(seed), team(seed)
    if chance.random() < 0.5:
        joint.covariance[AXES, :] = joint.covariance[:, AXES] = 0.0
        joint.covariance[AXES, AXES] = np.eye(2) * FLAT
    biases = (Bias(0.1, 7.0), Bias(0.3, 100.0))
    relatives = [
        Relative("robot/r0", str(chance.choice(["robot/r1", "object/ball"])), d, 0.3, 0.04, 0.01, 0.0, biases, "g")
        for d in (2.0, 3.0)
    ]
    before = joint.copy()
    factors = [linearise(joint, relative, {}) for relative in relatives]
    apart, together = [joint.innovation(factor) for factor in factors], joint.innovation(*factors)
    assert joint.blocks == before.blocks
    assert np.array_equal(joint.mean, before.mean)
    assert np.array_equal(joint.covariance, before.covariance)
    whole = joint.copy()
    for factor in factors:
        whole.begin(factor.priors, factor.anchors)
    for factor, alone in zip(factors, apart, strict=True):
        assert np.array_equal(whole.innovation(factor).covariance, alone.covariance)
    rows = np.zeros((4, len(whole.mean)))
    for k, factor in enumerate(factors):
        for block, part in factor.jacobians.items():
            rows[2 * k : 2 * k + 2, whole.blocks[block]] = part
    noise = np.zeros((4, 4))
    noise[:2, :2], noise[2:, 2:] = (factor.noise for factor in factors)
    assert np.allclose(together.covariance, rows @ whole.covariance @ rows.T + noise)


def test_where_to_linearise_is_no_evidence() -> None:
    joint = team(5, robots=1, scale=0.001)
    relative = Relative("robot/r0", "landmark/6", 2.0, 0.3, 0.01, 0.0004)
    place = joint.mean[AXES] + [1.0, 1.5]
    exact = linearise(joint, relative, {}, place)
    near = linearise(joint, relative, {}, place, at=joint.mean + 1e-6)
    assert np.allclose(exact.residual, near.residual, atol=1e-8)


def test_a_profile_is_averaged_over_where_the_subject_may_be() -> None:
    profile = ((1.0, 1.0), (2.0, 1.0), (3.0, 9.0))
    joint = team(5, robots=1, scale=1e-4)
    relative = Relative("robot/r0", "landmark/6", 2.0, 0.0, 0.0, 0.0, profile=profile)
    sharp = linearise(joint, relative, {}, joint.mean[AXES] + [2.0, 0.0])
    assert sharp.noise[0, 0] == pytest.approx(1.0, abs=0.01)
    joint.covariance[AXES, AXES] = np.eye(2)
    wide = linearise(joint, relative, {}, joint.mean[AXES] + [2.0, 0.0])
    assert np.trace(wide.noise) > 3.0


# --- increments ----------------------------------------------------------------------------------------------------------


def evidence(joint: Joint, seed: int) -> None:
    chance = np.random.default_rng(seed)
    rows = chance.normal(size=(2, STATES))
    joint.update(Factor(chance.normal(size=2) * 0.1, {"robot/r0": rows}, random_covariance(chance, 2, 0.5)))


@given(SEEDS)
def test_an_increment_gives_a_belief_back_to_its_own_prediction(seed: int) -> None:
    joint = team(seed, robots=1)
    prediction, other = joint.moments("robot/r0"), joint.copy()
    evidence(joint, seed)
    increment = present(gained(prediction, joint.moments("robot/r0")))
    assert np.linalg.eigvalsh(increment.information).min() > -1e-9 * np.linalg.norm(increment.information)
    factor = likelihood(other, "robot/r0", increment)
    other.update(present(factor))
    assert np.allclose(other.mean, joint.mean, atol=1e-6)
    assert np.allclose(other.covariance, joint.covariance, atol=1e-7)


@given(SEEDS)
def test_an_increment_is_the_same_evidence_on_any_belief(seed: int) -> None:
    private, elsewhere = team(seed, robots=1), team(seed + 1, robots=2)
    elsewhere.mean[:STATES] = private.mean + 0.01
    direct = elsewhere.copy()
    prediction = private.moments("robot/r0")
    evidence(private, seed)
    increment = gained(prediction, private.moments("robot/r0"))
    factor = likelihood(elsewhere, "robot/r0", present(increment))
    elsewhere.update(present(factor))
    chance = np.random.default_rng(seed)
    rows = chance.normal(size=(2, STATES))
    residual = chance.normal(size=2) * 0.1 + rows @ (prediction.mean - direct.mean[:STATES])
    direct.update(Factor(residual, {"robot/r0": rows}, random_covariance(chance, 2, 0.5)))
    assert np.allclose(elsewhere.mean, direct.mean, atol=1e-6)
    assert np.allclose(elsewhere.covariance, direct.covariance, atol=1e-7)


def test_nothing_gained_is_no_increment_and_a_wider_belief_none_either() -> None:
    joint = team(2, robots=1)
    before = joint.moments("robot/r0")
    assert gained(before, before) is None
    assert gained(before, Moments(before.mean, before.covariance * 1.1)) is None


def test_states_that_are_known_exactly_gain_nothing() -> None:
    prior = entering(Moments(np.zeros(3), np.eye(3)), Nuisance())
    joint = Joint()
    joint.add("robot/r0", prior)
    joint.update(Factor(np.array([0.5]), {"robot/r0": np.eye(STATES)[[X]]}, np.eye(1)))
    increment = present(gained(prior, joint.moments("robot/r0")))
    assert increment.information[X, X] == pytest.approx(1.0)
    assert not increment.information[FORWARD:].any()
    assert not increment.information[BEARING, RANGE]


# --- drawing -------------------------------------------------------------------------------------------------------------


def test_a_drawn_gaussian_has_its_moments_whether_wide_or_thin() -> None:
    grid = Grid((40, 50), 0.1, (-2.0, -2.5), "m")
    for sigma in (0.01, 0.1, 0.3):
        covariance = sigma**2 * np.array([[1.0, 0.5], [0.5, 1.0]])
        drawn = draw(grid, Moments(np.array([0.13, -0.22]), covariance))
        assert drawn.mean() == pytest.approx((0.13, -0.22), abs=0.04)
        assert np.allclose(drawn.covariance(), covariance, atol=0.0025)


def test_a_gaussian_far_outside_the_grid_is_drawn_as_nothing_known() -> None:
    grid = Grid((4, 4))
    assert np.allclose(draw(grid, Moments(np.array([1e6, 0.0]), np.eye(2))).p, 1 / 16)
