"""The MRCLAM files: read in any tidiness, and a fault is named by file and line."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import UserError
from sim_world.mrclam.files import LONGEST_GAP, RobotFiles, read_recording
from tests.files import DATASET7, needs_dataset7
from tests.present import present
from tests.sim_world.datasets import T0, write


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path)
    return tmp_path


def test_barcodes_become_subjects_and_strangers_are_dropped(folder: Path) -> None:
    recording = read_recording(folder)
    assert sorted(recording.tracks) == [1, 2]
    assert recording.landmarks == {6: (1.0, 2.0), 7: (-1.0, 0.5)}
    assert recording.tracks[1].sightings[:, 1].tolist() == [6, 2, 7]  # not the unknown barcode, not itself
    assert (recording.number("r1"), recording.number("r2")) == (1, 2)


def test_the_files_may_be_untidy(folder: Path) -> None:
    before = read_recording(folder)
    for file in folder.iterdir():
        lines = file.read_text().splitlines()
        rows = [f" \t{line.replace(' ', chr(9))}\t99 # said" for line in lines if not line.startswith("#")]
        file.write_text("\n\n# other words: é\n" + "\n \n".join(reversed(rows)) + "\r\n", encoding="latin-1")
    after = read_recording(folder)
    assert after.landmarks == before.landmarks
    for number, track in before.tracks.items():
        for name in ("odometry", "sightings", "truth"):
            assert np.array_equal(getattr(track, name), getattr(after.tracks[number], name))


def test_a_robot_that_sees_nothing_is_one(folder: Path) -> None:
    (folder / "Robot2_Measurement.dat").write_text("# nothing\n")
    assert read_recording(folder).tracks[2].sightings_in(0.0, 2e9) == []


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("Robot1_Odometry.dat", "1000.5 0.1 what"),
        ("Robot1_Odometry.dat", "1000.5 0.1"),
        ("Robot2_Groundtruth.dat", "1000.5 nan 0 0"),
        ("Robot2_Measurement.dat", "1000.5 11 -1.0 0.1"),
        ("Robot2_Measurement.dat", "1000.5 11 1.0 inf"),
        ("Landmark_Groundtruth.dat", "eight 1 2 0 0"),
        ("Barcodes.dat", "3"),
    ],
)
def test_a_corrupt_line_is_named(folder: Path, file: str, line: str) -> None:
    with (folder / file).open("a") as text:
        text.write(f"\n# a comment\n{line}\n")
    number = (folder / file).read_text().splitlines().index(line) + 1
    with pytest.raises(UserError, match=rf"{file}, line {number}: not \d sound numbers: .*; mend or remove it"):
        read_recording(folder)


def test_a_missing_file_or_folder_is_a_mistake(folder: Path) -> None:
    (folder / "Robot2_Groundtruth.dat").unlink()
    with pytest.raises(UserError, match=r"Robot2_Groundtruth\.dat: cannot be read \(No such file.*needs this file"):
        read_recording(folder)
    with pytest.raises(UserError, match=r"world\.dir: no folder .*nowhere; give"):
        read_recording(folder / "nowhere")
    (folder / "empty").mkdir()
    with pytest.raises(UserError, match=r"world\.dir: .*empty has no Robot1_Odometry\.dat; give"):
        read_recording(folder / "empty")
    with pytest.raises(UserError, match=r"world\.dir: .*--mrclam DIR"):
        read_recording(None)


def test_a_table_without_rows_is_a_mistake(folder: Path) -> None:
    (folder / "Robot1_Odometry.dat").write_text("# nothing\n")
    with pytest.raises(UserError, match=r"Robot1_Odometry\.dat: no rows"):
        read_recording(folder)


def test_a_robot_that_was_not_recorded_is_a_mistake(folder: Path) -> None:
    for robot in ("r3", "karl"):
        with pytest.raises(UserError, match=rf"team\.sub_teams: .* has no robot {robot}; it has r1, r2"):
            read_recording(folder).number(robot)


def track(odometry: list[list[float]], truth: list[list[float]] | None = None) -> RobotFiles:
    return RobotFiles(np.array(odometry), np.zeros((0, 4)), np.array(truth or [[0.0, 0, 0, 0]]))


@given(
    gaps=st.lists(st.sampled_from([0.0, 0.01, 0.3, 1.4]), min_size=1, max_size=8),
    speeds=st.lists(st.floats(-1, 1), min_size=8, max_size=8),
    since=st.floats(-1, 6),
    span=st.floats(0, 4),
)
def test_a_command_holds_until_the_next(gaps: list[float], speeds: list[float], since: float, span: float) -> None:
    times = np.cumsum(gaps)
    driven = track([[t, v, -2 * v] for t, v in zip(times, speeds, strict=False)])
    distance, turn, *_ = driven.commanded(since, since + span)
    # the slow, obvious way: cut the span wherever a command comes, and look up the newest one of each piece
    cuts = [since, *(t for t in times if since < t < since + span), since + span]
    expected = 0.0
    for a, b in itertools.pairwise(cuts):
        newest = [v for t, v in zip(times, speeds, strict=False) if t <= a]
        expected += (newest[-1] if newest else 0.0) * (b - a)
    assert distance == pytest.approx(expected, abs=1e-9)
    assert turn == pytest.approx(-2 * expected, abs=1e-9)


@given(
    commands=st.lists(st.sampled_from([(0.1, 0.0), (0.0, 0.7), (0.2, -0.9), (0.0, 0.0)]), min_size=1, max_size=8),
    since=st.floats(0, 4),
    span=st.floats(0, 4),
)
def test_curves_are_told_from_turns_on_the_spot_within_a_step(
    commands: list[tuple[float, float]], since: float, span: float
) -> None:
    """A step in which the robot turned and then drove ahead looked like a curve."""
    driven = track([[float(k), *command] for k, command in enumerate(commands)])
    seconds = [max(0.0, min(k + 1.0, since + span) - max(float(k), since)) for k in range(len(commands))]
    seconds[-1] = max(0.0, since + span - max(since, len(commands) - 1.0))  # the last command holds
    curves = [(t, v, w) for t, (v, w) in zip(seconds, commands, strict=True) if v and w]
    _, _, way, turn = driven.commanded(since, since + span)
    assert way == pytest.approx(sum(t * v for t, v, _ in curves), abs=1e-9)
    assert turn == pytest.approx(sum(t * w for t, _, w in curves), abs=1e-9)


def test_truth_is_interpolated_over_short_gaps_only() -> None:
    driven = track([[0, 0, 0]], [[10.0, 0, 0, 3.1], [10.4, 4, 8, -3.1], [11.0, 5, 5, 0]])
    assert driven.pose(9.9) is None
    assert driven.pose(10.0) == (0, 0, 3.1)
    middle = present(driven.pose(10.2))
    assert middle[:2] == pytest.approx((2, 4))
    assert np.cos(middle[2] - np.pi) == pytest.approx(1.0)  # over the seam, not through zero
    assert driven.pose(10.7) is None  # a gap of 0.6 s
    assert driven.pose(11.0) == (5, 5, 0)
    assert driven.pose(11.1) is None


@needs_dataset7
def test_dataset_7_is_what_its_page_says() -> None:
    """13 758 readings in the window of 600 s; a robot sees some landmark in 63 % of the seconds."""
    recording = read_recording(DATASET7)
    assert (sorted(recording.tracks), sorted(recording.landmarks)) == ([1, 2, 3, 4, 5], list(range(6, 21)))
    assert sum(len(track.sightings_in(T0, T0 + 600)) for track in recording.tracks.values()) == 13758
    seconds = [
        any(subject in recording.landmarks for _, subject, _, _ in track.sightings_in(T0 + k, T0 + k + 1))
        for track in recording.tracks.values()
        for k in range(600)
    ]
    assert np.mean(seconds) == pytest.approx(0.63, abs=0.005)
    assert recording.first == 1248446191.0
    assert recording.last == pytest.approx(1248447082.106)


def test_a_pose_between_two_rows_is_interpolated_the_short_way_round() -> None:
    truth = np.array([[10.0, 1.0, -2.0, 3.0], [10.4, 2.0, -4.0, -3.0]])
    files = RobotFiles(np.zeros((1, 3)), np.zeros((0, 4)), truth)
    pose = present(files.pose(10.1))
    turn = 2 * math.pi - 6.0
    assert pose == pytest.approx((1.25, -2.5, 3.0 + turn / 4))
    assert files.pose(10.0) == (1.0, -2.0, 3.0)
    assert files.pose(10.4) == (2.0, -4.0, -3.0)
    assert (files.pose(9.9), files.pose(10.5)) == (None, None)


@pytest.mark.parametrize(("gap", "known"), [(LONGEST_GAP, True), (1.01 * LONGEST_GAP, False)])
def test_a_longer_gap_is_not_bridged(gap: float, known: bool) -> None:
    files = RobotFiles(np.zeros((1, 3)), np.zeros((0, 4)), np.array([[0.0, 1.0, 1.0, 0.0], [gap, 2.0, 2.0, 0.0]]))
    assert (files.pose(0.1) is not None) == known


def test_an_unknown_barcode_is_dropped_whoever_saw_it(tmp_path: Path) -> None:
    write(tmp_path)
    for robot in (1, 2):
        with (tmp_path / f"Robot{robot}_Measurement.dat").open("a") as text:
            text.write("1003.0 98 1.0 0.0\n")
    recording = read_recording(tmp_path)
    assert [len(recording.tracks[robot].sightings) for robot in (1, 2)] == [3, 3]
    assert recording.tracks[2].sightings[:, 1].tolist() == [1, 6, 6]
