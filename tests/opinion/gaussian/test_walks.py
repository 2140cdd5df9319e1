"""How fast an object moves is found from its sightings, whatever was told."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.walks import FACTORS, LOST, MEMORY, PRIOR, UNLIKELY, WALKERS, Walks

DT, SIGMA = 0.2, 0.5  # seconds, units


def watched(walks: Walks, drift: float, places: np.ndarray, rng: np.random.Generator) -> list[float]:
    """The drift after each tick, of an object that is seen at some places, shape (n, 2), in two of five ticks."""
    drifts = []
    for place in places:
        walks.pass_time("object/ball", drift, DT)
        if rng.random() < 0.4:
            measured = place + SIGMA * rng.normal(size=2)
            walks.judge("object/ball", Moments(measured, SIGMA**2 * np.eye(2)))
        drifts.append(walks.drift("object/ball", drift))
    return drifts


def test_what_is_told_counts_until_something_is_seen_twice() -> None:
    walks = Walks()
    assert walks.drift("object/ball", 0.3) == 0.3
    walks.judge("object/ball", Moments(np.zeros(2), np.eye(2)))
    assert walks.drift("object/ball", 0.3) == pytest.approx(0.3, rel=0.01)
    walks.forget("object/ball")
    assert walks.drift("object/ball", 0.3) == 0.3


def test_what_is_told_is_the_root_mean_square_of_what_objects_do() -> None:
    for prior in (PRIOR, WALKERS):
        shares = np.exp(prior) / np.exp(prior).sum()
        assert float(shares @ FACTORS**2) == pytest.approx(1.0, rel=1e-12)
    assert np.exp(PRIOR)[0] / np.exp(PRIOR).sum() == pytest.approx(0.5, abs=0.01)


def test_a_post_is_taken_to_stand_after_a_minute_but_not_so_soon_by_one_robot_alone() -> None:
    rng, several, lone = np.random.default_rng(3), Walks(), Walks()
    for _ in range(300):
        measured = Moments(SIGMA * rng.normal(size=2), SIGMA**2 * np.eye(2))
        for walks, alone in ((several, False), (lone, True)):
            walks.pass_time("object/post", 0.3, DT)
            walks.judge("object/post", measured, alone=alone)
    assert several.drift("object/post", 0.3) < 0.025
    assert several.drift("object/post", 0.3) < 0.7 * lone.drift("object/post", 0.3)


@pytest.mark.parametrize("drift", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("true", [0.1, 0.5, 2.0])
def test_the_walk_is_found_within_a_factor_of_two_whatever_was_told(true: float, drift: float) -> None:
    rng = np.random.default_rng([int(10 * true), int(10 * drift)])
    logs = []
    for _ in range(10):
        places = np.cumsum(true * math.sqrt(DT) * rng.normal(size=(300, 2)), axis=0)
        logs += np.log(watched(Walks(), drift, places, rng)[150:]).tolist()
    assert 0.5 < math.exp(np.mean(logs)) / true < 2.0


def test_what_stands_is_known_to_stand_and_anything_again_once_it_is_kicked() -> None:
    rng, walks = np.random.default_rng(1), Walks()
    assert watched(walks, 0.5, np.zeros((300, 2)), rng)[-1] < 0.1
    assert max(watched(walks, 0.5, np.full((10, 2), [8.0, 0.0]), rng)) > 0.3
    assert watched(walks, 0.5, np.full((600, 2), [8.0, 0.0]), rng)[-1] < 0.15


def test_of_two_far_sightings_that_agree_the_second_is_a_kick_which_is_made_up_for() -> None:
    walks, there, elsewhere = Walks(), np.array([8.0, 6.0]), np.array([-8.0, 0.0])
    watched(walks, 0.5, np.zeros((100, 2)), np.random.default_rng(1))
    seen = Moments(np.zeros(2), SIGMA**2 * np.eye(2))
    without = walks.copy()
    without.judge("object/ball", seen)

    def judged(place: np.ndarray) -> Moments | None:
        return walks.judge("object/ball", replace(seen, mean=place))

    assert judged(there) is None
    assert judged(elsewhere) is None
    assert judged(np.zeros(2)) is None
    assert judged(there) is None
    assert walks.drift("object/ball", 0.5) == without.drift("object/ball", 0.5)
    made_up = judged(there)
    assert made_up is not None
    assert made_up.covariance == pytest.approx(100.0 * np.eye(2), rel=0.2)
    assert judged(there) is None


def test_a_copy_goes_its_own_way() -> None:
    walks = Walks()
    walks.judge("object/ball", Moments(np.zeros(2), np.eye(2)))
    walks.pass_time("object/ball", 0.3, 1.0)
    walks.judge("object/ball", Moments(np.array([9.0, 9.0]), np.eye(2)))
    drift, copy = walks.drift("object/ball", 0.3), walks.copy()
    copy.judge("object/ball", Moments(np.array([9.0, 9.0]), np.eye(2)))
    copy.pass_time("object/ball", 0.3, 9.0)
    copy.judge("object/ball", Moments(np.array([7.0, 9.0]), np.eye(2)))
    assert walks.drift("object/ball", 0.3) == drift
    assert copy.drift("object/ball", 0.3) != drift
    assert walks.judge("object/ball", Moments(np.zeros(2), np.eye(2))) is None


Members = list[tuple[float, np.ndarray, np.ndarray]]  # log likelihood, place and covariance of each
SIGHTINGS = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.05, 3), st.floats(0, 5)), min_size=1, max_size=12
)


def passed(members: Members, drift: float, dt: float) -> Members:
    return [
        (log * math.exp(-dt / MEMORY), mean, covariance + np.eye(2) * (drift * factor) ** 2 * dt)
        for (log, mean, covariance), factor in zip(members, FACTORS, strict=True)
    ]


def density(members: Members, measured: np.ndarray | None, noise: np.ndarray) -> float:
    """The log of how likely a sighting is, by all members; None: where each of them has the object."""
    total = of_all = 0.0
    for (log, mean, covariance), prior in zip(members, PRIOR, strict=True):
        apart = np.zeros(2) if measured is None else measured - mean
        squared = float(apart @ np.linalg.solve(covariance + noise, apart))
        total += math.exp(log + prior - 0.5 * squared) / math.sqrt(np.linalg.det(covariance + noise))
        of_all += math.exp(log + prior)
    return math.log(max(total, 1e-300) / of_all)


def updated(members: Members, measured: np.ndarray, noise: np.ndarray) -> Members:
    after: Members = []
    for log, mean, covariance in members:
        spread, apart = covariance + noise, measured - mean
        squared = float(apart @ np.linalg.solve(spread, apart))
        gain = covariance @ np.linalg.inv(spread)
        news = -0.5 * (squared + math.log(np.linalg.det(spread)))
        after.append((log + news, mean + gain @ apart, covariance - gain @ covariance))
    best = max(after, key=lambda member: member[0])
    after = [(log - best[0], *(filter_ if log - best[0] >= LOST else best[1:])) for log, *filter_ in after]
    return [(max(log, LOST), mean, covariance) for log, mean, covariance in after]


@given(SIGHTINGS, st.floats(0.01, 5))
@settings(max_examples=100, deadline=None)
def test_the_bank_is_a_filter_for_each_drift_weighed_by_what_it_expected(
    sightings: list[tuple[float, float, float, float]], drift: float
) -> None:
    """The oracle: one Kalman filter at a time, in the words of the textbook, and a second bank since the last misread."""
    walks = Walks()
    members: Members = []
    kicked: Members = []
    for x, y, sigma, dt in sightings:
        measured, noise = np.array([x, y]), sigma**2 * np.eye(2)
        walks.pass_time("object/ball", drift, dt, "walk")
        walks.judge("object/ball", Moments(measured, noise))
        anew = [(0.0, measured, noise) for _ in FACTORS]
        members, kicked = passed(members, drift, dt) if members else [], passed(kicked, drift, dt) if kicked else []
        if not members:
            members = anew
        elif density(members, measured, noise) > density(members, None, noise) - UNLIKELY:
            members, kicked = updated(members, measured, noise), []
        elif kicked and density(kicked, measured, noise) > density(kicked, None, noise) - UNLIKELY:
            members, kicked = updated(kicked, measured, noise), []
        else:
            kicked = anew
    shares = [math.exp(log + prior) for (log, _, _), prior in zip(members, PRIOR, strict=True)]
    mean_square = sum(share * factor**2 for share, factor in zip(shares, FACTORS, strict=True)) / sum(shares)
    assert walks.drift("object/ball", drift) == pytest.approx(drift * math.sqrt(mean_square), rel=1e-6)
    assert drift * FACTORS[0] * 0.999 <= walks.drift("object/ball", drift) <= drift * FACTORS[-1] * 1.001
