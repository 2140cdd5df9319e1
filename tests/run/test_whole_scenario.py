"""Mistakes that only the whole scenario shows: a launcher tells them before anything starts, a process started alone does not."""

from pathlib import Path
from typing import Any

import pytest

import blackboard.__main__
from blackboard.errors import UserError
from blackboard.run import door, launch

OBJECTS = "[world.objects]\nball = {}\ncan = {}\n"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What would have been started: a team, or a service by its name."""
    names: list[str] = []

    def run_scenario(*_: object, **__: object) -> tuple[int, dict[str, Any]]:
        names.append("team")
        return 0, {}

    monkeypatch.setattr(launch, "run_scenario", run_scenario)
    monkeypatch.setattr(door, "serve", lambda service, name, flags, **_: names.append(name))
    return names


def call(*arguments: str) -> None:
    command, bound, _ = blackboard.__main__.app.parse_args(arguments, exit_on_error=False, print_error=False)
    command(*bound.args, **bound.kwargs)


def scenario(folder: Path, text: str) -> str:
    file = folder / "mine.toml"
    file.write_text(text)
    return str(file)


def drifts(text: str, world: str = OBJECTS) -> str:
    return f"[board]\nobjects_drifts = {{ {text} }}\n{world}"


RULES = '[board.subjects."object/bal"]\nindependence = 1\n[board.subjects."object/*"]\ngate = 3\n'


@pytest.mark.parametrize(
    ("text", "wrong", "cure"),
    [
        (drifts("can = 0.1, cn = 0.1"), "objects_drifts.cn", "; did you mean can?; it has ball, can"),
        (drifts("zzz = 0.1"), "objects_drifts.zzz", "; it has ball, can"),
        # the objects that a world has by itself
        (drifts("cn = 0.1", ""), "objects_drifts.cn", "; did you mean can?; it has ball, can"),
        (drifts("can = 0.1", "[world]\nobjects = {}\n"), "objects_drifts.can", "; it has none"),
        (RULES, "subjects.object/bal", "; did you mean ball?; it has ball, can"),
    ],
)
def test_the_drift_or_rule_of_an_object_that_the_world_does_not_have_is_told_in_one_line(
    text: str, wrong: str, cure: str, tmp_path: Path, started: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    file = scenario(tmp_path, text)
    call("up", file, "--json")
    assert caplog.messages == [f"{file}: board.{wrong}: the world has no such object{cure}"]
    assert started == ["team"]  # a robot may report what is not of this world


@pytest.mark.parametrize("text", [drifts("can = 0.1"), "[board]\nmax_age = 2\n"])
def test_an_object_of_the_world_and_a_short_memory_of_robots_without_a_budget_are_no_mistake(
    text: str, tmp_path: Path, started: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    call("up", scenario(tmp_path, text), "--json")
    assert started == ["team"]
    assert caplog.messages == []


def test_a_recording_names_no_objects_and_a_board_alone_reads_no_world(tmp_path: Path, started: list[str]) -> None:
    call("up", scenario(tmp_path, drifts("box = 0.1", f"[world]\nkind = 'mrclam'\ndir = '{tmp_path}'\n")), "--json")
    call("serve", "--sub-team", "a", "--scenario", scenario(tmp_path, drifts("cn = 0.1")))
    assert started == ["team", "board-a"]


@pytest.mark.parametrize(
    ("text", "cure"),
    [
        ('[team]\nsub_teams = { a = ["r1", "r1"] }\n', "team.sub_teams: r1 is in sub-team a more than once"),
        ("[team]\nsub_teams = { a = [] }\n", "team.sub_teams: no robot in any sub-team; name one at least"),
        ('[world]\nlost = ["r7"]\n', "world.lost: r7: no sub-team has such a robot; known are r1, r2, r3"),
        (
            "[robot.send]\nbudget = 1000\nlongest = 20\n",
            "robot.send.longest: boards forget what is older than board.max_age, 10 s; give less, not 20",
        ),
        (
            "[robot.send]\nrate = 1\n",
            "robot.send.rate: 1 messages a second of 3 robots are less than one of each in robot.send.longest, 4 s; "
            "give at least 1.05",
        ),
    ],
)
def test_names_and_times_that_do_not_fit_together_are_told_in_one_line(
    text: str, cure: str, tmp_path: Path, started: list[str]
) -> None:
    file = scenario(tmp_path, text)
    with pytest.raises(UserError) as error:
        call("up", file, "--json")
    assert str(error.value).startswith(f"{file}: {cure}")
    assert started == []


def test_a_process_of_a_sub_team_that_its_scenario_lacks_says_so_and_starts(
    started: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    call("serve", "--sub-team", "a", "--scenario", "demo")
    assert caplog.messages == []
    call("serve", "--sub-team", "bb", "--scenario", "demo")
    assert caplog.messages == ["demo (shipped) has no sub-team bb; did you mean b?; it has a, b"]
    call("serve", "--sub-team", "zz")
    assert len(caplog.messages) == 1
    assert started == ["board-a", "board-bb", "board-zz"]
