"""The noise of wheels and camera, estimated on line: larger or smaller than the model says, and no lie breaks it."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.vehicle import FORWARD, HEADING, STATES, TURN, Motion, Nuisance, drive
from blackboard.wire.messages import Sighting
from robot_agent.config import RobotSection
from robot_agent.gaussian.factors import NoiseFactor, NoiseFactors
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.noise import SPANS, CameraNoise, WheelNoise
from robot_agent.gaussian.sensors import GUESSED, WHEELED, Camera, Sensors, Wheels, sensors_of
from robot_agent.gaussian.spans import LONGEST
from tests.robot_agent.mishaps import DRIVES, LANDMARKS, readings

ROBOT = "robot/r1"
SPAN = max(SPANS)
ALONG = 0.03  # unit / sqrt(s), as the physics say
TICK = Motion(distance=0.2, dt=1.0, moving=1.0, along=ALONG**2, across=0.004**2, heading=1e-4)
SURE = 0.01  # unit: sigma of the position that is seen


def block(x: float, y: float = 0.0, heading: float = 0.0, sigma: float = SURE) -> Moments:
    mean = np.zeros(STATES)
    mean[:3], mean[[FORWARD, TURN]] = (x, y, heading), 1.0
    covariance = np.zeros((STATES, STATES))
    covariance[0, 0] = covariance[1, 1] = sigma**2
    return Moments(mean, covariance)


@dataclass
class Driver:
    """A robot whose filter, or whose team, sees it with a sigma of `SURE`, and the estimate of its wheels."""

    noise: WheelNoise
    own: Joint
    by_team: bool = False

    def move(self, motion: Motion = TICK) -> None:
        motion = self.noise.scaled(motion)
        angle = float(self.own.mean[HEADING]) + motion.turn / 2
        drive(self.own, ROBOT, motion, self.noise.nuisance)
        self.noise.move(self.own, motion, angle)

    def see(self, seen: Moments) -> None:
        """The place, and the heading, where the robot is seen."""
        if self.by_team:
            self.noise.judge(self.own, seen)
            return
        rows = np.eye(STATES)[[0, 1, HEADING]]
        apart = rows @ (seen.mean - self.own.moments(ROBOT).mean)
        noise = rows @ seen.covariance @ rows.T + np.diag([0.0, 0.0, 1e-6])
        self.own.update(Factor(apart, {ROBOT: rows}, noise))
        self.noise.judge(self.own, None)


def driver(given: bool = True, nuisance: Nuisance | None = None, *, by_team: bool = False) -> Driver:
    """A robot at 0 whose wheels' noise was given, or is a guess."""
    noise = WheelNoise(ROBOT, nuisance or Nuisance(), (given,) * 3, (1.0 if given else GUESSED,) * 2)
    return Driver(noise, Joint.of({ROBOT: block(0.0)}), by_team)


def driven(
    true: float, seconds: int, seed: int, by_team: bool = False, heading: float = 0.0, given: bool = True
) -> WheelNoise:
    """A robot that is seen in each tick while it drives, with an error along the way of `true` times what the physics say."""
    rng, robot, way = np.random.default_rng(seed), driver(given, by_team=by_team), 0.0
    robot.own = Joint.of({ROBOT: block(0.0, 0.0, heading)})
    for _ in range(seconds):
        measured = way + SURE * rng.normal()
        robot.see(block(measured * math.cos(heading), measured * math.sin(heading), heading))
        robot.move()
        way += TICK.distance + true * ALONG * rng.normal()
    return robot.noise


def along(noise: WheelNoise) -> float:
    return math.sqrt(noise.found["along"].variance)


@pytest.mark.long
@pytest.mark.parametrize(("true", "heading"), [(1.0, 0.0), (2.0, 2.0), (4.0, 0.0)])
def test_the_error_along_the_way_is_found_after_ten_minutes(true: float, heading: float) -> None:
    """To what the prior holds back, and a fifth."""
    errors = [along(driven(true, 600, seed, heading=heading)) for seed in range(4)]
    assert np.mean(errors) == pytest.approx(true, rel=0.35)
    assert (np.mean(errors) - true) * (true - 1) <= 0.2 * true, "what may be luck is not used"


@pytest.mark.long
def test_wheels_that_are_as_the_physics_say_are_taken_for_those_after_two_minutes() -> None:
    """Two minutes have seven long spans: one drive in many looks half as noisy again as it is."""
    errors = [along(driven(1.0, 120, seed)) for seed in range(16)]
    assert max(errors) < 1.75
    assert np.mean(errors) < 1.25


@pytest.mark.parametrize("by_team", [False, True])
def test_wheels_that_are_better_than_the_physics_say_count_as_those(by_team: bool) -> None:
    assert driven(0.2, 600, 1, by_team=by_team).found["along"].variance == 1.0


def test_it_begins_with_the_physics_and_one_span_moves_it_little() -> None:
    assert driven(4.0, int(min(SPANS)), 1).found["along"].variance == 1.0
    assert all(driven(1.0, int(SPAN) + 2, seed).found["along"].variance < 2.0**2 for seed in range(20))


@pytest.mark.long
@pytest.mark.parametrize("true", [0.5, 1.0, 4.0])
def test_a_guessed_model_is_replaced_by_what_is_seen(true: float) -> None:
    assert along(driven(1.0, 1, 1, given=False)) == 1.0
    errors = [along(driven(true, 300, seed, given=False)) for seed in range(8)]
    assert 0.9 * true < np.mean(errors) < 1.3 * true


def test_a_guessed_model_is_never_taken_for_none() -> None:
    assert GUESSED <= driven(0.1, 600, 1, given=False).found["along"].variance < 0.4


def test_a_belief_that_knows_no_more_than_odometry_judges_nothing() -> None:
    robot = driver(by_team=True)
    robot.see(block(0.0))
    for tick in range(1, 3 * int(LONGEST)):
        robot.move()
        robot.see(block(TICK.distance * tick + 5.0, sigma=math.hypot(SURE, ALONG * math.sqrt(tick))))
    assert robot.noise.found["along"].variance == 1.0


def test_a_span_of_the_team_is_not_judged_by_the_robot_alone() -> None:
    robot = driver()
    for _ in range(8):
        before = robot.noise.found["along"].variance
        robot.noise.judge(robot.own, block(0.0))
        for tick in range(1, int(LONGEST)):
            robot.noise.move(robot.own, TICK, 0.0)
            robot.noise.judge(Joint.of({ROBOT: block(TICK.distance * tick + 1.0)}), None)
        assert robot.noise.found["along"].variance == before
        robot.noise.judge(robot.own, block(TICK.distance * (LONGEST - 1) + 1.0))
        robot.noise.give_up()
    assert robot.noise.found["along"].variance > 1.0


def test_a_team_that_knows_more_than_the_robot_tells_it_the_noise_of_its_wheels() -> None:
    assert 3.0 < along(driven(4.0, 600, 1, by_team=True)) < 5.0


@pytest.mark.parametrize(
    ("given", "least", "most"), [((True, True), 1.5, 3.0), ((False, False), 1.5, 3.0), ((False, True), 1.0, 1.0)]
)
def test_a_heading_that_errs_more_says_so_of_the_way_where_both_were_told_or_neither(
    given: tuple[bool, bool], least: float, most: float
) -> None:
    rng, along, heading = np.random.default_rng(3), NoiseFactor(GUESSED, given[0]), NoiseFactor(GUESSED, given[1])
    factors, unseen = NoiseFactors((along, heading)), np.array([[[0.0]], [[1.0]]])
    for _ in range(40):
        factors.weigh(3.0 * rng.normal(size=1), np.zeros((1, 1)), unseen)
    assert 2.0 < math.sqrt(heading.variance) < 4.0
    assert least - 0.1 <= math.sqrt(along.variance) <= most + 0.1


def test_a_heading_that_drifts_far_within_a_span_leaves_the_noise_open() -> None:
    """The covariance without the noise of wheels had a negative eigenvalue, and one factor got all the weight."""
    rng, heading = np.random.default_rng(4), 0.0
    robot, place = driver(nuisance=WHEELED, by_team=True), np.zeros(2)
    for tick in range(200):
        robot.see(block(place[0], place[1], heading, 0.1))
        turn, told = 0.1 * (tick % 16 > 8), 0.13 * rng.normal()
        robot.move(replace(TICK, turn=turn + told, driven=turn, heading=0.13**2, along=(3 * ALONG) ** 2))
        heading += turn
        place += 0.2 * np.array([math.cos(heading), math.sin(heading)]) + 0.1 * rng.normal(size=2)
        assert all(kind.sigma > 0.1 for span in robot.noise.spans for kind in span.kinds.values())


@pytest.mark.parametrize("by_team", [False, True])
def test_what_was_given_up_is_not_judged(by_team: bool) -> None:
    robot = driver(by_team=by_team)
    for _ in range(10):
        robot.see(block(0.0))
        for _ in range(int(SPAN)):
            robot.move()
        robot.noise.give_up()
    assert robot.noise.found["along"].variance == 1.0


@pytest.mark.parametrize("by_team", [False, True])
def test_one_misread_correction_is_not_taken_for_the_wheels(by_team: bool) -> None:
    robot = driver(by_team=by_team)
    for tick in range(300):
        robot.see(block(TICK.distance * tick + (1e3 if tick == 290 else 0.0)))
        robot.move()
    assert robot.noise.found["along"].variance < 2.0**2


NUMBERS = st.floats(-1e4, 1e4)


@pytest.mark.long
@given(st.lists(st.tuples(NUMBERS, NUMBERS, st.floats(0, 1e4)), max_size=40), st.booleans(), st.booleans())
def test_it_stays_between_the_physics_and_eight_times_them_whatever_is_said(
    spans: list[tuple[float, float, float]], given: bool, by_team: bool
) -> None:
    robot = driver(given, Nuisance(sigmas=(0.05,) * 9), by_team=by_team)
    for x, heading, sigma in spans:
        robot.see(block(x, -x, heading, sigma))
        for _ in range(int(SPAN)):
            robot.move()
        for kind, factor in robot.noise.found.items():
            wild = kind == "across"
            assert (1.0 if given or wild else GUESSED) <= factor.variance <= (1024.0 if wild else 8.0) ** 2


# --- a whole robot ----------------------------------------------------------------------------------------------------


@dataclass
class Truth:
    """What a simulated robot's wheels and camera really are, against what it is told."""

    way: float = 1.0
    spin: float = 1.0
    curve: float = 1.0  # of the turn while it drives
    lag: float = 0.0
    range: float = 1.0
    bearing: float = 0.0
    noise: float = 1.0  # times the nominal noise of the camera
    slip: float = 0.01  # unit / sqrt(s), along the way
    jitter: float = 0.0  # rad / sqrt(s): of the turns that it is told


STRAIGHT = [(0.1, 0.0)]


def simulated(
    truth: Truth,
    seconds: int,
    seed: int = 1,
    sensors: Sensors | None = None,
    drives: list[tuple[float, float]] = DRIVES,
) -> tuple[FirstHand, float, float]:
    """Its filter after a drive, the RMSE (unit) of the second half, and the share within 95 %."""
    rng, own = np.random.default_rng(seed), FirstHand("robot/r1", sensors or Sensors())
    x, y, heading, squares, held, before = 0.0, 0.0, 0.0, list[float](), list[bool](), (0.0, 0.0)
    for tick in range(seconds + 1):
        command = drives[tick % len(drives)]
        if tick:
            now = [(1 - truth.lag) * a + truth.lag * b for a, b in zip(command, before, strict=True)]
            turn = now[1] * (truth.curve if now[0] > 0.1 else truth.spin) + 0.01 * rng.normal()
            way = now[0] * truth.way + truth.slip * rng.normal()
            x += way * math.cos(heading + turn / 2)
            y += way * math.sin(heading + turn / 2)
            heading += turn
        sightings = []
        for number, place in enumerate(LANDMARKS):
            away = math.dist(place, (x, y))
            if tick % 4 == number % 4 and tick:
                measured = away * truth.range * (1 + truth.noise * 0.035 * rng.normal())
                angle = (
                    math.atan2(place[1] - y, place[0] - x) - heading + truth.bearing + truth.noise * 0.01 * rng.normal()
                )
                sightings.append(
                    Sighting(subject=f"landmark/{number}", range=max(0.0, measured), bearing=angle, landmark=place)
                )
        own.step(readings(tick, command[0], command[1] + (truth.jitter * rng.normal() if tick else 0.0), sightings))
        before = command
        assert own.belief is not None
        apart = np.array([x, y]) - own.belief.mean[:2]
        if tick > seconds / 2:
            squares.append(float(apart @ apart))
            held.append(float(apart @ np.linalg.solve(own.belief.covariance[:2, :2], apart)) < 5.99)
    return own, math.sqrt(np.mean(squares)), float(np.mean(held))


WRONG = [
    ("way scale", Truth(), 1.0),
    ("way scale", Truth(way=0.7), 0.7),
    ("way scale", Truth(way=1.3), 1.3),
    ("curve turn scale", Truth(curve=0.6), 0.6),
    ("spin scale", Truth(spin=0.8, curve=0.8), 0.8),
    ("lag", Truth(lag=0.3), 0.3),
    ("range scale", Truth(range=1.15), 1 / 1.15),
    ("bearing bias", Truth(bearing=0.05), 0.05),
]


@pytest.mark.parametrize(("name", "truth", "value"), WRONG)
def test_a_robot_finds_what_its_wheels_and_its_camera_are_like(name: str, truth: Truth, value: float) -> None:
    own, rmse, held = simulated(truth, 240)
    assert rmse < 0.08, "unit; .038 where the model is right"
    assert held > 0.95
    parameters = own.found()
    assert parameters[name] == pytest.approx(value, abs=0.05)
    assert abs(parameters[name] - value) < 3 * parameters[f"{name} sigma"] + 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_noise_of_the_turns_is_not_taken_for_a_curve_that_turns_less_than_told(seed: int) -> None:
    """Six times as much noise as the model has."""
    own, _, _ = simulated(Truth(jitter=0.13), 60, seed, drives=STRAIGHT)
    parameters = own.found()
    assert parameters["curve turn scale"] + 3 * parameters["curve turn scale sigma"] > 1.0


@pytest.mark.parametrize(("noise", "low", "high"), [(1 / 3, 0.2, 0.5), (3.0, 1.5, 3.6)])
def test_a_robot_finds_how_noisy_its_camera_is(noise: float, low: float, high: float) -> None:
    """The model's range noise is about twice that of `simulated`, because the errors of a real camera last seconds."""
    own, _, held = simulated(Truth(noise=noise), 300)
    assert low < math.sqrt(own.camera.range.variance) < high
    assert held > 0.9
    told = own.camera.found(own.sensors.camera)
    assert told is not None
    assert low < 2 ** told.range[0] < high
    assert told.range[1] < 0.5


def test_a_camera_with_a_profile_tells_mates_nothing() -> None:
    assert CameraNoise().found(Camera(profile=((1.0, 0.1), (5.0, 0.2)))) is None


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("slip", "low", "high"), [(0.01, 0.5, 0.8), (0.09, 1.7, 3.6)])
def test_a_robot_that_nobody_described_finds_how_much_its_wheels_slip(
    slip: float, low: float, high: float, seed: int
) -> None:
    """The model's noise along the way is 0.03: smaller is found, too, but never less than half of it.

    Its filter knows that the errors of a landmark's range last: without them, slip was taken for a change of those.
    """
    own, _, held = simulated(Truth(slip=slip), 300, seed)
    assert low <= own.found()["along noise"] < high
    assert held > 0.9
    assert own.found()["heading noise"] >= 1.0, "the whole team may share a heading's error, and then nobody sees it"


def test_a_model_that_was_measured_is_not_taken_for_less() -> None:
    section = RobotSection.model_validate(
        {"vision": {"kind": "range-bearing"}, "odometry": {"measured": True, "along": 0.03}}
    )
    own, _, _ = simulated(Truth(slip=0.003), 300, sensors=sensors_of(section))
    assert own.found()["along noise"] == 1.0


def test_wheels_that_were_told_three_times_too_noisy_are_found_to_be_as_good_as_usual() -> None:
    told = {"measured": True, "along": 3 * ALONG, "turn": 0.06, "turning": 0.3}
    section = RobotSection.model_validate({"vision": {"kind": "range-bearing"}, "odometry": told})
    own, _, held = simulated(Truth(slip=0.003), 300, sensors=sensors_of(section))
    assert own.found()["along noise"] == pytest.approx(1 / 3, abs=0.1)
    assert own.found()["heading noise"] == pytest.approx(1 / 3, abs=0.1)
    assert held > 0.9


def test_wheels_are_not_found_better_than_told_where_no_landmark_tells_the_noise_of_the_camera() -> None:
    told = Sensors(Wheels(along=3 * ALONG, heading=0.06, turning=0.3, given=(True,) * 3))
    assert told.least_noise(camera_judged=False) == (1.0, 1.0)
    assert told.least_noise(camera_judged=True) == pytest.approx((1 / 9, 1 / 9))
    guessed = Sensors(Wheels(given=(False,) * 3))
    assert guessed.least_noise(camera_judged=False) == (GUESSED, GUESSED)


def test_a_robot_whose_model_leaves_nothing_open_tells_nothing() -> None:
    own = FirstHand("robot/r1", Sensors(wheels=Wheels(Nuisance())))
    assert own.found() == {}
    own.step(readings(0, 0.0, 0.0, []))
    assert own.found() == {}
