"""Which localizers there are: the package's own, a script's, and those of installed packages."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from blackboard import plugins
from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Sighting
from examples.own_localizer import kalman, main
from robot_agent.config import RobotSection
from robot_agent.estimator import Estimator
from robot_agent.localizer import Localizer
from robot_agent.localizers import known_localizers, localizer, localizer_factory
from robot_agent.pose import PoseLocalizer
from robot_agent.position import PositionLocalizer
from robot_agent.sensing import TickMotion
from tests.robot_agent.robots import measured

GRID = Grid((40, 36), 0.1, (-2.0, -1.8), "m")


def named(name: str) -> RobotSection:
    return Scenario({"robot": {"localizer": name}}, "it.toml").section("robot", RobotSection)


def test_the_packages_own_are_found_by_name() -> None:
    assert {"pose", "position"} <= set(known_localizers())
    assert isinstance(Estimator.begin(named("position"), GRID, "r1").localizer, PositionLocalizer)
    assert isinstance(Estimator.begin(named("pose"), GRID, "r1").localizer, PoseLocalizer)


def test_an_unknown_name_is_a_mistake_that_names_the_known_ones() -> None:
    known = ", ".join(known_localizers())
    with pytest.raises(UserError, match=rf"it\.toml: robot\.localizer: .*no localizer of this name.*{known}"):
        named("gps")
    with pytest.raises(UserError, match=rf"robot\.localizer: no localizer 'gps'; known are {known}"):
        localizer_factory("gps")


def test_a_script_registers_its_own() -> None:
    @localizer("begins near the origin")
    def begin(settings: RobotSection, grid: Grid) -> PositionLocalizer:
        unknown = PositionLocalizer.unknown(settings, grid)
        return unknown.update_with_fix(Fix(position=(0.55, 0.55), sigma=0.1))

    estimator = Estimator.begin(named("begins near the origin"), GRID, "r1")
    readings = measured(0, compass=0.0)
    assert estimator.advance(readings).localizer.marginal().mean() == pytest.approx((0.55, 0.55), abs=0.01)
    assert "begins near the origin" in known_localizers()


def test_the_example_from_scratch_is_a_localizer() -> None:
    unknown = kalman(named("kalman"), GRID)
    assert isinstance(unknown, Localizer)
    assert unknown.covariance == pytest.approx(np.diag([4.0**2, 3.6**2]) / 12)
    robot = unknown.update_with_fix(Fix(position=(-1.0, 0.0), sigma=0.2, heading=0.0))
    assert robot.marginal().mean() == pytest.approx((-1.0, 0.0), abs=0.05)
    assert robot.entropy() == pytest.approx(entropy(robot.marginal().p), abs=0.05)
    driven = robot.predict(TickMotion(0.5, 0.0, 1.0, 0.01, 0.03, 0.0), compass=None)
    assert driven.mean - robot.mean == pytest.approx((0.5, 0.0))
    assert driven.covariance - robot.covariance == pytest.approx(np.diag([0.01, 0.03]))
    landmark = Sighting(subject="landmark/1", range=1.0, bearing=math.pi / 2)
    seen = driven.update_with_sighting(landmark, None, np.array([-0.3, 1.0]), np.zeros((2, 2)))
    assert driven.mean[0] < seen.mean[0] < -0.3
    assert seen.entropy() < driven.entropy() < driven.tempered(0.5).entropy()
    assert driven.project(landmark, None).mean() == pytest.approx(driven.mean + (0.0, 1.0), abs=0.05)
    agreed = gaussian(GRID, (-0.2, 0.1), 0.15)
    assert driven.fold(agreed, driven.marginal()).marginal().mean() == pytest.approx((-0.2, 0.1), abs=0.02)


def test_a_name_is_given_once() -> None:
    localizer("twice")(PoseLocalizer.unknown)
    for name in ("pose", "twice"):
        with pytest.raises(ValueError, match=f"localizer '{name}' is already there; choose another"):
            localizer(name)(PositionLocalizer.unknown)


def test_what_lacks_a_method_is_a_mistake() -> None:
    @localizer("half")
    @dataclass
    class Half:
        settings: RobotSection
        grid: Grid

        def predict(self, motion: TickMotion, compass: float | None) -> "Half":
            return self

    with pytest.raises(UserError, match=r"robot\.localizer: 'half' makes a Half, which has not all methods of .*; add"):
        Estimator.begin(named("half"), GRID, "r1")


def install(folder: Path, name: str, value: str) -> None:
    """A package with one entry point, as an installer leaves it."""
    info = folder / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{plugins.LOCALIZERS}]\n{name} = {value}\n")
    (folder / "their_robot.py").write_text(
        "from robot_agent.position import PositionLocalizer\nclass Theirs(PositionLocalizer): pass\n"
    )


def test_an_installed_package_offers_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, "theirs", "their_robot:Theirs.unknown")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert {"pose", "position", "theirs"} <= set(known_localizers())
    assert type(Estimator.begin(named("theirs"), GRID, "r1").localizer).__name__ == "Theirs"


@pytest.mark.parametrize("value", ["no_such_module:Theirs", "their_robot:Nothing"])
def test_an_installed_package_that_fails_to_load_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str
) -> None:
    install(tmp_path, "theirs", value)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UserError, match=rf"plug-in 'theirs' of .*: {value} cannot be loaded .*; mend or uninstall"):
        Estimator.begin(named("theirs"), GRID, "r1")


def test_the_example_runs_the_demo_with_its_own_localizer_and_with_the_package_s(
    capsys: pytest.CaptureFixture[str],
) -> None:
    main(seconds=2.0)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["kalman", "position"]
    assert all(re.search(r"solo \d+\.\d\d, agreed \d+\.\d\d cell$", line) for line in lines)
