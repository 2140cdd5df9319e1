"""A robot of a team whose messages are counted: one datagram in each slot, and nothing that was seen or gained is lost."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import UserError
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.relation import measured
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.gaussians import pack_evidence
from blackboard.wire.messages import Report, Status
from robot_agent.config import RobotSection, SendSection
from robot_agent.service import AgentService
from robot_agent.slots import DATAGRAM, Slots
from tests.robot_agent.services import GRID, NOW, readings
from tests.scenarios import SCENARIO
from tests.wire.envelopes import token

TICK = 0.2
RATED = SCENARIO.changed("time", seconds=6.0).changed("board", fusion="joint").changed("robot", send={"rate": 8.0})


def evidence(time: float, turn: float, values: tuple[float, ...], kind: str, epoch: int = 0) -> PackedEvidence:
    """What a robot says that turned so far, and sees a ball now."""
    spread = {"range": [0.01], "bearing": [0.001], "position": [0.01, 0.0, 0.02], "pose": [0.01, 0, 0, 0.02, 0, 0.001]}
    sighting = measured(kind, "robot/r1", "object/ball", values, spread[kind])  # type: ignore[arg-type]
    motion = Motion(turn=turn, dt=time, moving=time)
    return pack_evidence(Evidence("robot/r1", epoch, 0, motion, Nuisance(), relatives=(sighting,)))


@given(
    kind=st.sampled_from(["range", "bearing", "position", "pose"]),
    bearing=st.floats(-math.pi, math.pi),
    rate=st.floats(-1.0, 1.0),
)
def test_the_mean_of_what_was_seen_on_an_even_way_is_what_is_seen_at_its_mean_time(
    kind: str, bearing: float, rate: float
) -> None:
    """A ball far away that goes past evenly, seen by a robot that turns: in the middle tick it is where the mean has it."""
    slots, middle = Slots(2.0), 20.0 * np.array([math.cos(bearing), math.sin(bearing)])
    expected: tuple[float, ...] = ()
    for tick in range(3):
        turned, heading = rate * TICK * tick, 0.3 * (tick - 1)
        x, y = middle + (tick - 1) * np.array([0.1, -0.05])
        apart = math.hypot(x, y)
        angle = math.remainder(math.atan2(y, x) - turned, math.tau)
        position = apart * math.cos(angle), apart * math.sin(angle)
        values = {"range": (apart,), "bearing": (angle,), "position": position}
        its = values.get(kind, (*position, math.remainder(heading - turned, math.tau)))
        expected = its if tick == 1 else expected
        packed = evidence(TICK * tick, turned, its, kind)
        if tick < 2:
            slots.wait(TICK * tick, packed)
    (sighting,) = slots.with_means(2 * TICK, packed).seen
    assert sighting.age == pytest.approx(TICK, abs=1e-6)
    off = np.subtract(sighting.values, expected)
    if kind in ("bearing", "pose"):
        off[-1] = math.remainder(off[-1], math.tau)
    assert off == pytest.approx(np.zeros(len(expected)), abs=2e-3)
    trace = (
        [sighting.covariance[0]] if len(expected) == 1 else [sighting.covariance[0], sighting.covariance[len(expected)]]
    )
    alone = [packed.seen[0].covariance[0]] if len(expected) == 1 else [0.01, 0.02]
    assert sum(trace) == pytest.approx(sum(alone) / 3, rel=1e-4)


def test_what_was_seen_before_a_filter_began_anew_is_not_told() -> None:
    slots = Slots(2.0)
    slots.wait(0.0, evidence(0.0, 0.0, (1.0, 0.0), "position"))
    packed = slots.with_means(TICK, evidence(TICK, 0.0, (3.0, 0.0), "position", epoch=7))
    assert packed.seen[0].values == pytest.approx((3.0, 0.0))
    slots.wait(TICK, None)
    assert slots.with_means(TICK, evidence(TICK, 0.0, (3.0, 0.0), "position")).seen[0].values == pytest.approx(
        (3.0, 0.0)
    )


def test_several_sightings_of_one_moment_are_different_things_and_have_no_mean() -> None:
    slots, first, other = (
        Slots(2.0),
        evidence(0.0, 0.0, (1.0, 0.0), "position"),
        evidence(0.0, 0.0, (5.0, 0.0), "position"),
    )
    both = first.model_copy(update={"seen": [*first.seen, *other.seen]})
    slots.wait(0.0, first)
    packed = slots.with_means(
        TICK, both.model_copy(update={"travelled": evidence(TICK, 0.0, (0, 0), "position").travelled})
    )
    assert [sighting.values for sighting in packed.seen] == [(1.0, 0.0), (5.0, 0.0)]


def test_of_a_class_the_newest_is_told_because_the_one_before_may_be_another_thing() -> None:
    def unnamed(named: PackedEvidence) -> PackedEvidence:
        return named.model_copy(update={"seen": [named.seen[0].model_copy(update={"subject": "robot/?"})]})

    slots = Slots(2.0)
    slots.wait(0.0, unnamed(evidence(0.0, 0.0, (1.0, 0.0), "position")))
    packed = slots.with_means(TICK, unnamed(evidence(TICK, 0.0, (5.0, 0.0), "position")))
    assert [(sighting.values, sighting.age) for sighting in packed.seen] == [((5.0, 0.0), 0.0)]


def test_a_sighting_is_told_once() -> None:
    slots = Slots(2.0)
    slots.wait(0.0, evidence(0.0, 0.0, (1.0, 0.0), "position"))
    slots.said(TICK)
    assert slots.with_means(2 * TICK, evidence(2 * TICK, 0.0, (3.0, 0.0), "position")).seen[0].values[
        0
    ] == pytest.approx(3.0)


# --- a team ----------------------------------------------------------------------------------------------------------------


def test_a_team_says_no_more_than_its_rate_in_datagrams_and_knows_where_all_are() -> None:
    team = InProcessTeam(RATED)
    sizes, agreed = list[int](), set[tuple[str, str]]()

    def spy(envelope: Envelope) -> None:
        if envelope.kind is Kind.PUT and keys.REPORT.match(envelope.key):
            sizes.append(len(envelope.key) + len(envelope.payload))
        elif envelope.kind is Kind.PUT and (parts := keys.AGREED.match(envelope.key)):
            agreed.add((parts["sub_team"], parts["subject"]))

    team.bus.spies.append(spy)
    team.run()
    assert team.world.why == ""
    robots = RATED.team.robots
    assert len(robots) <= len(sizes) <= 8.0 * RATED.time.seconds + len(robots)
    assert max(sizes) <= DATAGRAM
    assert {(sub_team, f"robot/{name}") for sub_team in RATED.team.sub_teams for name in robots} <= agreed


def test_where_boards_pool_opinions_all_subjects_have_their_turn() -> None:
    team, subjects = InProcessTeam(RATED.changed("board", fusion="opinions").changed("time", seconds=8.0)), list[str]()
    team.bus.spies.append(
        lambda envelope: subjects.extend(
            parts["subject"] for parts in [keys.REPORT.match(envelope.key)] if parts and parts["source"] == "r1"
        )
    )
    team.run()
    assert {"robot/r1", "object/ball"} <= set(subjects)


def test_without_a_world_statuses_count_too() -> None:
    """20 s at 10 Hz on the robot's own clock: reports and statuses together are within its share of the rate."""
    send = SendSection(rate=10.0)
    robot = AgentService(
        team="t",
        sub_teams=("a",),
        robot="r1",
        grid=GRID,
        settings=RobotSection(send=send),
        joint=True,
        robots=5,
    )
    out = robot.receive(token(keys.BOARD, "board-a"), NOW)
    for tick in range(200):
        now = NOW + 0.1 * tick
        out += robot.receive(readings(tick, time=now), now)
        out += robot.wake(now + 0.05)
    messages = [open_envelope(envelope)[2] for envelope in out]
    statuses = [message for message in messages if isinstance(message, Status)]
    reports = [message for message in messages if isinstance(message, Report)]
    assert len(statuses) + len(reports) == len(messages) <= 20 * 10.0 / 5 + 2
    assert len(reports) >= 20 * (10.0 / 5 - 0.1) - 1
    assert 2 <= len(statuses) <= 3
    assert robot.wake_at(now) > now


def test_a_rate_must_leave_each_robot_as_many_words_as_it_is_to_say() -> None:
    least = 5 * (1 / 4.0 + 0.1)
    assert SendSection(rate=least).pace(5) == pytest.approx(0.25)
    with pytest.raises(UserError, match="give at least 1.75"):
        SendSection(rate=0.9 * least).pace(5)
