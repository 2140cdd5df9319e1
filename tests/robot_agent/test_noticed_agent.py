"""What an agent takes from its team and reports to it, against exact expectations and limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Report, Sighting
from robot_agent.agent import Agent, Agreed
from robot_agent.config import RobotSection
from tests.robot_agent.test_noticed_estimator import MATE, bump, readings
from tests.robot_agent.test_noticed_position import CAMERA, GRID, STILL, localizer


def agreed(
    tick: int, belief: Belief, subject: str = "robot/r1", ancestors: tuple[str, ...] = ("r1", "r2")
) -> dict[str, Agreed]:
    consensus = Consensus(
        board="a", sub_team="a", level="agreed", subject=subject, tick=tick, time=0.5 * tick, belief=pack(belief),
        ancestors=dict.fromkeys(ancestors, 0.5 * tick), used=[], entropy=1.0, conflict=False, rule="coalition",
    )  # fmt: skip
    return {subject: Agreed.unpacked(consensus, GRID)}


def agent(**vision: object) -> Agent:
    return Agent("r1", RobotSection.model_validate({"vision": {**CAMERA, **vision}}), GRID)


def by_subject(reports: list[Report]) -> dict[str, Report]:
    return {report.subject: report for report in reports}


@pytest.mark.parametrize("mates", [True, False])
def test_a_mate_is_a_landmark_only_where_the_settings_say_so(mates: bool) -> None:
    informed = {}
    for told in (True, False):
        it = agent(mates=mates)
        it.tick(readings(0, fix=(0.5, 5.5)), {})
        team = agreed(0, bump(0.5, 5.5, 0.5))
        if told:
            team |= agreed(0, bump(4.5, 6.0, 0.2), "robot/r2")
        it.tick(readings(1, MATE), team)
        informed[told] = it.informed.localizer.marginal().p
    assert (np.abs(informed[True] - informed[False]).max() > 1e-4) == mates


@pytest.mark.parametrize("sigma", [0.9, 1.3])
def test_an_informed_belief_about_another_is_told_only_where_it_is_half_a_nat_sharper(sigma: float) -> None:
    """What the team told of the robot's own place sharpens where it sees a ball, by the more the surer the team is."""
    it = agent()
    it.tick(readings(0, fix=(0.5, 5.5)), {})
    it.firsthand = replace(it.firsthand, localizer=localizer(bump(0.5, 5.5, 1.4)))
    it.informed = replace(it.firsthand, localizer=localizer(bump(0.5, 5.5, sigma)), ancestors={"r1": 0.0, "r2": 0.0})
    reports, _ = it.tick(readings(1, Sighting(subject="object/ball", range=2.0, bearing=0.3)), {})
    first = it.firsthand.objects["object/ball"].p
    informed = it.informed.objects["object/ball"].p
    ball = by_subject(reports)["object/ball"]
    gained = entropy(first) - entropy(informed)
    assert (ball.informed is not None) == (gained > 0.5)
    assert by_subject(reports)["robot/r1"].informed is not None  # about itself always
    assert unpack(ball.belief).p == pytest.approx(unpack(pack(Belief(GRID, first))).p)
    assert 0.6 < gained < 0.7 if sigma == 0.9 else 0.1 < gained < 0.5


@pytest.mark.parametrize(("back", "taken"), [(8, True), (9, False)])
def test_an_agreed_belief_may_come_eight_ticks_late(back: int, taken: bool) -> None:
    it = agent()
    it.tick(readings(0, fix=(0.5, 5.5)), {})
    for tick in range(1, back):
        it.tick(readings(tick), {})
    it.tick(readings(back), agreed(0, bump(1.2, 5.5, 0.3)))
    assert (it.informed is not it.firsthand) == taken


def test_an_agreed_belief_without_ancestors_is_nobodys() -> None:
    it = agent()
    it.tick(readings(0, fix=(0.5, 5.5)), {})
    reports, _ = it.tick(readings(1), agreed(0, uniform(GRID), ancestors=()))
    assert all(report.informed is None for report in reports)


@pytest.mark.parametrize("rounds", [1, 3])
def test_a_team_that_agrees_with_what_was_reported_changes_nothing(rounds: int) -> None:
    """To the bit: what came back is compared with what was sent, not with what it was coded from."""
    it = agent()
    reports, _ = it.tick(readings(0, fix=(0.5, 5.5)), {})
    for tick in range(1, rounds + 1):
        own = by_subject(reports)["robot/r1"]
        sent = own.informed.belief if own.informed else own.belief
        reports, _ = it.tick(readings(tick), agreed(tick - 1, unpack(sent)))
        assert it.informed.ancestors.keys() == {"r1", "r2"}
        assert it.informed.localizer.marginal().p == pytest.approx(it.firsthand.localizer.marginal().p, abs=1e-12)


def test_a_second_agreed_belief_of_the_same_tick_is_compared_with_the_first_report_too() -> None:
    """What was told did not change when the first answer came, so the second adds its own news to it."""
    it = agent()
    (report,), _ = it.tick(readings(0, fix=(0.5, 5.5)), {})
    it.tick(readings(1), agreed(0, bump(0.8, 5.5, 0.4)))
    after = it.informed.localizer.marginal().p
    it.tick(readings(2), agreed(0, unpack(report.belief)))
    assert it.informed.localizer.predict(STILL, 0.0).marginal().mean() == pytest.approx(
        Belief(GRID, after).mean(), abs=1e-6
    )
