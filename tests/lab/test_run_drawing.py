"""The pictures of a run: what is in them, and that the same samples give the same bytes."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blackboard.errors import RunFailed
from blackboard.judge.samples import Sample

drawing = pytest.importorskip("blackboard.lab.run_drawing", reason="needs the extra `plot`")

ONE = Sample(
    1, 0.2, "r1", "a", "robot/r1", "agreed", 1.0, 2.0, 1.5, 2.5, -1.0, 0.25, 0.01, 4.0, math.inf,
    error=0.5, entropy=2.0, sources=2, var_x=4.0, cov_xy=0.0, var_y=1.0,
)  # fmt: skip


def samples() -> list[Sample]:
    return [
        replace(
            ONE, tick=tick, time=tick / 5, subject=subject, level=level, robot=robot, mean_x=tick / 7, error=tick / 9
        )
        for tick in range(1, 101)
        for subject, robot in (("robot/r1", "r1"), ("object/ball", "r1"), ("object/ball", "r2"))
        for level in ("solo", "consensus", "agreed")
    ]


def test_the_files_are_listed_and_the_same_each_time(tmp_path: Path) -> None:
    files = drawing.draw_run(samples(), "cell", tmp_path / "one", "demo, seed 1")
    again = drawing.draw_run(samples(), "cell", tmp_path / "two", "demo, seed 1")
    assert [file.name for file in files] == [
        "over-time.svg", "over-time.png", "trajectories.svg", "trajectories.png"
    ]  # fmt: skip
    for file, other in zip(files, again, strict=True):
        assert file.read_bytes() == other.read_bytes()


def test_over_time_there_is_a_line_for_each_level_of_robots_and_objects() -> None:
    figure = drawing.over_time(samples(), "cell", "demo, seed 1")
    assert [axis.get_ylabel() for axis in figure.axes if axis.get_ylabel()] == [
        "RMS error [cell]", "95 % region [cell²]", "entropy [nats]", "in the 95 % region"
    ]  # fmt: skip
    first = figure.axes[0].get_lines()
    assert [line.get_label() for line in first] == ["solo", "consensus", "agreed"]
    np.testing.assert_allclose(first[0].get_xdata(), np.arange(1, 21))
    np.testing.assert_allclose(first[0].get_ydata()[0], np.sqrt(np.mean([(t / 9) ** 2 for t in range(1, 6)])))
    covered = figure.axes[6].get_lines()[0]
    np.testing.assert_allclose(covered.get_xdata(), [10, 20])
    np.testing.assert_allclose(covered.get_ydata(), [1, 1])
    assert figure.get_suptitle() == "demo, seed 1"


def test_a_share_has_an_interval_where_there_are_blocks_enough() -> None:
    two, four = ([replace(ONE, time=time, region=region) for time in range(1, last + 1) for region in (0.1, 0.99)]
                 for last in (20, 40))  # fmt: skip
    assert drawing.coverage(two) == "0.50"
    share, low, high = map(float, drawing.coverage(four).replace("[", "").replace(",", "").replace("]", "").split())
    assert 0 < low < share == 0.5 < high < 1


def test_a_way_has_one_sample_a_tick_and_ellipses() -> None:
    way = drawing.agreed_way(samples(), "object/ball")
    assert [sample.tick for sample in way] == list(range(1, 101))
    figure = drawing.trajectories(samples(), "m", "demo, seed 1")
    assert [axis.get_title() for axis in figure.axes if axis.get_visible()] == ["robot/r1", "object/ball"]
    assert len(figure.axes[0].patches) >= drawing.ELLIPSES
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["truth", "agreed", "95 % of what is agreed"]


def test_an_ellipse_holds_95_percent_of_the_gaussian() -> None:
    shape = drawing.ellipse(replace(ONE, var_x=4.0, cov_xy=1.2, var_y=1.0))
    covariance = np.array([[4.0, 1.2], [1.2, 1.0]])
    points = np.random.default_rng(1).multivariate_normal((ONE.mean_x, ONE.mean_y), covariance, 4000)
    angle = np.radians(shape.angle)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    away = (points - np.array(shape.center)) @ turn.T / (np.array([shape.width, shape.height]) / 2)
    assert np.mean((away**2).sum(axis=1) <= 1) == pytest.approx(0.95, abs=0.012)


def test_without_samples_there_is_nothing_to_draw(tmp_path: Path) -> None:
    with pytest.raises(RunFailed, match="no samples"):
        drawing.draw_run([], "cell", tmp_path, "demo")
