"""Which localizers there are: the package's own, a script's, and those of installed packages."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from blackboard import plugins
from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.opinion.grid import Grid
from blackboard.wire.messages import Fix, Readings
from robot_agent.config import RobotSection
from robot_agent.estimator import Estimator
from robot_agent.localizers import known_localizers, localizer, localizer_factory
from robot_agent.pose import PoseLocalizer
from robot_agent.position import PositionLocalizer
from robot_agent.sensing import TickMotion

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
    readings = Readings(run="x", robot="r1", tick=0, time=0.0, odometry=None, compass=0.0, fix=None, sightings=[])
    assert estimator.advance(readings).localizer.marginal().mean() == pytest.approx((0.55, 0.55), abs=0.01)
    assert "begins near the origin" in known_localizers()


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
