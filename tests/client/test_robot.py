"""`Robot` at a real board and router: readings in, poses out; and each wrong call is one sentence that names the argument."""

import asyncio
import math
from collections.abc import Callable

import numpy as np
import pytest

from blackboard.client import Robot
from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.opinion.grid import Grid
from tests.client.boards import serving
from tests.present import present
from tests.processes import LONG, wait_until

pytestmark = pytest.mark.team

GRID = Grid((40, 32), 0.25, unit="m")
NAN = math.nan


def test_two_robots_on_a_field_know_themselves_and_what_they_see(endpoint: str) -> None:
    with (
        serving(endpoint, GRID, fusion="joint"),
        Robot("r1", endpoint=endpoint) as first,
        Robot("r2", endpoint=endpoint) as second,
    ):
        assert first.step() is None
        first.fix((2.0, 3.0), 0.05, 0.0, 0.02)
        second.fix((4.0, 3.0), 1.0, math.pi, 0.05)  # nearly lost

        def is_found() -> bool:
            first.odometry(0.0, 0.0, 0.1)
            second.odometry(0.0, 0.0, 0.1)
            first.see("robot/r2", 2.5, 0.0, 0.05, 0.02)
            second.see("object/ball", position=(1.0, 0.0), covariance=np.eye(2) * 0.01)
            first.step()
            pose = second.step()
            return pose is not None and abs(pose.mean[0] - 4.5) < 0.1 and math.sqrt(pose.covariance[0, 0]) < 0.15

        wait_until(is_found, lambda: f"what r1 sees tells r2 where it is: {second.pose}")
        ball = second.newest("object/ball", LONG)
        wait_until(lambda: abs(second.agreed["object/ball"].belief.mean()[0] - 3.5) < 0.2, "the ball is in front of r2")
        assert ball.belief.grid == GRID
        assert "robot/r2: agreed by board-a" in str(second.why("robot/r2"))
        assert second.refused == []


def test_poses_of_an_odometry_frame_are_moves(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.fix((2.0, 3.0), 0.05, math.pi / 2, 0.02)
        robot.step()
        robot.moved_to((100.0, 50.0, 0.0), 0.1)
        robot.moved_to((100.5, 50.0, 0.0), 0.1)
        robot.moved_to((0.0, 0.0, 1.0), 0)  # its frame jumped
        robot.moved_to((math.cos(1.0) * 0.5, math.sin(1.0) * 0.5, 1.0), 0.1)
        pose = robot.step()
        assert present(pose).mean == pytest.approx((2.0, 4.0, math.pi / 2), abs=0.05)


def test_a_robot_that_drives_sideways_says_so_in_each_way_there_is(endpoint: str) -> None:
    """Before, poses of an odometry frame lost what was not ahead, without a word."""
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.fix((2.0, 3.0), 0.05, math.pi / 2, 0.02)
        robot.step()
        robot.moved_to((100.0, 50.0, 0.0), 0.1)
        robot.moved_to((100.0, 49.5, 0.0), 0.1)  # to its right
        robot.odometry(0.0, 0.0, 0.1, aside=-0.5)
        assert present(robot.step()).mean == pytest.approx((3.0, 3.0, math.pi / 2), abs=0.05)


def test_on_grids_it_is_said_that_the_way_to_the_side_is_left_out(
    endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    with serving(endpoint, GRID), Robot("r1", endpoint=endpoint) as robot:
        robot.odometry(0.1, 0.0, 0.1, aside=0.05)
        assert "to the side" not in caplog.text
        robot.odometry(0.0, 0.0, 0.1, aside=0.1)
        robot.odometry(0.0, 0.0, 0.1, aside=0.1)
        robot.step()
    assert caplog.text.count("what it drives to the side is left out") == 1


def test_a_filter_of_a_robot_that_drives_sideways_says_how_far_it_went(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        for number in range(12):
            spread = np.diag([0.04 + 0.001 * number, 0.04 + 0.001 * number, 0.01])
            robot.belief((2.0, 2.0 + 0.3 * number, 0.0), spread, (0.0, 0.0, 0.1, 0.3 if number else 0.0))
            pose = present(robot.step())
            assert pose.mean == pytest.approx((2.0, 2.0 + 0.3 * number, 0.0), abs=0.05)
        assert math.sqrt(pose.covariance[1, 1]) < 0.4, "the way is no jump of its filter"


def test_ranges_alone_to_known_places_tell_where_it_is(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.fix((5.0, 4.0), 0.5, 0.0, 0.02)
        robot.step()
        for name, at in (("n", (5.0, 8.0)), ("e", (10.0, 4.0)), ("w", (0.0, 4.0))):
            robot.see(f"landmark/{name}", range=math.dist(at, (5.4, 3.8)), range_sigma=0.05, at=at)
            robot.see("object/ball", bearing=0.5, bearing_sigma=0.1)
            robot.odometry(0.0, 0.0, 0.1)
            pose = robot.step()
        assert present(pose).mean[:2] == pytest.approx((5.4, 3.8), abs=0.15)


def test_asyncio_and_a_callback(endpoint: str) -> None:
    async def main() -> tuple[str, set[str]]:
        heard = set()
        async with Robot("r1", endpoint=endpoint) as robot:
            robot.on_agreed(lambda agreed: heard.add(agreed.subject))
            robot.fix((2.0, 3.0), 0.05, 0.0, 0.02)
            robot.step()
            return (await asyncio.wait_for(robot.next("robot/r1"), LONG)).subject, heard

    with serving(endpoint, GRID, fusion="joint"):
        assert asyncio.run(main()) == ("robot/r1", {"robot/r1"})


def test_a_sighting_near_a_wall_and_far_behind_it_is_no_exception(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.fix((0.1, 0.1), 0.05, math.pi, 0.02)
        for distance in (0.0, 0.2, 3.0, 1000.0):
            robot.see("object/ball", distance, 0.0, 0.05, 0.02)
            assert robot.step() is not None
            robot.odometry(0.3, 0.0, 0.1)  # through the wall


def test_the_sigmas_of_a_robot_that_stands_may_be_0_as_those_that_grow_with_its_way(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.fix((2.0, 3.0), 0.1, 0.0, 0.02)
        for distance in (0.0, 0.1, 0.0):
            assert robot.step() is not None
            robot.odometry(distance, 0.0, 0.1, 0.1 * math.sqrt(distance), 0.0)
        pose = robot.step()
        assert pose is not None
        assert np.linalg.eigvalsh(pose.covariance)[0] > 0


WRONG: list[tuple[Callable[[Robot], object], str]] = [
    (lambda r: r.odometry(NAN, 0, 0.1), r"odometry\(distance=nan\): give a finite number"),
    (lambda r: r.odometry(0, -1e300, 0.1), r"odometry\(turn=-1e\+300\): is larger than 1e\+12, .* another unit"),
    (lambda r: r.odometry(0, "left", 0.1), r"odometry\(turn='left'\): give a finite number"),  # type: ignore[arg-type]
    (lambda r: r.odometry(0, 0, 0.1, aside=NAN), r"odometry\(aside=nan\): give a finite number"),
    (lambda r: r.odometry(0, 0, 0), r"odometry\(dt=0\): give a finite number of at least 1e-06"),
    (lambda r: r.odometry(0, 0, 1, -1), r"odometry\(distance_sigma=-1\): give"),
    (lambda r: r.moved_to((0, 0), 1), r"moved_to\(pose=\(0, 0\)\): give 3 finite numbers"),
    (lambda r: r.compass(None), r"compass\(heading=None\): give a finite number"),  # type: ignore[arg-type]
    (lambda r: r.compass(0, 0), r"compass\(sigma=0\): give"),
    (lambda r: r.fix((1, NAN), 1), r"fix\(position=\(1, nan\)\): give 2 finite numbers"),
    (lambda r: r.fix((1, 1), None), r"fix\(sigma=None\): give"),  # type: ignore[arg-type]
    (lambda r: r.fix((1, 1), 1, 0.5), r"fix\(heading_sigma=None\): give the sigma of the heading"),
    (lambda r: r.fix((1, 1), 1, None, 0.5), r"fix\(heading_sigma=0.5\): give heading too"),
    (lambda r: r.see("ball", 1, 0), r"see\(subject='ball'\): give robot/NAME, object/NAME, landmark/NAME, or a class as robot/\?"),
    (lambda r: r.see("robot/r1", 1, 0), r"see\(subject='robot/r1'\): is this robot itself"),
    (lambda r: r.see("robot/r2", -1, 0), r"see\(range=-1\): give a finite number of at least 0"),
    (lambda r: r.see("robot/r2"), r"see\(range=None\): give a range, a bearing, both, or a position"),
    (lambda r: r.see("robot/r2", 1, bearing_sigma=1), r"see\(bearing_sigma=1.0\): give bearing too"),
    (lambda r: r.see("robot/r2", 1, 0, 0), r"see\(range_sigma=0\): give"),
    (lambda r: r.see("robot/r2", 1, 0, age=-1), r"see\(age=-1\): give"),
    (lambda r: r.see("robot/r2", 1, 45.0), r"see\(bearing=45.0\): give radians; this is more than a whole turn"),
    (lambda r: r.see("robot/r2", position=(1, 1)), r"see\(covariance=None\): give the covariance"),
    (lambda r: r.see("robot/r2", 1, 0, covariance=np.eye(2)), r"see\(covariance=...\): belongs to a position"),
    (lambda r: r.see("robot/r2", 1, 0, position=(1, 1)), r"see\(position=...\): give either"),
    (lambda r: r.see("robot/r2", position=(1, 1), covariance=[[1, 2], [2, 1]]), r"see\(covariance=\[\[1, 2\], \[2, 1\]\]\): give a sym"),
    (lambda r: r.belief((1, 2), np.eye(3), (0, 0, 1)), r"belief\(mean=\(1, 2\)\): give 3 finite numbers"),
    (lambda r: r.belief((1, 2, 3), -np.eye(3), (0, 0, 1)), r"belief\(covariance=array\(\[\[-1., -0., -0.\], \["),
    (lambda r: r.belief((1, 2, 3), np.eye(3), (0, 0)), r"belief\(odometry=\(0, 0\)\): give 3 finite numbers"),
    (lambda r: r.belief((1, 2, 3), np.eye(3), (0, 0, 0)), r"belief\(odometry=\(0, 0, 0\)\): dt is 0; give the seconds that it took, at least 1e-06"),
    (lambda r: r.belief((1, 2, 3), np.eye(3), (0, 0, 1, -2, 0)), r"belief\(odometry=\(0, 0, 1, -2, 0\)\): distance_sigma is -2; give at least 0, or leave"),
    (lambda r: r.particles([(1, 2, 3)], (0, 0, 1, 0, -2)), r"particles\(odometry=\(0, 0, 1, 0, -2\)\): turn_sigma is -2; give"),
    (lambda r: r.particles([(1, 2)], (0, 0, 1)), r"particles\(particles=\(1, 2\)\): give an array of shape \(N, 3\)"),
    (lambda r: r.particles([(1, 2, 3)], (0, 0, 1), [-1]), r"particles\(weights=\[-1\]\): give numbers of at least 0"),
    (lambda r: r.see("landmark/?", 1), r"see\(subject='landmark/\?'\): of a landmark of the map give a range and a bearing"),
    (lambda r: r.see("landmark/door", 1, 0), r"see\(at=None\): give where the landmark stands"),
    (lambda r: r.see("object/ball", 1, 0, at=(1, 1)), r"see\(at=\(1, 1\)\): belongs to a landmark"),
    (lambda r: r.odometry(b"1", 0, 1), r"odometry\(distance=b'1'\): give a finite number"),  # type: ignore[arg-type]
    (lambda r: r.compass(np.True_), r"compass\(heading=(np.)?True_?\): give a finite number"),  # type: ignore[arg-type]
    (lambda r: r.fix(("1", "2"), 1), r"fix\(position=\('1', '2'\)\): give 2 finite numbers"),
    (lambda r: r.fix(10**400, 1), r"fix\(position=1000.*\.\.\.\): give 2 finite numbers"),
    (lambda r: r.particles([(1, 2, 3), (1, 2)], (0, 0, 1)), r"particles\(particles=\[\(1, 2, 3\), \(1, 2\)\]\): give an array"),
    (lambda r: r.see("robot/r2", position=[(1, 2), 3], covariance=np.eye(2)), r"see\(position=\[\(1, 2\), 3\]\): give 2 finite numbers"),
    (lambda r: r.belief((1, 2, 3), np.eye(3), [(1, 2), 3]), r"belief\(odometry=\[\(1, 2\), 3\]\): give 3 finite numbers"),  # type: ignore[list-item]
    (lambda r: r.odometry("x" * 10**6, 0, 1), r"odometry\(distance='xxx.*\.\.\.\): give a finite number"),  # type: ignore[arg-type]
    (lambda r: r.see("x" * 10**6, 1, 0), r"see\(subject='xxx.*\.\.\.\): give robot/NAME"),
    (lambda r: r.see("robot/r2", position=(1, 1), covariance=np.eye(2) * 1e-13), r"see\(covariance=.*\): give variances of at least 1e-12"),
    (lambda r: r.see("robot/r2", position=(1e12, 1e12), covariance=np.eye(2)), r"see\(position=\(1000000000000.0, .*\): is farther than 1e\+12, which no message holds: has it another unit"),
    (lambda r: r.see("robot/r2", range=1, range_sigma=2e6), r"see\(range_sigma=2000000.0\): is larger than 1e\+06, which no message holds: has it another unit"),
    (lambda r: r.newest("ball"), r"newest\(subject='ball'\): give robot/NAME, object/NAME, landmark/NAME, or person/NAME"),
    (lambda r: r.why(5), r"why\(subject=5\): give robot/NAME"),  # type: ignore[arg-type]
    (lambda r: asyncio.run(r.next("ball")), r"next\(subject='ball'\): give robot/NAME"),
    (lambda r: r.fix((True, 2), 1), r"fix\(position=\(True, 2\)\): give 2 finite numbers"),
    (lambda r: r.fix(np.array([1, "2"], object), 1), r"fix\(position=array\(\[1, '2'\], dtype=object\)\): give 2 finite numbers"),
    (lambda r: r.on_agreed(None), r"on_agreed\(callback=None\): give a function"),  # type: ignore[arg-type]
]  # fmt: skip


@pytest.mark.parametrize(
    ("way", "warned"),
    [
        ((25.0, 5400.0, 5401.0), "a fix at (5400, 3) is outside the team's grid"),
        ((2.0, 3.0, 3.0, 3.0), "the same fix again, at (3, 3), counts once"),
    ],
)
def test_a_fix_outside_the_grid_or_told_again_is_warned_of_once(
    way: tuple[float, ...], warned: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = Robot("r1", "demo")
    for x in way:
        robot.fix((x, 3.0), sigma=0.1)
    (line,) = caplog.messages
    assert f"r1: {warned}" in line


def test_a_belief_or_particles_outside_the_grid_are_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("r1", "demo")
    robot.belief((2.0, 3.0, 0.0), np.eye(3), (0, 0, 0.1))
    for x in (200.0, 201.0):
        robot.belief((x, 2.0, 0.0), np.eye(3), (0, 0, 0.1))
    robot.particles([(200.0, 2.0, 0.1), (200.0, 2.1, 0.1)], (0, 0, 0.1))
    assert caplog.messages == ["r1: a belief at (200, 2) is outside the team's grid: has it another unit or frame?"]


def test_a_mate_that_the_scenario_does_not_name_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("r1", "demo")
    for subject in ("robot/r22", "robot/r2", "robot/r22", "robot/?", "object/R2", "robot/north..r1"):
        robot.see(subject, 1.0, 0.0)
    (line,) = caplog.messages
    assert line == (
        "r1: see(subject='robot/r22'): give a robot of the scenario (r1, r2, r3, r4, r5, r6), "
        'or admit this one: [team] guests = "vote"; did you mean r2?'
    )


def test_where_guests_are_admitted_or_nobody_is_named_any_mate_may_be_seen(caplog: pytest.LogCaptureFixture) -> None:
    admits = Scenario({"team": {"sub_teams": {"a": ["r1"]}, "guests": "vote"}})
    robots = [Robot("r1", admits), Robot("r1", Scenario({})), Robot("r1"), Robot("r1", "demo", team="other")]
    for robot in [*robots, Robot("r9", "demo")]:
        robot.see("robot/R2", 1.0, 0.0)
    assert not caplog.messages


def test_what_is_seen_farther_away_than_the_map_is_large_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("r1", grid=GRID)  # 10 by 8 m
    for far in (12.8, 300.0, 301.0):
        robot.see("object/far", far, 0.0)
        robot.see("object/far", range=far, range_sigma=0.1)
        robot.see("robot/?", position=(far, 0.0), covariance=np.eye(2))
        robot.see("landmark/tower", far, 0.0, at=(far, 0.0))
    assert caplog.messages == [
        "r1: see(range=300.0): is farther away than the map is large, 12.8 from corner to corner: has it another unit?",
        "r1: see(position=(300.0, 0.0)): is farther away than the map is large, 12.8 from corner to corner: "
        "has it another unit?",
    ]


def test_poses_of_one_stamp_lose_their_way_not_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("r1", "demo")
    for x, dt in ((0.0, 0.0), (0.1, 0.1), (5.0, 0.0), (5.1, 0.1), (5.1, 0.0)):  # it begins, and its frame jumps once
        robot.moved_to((x, 0.0, 0.0), dt)
    assert not caplog.messages
    for x in (5.2, 5.3):
        robot.moved_to((x, 0.0, 0.0), 0.0)
    (line,) = caplog.messages
    assert "r1: moved_to(dt=0) again: each time the way is lost" in line


@pytest.mark.parametrize(("call", "names"), WRONG, ids=[names for _, names in WRONG])
def test_a_wrong_call_is_one_sentence_that_names_the_argument(call: Callable[[Robot], object], names: str) -> None:
    with pytest.raises(ValueError, match=f"^{names}") as error:
        call(Robot("r1", "demo"))
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("robot", 5),
        ("robot", None),
        ("scenario", 5),
        ("endpoint", 5),
        ("endpoint", (5,)),
        ("sub_team", 5),
        ("sub_team", [5]),
    ]
    + [("team", 5), ("grid", 5), ("keys", 5), ("patience", "x"), ("patience", NAN), ("patience", -1.0)],
)
def test_a_robot_that_cannot_be_made_is_one_sentence_that_names_the_argument(argument: str, value: object) -> None:
    with pytest.raises(UserError, match=rf"^Robot\({argument}=.*\): give [^\n]*$"):
        Robot(**{"robot": "r1", argument: value})


def test_angles_of_more_than_a_whole_turn_are_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    """A heading may have grown over many turns, so it is taken; most who say it mean degrees."""
    robot = Robot("r1", "demo")
    robot.compass(-3.1)
    for heading in (90.0, 180.0):
        robot.compass(heading)
    robot.fix((1.0, 1.0), 0.1, 270.0, 0.1)
    robot.odometry(0.1, 45.0, 0.1)
    of_filters = Robot("r2", "demo")
    of_filters.belief((1.0, 1.0, 270.0), np.eye(3), (0, 0, 0.1))
    of_filters.particles([(1.0, 1.0, 0.0), (1.0, 1.0, -90.0)], (0, 0, 0.1))
    assert caplog.messages == [
        "r1: compass(heading=90): is more than a whole turn; give radians",
        "r1: fix(heading=270): is more than a whole turn; give radians",
        "r1: odometry(turn=45): is more than a whole turn; give radians",
        "r2: belief(heading=270): is more than a whole turn; give radians",
        "r2: particles(heading=-90): is more than a whole turn; give radians",
    ]


def test_a_way_that_is_longer_than_the_map_is_large_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("r1", grid=GRID)  # 10 by 8 m
    for way in (12.8, 1500.0, 1600.0):
        robot.odometry(way, 0.0, 0.1)
    assert caplog.messages == [
        "r1: odometry(distance=1500.0): is farther away than the map is large, 12.8 from corner to corner: "
        "has it another unit?"
    ]


def test_particles_that_are_all_alike_are_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("r1", "demo")
    for _ in range(2):
        robot.particles(np.ones((50, 3)), (0, 0, 0.1))
    assert caplog.messages == [
        "r1: particles(particles=...): are all alike, and say that the pose is certain: spread them"
    ]


def test_a_fourth_number_of_the_odometry_of_a_belief_is_said_to_be_the_way_to_the_left(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Who leaves out the second sigma drove sideways by the first one."""
    robot = Robot("r1", "demo")
    for odometry in (
        (0, 0, 0.1),
        (0.1, 0, 0.1, 0.0),
        (0.1, 0, 0.1, 0.02, 0.01),
        (0.1, 0, 0.1, 0.02),
        (0.1, 0, 0.1, 0.03),
    ):
        robot.belief((1.0, 1.0, 0.0), np.eye(3), odometry)
    assert caplog.messages == [
        "r1: belief(odometry=(0.1, 0, 0.1, 0.02)): has 4 numbers: the last is the way to the left; "
        "one with sigmas has both of them, and so 5 numbers"
    ]


def test_only_the_first_belief_may_come_without_odometry() -> None:
    robot = Robot("r1", "demo")
    robot.belief((1.0, 1.0, 0.0), np.eye(3))
    with pytest.raises(ValueError, match=r"^belief\(odometry=None\): give \(distance, turn, dt\) since the last one"):
        robot.belief((1.0, 1.0, 0.0), np.eye(3))


def test_a_filter_of_its_own_and_particles(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.belief((2.0, 3.0, 0.0), np.diag([0.04, 0.04, 0.01]))
        pose = robot.step()
        assert present(pose).mean == pytest.approx((2.0, 3.0, 0.0))
        robot.belief((2.1, 3.0, 0.0), np.diag([0.01, 0.01, 0.01]), (0.1, 0.0, 0.1, 0.01, 0.01))
        robot.see("object/ball", 1.0, 0.0, 0.05, 0.02)
        robot.step()
        cloud = np.random.default_rng(1).multivariate_normal((2.2, 3.0, 0.0), np.diag([0.01, 0.01, 0.01]), 500)
        robot.particles(cloud, (0.1, 0.0, 0.1))
        pose = robot.step()
        assert present(pose).mean[0] == pytest.approx(2.2, abs=0.1)
        assert robot.newest("object/ball", LONG).belief.grid == GRID
        independence = robot.independence
        assert not present(independence).fed_back
        with pytest.raises(ValueError, match=r"^r1: gives either compass and fixes, or beliefs"):
            robot.fix((1, 1), 0.1)


def test_a_filter_that_is_slower_than_the_wheels(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.belief((2.0, 3.0, 0.0), np.diag([0.04, 0.04, 0.01]), (0.0, 0.0, 0.1))
        robot.step()
        for number in range(1, 7):
            robot.odometry(0.1, 0.0, 0.1)
            if number % 3 == 0:
                robot.belief((2.0 + 0.1 * number, 3.0, 0.0), np.diag([0.01, 0.01, 0.01]))
                robot.odometry(0.1, 0.0, 0.1)
            pose = robot.step()
            assert present(pose).mean[0] == pytest.approx(2.0 + 0.1 * (number + number // 3), abs=0.11)
        with pytest.raises(
            ValueError, match=r"^belief\(odometry=.*\): was told by odometry\(\) since the last one: leave"
        ):
            robot.belief((2.8, 3.0, 0.0), np.diag([0.01, 0.01, 0.01]), (0.1, 0.0, 0.1))
        robot.belief((2.8, 3.0, 0.0), np.diag([0.01, 0.01, 0.01]))
        with pytest.raises(
            ValueError, match=r"^belief\(odometry=None\): give \(distance, turn, dt\) since the last one, or"
        ):
            robot.belief((2.8, 3.0, 0.0), np.diag([0.01, 0.01, 0.01]))


def test_a_call_of_who_is_in_no_team_is_one_sentence(endpoint: str) -> None:
    calls: list[Callable[[Robot], object]] = [
        lambda r: r.step(), lambda r: r.pose, lambda r: r.time, lambda r: r.independence,
        lambda r: r.why("object/ball"), lambda r: r.newest("object/ball"), lambda r: next(iter(r)),
    ]  # fmt: skip
    robot = Robot("r1", "demo", endpoint=endpoint)
    for call in calls:
        with pytest.raises(RuntimeError, match=r"^r1 has not joined its team: `with Robot\(\.\.\.\) as \.\.\.:`$"):
            call(robot)
    with robot:
        with pytest.raises(RuntimeError, match="^r1 has joined its team already$"):
            robot.__enter__()
        assert robot.step() is None
    for call in calls[:5]:
        with pytest.raises(RuntimeError, match="^the team is closed$"):
            call(robot)


def test_time_does_not_go_back(endpoint: str) -> None:
    with serving(endpoint, GRID), Robot("r1", endpoint=endpoint) as robot:
        now = robot.time
        robot.step(time=now)
        with pytest.raises(ValueError, match=r"^step\(time=.*\): is before the last step"):
            robot.step(time=now - 1)


def test_what_boards_refuse_because_it_is_old_comes_back(endpoint: str) -> None:
    with serving(endpoint, GRID, fusion="joint"), Robot("r1", endpoint=endpoint) as robot:
        robot.fix((2.0, 3.0), 0.1, 0.0, 0.1)

        def is_refused() -> bool:
            robot.odometry(0.0, 0.0, 0.1)
            robot.step(time=robot.time - 20.0)
            return any(refusal.reason == "past" for refusal in robot.refused)

        wait_until(is_refused, "the board says that it refuses what is old")


def test_a_time_of_another_clock_is_named(endpoint: str) -> None:
    """As `time.monotonic()`: boards refused all that the robot said, and the program heard nothing of it."""
    with serving(endpoint, GRID), Robot("r1", endpoint=endpoint) as robot:
        for wrong in (12.5, robot.time + 1000):
            with pytest.raises(ValueError, match=r"^step\(time=.*\): give team time in seconds, as `robot.time`"):
                robot.step(time=wrong)
        robot.fix((2.0, 3.0), 0.1, 0.0, 0.1)
        assert robot.step(time=robot.time) is not None
        with pytest.raises(
            ValueError, match=r"^step\(time=.*\): is \d.\d s ahead of team time; boards take at most 1 s$"
        ):
            # Before, it seemed to have driven unmeasured, and looked for its place for good.
            robot.step(time=robot.time + 5)
        assert robot.step() is not None


def test_a_sub_team_that_the_scenario_does_not_have_is_named() -> None:
    with pytest.raises(UserError, match=r"^Robot\(sub_team='z'\): the scenario has a, b$"):
        Robot("r1", Scenario({"team": {"sub_teams": {"a": ["r1"], "b": ["r2"]}}}), sub_team="z")
