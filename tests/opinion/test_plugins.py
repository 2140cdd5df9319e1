"""Rules of users: by the decorator in one's own script, and by the entry point of an installed package."""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from blackboard import POOLS, plugins
from blackboard.config import load
from blackboard.errors import UserError
from blackboard.lab import comparison, tuning
from blackboard.lab.cases import GRID, TRIALS
from blackboard.opinion import laws, rules
from blackboard.opinion.averages import Linear
from blackboard.opinion.rules import Rule, find, read_rule, rule
from tests.files import page
from tests.opinion.stacks import make

PAGE = page("rules.md")
EXAMPLE = re.search(r"## A rule of your own.*?```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(autouse=True)
def registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers ends with it."""
    monkeypatch.setattr(rules, "REGISTRY", dict(rules.REGISTRY))


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path that holds an installed package with the page's example, and a broken plug-in."""
    assert EXAMPLE
    (tmp_path / "trimming.py").write_text(EXAMPLE[1])
    (tmp_path / "broken.py").write_text("import nothing_of_this_name\n")
    info = tmp_path / "trimming-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: trimming\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[cop_blackboard.pools]\ntrimmed = trimming:Trimmed\nbroken = broken:Broken\nalias = trimming:Trimmed\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield tmp_path
    sys.modules.pop("trimming", None)


def test_the_page_s_example_is_short_and_keeps_the_laws() -> None:
    assert EXAMPLE
    space: dict[str, object] = {"__name__": "own_script"}
    exec(compile(EXAMPLE[1], "own_script.py", "exec", dont_inherit=True), space)
    cls = find("trimmed")
    assert cls is space["Trimmed"]
    code = [line for line in EXAMPLE[1].splitlines() if line.strip() and not line.startswith(("import", "from"))]
    assert len(code) <= 12
    laws.check(read_rule({"rule": "trimmed"}), np.random.default_rng(1), repeats=3)
    opinions = make("random", 4, (6,), np.random.default_rng(1))
    assert POOLS["trimmed"](opinions, drop=1).sum() == pytest.approx(1.0)
    assert load("demo").with_rule("trimmed").board.in_force() == {"rule": "trimmed", "drop": 1.0}


def test_a_plug_in_is_loaded_when_its_name_is_looked_up(package: Path) -> None:
    assert "trimming" not in sys.modules
    assert "trimmed" in list(POOLS)
    assert "trimming" not in sys.modules, "listing the names loads nothing"
    scenario = load("demo").with_rule("trimmed").changed("board", drop=2)
    assert scenario.board.in_force() == {"rule": "trimmed", "drop": 2.0}
    assert "trimming" in sys.modules
    laws.check(read_rule({"rule": "trimmed"}), np.random.default_rng(1), repeats=1)


def test_the_lab_compares_a_plug_in_and_tune_tries_its_parameters(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = package / "trimming-1.dist-info" / "entry_points.txt"
    points.write_text("[cop_blackboard.pools]\ntrimmed = trimming:Trimmed\n")
    assert comparison.contenders(GRID)["trimmed"].in_force()["rule"] == "trimmed"
    assert tuning.spaces()["trimmed"] == {"drop": (0, 1, 2)}
    (case,) = (TRIALS["independent"](np.random.default_rng(1)) for _ in range(1))
    tried = tuning.try_all("trimmed", [[case]])
    assert tried.log_scores.shape == (1, 3)
    judged = comparison.judge([(0, [case])], {"x": read_rule({"rule": "trimmed", "drop": 2})}, lambda: 0.0)
    assert tried.log_scores[0, 2] == pytest.approx(judged["x"].score.log_scores[0])


def test_a_plug_in_that_cannot_be_loaded_is_named(package: Path) -> None:
    with pytest.raises(
        UserError, match=r"^plug-in 'broken' of cop_blackboard\.pools: broken:Broken cannot be loaded \(Module"
    ):
        load("demo").with_rule("broken")
    with pytest.raises(UserError, match=r"^plug-in 'alias' of .* which is no Rule of this name$"):
        find("alias")


def test_two_packages_with_one_name_are_both_named(package: Path) -> None:
    other = package / "other-1.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1\n")
    (other / "entry_points.txt").write_text("[cop_blackboard.pools]\ntrimmed = other:Trimmed\n")
    importlib.invalidate_caches()
    with pytest.raises(UserError, match="offered by other:Trimmed and trimming:Trimmed; uninstall all but one"):
        plugins.load(plugins.POOLS, "trimmed")
    assert plugins.load(plugins.LOCALIZERS, "trimmed") is None


def test_a_name_is_given_once() -> None:
    with pytest.raises(
        ValueError, match=r"rule 'linear' is already blackboard\.opinion\.averages\.Linear; choose another"
    ):

        @rule("linear")
        class Mine(Rule):
            pass

    assert find("linear") is Linear


def test_tuning_a_rule_without_anything_to_try_is_a_mistake() -> None:
    with pytest.raises(UserError, match="^--rule linear: nothing to tune; rules with .* are calibrated, coalition$"):
        tuning.space("linear")
