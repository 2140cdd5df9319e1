"""A robot whose program gives its readings by calls: what a step makes of them, alone, with a board, and in a world's ticks."""

import logging.handlers
import math
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, drive, entering
from blackboard.opinion.grid import Grid
from blackboard.process.reactions import Cue
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Odometry, Report, Sighting, Status
from blackboard.wire.types import Message
from robot_agent.config import OdometrySection
from robot_agent.driven import PIECES, UNKNOWN_WHEELS, Driven, Pose, SinceStep, driven, sensors_in
from robot_agent.extrapolated import Extrapolated
from robot_agent.gaussian.sensors import Wheels, wheels_of
from tests.present import present
from tests.robot_agent.services import NOW, clock, kinds
from tests.wire.envelopes import opened, world

GRID = Grid((20, 20), 0.5, unit="m")
START = SinceStep(fix=Fix(position=(5.0, 5.0), sigma=0.1, heading=0.0, heading_sigma=0.05))
AHEAD = SinceStep(Odometry(distance=0.1, turn=0.0, dt=0.1))


def new_robot(joint: bool = True, heard: list[Cue | Message] | None = None, scenario: Scenario | None = None) -> Driven:
    news = (lambda event, now: None) if heard is None else (lambda event, now: heard.append(event))
    return driven(news, scenario, team="t", sub_teams=("a",), robot="r1", grid=GRID, joint=joint)


def pose_after(*steps: SinceStep, every: float = 0.1, robot: Driven | None = None) -> Pose:
    """Where a robot is after a start and some steps, each so many seconds after the one before."""
    robot = robot or new_robot()
    robot.step(START, NOW)
    for number, step in enumerate(steps, 1):
        pose, _ = robot.step(step, NOW + every * number)
        robot.check()
    return present(pose)


def test_nobody_knows_where_it_is_before_it_was_told() -> None:
    robot = new_robot()
    pose, _ = robot.step(None, NOW)
    assert pose is None
    pose, _ = robot.step(SinceStep(compass=(0.5, 0.05)), NOW + 0.1)
    assert pose is None  # a heading alone is no place


@pytest.mark.parametrize("joint", [True, False])
def test_a_step_moves_it_and_tells_the_board(joint: bool) -> None:
    robot = new_robot(joint)
    robot.step(START, NOW)
    for number in range(1, 11):
        pose, out = robot.step(AHEAD, NOW + 0.1 * number)
        robot.check()
    assert pose is not None
    assert pose.time == NOW + 1.0
    assert pose.mean == pytest.approx((6.0, 5.0, 0.0), abs=0.15)
    assert pose.covariance.shape == (3, 3)
    reports = [message for message in opened(out) if isinstance(message, Report)]
    assert [report.subject for report in reports] == ["robot/r1"]
    assert (reports[0].evidence is not None) == joint
    assert isinstance(opened(out)[-1], Status)
    assert "Readings" not in kinds(out)


def test_it_hears_no_readings_of_others() -> None:
    assert not [key for key in new_robot().listens if "reading" in key]


def test_ticks_grow_where_the_program_is_started_again() -> None:
    first = new_robot()
    first.step(START, NOW)
    again = new_robot()
    again.step(START, NOW + 1.0)
    assert again.tick > first.tick
    again.step(AHEAD, NOW + 1.0)  # twice in a millisecond
    assert again.tick > int(1000 * (NOW + 1.0))


def test_what_several_calls_told_adds_up() -> None:
    first = SinceStep(Odometry(distance=0.1, turn=0.2, dt=0.1, distance_sigma=0.03, turn_sigma=0.0))
    second = SinceStep(Odometry(distance=0.2, turn=-0.1, dt=0.1, distance_sigma=0.04), compass=(1.0, None))
    both = first.plus(second).plus(
        SinceStep(compass=(2.0, 0.1), sightings=(Sighting(subject="object/x", range=1, bearing=0),))
    )
    assert both.odometry is not None
    assert both.odometry.distance == pytest.approx(0.3, abs=2e-3)  # along the chord
    assert both.odometry.turn == pytest.approx(0.1)
    assert both.odometry.distance_sigma == pytest.approx(0.05)
    assert both.odometry.turn_sigma is None  # of one piece nobody said it
    assert both.compass == (2.0, 0.1)
    assert len(both.sightings) == 1
    many = SinceStep()
    for _ in range(300):
        many = many.plus(both)
    assert len(many.sightings) == 256


@given(
    pieces=st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-1, 1)), min_size=2, max_size=6),
    scales=st.tuples(st.floats(0.5, 2), st.floats(0.5, 2)),
)
def test_what_wheels_make_of_a_step_is_what_they_make_of_its_pieces(
    pieces: list[tuple[float, float]], scales: tuple[float, float]
) -> None:
    """A turn on the spot and then a straight way were taken for a curve, on which wheels may turn 0.6 of what they are told."""
    wheels = replace(Wheels(), curved=scales[0], driven=scales[1])
    told = [Odometry(distance=distance, turn=turn, dt=0.1) for distance, turn in pieces]
    whole = present(reduce(SinceStep.plus, map(SinceStep, told), SinceStep()).odometry)
    motion, apart = wheels.motion(whole, None), reduce(Motion.plus, (wheels.motion(piece, None) for piece in told))
    for name in ("turn", "driven"):
        assert getattr(motion, name) == pytest.approx(getattr(apart, name), abs=1e-9)


@given(pieces=st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-1, 1), st.floats(-0.1, 0.1)), min_size=2, max_size=6))
def test_a_step_leads_to_where_its_pieces_led(pieces: list[tuple[float, float, float]]) -> None:
    """A turn and then a straight way were taken for a curve: at 2 Hz a robot was 2 times as far off as by one filter of all."""
    told = [Odometry(distance=distance, turn=turn, dt=0.1, aside=aside) for distance, turn, aside in pieces]
    whole = present(reduce(SinceStep.plus, map(SinceStep, told), SinceStep()).odometry)
    at = {}
    for name, steps in (("whole", [whole]), ("apart", told)):
        joint = Joint()
        joint.add("robot/r1", entering(Moments(np.array([1.0, 2.0, 0.5]), np.eye(3)), Nuisance()))
        for step in steps:
            drive(joint, "robot/r1", Wheels(nuisance=Nuisance()).motion(step, None), Nuisance())
        at[name] = joint.mean[:3]
    assert at["whole"] == pytest.approx(at["apart"], abs=1e-9)


@pytest.mark.parametrize(("pieces", "wider"), [(1, True), (10, False)])
def test_a_turn_somewhere_in_a_long_step_leaves_unknown_where_it_leads(pieces: int, wider: bool) -> None:
    """Summed by a program over 0.5 s, it was taken for an even curve without any error. Told piece by piece it is known."""

    def across(turn: float) -> float:
        robot = new_robot(scenario=Scenario({"robot": {"odometry": {"along": 0.0, "turn": 0.0}}}))
        sigmas, steps = {"turn_sigma": 0.0, "distance_sigma": 0.01}, []
        for turned in (0.0, 0.0, 0.0, turn):
            piece = Odometry(distance=0.4 / pieces, turn=turned / pieces, dt=0.5 / pieces, **sigmas)
            steps.append(reduce(SinceStep.plus, [SinceStep(piece)] * pieces))
        return float(np.linalg.eigvalsh(pose_after(*steps, every=0.5, robot=robot).covariance[:2, :2])[-1])

    assert (across(0.5) > across(0.0) + 0.03**2) == wider


@pytest.mark.parametrize("speed", [0.1, 0.5, 15.0])
@pytest.mark.parametrize("steps", [1, 20])
def test_a_robot_that_nobody_described_slips_by_a_share_of_its_speed(speed: float, steps: int) -> None:
    """The noise of one second of driving, reported in one step or in many, for the speeds of a toy, an indoor robot and a car."""
    step = Odometry(distance=speed / steps, turn=0.0, dt=1.0 / steps)
    moved = reduce(Motion.plus, [UNKNOWN_WHEELS.motion(step, None) for _ in range(steps)])
    for variance in (moved.along, moved.across):
        assert math.sqrt(variance) == pytest.approx(0.05 * speed, rel=0.1)


def test_a_fix_without_a_heading_leaves_the_heading_of_the_one_before() -> None:
    """A start and GPS in one step: without the heading the robot looked for its pose on the grid."""
    gps = SinceStep(fix=Fix(position=(5.0, 4.1), sigma=0.3))
    assert START.fix is not None
    both = START.plus(gps)
    assert both.fix == Fix(
        position=(5.0, 4.1), sigma=0.3, heading=START.fix.heading, heading_sigma=START.fix.heading_sigma
    )
    robot = new_robot()
    pose, _ = robot.step(both, NOW)
    assert present(pose).covariance[2, 2] == pytest.approx(present(START.fix.heading_sigma) ** 2, rel=0.2)


def test_sigmas_of_the_odometry_count_instead_of_the_model_s() -> None:
    def spread(**sigmas: float) -> float:
        steps = [SinceStep(Odometry(distance=0.1, turn=0.0, dt=0.1, **sigmas))] * 20
        return float(pose_after(*steps).covariance[2, 2])

    assert spread(distance_sigma=0.0, turn_sigma=0.0) < spread() < spread(distance_sigma=0.0, turn_sigma=0.2)


def test_in_a_world_it_does_one_step_a_tick_and_loses_nothing() -> None:
    robot = new_robot()
    robot.receive(world(), NOW)
    assert robot.step(START, NOW)[0] is None  # no Clock yet
    robot.receive(clock(0), NOW)
    robot.step(None, NOW)
    assert robot.tick == 0
    robot.step(AHEAD, NOW)
    robot.step(AHEAD, NOW)
    assert robot.tick == 0
    robot.receive(clock(1), NOW)
    pose, _ = robot.step(AHEAD, NOW)
    assert robot.tick == 1
    assert present(pose).mean[0] == pytest.approx(5.3, abs=0.05)


def test_what_the_scenario_says_of_wheels_counts() -> None:
    scenario = Scenario({"robot": {"odometry": {"along": 0.7}}})
    assert sensors_in(scenario, "r1").wheels.along == 0.7
    assert sensors_in(Scenario({"robot": {"vision": {"kind": "range-bearing"}}}), "r1").camera.bearing == pytest.approx(
        0.02
    )
    assert sensors_in(Scenario({}), "r1").wheels.nuisance.sigmas[0] > 0  # something may be off, and is found out


def test_of_wheels_that_are_described_by_their_noise_alone_something_may_be_off_all_the_same() -> None:
    """Before, their scales and the camera's mounting counted as exact: wheels 30 % off made a team 7 times as far off."""

    def sigmas(**odometry: object) -> tuple[float, ...]:
        return sensors_in(Scenario({"robot": {"odometry": odometry}}), "r1").wheels.nuisance.sigmas

    unknown = sensors_in(Scenario({}), "r1").wheels.nuisance.sigmas
    assert all(0.0 < sigmas(along=0.05)[k] < unknown[k] for k in (0, 1, 3, 5))  # way, turn, bearing, range
    assert sigmas(along=0.05, distance_lasting=0.3)[0] == 0.3
    assert sigmas(along=0.05, measured=True)[3] == wheels_of(OdometrySection(measured=True)).nuisance.sigmas[3]


def test_the_tables_of_one_robot_count_for_a_program_s_own_robot_too() -> None:
    tables = {
        "robot": {"odometry": {"along": 0.7}},
        "robots": {"r2": {"odometry": {"turn": 0.3}, "localizer": "position"}},
    }
    scenario = Scenario(tables)
    assert (sensors_in(scenario, "r1").wheels.along, sensors_in(scenario, "r1").wheels.heading) == (0.7, 0.02)
    assert (sensors_in(scenario, "r2").wheels.along, sensors_in(scenario, "r2").wheels.heading) == (0.7, 0.3)
    only = Scenario({"robots": {"r1": {"odometry": {"along": 0.4}}}})
    assert (sensors_in(only, "r1").wheels.along, new_robot(scenario=only).settings.localizer) == (0.4, "pose")
    assert sensors_in(only, "r2") == sensors_in(Scenario({}), "r2")
    with pytest.raises(UserError, match=r"robots\.r1: give tables"):
        new_robot(scenario=Scenario({"robots": {"r1": 3}}))


def test_wheels_that_are_off_are_found_out() -> None:
    told = Odometry(
        distance=0.1 / 1.05, turn=0.0, dt=0.1, distance_sigma=0.001, turn_sigma=0.001
    )  # its wheels measure 5 % too little
    steps = [SinceStep(told, fix=Fix(position=(5.0 + 0.1 * number, 5.0), sigma=0.02)) for number in range(1, 41)]
    assert math.dist(pose_after(*steps).mean[:2], (9.0, 5.0)) < 0.05


def test_its_program_is_told_what_it_hears() -> None:
    heard: list[Cue | Message] = []
    robot = new_robot(heard=heard)
    robot.receive(world(), NOW)
    robot.receive(clock(0), NOW)
    assert Cue.BEGIN in heard


def said_of(steps: list[SinceStep], every: float = 0.1) -> str:
    """What a robot logs that takes such steps again and again, each so many seconds after the one before."""
    robot, handler = new_robot(), logging.handlers.BufferingHandler(1000)
    robot.step(START, NOW)
    logger = logging.getLogger("robot_agent.driven")
    logger.addHandler(handler)
    for number in range(1, len(steps) * (PIECES + 2)):
        robot.step(steps[number % len(steps)], NOW + every * number)
    logger.removeHandler(handler)
    return "\n".join(record.getMessage() for record in handler.buffer)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        (
            [AHEAD, SinceStep(), SinceStep()],
            "0.33 times the time between its steps: what it drives in the rest is not told",
        ),
        (
            [SinceStep(Odometry(distance=0.1, turn=0.0, dt=100.0))],
            "1e+03 times the time between its steps: give seconds",
        ),
    ],
)
def test_a_robot_whose_odometry_is_not_of_all_of_its_way_is_told_so_once(steps: list[SinceStep], words: str) -> None:
    """Before, it was 5 m off with a region of 1 m, without a word."""
    assert said_of(steps).count(words) == 1


def test_a_robot_that_stands_between_ways_or_falls_behind_a_little_is_told_nothing() -> None:
    stood = SinceStep(Odometry(distance=0.0, turn=0.0, dt=0.1))
    assert not said_of([AHEAD])
    assert not said_of([AHEAD], every=0.12)
    assert not said_of([AHEAD] * 5 + [SinceStep()] * 5)
    assert not said_of([stood, SinceStep(), SinceStep()])


STOOD = SinceStep(Odometry(distance=0.0, turn=0.0, dt=0.1))


def spread_after(*steps: SinceStep) -> float:
    """The sigma (unit) of a place along x after a start and some steps."""
    return math.sqrt(pose_after(*steps).covariance[0, 0])


@pytest.mark.parametrize("silent", [10, 50])
def test_a_robot_whose_odometry_stops_may_have_driven_on(silent: int) -> None:
    """Before, it was taken to stand, as exact as ever."""
    spread = spread_after(*[AHEAD] * 20, *[SinceStep()] * silent)
    assert 0.8 <= spread / (silent * 0.1) <= 1.3


def test_it_is_the_same_where_odometry_comes_back_and_where_nothing_was_told_meanwhile() -> None:
    robot = new_robot()
    robot.step(START, NOW)
    for number in range(1, 11):
        robot.step(AHEAD, NOW + 0.1 * number)
    pose, _ = robot.step(AHEAD, NOW + 2.1)
    mute = math.sqrt(present(pose).covariance[0, 0])
    assert spread_after(*[AHEAD] * 10, *[SinceStep()] * 10, AHEAD) == pytest.approx(mute, rel=0.2)


def test_a_robot_that_says_that_it_stands_stays_where_it_is() -> None:
    sharp = spread_after(*[AHEAD] * 5)
    assert spread_after(*[AHEAD] * 5, *[STOOD] * 200) <= sharp + 0.02
    assert spread_after(*[AHEAD] * 5, STOOD, *[SinceStep()] * 200) <= sharp + 0.02
    assert spread_after(*[SinceStep()] * 200) <= 0.11  # and one that never told of a motion


def test_odometry_that_comes_less_often_than_steps_tells_all_of_the_way() -> None:
    piece = SinceStep(Odometry(distance=0.3, turn=0.0, dt=0.3))
    steps = [SinceStep(), SinceStep(), piece] * 10
    assert spread_after(*steps) <= 1.1 * spread_after(*[AHEAD] * 30)


def test_a_robot_whose_odometry_comes_every_fifth_step_is_where_it_is_in_each() -> None:
    """It was taken to stand meanwhile, and then drove once more what its fixes had told: 95 % regions held .69."""
    random, robot, squared = np.random.default_rng(1), new_robot(), []
    robot.step(START, NOW)
    for number in range(1, 101):
        x = 5.0 + 0.1 * number
        odometry = Odometry(distance=0.5, turn=0.0, dt=0.5) if number % 5 == 0 else None
        fix = Fix(position=(x + 0.2 * random.normal(), 5.0 + 0.2 * random.normal()), sigma=0.2)
        pose, _ = robot.step(SinceStep(odometry, fix=fix), NOW + 0.1 * number)
        off = present(pose).mean[:2] - (x, 5.0)
        if number > 20:
            squared.append(off @ np.linalg.solve(present(pose).covariance[:2, :2], off))
    assert np.mean(np.array(squared) < 5.99) >= 0.9


@given(
    speeds=st.lists(st.tuples(st.floats(0.1, 2.0), st.floats(-1, 1)), min_size=30, max_size=30),
    comes=st.lists(st.booleans(), min_size=30, max_size=30),
)
def test_what_was_extrapolated_and_what_came_late_lead_to_where_the_odometry_leads(
    speeds: list[tuple[float, float]], comes: list[bool]
) -> None:
    extrapolated, told, given, pieces = Extrapolated(), SinceStep(), SinceStep(), SinceStep()
    for number, ((speed, rate), is_told) in enumerate(zip(speeds, [*comes[:-1], True], strict=True), 1):
        pieces = pieces.plus(SinceStep(Odometry(distance=0.1 * speed, turn=0.1 * rate, dt=0.1)))
        extrapolated = extrapolated.after(pieces.odometry if is_told else None, 0.1 * number)
        given = given.plus(SinceStep(extrapolated.odometry))
        told, pieces = (told.plus(pieces), SinceStep()) if is_told else (told, pieces)
    for name in ("distance", "turn", "aside", "dt"):
        assert getattr(present(given.odometry), name) == pytest.approx(getattr(present(told.odometry), name), abs=1e-6)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.0, 1e-9, 0.1, 0.5, 3.0, -0.5, 1e4, -1e4]),
            st.none() | st.tuples(st.sampled_from([0.1, -0.1, 1e-12, 1e12]), st.sampled_from([0.0, 3.0, -1e12])),
            st.sampled_from([1e-6, 0.1, 0.5, 1e12]),
        ),
        max_size=30,
    )
)
def test_whatever_the_times_and_pieces_what_is_extrapolated_is_odometry(
    steps: list[tuple[float, tuple[float, float] | None, float]],
) -> None:
    """A step whose time stood still ended the robot: a piece of no time has no speed."""
    extrapolated, time = Extrapolated(), 0.0
    for seconds, told, dt in steps:
        time += seconds
        extrapolated = extrapolated.after(
            None if told is None else Odometry(distance=told[0], turn=told[1], dt=dt), time
        )
        if extrapolated.odometry is not None:
            assert Odometry.model_validate(extrapolated.odometry.model_dump()) == extrapolated.odometry


@pytest.mark.parametrize("joint", [True, False])
def test_landmarks_without_names_are_warned_of_once_where_there_is_no_map(
    joint: bool, caplog: pytest.LogCaptureFixture
) -> None:
    robot = new_robot(joint)
    robot.step(START, NOW)
    for number in range(3):
        robot.step(
            replace(AHEAD, sightings=(Sighting(subject="landmark/?", range=1.0, bearing=0.0),)),
            NOW + 0.1 * (number + 1),
        )
    (line,) = caplog.messages
    assert line.startswith("r1: see('landmark/?') tells nothing: the scenario has no map; give [robot] landmarks")


@pytest.mark.parametrize("joint", [True, False])
def test_a_sighting_older_than_the_motions_that_are_kept_is_warned_of_once(
    joint: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A robot that drove for 6 s put what it saw 100 s ago 100 m behind itself, without a word."""
    robot = new_robot(joint)
    robot.step(START, NOW)
    for number, age in enumerate((0.1, 1.05, 100.0, 101.0)):
        sighting = Sighting(subject="object/ball", range=1.0, bearing=0.0, age=age)
        robot.step(replace(AHEAD, sightings=(sighting,)), NOW + 0.1 * (number + 1))
    assert caplog.messages == [
        "r1: see(age=100): its way is kept for 1.1 s, and where it was before is guessed; "
        "tell sightings sooner, and their age in seconds"
    ]


def test_a_slow_step_covers_older_sightings(caplog: pytest.LogCaptureFixture) -> None:
    robot = new_robot()
    robot.step(START, NOW)
    seen = Seen(subject="object/ball", kind="range", values=(1.0,), covariance=(0.01,), age=2.9)
    robot.step(SinceStep(Odometry(distance=0.2, turn=0.0, dt=2.0), seen=(seen,)), NOW + 2.0)
    assert not caplog.messages


def test_what_was_extrapolated_of_odometry_that_is_lost_is_not_taken_back() -> None:
    extrapolated, odometry = Extrapolated(), AHEAD.odometry
    for number in range(1, 11):
        extrapolated = extrapolated.after(odometry, 0.1 * number)
    extrapolated = extrapolated.after(None, 1.1).after(None, 1.2)
    assert extrapolated.odometry is None  # it is silent by now
    assert extrapolated.after(odometry, 3.0).odometry == odometry


def test_a_robot_whose_odometry_stops_is_told_so_once() -> None:
    assert said_of([AHEAD] * 20 + [SinceStep()] * 20).count("no odometry for 1.1 s, and it moved before") == 1


def test_without_odometry_a_fix_still_tells_where_it_is() -> None:
    here = SinceStep(fix=Fix(position=(8.0, 5.0), sigma=0.3))
    pose = pose_after(*[AHEAD] * 20, *[SinceStep()] * 30, here)
    assert pose.mean[:2] == pytest.approx((8.0, 5.0), abs=0.2)
    assert math.sqrt(pose.covariance[0, 0]) <= 0.31


def test_a_robot_whose_own_filter_falls_silent_may_have_driven_on() -> None:
    robot = new_robot()
    for number in range(20):
        posterior = Moments(np.array([5.0 + 0.1 * number, 5.0, 0.0]), np.diag([0.01, 0.01, 0.001]))
        robot.step(replace(AHEAD, posterior=posterior), NOW + 0.1 * number)
    for number in range(20, 40):
        pose, _ = robot.step(SinceStep(), NOW + 0.1 * number)
    assert 1.6 <= math.sqrt(present(pose).covariance[0, 0]) <= 2.6
