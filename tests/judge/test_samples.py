"""The series: what the referee says of each sample, and the file that gives it back exactly."""

import math
import tempfile
from dataclasses import astuple, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.config.world import CheckSection
from blackboard.errors import UserError
from blackboard.judge.instant import Instant, who_saw_landmarks
from blackboard.judge.referee import Referee
from blackboard.judge.samples import COLUMNS, LEVELS, NEEDED, Sample, read_series, series_file
from blackboard.wire.messages import Readings, Sighting, Used
from tests.judge.instants import GRID, at, both, cells, consensus, new_instant, solo

SAMPLE = Sample(3, 0.6, "r1", "a", "robot/r1", "agreed", 1.0, 2.0, 1.5, 2.5, -1.0, 0.25, 0.01, 4.0, math.inf)
FINITE = st.floats(allow_nan=False)


def samples_of(*ticks: Instant) -> list[Sample]:
    samples: list[Sample] = []
    judge = Referee(GRID, CheckSection(), ("r1",), samples.append)
    for instant in ticks:
        judge.judge_instant(instant, judged=instant.truth.tick % 2 == 1)
    return samples


def tick(number: int, *, saw: bool) -> Instant:
    instant = new_instant({"robot/r1": (2.5, 2.5)}, number, teams={"a": ["r1"]})
    instant.landmark_seen = frozenset({"r1"} if saw else ())
    solo(instant, "r1", {"robot/r1": cells({(2, 2): 0.25, (2, 4): 0.75})})
    both(instant, "a", "robot/r1", at(5, 6), at(2, 2))
    return instant


def test_a_sample_says_how_each_level_did() -> None:
    samples = samples_of(tick(1, saw=False))
    assert [sample.level for sample in samples] == list(LEVELS)
    alone, together, agreed = samples
    values = (1, 0.2, "r1", "a", "robot/r1", "solo", 2.5, 2.5, 2.5, 4.0, pytest.approx(math.log(0.25)), 0.75, 0.25, 2.0)
    spread = {"var_x": 1 / 12, "cov_xy": 0.0, "var_y": 4 * 0.25 * 0.75 + 1 / 12}
    assert vars(alone) == {
        **dict(zip(COLUMNS, values, strict=False)),
        "landmark_age": math.inf,
        "error": pytest.approx(1.5),
        "entropy": pytest.approx(-0.25 * math.log(0.25) - 0.75 * math.log(0.75)),
        "sources": 1,
        **{name: pytest.approx(value) for name, value in spread.items()},
        "lost": pytest.approx(math.nan, nan_ok=True),
    }
    assert (together.mean_x, together.mean_y, together.region, together.area) == (5.5, 6.5, 1.0, 1.0)
    assert (agreed.mean_x, agreed.mean_y, agreed.log_score, agreed.region) == (2.5, 2.5, 0.0, 0.0)


def test_a_landmark_counts_from_ticks_that_are_not_judged_too() -> None:
    samples = samples_of(*(tick(number, saw=number in (2, 5)) for number in range(1, 8)))
    ages = [sample.landmark_age for sample in samples if sample.level == "solo"]
    assert ages == [math.inf, pytest.approx(0.2), 0.0, pytest.approx(0.4)]


def test_only_what_counts_for_the_scores_is_in_the_series() -> None:
    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": at(2, 2)})
    consensus(instant, "a", "consensus", "robot/r1", at(2, 2))  # and nothing was agreed
    assert samples_of(instant) == []


def test_who_saw_a_landmark() -> None:
    landmark = Sighting(subject="landmark/6", range=1.0, bearing=0.0, landmark=(1.0, 2.0))
    mate = Sighting(subject="robot/r2", range=1.0, bearing=0.0)
    sightings = {"r1": [mate, landmark], "r2": [mate], "r3": []}
    assert who_saw_landmarks(
        Readings(run="x", robot=r, tick=1, time=1.0, sightings=s) for r, s in sightings.items()
    ) == {"r1"}


@given(st.lists(st.tuples(FINITE, FINITE, st.floats(0, math.inf))))
def test_a_file_gives_back_what_was_written(numbers: list[tuple[float, float, float]]) -> None:
    samples = [replace(SAMPLE, mean_x=x, log_score=y, landmark_age=age) for x, y, age in numbers]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "series.csv"
        with series_file(file) as record:
            assert record is not None
            for sample in samples:
                record(sample)
        assert list(map(repr, read_series(file))) == list(map(repr, samples))  # NaN is not equal to itself


def test_without_a_file_nothing_is_recorded() -> None:
    with series_file(None) as record:
        assert record is None


def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"--table .*choose another place"), series_file(tmp_path / "no" / "s.csv"):
        pass


ROW = ",".join(str(value) for value in astuple(SAMPLE))


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("", "line 1: not the columns"),
        ("a,b\n1,2\n", "line 1: not the columns"),
        (",".join(COLUMNS) + f"\n{ROW}\n1,2\n", "line 3: not a row"),
        (",".join(NEEDED[1:]) + "\n", "line 1: not the columns"),
        (",".join(COLUMNS) + f"\n{ROW.replace('0.25', 'half')}\n", "line 2: not a row.*half"),
        (b"\xff\xfe", "cannot be read"),
        (None, "cannot be read"),
    ],
)
def test_a_file_that_is_no_series_is_one_line(content: str | bytes | None, fault: str, tmp_path: Path) -> None:
    file = tmp_path / "series.csv"
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError, match=fault):
        read_series(file)


def test_a_series_of_an_older_version_is_read() -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "series.csv"
        old = ",".join(str(getattr(SAMPLE, name)) for name in NEEDED)
        file.write_text(",".join(NEEDED) + f"\n{old}\n")
        (sample,) = read_series(file)
    assert (sample.log_score, sample.sources, sample.error) == (SAMPLE.log_score, 0, math.hypot(0.5, 0.5))
    assert math.isnan(sample.entropy)


def test_the_sources_are_the_robots_behind_a_belief() -> None:
    """Of what is agreed in the exchange: those behind the consensus of each sub-team that it names."""

    def used(*names: str) -> list[Used]:
        return [Used(source=name, weight=1.0, age=0.0, entropy=1.0, how="independent") for name in names]

    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1", "r2"], "b": ["r3"]})
    for sub_team, level, names in (
        ("a", "consensus", ("r1", "r2", "r1")),
        ("b", "consensus", ("r3",)),
        ("a", "agreed", ("a", "b")),
        ("b", "agreed", ("r3", "r1")),  # of a joint
    ):
        consensus(instant, sub_team, level, "robot/r1", at(2, 2), used(*names))
    sources = {(s, level): instant.sources(level, "r1", s, "robot/r1") for s in "ab" for level in LEVELS}
    assert sources == {
        ("a", "solo"): {"r1"},
        ("b", "solo"): {"r1"},
        ("a", "consensus"): {"r1", "r2"},
        ("b", "consensus"): {"r3"},
        ("a", "agreed"): {"r1", "r2", "r3"},
        ("b", "agreed"): {"r1", "r3"},
    }
