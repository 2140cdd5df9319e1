"""The agent: two estimators on the same readings, and what is told of them."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.levels import Coding
from blackboard.wire.messages import Consensus, Fix, Odometry, PackedBelief, Readings, Report, Sighting
from robot_agent.agent import Agent, Agreed, Feedback
from robot_agent.config import RobotSection
from robot_agent.position import PositionLocalizer

GRID = Grid((30, 30))


def readings(tick: int, *sightings: Sighting, fix: tuple[float, float] | None = None) -> Readings:
    return Readings(
        run="x",
        robot="r1",
        tick=tick,
        time=0.5 * tick,
        odometry=Odometry(distance=0.5, turn=0.0, dt=0.5) if tick else None,
        compass=0.0,
        fix=None if fix is None else Fix(position=fix, sigma=1.0),
        sightings=list(sightings),
    )


def agreed(tick: int, x: float, y: float, *, subject: str = "robot/r1") -> dict[str, Agreed]:
    consensus = Consensus(
        board="a",
        sub_team="a",
        level="agreed",
        subject=subject,
        tick=tick,
        time=0.5 * tick,
        belief=pack(gaussian(GRID, (x, y), 0.8)),
        ancestors={"r1": 0.5 * tick, "r2": 0.5 * tick},
        used=[],
        entropy=1.0,
        conflict=False,
        rule="coalition",
    )
    return {subject: Agreed.unpacked(consensus, GRID)}


def agent(feedback: Feedback = "guarded") -> Agent:
    return Agent("r1", RobotSection(), GRID, feedback)


BALL = Sighting(subject="object/ball", range=5.0, bearing=0.3)


def by_subject(reports: list[Report]) -> dict[str, Report]:
    return {report.subject: report for report in reports}


def test_alone_it_reports_first_hand_only() -> None:
    reports, solo = agent().tick(readings(0, BALL, fix=(10, 10)), {})
    found = by_subject(reports)
    assert set(found) == {"robot/r1", "object/ball"}
    assert all(r.informed is None and r.ancestors == {"r1": 0.0} for r in reports)
    assert solo.beliefs == {s: r.belief for s, r in found.items()}


def test_solo_and_first_hand_never_depend_on_the_team() -> None:
    helped, alone = agent(), agent()
    for tick in range(5):
        told = agreed(tick - 1, 14 + 0.5 * tick, 12) if tick else {}
        said = readings(tick, BALL, fix=(10, 10) if tick == 0 else None)
        (with_team, solo), (without, same) = helped.tick(said, told), alone.tick(said, {})
        assert solo == same
        assert [r.belief for r in with_team] == [r.belief for r in without]


def test_the_agreed_belief_is_taken_over_with_its_ancestors() -> None:
    it = agent()
    it.tick(readings(0, fix=(10, 10)), {})
    reports, _ = it.tick(readings(1), agreed(0, 12, 11))
    own = by_subject(reports)["robot/r1"]
    assert own.informed is not None
    assert set(own.informed.ancestors) == {"r1", "r2"}
    assert unpack(own.informed.belief).mean() == pytest.approx((12.5, 11), abs=0.3)
    assert unpack(own.belief).mean() == pytest.approx((10.5, 10), abs=0.3)


def test_a_late_agreed_belief_is_taken_at_its_own_tick() -> None:
    """Going back and playing the readings again gives what folding in time would have given."""
    prompt, late = agent(), agent()
    for it in (prompt, late):
        it.tick(readings(0, fix=(10, 10)), {})
    prompt.tick(readings(1), agreed(0, 12, 11))
    prompt.tick(readings(2), {})
    late.tick(readings(1), {})
    late.tick(readings(2), agreed(0, 12, 11))
    first, second = (it.informed.localizer.marginal().p for it in (prompt, late))
    assert np.allclose(first, second, atol=1e-3)


def test_without_a_common_tick_an_agreed_belief_is_taken_at_its_time() -> None:
    """Where no world counts the ticks, a board's ticks are its own: the newest readings before the belief count."""
    by_tick, by_time = agent(), agent()
    for it in (by_tick, by_time):
        for tick in range(4):
            it.tick(readings(tick, fix=(10, 10) if tick == 0 else None), {})
    told = agreed(2, 12, 11)["robot/r1"]
    by_tick.tick(readings(4), {"robot/r1": told})
    by_time.tick(readings(4), {"robot/r1": replace(told, tick=8_500_000_000, time=told.time + 0.4)})
    first, second = (it.informed.localizer.marginal().p for it in (by_tick, by_time))
    assert np.array_equal(first, second)
    before = by_time.informed
    by_time.tick(readings(5), {"robot/r1": replace(told, tick=8_500_000_000, time=-1.0)})
    assert by_time.informed.ancestors["r2"] == before.ancestors["r2"]
    assert np.array_equal(
        by_time.informed.localizer.marginal().p, before.advance(readings(5), by_time.mates).localizer.marginal().p
    )


def test_feedback_off_listens_to_nobody() -> None:
    it = agent("off")
    it.tick(readings(0, fix=(10, 10)), {})
    reports, _ = it.tick(readings(1), agreed(0, 12, 11))
    assert all(report.informed is None for report in reports)


def test_seen_again_and_again_through_one_pose_an_object_is_not_known_better_than_the_pose() -> None:
    it = agent()
    entropies = []
    for tick in range(10):
        _, solo = it.tick(readings(0, BALL, fix=(10, 10) if tick == 0 else None).model_copy(update={"tick": tick}), {})
        entropies.append(entropy(unpack(solo.beliefs["object/ball"]).p))
    assert entropies[0] - entropies[-1] < 1.0  # ten independent sightings would gain ln 10 = 2.3 nats


def test_each_belief_is_marginalised_and_packed_once_a_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    marginals, packs = Counter[str](), Counter[str]()
    marginal, packed = PositionLocalizer.marginal, pack

    def counted_marginal(localizer: PositionLocalizer) -> Belief:
        marginals["made"] += 1
        return marginal(localizer)

    def counted_pack(belief: Belief, coding: Coding) -> PackedBelief:
        packs["made"] += 1
        return packed(belief, coding)

    it = agent()
    it.tick(readings(0, BALL, fix=(10, 10)), {})
    monkeypatch.setattr(PositionLocalizer, "marginal", counted_marginal)
    monkeypatch.setattr("robot_agent.agent.pack", counted_pack)
    reports, solo = it.tick(readings(1, BALL), {})
    assert (marginals["made"], packs["made"]) == (1, 2)
    assert solo.beliefs == {report.subject: report.belief for report in reports}
    it.tick(readings(2, BALL), agreed(1, 12, 11))
    assert (marginals["made"], packs["made"]) == (3, 5)  # now also the informed belief about itself
