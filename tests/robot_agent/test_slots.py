"""A robot of a team whose messages are counted: one datagram in each slot, and nothing that was seen or gained is lost."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import UserError
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.relation import measured
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, moved_in, turned_by
from blackboard.opinion.grid import Array
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.gaussians import pack_evidence, unpack_motion
from blackboard.wire.messages import Report, Status
from robot_agent.config import RobotSection, SendSection
from robot_agent.service import AgentService
from robot_agent.slots import DATAGRAM, Slots
from robot_agent.told_way import RIGHT, ToldWay
from tests.robot_agent.services import GRID, NOW, readings
from tests.scenarios import SCENARIO
from tests.wire.envelopes import token

TICK = 0.2
RATED = SCENARIO.changed("time", seconds=6.0).changed("board", fusion="joint").changed("robot", send={"rate": 8.0})


def evidence(time: float, values: tuple[float, ...], epoch: int = 0) -> PackedEvidence:
    """What a robot says that stood until now, and sees where a ball is."""
    return evidence_of(Motion(dt=time), "position", values, epoch)


def evidence_of(
    motion: Motion, kind: str = "position", values: tuple[float, ...] = (), epoch: int = 0
) -> PackedEvidence:
    """What a robot says that came so far, and sees a ball, if there are values."""
    spread = {"range": [0.01], "bearing": [0.001], "position": [0.01, 0.0, 0.02], "pose": [0.01, 0, 0, 0.02, 0, 0.001]}
    seen = (measured(kind, "robot/r1", "object/ball", values, spread[kind]),) if values else ()  # type: ignore[arg-type]
    return pack_evidence(Evidence("robot/r1", epoch, 0, motion, Nuisance(), relatives=seen))


KINDS = ["range", "bearing", "position", "pose"]
STEPS = st.lists(st.tuples(st.floats(0.0, 0.3), st.floats(-0.5, 0.5)), min_size=2, max_size=8)
SUM = Motion.plus


class Sender:
    """A robot that says what it sees in the slots in which it is told to."""

    def __init__(self) -> None:
        self.slots, self.way = Slots(2.0), ToldWay()

    def waits(self, time: float, packed: PackedEvidence) -> None:
        self.way.on_tick(packed)
        self.slots.wait(time, packed)

    def says(self, time: float, packed: PackedEvidence) -> PackedEvidence:
        self.way.on_tick(packed)
        means = self.slots.with_means(time, packed, self.way)
        said = means.model_copy(update={"travelled": self.way.told(packed)})
        self.slots.said(time)
        self.way.said()
        return said


def pose_after(steps: Sequence[Motion]) -> tuple[Array, float]:
    """Where a robot is that began at the origin, driving each step along the chord of its turn."""
    place, heading = np.zeros(2), 0.0
    for step in steps:
        place = place + turned_by((step.distance, step.aside), heading + step.turn / 2)
        heading += step.turn
    return place, heading


def seen_by(kind: str, point: Array, heading: float, place: Array, headed: float) -> tuple[float, ...]:
    """What a robot at a place sees of a thing at a point."""
    x, y = turned_by(point - place, -headed)
    angle = math.atan2(y, x)
    values = {"range": (math.hypot(x, y),), "bearing": (angle,), "position": (x, y)}
    return values.get(kind, (x, y, math.remainder(heading - headed, math.tau)))


@given(driven=STEPS, before=STEPS)
def test_the_way_that_is_told_leads_where_the_robot_came_whatever_its_shape(
    driven: list[tuple[float, float]], before: list[tuple[float, float]]
) -> None:
    """It says something after `before` and again after `driven`: a board takes what was added for one chord."""
    sender, steps = Sender(), [Motion(*step, TICK) for step in [*before, *driven]]
    said = list[Motion]()
    for number in range(1, len(steps) + 1):
        packed = evidence_of(reduce(SUM, steps[:number]))
        if number in (1, len(before), len(steps)):
            said.append(unpack_motion(sender.says(number * TICK, packed).travelled))
        else:
            sender.waits(number * TICK, packed)
    place, heading = pose_after(steps)
    told = [said[0], *(later.since(one) for one, later in itertools.pairwise(said))]
    there, headed = pose_after(told)
    assert there == pytest.approx(place, abs=1e-9)
    assert headed == pytest.approx(heading, abs=1e-9)
    assert said[-1].dt == pytest.approx(len(steps) * TICK)


@given(kind=st.sampled_from(KINDS), bearing=st.floats(-math.pi, math.pi), driven=STEPS)
def test_what_stands_is_told_as_seen_from_the_way_that_boards_know(
    kind: str, bearing: float, driven: list[tuple[float, float]]
) -> None:
    """A post far away, seen in each tick by a robot that drives as it likes: so it is seen from the even way at the mean time.

    A range or a bearing alone cannot be told from another place: it is off by as much as the robot stood aside.
    """
    sender, post, steps = Sender(), 40.0 * np.array([math.cos(bearing), math.sin(bearing)]), [Motion(dt=TICK)]
    sender.says(TICK, evidence_of(steps[0]))
    for number, step in enumerate(driven, start=2):
        steps.append(Motion(*step, TICK))
        packed = evidence_of(reduce(SUM, steps), kind, seen_by(kind, post, 0.3, *pose_after(steps)))
        if number <= len(driven):
            sender.waits(number * TICK, packed)
    said = sender.says((len(driven) + 1) * TICK, packed)
    (sighting,) = said.seen
    assert sighting.age == pytest.approx(TICK * (len(driven) - 1) / 2, abs=1e-6)
    chord = unpack_motion(said.travelled)
    even = chord.since(Motion(dt=TICK))
    came, turned = moved_in(RIGHT, replace(even, before=(Motion(dt=TICK),)), sighting.age)
    place, heading = pose_after([even])
    stood = place - turned_by(came, heading)
    off = np.subtract(sighting.values, seen_by(kind, post, 0.3, stood, heading - turned))
    if kind in ("bearing", "pose"):
        off[-1] = math.remainder(off[-1], math.tau)
    mean = np.mean([pose_after(steps[: number + 1])[0] for number in range(1, len(steps))], axis=0)
    aside = float(np.linalg.norm(mean - stood)) * {"range": 1.0, "bearing": 1 / 30}.get(kind, 0.0)
    assert off == pytest.approx(np.zeros(len(off)), abs=aside + 1e-4 + (2e-3 if len(off) == 1 else 0.0))
    trace = [sighting.covariance[0]] if len(off) == 1 else [sighting.covariance[0], sighting.covariance[len(off)]]
    alone = [packed.seen[0].covariance[0]] if len(off) == 1 else [0.01, 0.02]
    assert sum(trace) == pytest.approx(sum(alone) / len(driven), rel=1e-4)


def test_what_was_seen_before_a_filter_began_anew_is_not_told() -> None:
    sender = Sender()
    sender.waits(0.0, evidence(0.0, (1.0, 0.0)))
    assert sender.says(TICK, evidence(TICK, (3.0, 0.0), epoch=7)).seen[0].values == pytest.approx((3.0, 0.0))
    sender.slots.wait(TICK, None)
    assert sender.says(2 * TICK, evidence(2 * TICK, (3.0, 0.0))).seen[0].values == pytest.approx((3.0, 0.0))


def test_several_sightings_of_one_moment_are_different_things_and_have_no_mean() -> None:
    sender, first, other = Sender(), evidence(0.0, (1.0, 0.0)), evidence(0.0, (5.0, 0.0))
    both = first.model_copy(update={"seen": [*first.seen, *other.seen]})
    sender.waits(0.0, first)
    said = sender.says(TICK, both.model_copy(update={"travelled": evidence(TICK, (0, 0)).travelled}))
    assert [sighting.values for sighting in said.seen] == [(1.0, 0.0), (5.0, 0.0)]


def test_of_a_class_the_newest_is_told_because_the_one_before_may_be_another_thing() -> None:
    def unnamed(named: PackedEvidence) -> PackedEvidence:
        return named.model_copy(update={"seen": [named.seen[0].model_copy(update={"subject": "robot/?"})]})

    sender = Sender()
    sender.waits(0.0, unnamed(evidence(0.0, (1.0, 0.0))))
    said = sender.says(TICK, unnamed(evidence(TICK, (5.0, 0.0))))
    assert [(sighting.values, sighting.age) for sighting in said.seen] == [((5.0, 0.0), 0.0)]


def test_a_sighting_is_told_once() -> None:
    sender = Sender()
    sender.says(0.0, evidence(0.0, (1.0, 0.0)))
    assert sender.says(2 * TICK, evidence(2 * TICK, (3.0, 0.0))).seen[0].values[0] == pytest.approx(3.0)


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
        team="t", sub_teams=("a",), robot="r1", grid=GRID, settings=RobotSection(send=send), joint=True, robots=5
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
