"""Streams of fusions of the same sources, and what a board that learns gains on them."""

import numpy as np
import pytest

from blackboard.lab import streams
from blackboard.lab.streams import LEARNED, ORACLE, STREAMS, generate, judge, report, sources, text


def test_one_liar_is_found_out_on_a_short_stream() -> None:
    scores = judge("one liar of 5", 30, np.random.default_rng(5))
    rules = report(["one liar of 5"], [scores])["streams"]["one liar of 5"]["rules"]
    assert rules[LEARNED]["log_score"] > rules["independence 0.2"]["log_score"] + 0.1
    assert rules[ORACLE]["gap"] == 0.0
    assert report(["one liar of 5"], [scores])["mean_gap"][LEARNED] == pytest.approx(rules[LEARNED]["gap"])


def test_a_trial_has_no_oracle() -> None:
    result = report(["trial echoes"], [judge("trial echoes", 4, np.random.default_rng(5))])
    assert ORACLE not in result["streams"]["trial echoes"]["rules"]
    assert result["mean_gap"] == {}
    assert "trial echoes" in text(result)


def test_the_oracle_of_two_independent_sources_is_their_product() -> None:
    for instant in generate(lambda share: sources(2), 3, np.random.default_rng(1)):
        product = instant.case.opinions.prod(axis=0)
        assert instant.oracle is not None
        np.testing.assert_allclose(instant.oracle.p, product / product.sum(), atol=1e-6)


@pytest.mark.parametrize("name", streams.NAMES)
def test_every_stream_gives_opinions_and_is_the_same_again(name: str) -> None:
    drawn, again = (list(streams.instants(name, 2, np.random.default_rng(3))) for _ in range(2))
    for first, second in zip(drawn, again, strict=True):
        assert np.array_equal(first.case.opinions, second.case.opinions)
        np.testing.assert_allclose(first.case.opinions.sum(axis=(1, 2)), 1.0)
    assert (drawn[0].oracle is None) == name.startswith("trial")


def test_errors_of_a_stream_are_what_it_says() -> None:
    """The spread of the means about the truth, in claimed sigmas: twice what is claimed."""
    away = []
    for instant in generate(STREAMS["all claim half"], 60, np.random.default_rng(2)):
        means = [
            np.array([(p.sum(axis=1 - axis) * (np.arange(50) + 0.5)).sum() for axis in (0, 1)])
            for p in instant.case.opinions
        ]
        peaks = instant.case.opinions.max(axis=(1, 2))
        away += [(m - instant.case.truth) * np.sqrt(2 * np.pi * peak) for m, peak in zip(means, peaks, strict=True)]
    assert np.std(away) == pytest.approx(2.0, rel=0.08)
