"""The simulated world: the same from the same seed, nobody leaves it, and one more robot changes nothing."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.config.world import ObjectSection, WorldOdometrySection, WorldSection, WorldVisionSection
from blackboard.errors import UserError
from blackboard.opinion.grid import Grid
from blackboard.wire.messages import Readings, Truth
from sim_world.world import MAX_ROBOTS, World, reflect
from tests.present import present

GRID = Grid((50, 50))


def new_world(
    settings: WorldSection | None = None,
    robots: Sequence[str] = ("r1", "r2"),
    *,
    grid: Grid = GRID,
    seed: int = 1,
    dt: float = 0.2,
) -> World:
    return World(
        settings or WorldSection(), grid, robots, dt, lambda name: np.random.default_rng([seed, *name.encode()])
    )


def play(world: World, ticks: int) -> list[tuple[Truth, list[Readings]]]:
    return [world.advance("run", tick) for tick in range(ticks)]


def test_the_same_seed_is_the_same_world() -> None:
    assert play(new_world(), 40) == play(new_world(), 40)
    assert play(new_world(), 40) != play(new_world(seed=2), 40)


def test_one_more_robot_changes_nothing_about_the_others() -> None:
    few, more = play(new_world(), 200), play(new_world(robots=("r1", "r2", "r9")), 200)
    met = 0
    for (truth, readings), (truth_more, readings_more) in zip(few, more, strict=True):
        assert truth.positions.items() <= truth_more.positions.items()
        for alone, beside in zip(readings, readings_more, strict=False):
            sightings = [s for s in beside.sightings if s.subject != "robot/r9"]
            met += len(beside.sightings) - len(sightings)
            assert alone == beside.model_copy(update={"sightings": sightings})
    assert met > 0  # r9 was seen, and still


def test_a_robot_is_welcome_later_and_told_where_it_is() -> None:
    world = new_world()
    play(world, 3)
    assert world.admit("late")
    assert world.robots == ("late", "r1", "r2")
    truth, (readings, *_) = world.advance("run", 3)
    assert readings.robot == "late"
    assert readings.fix is not None
    assert math.dist(readings.fix.position, truth.positions["robot/late"]) < 5 * readings.fix.sigma
    assert world.advance("run", 4)[1][0].fix is None


def test_the_welcome_has_an_end() -> None:
    world = new_world(robots=[f"r{i}" for i in range(MAX_ROBOTS)])
    assert not world.admit("one-too-many")
    assert world.admit("r0")


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), speed=st.sampled_from([0.5, 1.0, 2.0]))
def test_nobody_leaves_and_robots_keep_their_speed(seed: int, speed: float) -> None:
    grid = Grid((40, 40), 0.5, (-3.0, 7.0))
    objects = {"ball": ObjectSection(drift=2.0, start=(-2.9, 26.9))}
    world = new_world(WorldSection(speed=speed, turn_rate=2.0, objects=objects), ("r1",), grid=grid, seed=seed)
    before: tuple[float, float] | None = None
    for truth, _ in play(world, 300):
        assert all(grid.index(place) is not None for place in truth.positions.values())
        place = truth.positions["robot/r1"]
        if before is not None:
            assert math.dist(before, place) == pytest.approx(speed * 0.2)
        before = place


def test_odometry_and_compass_tell_the_motion() -> None:
    exact = WorldOdometrySection(along=0, turn=0, compass=0)
    x = y = None
    for truth, (readings,) in play(new_world(WorldSection(odometry=exact, objects={}), ("r1",)), 300):
        assert readings.compass is not None
        if x is not None and y is not None and readings.odometry:
            x += readings.odometry.distance * math.cos(readings.compass)
            y += readings.odometry.distance * math.sin(readings.compass)
            assert math.dist((x, y), truth.positions["robot/r1"]) < 1e-9
        else:
            x, y = truth.positions["robot/r1"]


def test_turns_add_up_to_the_compass() -> None:
    exact = WorldOdometrySection(along=0, turn=0, compass=0)
    said = [readings[0] for _, readings in play(new_world(WorldSection(odometry=exact, turn_rate=1.0)), 200)]
    for before, after in itertools.pairwise(said):
        assert after.odometry is not None
        assert abs(after.odometry.turn) <= 0.2 + 1e-12
        assert math.cos(present(before.compass) + after.odometry.turn - present(after.compass)) == pytest.approx(1.0)


def test_a_drifting_object_does_a_random_walk() -> None:
    world = new_world(
        WorldSection(objects={"ball": ObjectSection(drift=0.3, start=(500, 500))}), grid=Grid((1000, 1000))
    )
    places = np.array([truth.positions["object/ball"] for truth, _ in play(world, 2000)])
    steps = np.diff(places, axis=0)
    assert np.allclose(steps.std(axis=0), 0.3 * math.sqrt(0.2), rtol=0.06)
    assert np.allclose(steps.mean(axis=0), 0, atol=0.02)


def test_first_everybody_is_told_where_it_starts_and_the_lost_are_not() -> None:
    world = new_world(WorldSection(lost=["r2"], speed=0.9))
    first = {r.robot: r for r in world.advance("run", 0)[1]}
    assert first["r1"].fix is not None
    assert first["r2"].fix is None
    assert first["r1"].odometry is None
    assert all(r.compass is not None for r in first.values())
    later = [(r.robot, tick) for tick in range(1, 30) for r in world.advance("run", tick)[1] if r.fix]
    assert later == [("r1", 28), ("r2", 28)]  # the first step beyond 5 cells, at 0.18 cells a step


def test_robots_see_each_other_and_the_objects() -> None:
    subjects = {
        sighting.subject
        for _, said in play(new_world(WorldSection(vision=WorldVisionSection(half_angle=3.14))), 600)
        for readings in said
        for sighting in readings.sightings
    }
    assert subjects == {"robot/r1", "robot/r2", "object/ball", "object/can"}


def test_ticks_and_times() -> None:
    world = new_world(dt=0.5)
    assert [truth.time for truth, _ in play(world, 4)] == [0.0, 0.5, 1.0, 1.5]
    assert [world.judged(tick) for tick in range(3)] == [False, True, True]


def test_a_start_outside_the_grid_is_a_mistake() -> None:
    with pytest.raises(UserError, match=r"world\.objects\.ball\.start: .* outside the grid; give"):
        new_world(WorldSection(objects={"ball": ObjectSection(start=(50.5, 3.0))}))


def test_robots_that_cannot_turn_are_a_mistake() -> None:
    with pytest.raises(UserError, match=r"world\.speed: .*; lower the speed"):
        new_world(WorldSection(speed=10.0))


def test_robots_go_to_their_waypoints_and_get_new_ones_in_time() -> None:
    """Turning at most turn_rate, towards the waypoint; the next one is drawn within two turning circles."""
    world = new_world(WorldSection(objects={}, turn_rate=2.0), ("r1",))
    body = world.bodies["r1"]
    reached = 0
    for tick in range(600):
        before, heading, waypoint = body.place, body.heading, body.waypoint
        world.advance("run", tick)
        if not tick:
            continue
        wanted = math.atan2(waypoint[1] - before[1], waypoint[0] - before[0])
        left = abs(math.remainder(wanted - heading, 2 * math.pi))
        turned = abs(math.remainder(body.heading - heading, 2 * math.pi))
        assert turned == pytest.approx(min(left, 2.0 * 0.2))
        off = abs(math.remainder(wanted - body.heading, 2 * math.pi))
        assert off == pytest.approx(left - turned, abs=1e-9)  # towards it, not away
        if body.waypoint != waypoint:
            reached += 1
            assert math.dist(body.place, waypoint) < 2 * 1.0 / 2.0
            assert all(3 * 0.5 <= c <= 50 - 3 * 0.5 for c in body.waypoint)
        else:
            assert math.dist(body.place, waypoint) >= 2 * 1.0 / 2.0
    assert reached > 1


def test_an_object_turns_back_half_a_unit_before_each_wall() -> None:
    grid = Grid((20, 10), 0.5, (-2.0, 3.0))
    world = new_world(
        WorldSection(speed=0.2, objects={"ball": ObjectSection(drift=1.5, start=(0.0, 5.0))}), (), grid=grid
    )
    places = np.array([truth.positions["object/ball"] for truth, _ in play(world, 3000)])
    assert places.min(axis=0) == pytest.approx([-1.5, 3.5], abs=0.05)
    assert places.max(axis=0) == pytest.approx([7.5, 7.5], abs=0.05)
    assert (places.min(axis=0) >= [-1.5, 3.5]).all()
    assert (places.max(axis=0) <= [7.5, 7.5]).all()


@pytest.mark.parametrize(
    ("x", "turned_back"),
    [(3.0, 3.0), (0.5, 0.5), (0.4, 0.6), (-0.5, 1.5), (9.5, 9.5), (9.6, 9.4), (-20.0, 9.5), (40.0, 0.5)],
)
def test_a_step_over_a_wall_isreflected(x: float, turned_back: float) -> None:
    assert reflect(x, 0.0, 10.0) == pytest.approx(turned_back)


def test_the_room_to_turn_is_eight_times_the_tightest_circle() -> None:
    new_world(WorldSection(speed=1.25, turn_rate=1.0, objects={}), grid=Grid((10, 30)))
    for shape in ((10, 30), (30, 10)):
        with pytest.raises(UserError, match=r"world\.speed"):
            new_world(WorldSection(speed=1.26, turn_rate=1.0, objects={}), grid=Grid(shape))


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_starts_on_its_way_to_its_waypoint(seed: int) -> None:
    for body in new_world(seed=seed).bodies.values():
        there = math.dist(body.place, body.waypoint)
        x, y = body.x + there * math.cos(body.heading), body.y + there * math.sin(body.heading)
        assert (x, y) == pytest.approx(body.waypoint)


def test_an_object_that_rolls_keeps_its_speed_and_the_walls_throw_it_back() -> None:
    world = new_world(WorldSection(objects={"ball": ObjectSection(rolls=3.0)}), [])
    truths = [truth for truth, _ in play(world, 400)]
    turned = 0
    for before, after in itertools.pairwise(truths):
        assert math.hypot(*after.velocities["object/ball"]) == pytest.approx(3.0)
        assert world.grid.index(after.positions["object/ball"]) is not None
        turned += before.velocities != after.velocities
        if before.velocities == after.velocities:
            way = np.subtract(after.positions["object/ball"], before.positions["object/ball"])
            assert way / 0.2 == pytest.approx(after.velocities["object/ball"])
    assert turned > 3


def test_the_truth_has_headings_and_velocities_of_robots() -> None:
    world = new_world()
    first, *others = [truth for truth, _ in play(world, 20)]
    assert first.velocities == {}
    for before, after in itertools.pairwise(others):
        for robot, place in after.positions.items():
            if robot.startswith("robot/"):
                way = np.subtract(place, before.positions[robot]) / 0.2
                assert way == pytest.approx(after.velocities[robot])
                assert math.atan2(way[1], way[0]) == pytest.approx(after.headings[robot])
