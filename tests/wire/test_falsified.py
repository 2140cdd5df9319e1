"""Reports that are displaced or too sure: beliefs and evidence alike."""

from __future__ import annotations

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import unpack_increment, unpack_state
from blackboard.wire.falsified import displaced, moved, narrowed, overconfident
from tests.wire.reports import GRID, report


def test_all_places_are_off_by_the_offset_in_beliefs_and_evidence() -> None:
    true, lie = report(), displaced(report(), (2.0, -1.0))
    assert lie.informed
    assert lie.evidence
    assert lie.evidence.state
    assert lie.evidence.increment
    for packed in (lie.belief, lie.informed.belief):
        assert unpack(packed, GRID).mean() == pytest.approx([9.0, 7.0], abs=0.02)
    assert unpack_state(lie.evidence.state).mean[:3] == pytest.approx([9.0, 7.0, 0.5])
    assert unpack_increment(lie.evidence.increment).reference[:2] == pytest.approx([9.0, 7.0])
    assert true.evidence
    (one,), (other,) = lie.evidence.relatives, true.evidence.relatives
    at = [(it.range * np.cos(0.5 + it.bearing), it.range * np.sin(0.5 + it.bearing)) for it in (one, other)]
    assert np.subtract(*at) == pytest.approx([2.0, -1.0])


def test_a_belief_beyond_the_grid_stays_at_its_edge() -> None:
    lie = moved(gaussian(GRID, (7.0, 8.0), 0.6), (100.0, 0.0))
    assert lie.p.sum() == pytest.approx(1.0)
    assert lie.mean() == pytest.approx([14.75, 8.0], abs=0.02)


@pytest.mark.parametrize("factor", [1.5, 2.0])
def test_sigmas_are_smaller_by_the_factor(factor: float) -> None:
    wide = gaussian(GRID, (7.0, 8.0), 2.0)
    assert np.sqrt(np.diag(narrowed(wide, factor).covariance())) == pytest.approx([2.0 / factor] * 2, rel=0.05)
    said = overconfident(report(), factor)
    assert said.evidence
    assert said.evidence.state
    assert said.evidence.increment
    assert unpack_state(said.evidence.state).covariance[0, 0] == pytest.approx(0.4 / factor**2)
    assert unpack_increment(said.evidence.increment).information[0, 0] == pytest.approx(4.0 * factor**2)
    assert said.evidence.relatives[0].range_variance == pytest.approx(0.04 / factor**2)
