"""Reports that are displaced or too sure: beliefs and evidence alike."""

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import Seen
from blackboard.wire.falsified import displaced, moved, narrowed, overconfident
from blackboard.wire.gaussians import unpack_increment, unpack_state
from blackboard.wire.messages import Report
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
    (off,), (right,) = lie.evidence.relatives, true.evidence.relatives
    at = [
        (relative.range * np.cos(0.5 + relative.bearing), relative.range * np.sin(0.5 + relative.bearing))
        for relative in (off, right)
    ]
    assert np.subtract(*at) == pytest.approx([2.0, -1.0])


def seeing(*sightings: Seen) -> Report:
    said = report()
    assert said.evidence
    return said.model_copy(update={"evidence": said.evidence.model_copy(update={"seen": list(sightings)})})


def seen_in(said: Report) -> list[Seen]:
    assert said.evidence
    return said.evidence.seen


def test_sightings_of_further_kinds_are_off_and_too_sure_as_all_others() -> None:
    position = Seen(subject="robot/r2", kind="position", values=(3.0, 1.0), covariance=(0.4, 0.1, 0.4))
    pose = Seen(subject="robot/r3", kind="pose", values=(3.0, 1.0, 0.2), covariance=(0.4, 0.0, 0.0, 0.4, 0.0, 0.1))
    distance = Seen(subject="robot/r4", kind="range", values=(3.0,), covariance=(0.4,), biases=[(0.2, 10.0)])
    bearing = Seen(subject="robot/r4", kind="bearing", values=(0.3,), covariance=(0.4,))
    said = seeing(position, pose, distance, bearing)
    off = seen_in(displaced(said, (2.0, -1.0)))
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])  # of the observer's heading
    for lied, honest in zip(off[:2], (position, pose), strict=True):
        assert turn @ np.subtract(lied.values[:2], honest.values[:2]) == pytest.approx([2.0, -1.0])
        assert lied.values[2:] == honest.values[2:]
    assert [off[2].values, off[3].values] == [pytest.approx((3.0 + 5.0**0.5,)), (0.3,)]
    sure = seen_in(overconfident(said, 2.0))
    assert [sighting.covariance[0] for sighting in sure] == pytest.approx([0.1] * 4)
    assert sure[2].biases == [(0.1, 10.0)]
    assert [sighting.values for sighting in sure] == [sighting.values for sighting in seen_in(said)]


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
