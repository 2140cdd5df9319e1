"""What the package tells other programs about itself: its version, and that it is typed."""

import re
import subprocess
import sys
from importlib import resources
from importlib.metadata import version

import pytest

import blackboard
from tests.files import ROOT
from tests.rooms import PACKAGES, loaded_by


def test_the_version_is_the_one_of_the_metadata() -> None:
    assert blackboard.__version__ == version("cop-blackboard")


def test_the_newest_release_of_the_changelog_is_this_version() -> None:
    (declared,) = re.findall(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    heads = re.findall(r"^## \[(.+?)\](?: - (.+))?$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert heads[0] == ("Unreleased", "")
    assert heads[1][0] == declared
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", date) for _, date in heads[1:])


def test_each_change_is_one_line_of_the_changelog() -> None:
    _, *lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").partition("## [Unreleased]")[2].splitlines()
    assert [line for line in lines if line and not line.startswith(("- ", "## [", "### "))] == []


def test_reading_the_metadata_waits_until_it_is_asked_for() -> None:
    """`import blackboard` loads neither the metadata nor the entry points of plug-ins, which `importlib.metadata` reads."""
    assert "importlib.metadata" not in loaded_by("blackboard")


def test_beliefs_and_the_client_wait_until_they_are_asked_for() -> None:
    code = "import sys, blackboard; before = set(sys.modules); blackboard.Belief; print(*before); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    before, after = (set(line.split()) for line in done.stdout.splitlines())
    late = {"blackboard.client", "zenoh", "pydantic"}
    assert not (late | {"blackboard.opinion.belief"}) & before
    assert "blackboard.opinion.belief" in after
    assert not late & after


def test_other_names_are_missing_as_usual() -> None:
    with pytest.raises(AttributeError, match="no attribute 'version'"):
        blackboard.version  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_are_told_that_it_is_typed(package: str) -> None:
    assert (resources.files(package) / "py.typed").is_file()


def test_no_symbolic_link_is_part_of_the_sources() -> None:
    """A clone on another machine has nothing where a link points, and on this one `make` would install there."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    listed = subprocess.run(["git", "ls-files", "--stage"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert [line for line in listed.splitlines() if line.startswith("120000")] == []


def test_make_help_lists_every_target() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (phony,) = re.findall(r"^\.PHONY: (.+)$", makefile, re.MULTILINE)
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    assert set(phony.split()) == targets
    command = ["make", "--no-print-directory", "help"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert {line.split()[1] for line in done.stdout.splitlines()} == targets


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_printed_for_a_shell(shell: str) -> None:
    command = [sys.executable, "-m", "blackboard", "completion", shell]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    for word in ("demo", "--seconds", "tune", "--variants", "blackboard"):
        assert word in done.stdout
    if shell == "bash":
        subprocess.run(["bash", "-n"], input=done.stdout, text=True, check=True)


def test_every_file_and_target_that_contributing_names_is_there() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = set(re.findall(r"(?<![\w/.])((?:docs|tests|blackboard|robot_agent|sim_world|\.ci)/[\w./-]*\w/?)", page))
    assert len(named) > 15
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`?make ([a-z-]+)`", page):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    prose = re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL)  # the page without its code blocks
    assert len(prose.splitlines()) < 80


def test_the_rules_are_known_to_whoever_reads_a_scenario_and_nothing_else() -> None:
    """`import blackboard` loads no rule by itself, and a scenario names one."""
    code = (
        "import blackboard, sys\n"
        "assert 'numpy' not in sys.modules\n"
        "from blackboard.opinion.rules import find, names\n"
        "print(find('coalition').name, *names())"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[:3] == ["coalition", "linear", "logarithmic"]
