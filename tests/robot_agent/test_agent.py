"""The agent: two estimators on the same readings, and what is told of them."""

from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.levels import Coding
from blackboard.wire.messages import Fix, PackedBelief, Sighting
from robot_agent.agent import Agent, Feedback
from robot_agent.config import RobotSection
from robot_agent.position import PositionLocalizer
from tests.robot_agent.robots import BALL, CAMERA, FINE, GRID, STILL, agreed, by_subject, position_localizer, readings


def near(x: float, y: float) -> Belief:
    return gaussian(GRID, (x, y), 0.8)


def new_agent(feedback: Feedback = "guarded") -> Agent:
    return Agent("r1", RobotSection(), GRID, feedback)


def test_alone_it_reports_first_hand_only() -> None:
    reports, solo = new_agent().tick(readings(0, BALL, fix=(10, 10)), {})
    reported = by_subject(reports)
    assert set(reported) == {"robot/r1", "object/ball"}
    assert all(r.informed is None and r.ancestors == {"r1": 0.0} for r in reports)
    assert solo.beliefs == {s: r.belief for s, r in reported.items()}


def test_solo_and_first_hand_never_depend_on_the_team() -> None:
    helped, alone = new_agent(), new_agent()
    for tick in range(5):
        team = agreed(tick - 1, near(14 + 0.5 * tick, 12)) if tick else {}
        said = readings(tick, BALL, fix=(10, 10) if tick == 0 else None)
        (with_team, solo), (without, same) = helped.tick(said, team), alone.tick(said, {})
        assert solo == same
        assert [r.belief for r in with_team] == [r.belief for r in without]


def test_the_agreed_belief_is_taken_over_with_its_ancestors() -> None:
    agent = new_agent()
    agent.tick(readings(0, fix=(10, 10)), {})
    reports, _ = agent.tick(readings(1), agreed(0, near(12, 11)))
    own = by_subject(reports)["robot/r1"]
    assert own.informed is not None
    assert set(own.informed.ancestors) == {"r1", "r2"}
    assert unpack(own.informed.belief).mean() == pytest.approx((12.5, 11), abs=0.3)
    assert unpack(own.belief).mean() == pytest.approx((10.5, 10), abs=0.3)


def test_a_late_agreed_belief_is_taken_at_its_own_tick() -> None:
    """Going back and playing the readings again gives what folding in time would have given."""
    prompt, late = new_agent(), new_agent()
    for agent in (prompt, late):
        agent.tick(readings(0, fix=(10, 10)), {})
    prompt.tick(readings(1), agreed(0, near(12, 11)))
    prompt.tick(readings(2), {})
    late.tick(readings(1), {})
    late.tick(readings(2), agreed(0, near(12, 11)))
    first, second = (agent.informed.localizer.marginal().p for agent in (prompt, late))
    assert np.allclose(first, second, atol=1e-3)


def test_without_a_common_tick_an_agreed_belief_is_taken_at_its_time() -> None:
    """Where no world counts the ticks, a board's ticks are its own: the newest readings before the belief count."""
    by_tick, by_time = new_agent(), new_agent()
    for agent in (by_tick, by_time):
        for tick in range(4):
            agent.tick(readings(tick, fix=(10, 10) if tick == 0 else None), {})
    belief = agreed(2, near(12, 11))["robot/r1"]
    by_tick.tick(readings(4), {"robot/r1": belief})
    by_time.tick(readings(4), {"robot/r1": replace(belief, tick=8_500_000_000, time=belief.time + 0.4)})
    first, second = (agent.informed.localizer.marginal().p for agent in (by_tick, by_time))
    assert np.array_equal(first, second)
    before = by_time.informed
    by_time.tick(readings(5), {"robot/r1": replace(belief, tick=8_500_000_000, time=-1.0)})
    assert by_time.informed.ancestors["r2"] == before.ancestors["r2"]
    assert np.array_equal(
        by_time.informed.localizer.marginal().p, before.advance(readings(5), by_time.mates).localizer.marginal().p
    )


def test_feedback_off_listens_to_nobody() -> None:
    agent = new_agent("off")
    agent.tick(readings(0, fix=(10, 10)), {})
    reports, _ = agent.tick(readings(1), agreed(0, near(12, 11)))
    assert all(report.informed is None for report in reports)


def test_seen_again_and_again_through_one_pose_an_object_is_not_known_better_than_the_pose() -> None:
    agent = new_agent()
    entropies = []
    for tick in range(10):
        _, solo = agent.tick(
            readings(0, BALL, fix=(10, 10) if tick == 0 else None).model_copy(update={"tick": tick}), {}
        )
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

    agent = new_agent()
    agent.tick(readings(0, BALL, fix=(10, 10)), {})
    monkeypatch.setattr(PositionLocalizer, "marginal", counted_marginal)
    monkeypatch.setattr("robot_agent.agent.pack", counted_pack)
    reports, solo = agent.tick(readings(1, BALL), {})
    assert (marginals["made"], packs["made"]) == (1, 2)
    assert solo.beliefs == {report.subject: report.belief for report in reports}
    agent.tick(readings(2, BALL), agreed(1, near(12, 11)))
    assert (marginals["made"], packs["made"]) == (3, 5)  # now also the informed belief about itself


# --- against exact expectations ------------------------------------------------------------------------------------------

FIX = Fix(position=(0.5, 5.5), sigma=0.5)
MATE = Sighting(subject="robot/r2", range=3.5, bearing=0.3)
still = partial(readings, distance=0.0)


def bump(x: float, y: float, sigma: float) -> Belief:
    return gaussian(FINE, (x, y), sigma)


def new_seeing_agent(**vision: object) -> Agent:
    """An agent with a camera of range and bearing."""
    return Agent("r1", RobotSection.model_validate({"vision": {**CAMERA, **vision}}), FINE)


@pytest.mark.parametrize("mates", [True, False])
def test_a_mate_is_a_landmark_only_where_the_settings_say_so(mates: bool) -> None:
    informed = {}
    for placed in (True, False):
        agent = new_seeing_agent(mates=mates)
        agent.tick(still(0, fix=FIX), {})
        team = agreed(0, bump(0.5, 5.5, 0.5))
        if placed:
            team |= agreed(0, bump(4.5, 6.0, 0.2), "robot/r2")
        agent.tick(still(1, MATE), team)
        informed[placed] = agent.informed.localizer.marginal().p
    assert (np.abs(informed[True] - informed[False]).max() > 1e-4) == mates


@pytest.mark.parametrize("sigma", [0.9, 1.3])
def test_an_informed_belief_about_another_is_told_only_where_it_is_half_a_nat_sharper(sigma: float) -> None:
    """What the team told of the robot's own place sharpens where it sees a ball, by the more the surer the team is."""
    agent = new_seeing_agent()
    agent.tick(still(0, fix=FIX), {})
    agent.firsthand = replace(agent.firsthand, localizer=position_localizer(bump(0.5, 5.5, 1.4)))
    agent.informed = replace(
        agent.firsthand, localizer=position_localizer(bump(0.5, 5.5, sigma)), ancestors={"r1": 0.0, "r2": 0.0}
    )
    reports, _ = agent.tick(still(1, Sighting(subject="object/ball", range=2.0, bearing=0.3)), {})
    first = agent.firsthand.objects["object/ball"].p
    informed = agent.informed.objects["object/ball"].p
    ball = by_subject(reports)["object/ball"]
    gained = entropy(first) - entropy(informed)
    assert (ball.informed is not None) == (gained > 0.5)
    assert by_subject(reports)["robot/r1"].informed is not None  # about itself always
    assert unpack(ball.belief).p == pytest.approx(unpack(pack(Belief(FINE, first))).p)
    assert 0.6 < gained < 0.7 if sigma == 0.9 else 0.1 < gained < 0.5


@pytest.mark.parametrize(("back", "taken"), [(8, True), (9, False)])
def test_an_agreed_belief_may_come_eight_ticks_late(back: int, taken: bool) -> None:
    agent = new_seeing_agent()
    agent.tick(still(0, fix=FIX), {})
    for tick in range(1, back):
        agent.tick(still(tick), {})
    agent.tick(still(back), agreed(0, bump(1.2, 5.5, 0.3)))
    assert (agent.informed is not agent.firsthand) == taken


def test_an_agreed_belief_without_ancestors_is_nobodys() -> None:
    agent = new_seeing_agent()
    agent.tick(still(0, fix=FIX), {})
    reports, _ = agent.tick(still(1), agreed(0, uniform(FINE), ancestors=()))
    assert all(report.informed is None for report in reports)


@pytest.mark.parametrize("rounds", [1, 3])
def test_a_team_that_agrees_with_what_was_reported_changes_nothing(rounds: int) -> None:
    """To the bit: what came back is compared with what was sent, not with what it was coded from."""
    agent = new_seeing_agent()
    reports, _ = agent.tick(still(0, fix=FIX), {})
    for tick in range(1, rounds + 1):
        own = by_subject(reports)["robot/r1"]
        sent = own.informed.belief if own.informed else own.belief
        reports, _ = agent.tick(still(tick), agreed(tick - 1, unpack(sent)))
        assert agent.informed.ancestors.keys() == {"r1", "r2"}
        assert agent.informed.localizer.marginal().p == pytest.approx(agent.firsthand.localizer.marginal().p, abs=1e-12)


def test_a_second_agreed_belief_of_the_same_tick_is_compared_with_the_first_report_too() -> None:
    """What was told did not change when the first answer came, so the second adds its own news to it."""
    agent = new_seeing_agent()
    (report,), _ = agent.tick(still(0, fix=FIX), {})
    agent.tick(still(1), agreed(0, bump(0.8, 5.5, 0.4)))
    after = agent.informed.localizer.marginal().p
    agent.tick(still(2), agreed(0, unpack(report.belief)))
    assert agent.informed.localizer.predict(STILL, 0.0).marginal().mean() == pytest.approx(
        Belief(FINE, after).mean(), abs=1e-6
    )


def test_what_it_cannot_name_is_reported_beside_its_own_place_with_the_class_and_its_number() -> None:
    strange = [Sighting(subject=kind, range=4.0, bearing=0.0, confidence=0.8) for kind in ("person/?", "object/can?")]
    older = Sighting(subject="person/?", range=6.0, bearing=0.5, age=0.2)
    reports, _ = new_agent().tick(readings(0, BALL, older, *strange, fix=(10, 10)), {})
    own = by_subject(reports)["robot/r1"]
    assert [(unnamed.kind, unnamed.mark, unnamed.confidence) for unnamed in own.unnamed] == [
        ("person/?", 1, 0.8),
        ("object/can?", 2, 0.8),
    ]
    assert all(unpack(unnamed.belief).mean() == pytest.approx((14, 10), abs=0.5) for unnamed in own.unnamed)
    assert not any(report.unnamed for report in reports if report is not own)


def test_who_does_not_know_where_it_is_does_not_know_where_anything_is_that_it_sees() -> None:
    reports, _ = new_agent().tick(readings(0, Sighting(subject="person/?", range=4.0, bearing=0.0)), {})
    assert not by_subject(reports)["robot/r1"].unnamed
