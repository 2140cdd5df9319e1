"""A recorded team as a factor graph: what is read, what is refused, and a replay that tells nothing too early."""

import cmath
import math
from pathlib import Path

import pytest

from blackboard.config.pyfg import FactorGraph, read_graph
from blackboard.errors import UserError
from blackboard.lab.team import InProcessTeam
from blackboard.run.flags import RecordingFlags
from sim_world.pyfg import GraphReplay
from sim_world.sources import open_sensor_source, replayed_from
from tests.sim_world.graphs import ANCHOR, T0, spoilt, write


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write(tmp_path / "two.pyfg")
    return tmp_path / "two.pyfg"


@pytest.fixture
def graph(file: Path) -> FactorGraph:
    return read_graph(file)


def new_replay(file: Path, **world: object) -> GraphReplay:
    replay = open_sensor_source(RecordingFlags(pyfg=str(file)).scenario().changed("world", **world))
    assert isinstance(replay, GraphReplay)
    return replay


def test_a_file_has_robots_points_and_what_they_measured_of_each_other(graph: FactorGraph) -> None:
    assert list(graph.tracks) == ["A", "B"]
    assert graph.points == {"L0": ANCHOR}
    assert (graph.first, graph.last) == (T0, T0 + 20.0)
    kinds = [(sighting.kind, sighting.subject) for sighting in graph.tracks["A"].seen]
    assert {("range", "landmark/L0"), ("range", "robot/B"), ("pose", "robot/B"), ("position", "landmark/L0")} == set(
        kinds
    )
    assert graph.tracks["A"].sigmas == pytest.approx((0.003 / 0.1**0.5, 0.001 / 0.1**0.5, 0.002 / 0.1**0.5))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("VERTEX_SE2 1000.0 A1 0 0", r"line 2: no sound element: 'VERTEX_SE2 1000.0 A1 0 0'"),
        ("VERTEX_SE2 1000.0 A1 0 0 nan", "line 2: no sound element"),
        ("VERTEX_SE2 soon A1 0 0 0", "line 2: no sound element"),
        ("EDGE_RANGE 1000.0 A0 A1 -1 0.1", "line 2: no sound element"),
        ("EDGE_RANGE 1000.0 A0 A1 1 0", "line 2: no sound element"),
        ("VERTEX_XY ../x 0 0", "line 2: no sound element"),
        ("EDGE_RANGE 1000.0 A0 B7 1 0.1", "names A0 and B7, of which one has no VERTEX"),
        ("VERTEX_SE2 1000.0 A1 0 0 0", "no odometry .EDGE_SE2. of robot A"),
    ],
)
def test_a_line_that_cannot_be_is_named(tmp_path: Path, line: str, why: str) -> None:
    (tmp_path / "bad.pyfg").write_text(f"VERTEX_SE2 999.0 A0 0 0 0\n{line}\n")
    with pytest.raises(UserError, match=why):
        read_graph(tmp_path / "bad.pyfg")


def test_what_is_no_such_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        read_graph(tmp_path / "nowhere.pyfg")
    (tmp_path / "empty.pyfg").write_text("VERTEX_SE3:QUAT 1 2 3\n")
    with pytest.raises(UserError, match=r"no pose .VERTEX_SE2."):
        read_graph(tmp_path / "empty.pyfg")
    with pytest.raises(UserError, match="--pyfg FILE"):
        read_graph(None)


def test_the_scenario_is_the_file_s(file: Path) -> None:
    scenario = RecordingFlags(pyfg=str(file)).scenario()
    assert scenario.team.robots == ("A", "B")
    assert scenario.time.seconds == 20.0
    grid = scenario.grid
    for x, y in ((-1.0, -1.0), (5.0, 1.0), ANCHOR):
        assert 0 <= (x - grid.origin[0]) / grid.cell < grid.shape[0]
        assert 0 <= (y - grid.origin[1]) / grid.cell < grid.shape[1]
    assert scenario.tables["robot"]["odometry"]["turn"] == pytest.approx(0.002 / 0.1**0.5)
    assert replayed_from(scenario) == T0
    with pytest.raises(UserError, match="--mrclam and --pyfg"):
        RecordingFlags("folder", pyfg=str(file)).scenario()
    with pytest.raises(UserError, match="--start and --protocol"):
        RecordingFlags(protocol="A_all", pyfg=str(file)).scenario()


def test_a_tick_holds_the_way_and_the_measurements_of_its_time(file: Path) -> None:
    replay = new_replay(file)
    ticks = [replay.advance("run", tick) for tick in range(4)]
    first, second = ({r.robot: r for r in readings} for _, readings in ticks[:2])
    assert first["A"].odometry is None
    assert first["A"].seen == []
    step = second["A"].odometry
    assert step is not None
    assert (step.distance, step.turn, step.dt) == pytest.approx((0.06, 0.06, 0.2), abs=0.02)
    assert [(s.kind, s.subject, s.landmark) for s in second["A"].seen] == [
        ("range", "landmark/L0", ANCHOR),
        ("range", "robot/B", None),
    ]
    assert {s.kind for s in ticks[2][1][0].seen} == {"range", "pose"}
    for truth, readings in ticks:
        for reading in readings:
            assert all(0 <= s.age < 0.2 + 1e-9 for s in reading.seen)
        assert truth.positions["robot/A"] == pytest.approx(
            (math.cos(0.3 * truth.time), math.sin(0.3 * truth.time)), abs=1e-3
        )
    assert [tick for tick in range(11) if replay.judged(tick)] == [5, 10]


def test_a_way_to_the_side_is_told_too(tmp_path: Path) -> None:
    """Robots that drift, as boats do: all steps together lead where those of the file lead."""
    steps = [(0.1, 0.05 * math.sin(k), 0.2 * math.cos(k)) for k in range(30)]
    lines, (x, y, heading) = ["VERTEX_SE2 1000.0 A0 0 0 0"], (0.0, 0.0, 0.0)
    for k, (dx, dy, turn) in enumerate(steps):
        c, s = math.cos(heading), math.sin(heading)
        x, y, heading = x + c * dx - s * dy, y + s * dx + c * dy, heading + turn
        lines.append(f"VERTEX_SE2 {1000.0 + 0.2 * (k + 1)} A{k + 1} {x} {y} {heading}")
        lines.append(f"EDGE_SE2 {1000.0 + 0.2 * (k + 1)} A{k} A{k + 1} {dx} {dy} {turn} 1e-6 0 0 1e-6 0 1e-6")
    (tmp_path / "boat.pyfg").write_text("\n".join(lines) + "\n")
    replay, place, turned = new_replay(tmp_path / "boat.pyfg"), 0j, 0.0
    for tick in range(31):
        (reading,) = replay.advance("run", tick)[1]
        if (step := reading.odometry) is not None:
            place += complex(step.distance, step.aside) * cmath.exp(1j * (turned + step.turn / 2))
            turned += step.turn
    assert (place.real, place.imag, turned) == pytest.approx((x, y, heading), abs=1e-9)


def test_robots_whose_poses_are_a_second_apart_start_somewhere_and_are_judged(tmp_path: Path) -> None:
    lines = [f"VERTEX_SE2 {1000.3 + k} A{k} {0.2 * k} 0 0" for k in range(21)]
    lines += [f"EDGE_SE2 {1001.3 + k} A{k} A{k + 1} 0.2 0 0 1e-6 0 0 1e-6 0 1e-6" for k in range(20)]
    (tmp_path / "slow.pyfg").write_text("\n".join(lines) + "\n")
    replay = new_replay(tmp_path / "slow.pyfg")
    first, *later = [replay.advance("run", tick) for tick in range(50)]
    assert first[1][0].fix is not None
    for truth, _ in later:
        assert truth.positions["robot/A"] == pytest.approx((0.2 * truth.time, 0.0), abs=1e-9)


def test_where_a_robot_starts_is_told_with_an_error_that_the_seed_draws(file: Path) -> None:
    def starts(seed: int) -> list[tuple[float, float]]:
        fixes = [r.fix for r in new_replay(file, seed=seed).advance("run", 0)[1]]
        assert [(f.sigma, f.heading_sigma) for f in fixes if f] == [(0.5, 0.1)] * 2
        return [f.position for f in fixes if f]

    assert starts(1) == starts(1)
    assert starts(1) != starts(2)
    places = [starts(seed)[0] for seed in range(30)]
    assert 0.12 < sum(math.dist(place, (1.0, 0.0)) ** 2 / 2 for place in places) / 30 < 0.45


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"team": {"sub_teams": {"a": ["A", "C"]}}}, r"has no robot C; it has A, B"),
        ({"world": {"start": 5.0}}, r"world\.start: 5\.0 is not in"),
        ({"time": {"seconds": 30.0}}, r"time\.seconds: 30 s reach beyond the recording; use at most 20"),
        ({"time": {"tick": 0.3}}, r"time\.tick: 0\.3 s does not divide a second"),
    ],
)
def test_what_does_not_fit_the_file_is_said(file: Path, change: dict[str, dict[str, object]], why: str) -> None:
    scenario = RecordingFlags(pyfg=str(file)).scenario()
    for section, values in change.items():
        scenario = scenario.changed(section, **values)
    with pytest.raises(UserError, match=why):
        open_sensor_source(scenario)


@pytest.mark.parametrize("off", [False, True], ids=["as it is", "with errors"])
def test_a_team_that_measures_ranges_alone_finds_where_it_is(file: Path, tmp_path: Path, off: bool) -> None:
    """Starts known to half a metre: the team knows better by its ranges, and says how well."""
    if off:
        spoilt(file, tmp_path / "spoilt.pyfg", 3)
        file = tmp_path / "spoilt.pyfg"
    card = InProcessTeam(RecordingFlags(pyfg=str(file)).scenario().changed("time", tick=0.5, seconds=20.0)).run()
    robots = card["scores"]["robots"]
    assert robots["agreed"]["rmse"] < 0.35
    assert robots["agreed"]["coverage"]["95"] > 0.8
