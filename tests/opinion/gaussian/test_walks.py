"""How fast an object moves is found from its sightings, whatever was told."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.walks import FACTORS, LOST, MEMORY, PRIOR, Walks

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


@pytest.mark.parametrize("drift", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("true", [0.1, 0.5, 2.0])
def test_the_walk_is_found_within_a_factor_of_two_whatever_was_told(true: float, drift: float) -> None:
    rng = np.random.default_rng([int(10 * true), int(10 * drift)])
    logs = []
    for _ in range(10):
        places = np.cumsum(true * math.sqrt(DT) * rng.normal(size=(300, 2)), axis=0)
        logs += np.log(watched(Walks(), drift, places, rng)[150:]).tolist()
    assert 0.5 < math.exp(np.mean(logs)) / true < 2.0


def test_what_stands_is_known_to_stand_and_is_followed_once_it_is_kicked() -> None:
    rng, walks = np.random.default_rng(1), Walks()
    assert watched(walks, 0.5, np.zeros((300, 2)), rng)[-1] < 0.1
    assert max(watched(walks, 0.5, np.full((10, 2), [8.0, 0.0]), rng)) > 3.0
    assert watched(walks, 0.5, np.full((600, 2), [8.0, 0.0]), rng)[-1] < 0.15


def test_a_copy_goes_its_own_way() -> None:
    walks = Walks()
    walks.judge("object/ball", Moments(np.zeros(2), np.eye(2)))
    copy = walks.copy()
    copy.pass_time("object/ball", 0.3, 1.0)
    copy.judge("object/ball", Moments(np.array([9.0, 9.0]), np.eye(2)))
    assert walks.drift("object/ball", 0.3) == pytest.approx(0.3, rel=0.01)
    assert copy.drift("object/ball", 0.3) > 0.6


SIGHTINGS = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.05, 3), st.floats(0, 5)), min_size=1, max_size=12
)


@given(SIGHTINGS, st.floats(0.01, 5))
@settings(max_examples=100, deadline=None)
def test_the_bank_is_a_filter_for_each_drift_weighed_by_what_it_expected(
    sightings: list[tuple[float, float, float, float]], drift: float
) -> None:
    """The oracle: one Kalman filter at a time, in the words of the textbook."""
    walks = Walks()
    members: list[tuple[float, np.ndarray, np.ndarray]] = []
    for x, y, sigma, dt in sightings:
        measured, noise = np.array([x, y]), sigma**2 * np.eye(2)
        walks.pass_time("object/ball", drift, dt)
        walks.judge("object/ball", Moments(measured, noise))
        if not members:
            members = [(0.0, measured, noise) for _ in FACTORS]
            continue
        moved = []
        for (log, mean, covariance), factor in zip(members, FACTORS, strict=True):
            predicted = covariance + np.eye(2) * (drift * factor) ** 2 * dt
            spread = predicted + noise
            apart = measured - mean
            squared = float(apart @ np.linalg.solve(spread, apart))
            now = log * math.exp(-dt / MEMORY) - 0.5 * (squared + math.log(np.linalg.det(spread)))
            gain = predicted @ np.linalg.inv(spread)
            moved.append((now, mean + gain @ apart, predicted - gain @ predicted))
        best = max(moved, key=lambda member: member[0])
        members = [(log - best[0], *(filter_ if log - best[0] >= LOST else best[1:])) for log, *filter_ in moved]
        members = [(max(log, LOST), mean, covariance) for log, mean, covariance in members]
    shares = [math.exp(log + prior) for (log, _, _), prior in zip(members, PRIOR, strict=True)]
    mean_square = sum(share * factor**2 for share, factor in zip(shares, FACTORS, strict=True)) / sum(shares)
    assert walks.drift("object/ball", drift) == pytest.approx(drift * math.sqrt(mean_square), rel=1e-6)
    assert drift * FACTORS[0] * 0.999 <= walks.drift("object/ball", drift) <= drift * FACTORS[-1] * 1.001
