"""The replay: what a robot is told rests on nothing stamped later, and each protocol withholds what it says."""

import math
from functools import cache
from pathlib import Path

import pytest

from blackboard.config.protocols import FAMILIES, PROTOCOLS
from blackboard.config.world import WorldSection
from blackboard.errors import UserError
from blackboard.wire.messages import Readings
from sim_world.mrclam.files import Recording, read_recording
from sim_world.mrclam.replay import MrclamSource
from tests.files import DATASET7, needs_dataset7
from tests.sim_world.datasets import T0, write

ROBOTS = ("r1", "r2", "r3", "r4", "r5")


@pytest.fixture
def tiny(tmp_path: Path) -> Recording:
    write(tmp_path)
    return read_recording(tmp_path)


def new_replay(
    recording: Recording, *robots: str, dt: float = 0.5, seconds: float = 10.0, **world: object
) -> MrclamSource:
    settings = WorldSection.model_validate({"kind": "mrclam", **world})
    return MrclamSource(settings, recording, robots or ("r1", "r2"), dt, seconds)


def said(replay: MrclamSource, robot: str, ticks: int) -> list[Readings]:
    return [{r.robot: r for r in replay.advance("run", tick)[1]}[robot] for tick in range(ticks)]


def test_it_starts_with_the_true_pose(tiny: Recording) -> None:
    replay = new_replay(tiny, start=1001.0)
    first = said(replay, "r1", 1)[0]
    assert first.fix is not None
    assert first.fix.position == pytest.approx((0.1, 0.0))
    assert (first.fix.sigma, first.fix.heading, first.fix.heading_sigma) == (0.05, 0.0, 0.03)
    assert (first.odometry, first.compass, first.sightings) == (None, None, [])
    assert new_replay(tiny).start == 1000.0  # nothing said: where the files begin


def test_a_tick_holds_the_commands_and_sightings_of_its_time(tiny: Recording) -> None:
    replay = new_replay(tiny, start=1000.5, odometry_lag=0.2, sighting_latency=0.05)
    _, first, second = said(replay, "r1", 3)  # ticks end at 1000.5, 1001.0, 1001.5
    assert first.odometry is not None
    assert first.odometry.distance == pytest.approx(0.05)
    assert (first.odometry.turn, first.odometry.dt) == (0.0, 0.5)
    sightings = [
        (s.subject, s.range, s.bearing, round(s.age, 6), s.landmark) for s in first.sightings + second.sightings
    ]
    assert sightings == [
        ("landmark/6", 2.0, 0.1, 0.15, (1.0, 2.0)),
        ("robot/r2", 1.0, 0.2, 0.05, None),  # stamped 1001.00: the last moment of its tick
        ("landmark/7", 3.0, -0.3, 0.15, (-1.0, 0.5)),
    ]
    assert (first.time, second.time) == (0.5, 1.0)


def test_the_commands_lead_the_motion(tiny: Recording) -> None:
    """Before the first command nothing moves: with a lag of 0.3 s the first half second holds 0.2 s of it."""
    turn = said(new_replay(tiny, start=1000.0, odometry_lag=0.3), "r2", 2)[1].odometry
    assert turn is not None
    assert turn.turn == pytest.approx(0.2 * 0.2)


def test_two_sightings_of_one_subject_are_both_kept(tiny: Recording) -> None:
    last = said(new_replay(tiny, start=1002.0), "r2", 2)[1]
    assert [(s.subject, s.range) for s in last.sightings] == [("landmark/6", 1.5), ("landmark/6", 1.4)]


def test_truth_has_all_robots_and_whole_seconds_are_judged(tiny: Recording) -> None:
    replay = new_replay(tiny, "r2", start=1002.0, dt=0.25)
    truth, readings = replay.advance("run", 0)
    assert truth.positions == {"robot/r1": pytest.approx((0.2, 0.0)), "robot/r2": (0.0, 1.0)}
    assert [r.robot for r in readings] == ["r2"]
    assert [tick for tick in range(9) if replay.judged(tick)] == [4, 8]


def test_only_recorded_robots_are_welcome(tiny: Recording) -> None:
    replay = new_replay(tiny)
    assert replay.admit("r2")
    assert not replay.admit("r7")
    assert replay.robots == ("r1", "r2")


def test_where_truth_has_a_gap_nothing_is_judged(tmp_path: Path) -> None:
    write(tmp_path)
    file = tmp_path / "Robot1_Groundtruth.dat"
    rows = [row for row in file.read_text().splitlines() if not row.startswith("1002.")]
    file.write_text("\n".join(rows))
    replay = new_replay(read_recording(tmp_path), dt=1.0)
    positions = [set(replay.advance("run", tick)[0].positions) for tick in range(5)]
    both = {"robot/r1", "robot/r2"}
    assert positions == [both, both, {"robot/r2"}, both, both]
    with pytest.raises(UserError, match=r"world\.start: the ground truth of r1 has a gap there; move"):
        new_replay(read_recording(tmp_path), start=1002.5)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"start": 900.0}, r"world\.start: 900\.0 is not in .*; use 1000 to 1020$"),
        ({"seconds": 30.0}, r"time\.seconds: 30 s reach beyond the recording; use at most 20$"),
        ({"dt": 0.3}, r"time\.tick: 0\.3 s does not divide a second.*; use 0\.5 or 1\.0"),
        ({"dt": 2.0}, r"time\.tick: 2 s does not divide a second"),
    ],
)
def test_what_does_not_fit_is_a_mistake(tiny: Recording, changes: dict[str, float], text: str) -> None:
    with pytest.raises(UserError, match=text):
        new_replay(tiny, **changes)


# --- the real one ----------------------------------------------------------------------------------------------------


@cache
def dataset7() -> Recording:
    return read_recording(DATASET7)


def landmarks(protocol: str, seconds: int) -> dict[str, list[tuple[int, str]]]:
    """Robot -> (second, landmark) of each landmark sighting that a protocol lets through."""
    replay = new_replay(dataset7(), *ROBOTS, dt=1.0, seconds=seconds, start=T0, protocol=protocol)
    by_robot: dict[str, list[tuple[int, str]]] = {robot: [] for robot in ROBOTS}
    for tick in range(seconds + 1):
        for readings in replay.advance("run", tick)[1]:
            by_robot[readings.robot] += [(tick, s.subject) for s in readings.sightings if s.landmark is not None]
    return by_robot


@needs_dataset7
def test_protocols_withhold_landmarks() -> None:
    everything = landmarks("A_all", 60)
    assert all(everything.values())
    blind = landmarks("C_blind12", 60)
    assert {robot for robot, sightings in blind.items() if sightings} == {"r3", "r4", "r5"}
    assert blind["r3"] == everything["r3"]
    assert {robot for robot, sightings in landmarks("D_one3", 60).items() if sightings} == {"r3"}
    assert not any(landmarks("F_nolm", 60).values())
    south = {subject for sightings in landmarks("E_south", 60).values() for _, subject in sightings}
    assert south == {f"landmark/{i}" for i in range(6, 11)}
    everything = landmarks("A_all", 310)
    for robot, sightings in landmarks("B_turns", 310).items():
        turn = int(robot[1:]) - 1
        mine = [(tick, s) for tick, s in everything[robot] if (tick - 1) // 60 % 5 == turn]
        assert sightings == mine  # the sightings of second k carry stamps in (k - 1, k]


@needs_dataset7
@pytest.mark.parametrize(("protocol", "lost"), [("A_all", ()), ("G_wake", ROBOTS), ("H_lost12", ("r1", "r2"))])
def test_the_lost_have_a_compass_and_no_start(protocol: str, lost: tuple[str, ...]) -> None:
    replay = new_replay(dataset7(), *ROBOTS, start=T0, protocol=protocol)
    for tick in range(4):
        for readings in replay.advance("run", tick)[1]:
            assert (readings.compass is not None) == (readings.robot in lost)
            assert (readings.fix is not None) == (tick == 0 and readings.robot not in lost)


def test_a_landmark_may_be_the_object_whose_place_nobody_is_told(tiny: Recording) -> None:
    replay = new_replay(tiny, start=1000.5, protocol="O1_landmark6", dt=1.0)
    ticks = [replay.advance("run", tick) for tick in range(4)]
    sightings = [(s.subject, s.landmark) for _, readings in ticks for r in readings for s in r.sightings]
    assert ("object/landmark6", None) in sightings
    assert ("landmark/7", (-1.0, 0.5)) in sightings
    assert all(subject != "landmark/6" for subject, _ in sightings)
    assert all(truth.positions["object/landmark6"] == (1.0, 2.0) for truth, _ in ticks)
    both = [tick for tick in range(4) if replay.judged(tick)]
    assert both == [], "r1 sees it in the first second, r2 in the second one"


def test_a_robot_may_be_the_object_and_does_not_take_part(tiny: Recording) -> None:
    replay = new_replay(tiny, start=1000.5, protocol="O2_mate2", dt=1.0)
    truth, readings = replay.advance("run", 1)
    assert replay.robots == ("r1",)
    assert not replay.admit("r2")
    assert set(truth.positions) == {"robot/r1", "object/robot2"}
    assert [s.subject for r in readings for s in r.sightings if s.landmark is None] == ["object/robot2"]


def test_an_object_that_is_not_in_the_recording_is_a_mistake(tiny: Recording) -> None:
    with pytest.raises(UserError, match="O1_landmark20 is about 20, which is not in the recording"):
        new_replay(tiny, protocol="O1_landmark20")


@needs_dataset7
def test_the_object_protocols_are_judged_at_the_events_of_the_recording_s_page() -> None:
    """1 066 events for O1 and 159 for O2 (../shared/mrclam/README.md)."""
    for family, events in (("O1_landmark", 1066), ("O2_mate", 159)):
        runs = (new_replay(dataset7(), *ROBOTS, start=T0, protocol=p, dt=1.0, seconds=600) for p in FAMILIES[family])
        assert sum(run.judged(tick) for run in runs for tick in range(601)) == events


@needs_dataset7
def test_mates_are_seen_under_every_protocol() -> None:
    expected = sum(row[1] <= 5 for track in dataset7().tracks.values() for row in track.sightings_in(T0, T0 + 30))
    assert expected > 100
    for protocol in PROTOCOLS:
        replay = new_replay(dataset7(), *ROBOTS, start=T0, protocol=protocol, dt=1.0, seconds=30)
        mates = sum(s.landmark is None for t in range(31) for r in replay.advance("run", t)[1] for s in r.sightings)
        assert mates == expected


@needs_dataset7
def test_what_is_said_rests_on_the_past_only() -> None:
    """With everything after a moment cut off or replaced, all readings until then are the same to the bit."""
    ticks, end = 60, T0 + 30.0
    whole = dataset7()
    tracks = {}
    for number, track in whole.tracks.items():
        odometry, sightings = track.odometry.copy(), track.sightings.copy()
        odometry[odometry[:, 0] > end, 1:] = 7.0
        sightings[sightings[:, 0] > end, 2:] = 0.5
        tracks[number] = type(track)(odometry, sightings[sightings[:, 0] < end + 5], track.truth)
    cut = Recording(whole.folder, tracks, whole.landmarks)
    a, b = (new_replay(recording, *ROBOTS, start=T0, seconds=60, protocol="A_all") for recording in (whole, cut))
    for tick in range(ticks + 1):
        assert a.advance("run", tick)[1] == b.advance("run", tick)[1]
    assert a.advance("run", ticks + 1)[1] != b.advance("run", ticks + 1)[1]


@needs_dataset7
def test_the_commands_follow_the_true_turns() -> None:
    """The lag of 0.22 s fits: with it the turns of half a second agree with motion capture, without it much less."""

    def error(lag: float) -> float:
        total = []
        replay = new_replay(dataset7(), "r2", "r4", start=T0, seconds=60, odometry_lag=lag)
        for tick in range(121):
            for readings in replay.advance("run", tick)[1]:
                track = dataset7().tracks[int(readings.robot[1:])]
                now, before = track.pose(T0 + tick / 2), track.pose(T0 + tick / 2 - 0.5)
                if readings.odometry and now and before:
                    total.append(math.remainder(now[2] - before[2] - readings.odometry.turn, 2 * math.pi) ** 2)
        return math.sqrt(sum(total) / len(total))

    assert error(0.22) < 0.04
    assert error(0.0) > 1.5 * error(0.22)
