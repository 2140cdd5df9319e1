"""A sweep: which runs there are, what is kept of them, and what is said of them."""

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.errors import UserError, extra
from blackboard.judge.files import table_file
from blackboard.judge.intervals import student
from blackboard.lab import __main__ as room
from blackboard.lab import parallel, sweep
from blackboard.lab.sweep_plan import label, parse_seeds, plan
from blackboard.lab.sweep_report import TRACKED, report, rows, text
from blackboard.lab.team import InProcessTeam
from blackboard.run.door import version
from tests.commands import call
from tests.files import ROOT

TINY = Scenario({
    "team": {"name": "t", "sub_teams": {"a": ["r1"], "b": ["r2"]}},
    "grid": {"shape": [12, 12]},
    "time": {"tick": 0.5, "seconds": 1.0},
    "world": {"objects": {"ball": {}}},
}, "tiny.toml")  # fmt: skip


@pytest.mark.parametrize(
    ("given", "seeds"), [("3", [3]), ("1..4", [1, 2, 3, 4]), ("9,1..3, 2", [1, 2, 3, 9]), ("5..5", [5])]
)
def test_seeds_are_numbers_and_ranges(given: str, seeds: list[int]) -> None:
    assert parse_seeds(given) == seeds


@pytest.mark.parametrize("given", ["", "4..1", "a", "1..", "-1", "1...3", "1,,2", "1..999999999"])
def test_seeds_that_are_none_are_one_line(given: str) -> None:
    with pytest.raises(UserError, match=r"^--seeds .*: give numbers and ranges, as 1\.\.20 or 1,5,9"):
        parse_seeds(given)


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (["board.rule"], "--set board.rule: say KEY=VALUE,VALUE"),
        (["board.rule="], "say KEY=VALUE,VALUE"),
        (["board.rule=a,,b"], "say KEY=VALUE,VALUE"),
        (["rule=linear"], "--set rule: no key of a section"),
        (["board rule=linear"], "no key of a section"),
        (["world.seed=1,2"], "--set world.seed=1,2: the seeds are --seeds, as --seeds 1,2"),
        (["world . 'seed'=1"], "the seeds are --seeds"),
        (["board.k=1", "board.k=2"], "--set board.k: given twice; give all values at once"),
        (["team.name.x=1"], "--set team.name.x: name is no table in tiny.toml"),
        (["board.rule=coperative"], "; did you mean cooperative?"),
        (["board.rule=best"], "tiny.toml: board.rule: 'best' is none of"),
        ([f"board.k={','.join(['1'] * 400)}", f"world.speed={','.join(['1'] * 400)}"], "160000 runs; at most 100000"),
    ],
)
def test_a_mistake_in_a_setting_is_one_line(sets: list[str], message: str) -> None:
    with pytest.raises(UserError) as error:
        plan(TINY, [1], sets)
    assert message in str(error.value)


def test_every_combination_runs_with_every_seed() -> None:
    planned = plan(TINY, [4, 7], ["board.rule=linear,coalition", "world.vision.gain=0.05,0.1"])
    assert [(job.seed, job.combination) for job in planned] == [(seed, n) for seed in (4, 7) for n in range(4)]
    assert len({job.key for job in planned}) == 8
    last = planned[-1]
    assert label(last.settings) == "board.rule=coalition world.vision.gain=0.1"
    assert last.scenario.board.rule == "coalition"
    assert last.scenario.tables["world"] == {"objects": {"ball": {}}, "vision": {"gain": 0.1}, "seed": 7}
    assert "vision" not in TINY.tables["world"]
    assert label(plan(TINY, [1], [])[0].settings) == "as it is"


def card(rmse: float, seed: int) -> dict[str, Any]:
    block: dict[str, Any] = {
        "n": 5,
        "rmse": rmse,
        "mean": rmse,
        "p95": rmse,
        "max": rmse,
        "entropy": 1.0,
        "log_score": -rmse,
    }
    block |= {"coverage": {"50": 0.5, "90": 0.9, "95": 0.99}}
    none = {**dict.fromkeys(block), "n": 0, "coverage": dict.fromkeys(("50", "90", "95"))}
    levels = ("solo", "consensus", "agreed")
    scores = {"robots": dict.fromkeys(levels, block), "objects": dict.fromkeys(levels, none)}
    return {
        "verdict": "PASS" if seed % 2 else "FAIL",
        "hash": f"h{seed}",
        "unit": "cell",
        "scores": scores,
        "cpu_s": 2.0,
    }


def test_means_have_intervals_and_differences_are_paired() -> None:
    planned = plan(TINY, range(1, 11), ["board.k=1,2"])
    cards = [card(job.seed / 10 + 0.25 * job.combination, job.seed) for job in planned]
    result = report(planned, cards, np.random.default_rng(1))
    first, second = result["combinations"]
    assert (first["runs"], first["passed"], first["cpu_s"], first["difference"]) == (10, 5, 2.0, {})
    rmse = first["scores"]["robots"]["agreed"]["rmse"]
    assert rmse["value"] == pytest.approx(0.55)
    half = student(9) * 0.30277 / 10**0.5  # what the bootstrap comes near to: the spread of 0.1, 0.2, ..., 1.0
    assert (rmse["low"], rmse["high"]) == pytest.approx((0.55 - half, 0.55 + half), rel=0.1)
    gap = second["difference"]["robots"]["agreed"]["rmse"]
    assert (gap["value"], gap["low"], gap["high"]) == pytest.approx((0.25, 0.25, 0.25))  # the seeds' spread drops out
    assert first["scores"]["robots"]["agreed"]["coverage_95"]["high"] <= 1.0
    assert second["difference"]["objects"]["agreed"]["rmse"] == {"value": None, "low": None, "high": None}
    assert first["hashes"] == {str(seed): f"h{seed}" for seed in range(1, 11)}
    assert json.loads(json.dumps(result)) == result
    lines = text(result).splitlines()
    assert "10 seeds" in lines[0]
    assert any(line.startswith("board.k=2") and "+0.250 [+0.250, +0.250]" in line for line in lines)


def test_tracks_of_unnamed_things_are_compared_in_pairs_too() -> None:
    planned = plan(TINY, range(1, 11), ["board.k=1,2"])
    cards = []
    for job in planned:
        gospa = job.seed / 10 + 0.5 * job.combination
        judged = dict.fromkeys(TRACKED, 1.0) | {"gospa": gospa, "existence": {"brier": 0.02}}
        cards.append({**card(1.0, job.seed), "tracks": {"person": judged} if job.seed < 10 else {}})
    result = report(planned, cards, np.random.default_rng(1))
    first, second = result["combinations"]
    assert first["tracks"]["person"]["gospa"]["value"] == pytest.approx(0.5), "the mean of nine seeds"
    assert first["tracks"]["person"]["brier"]["value"] == pytest.approx(0.02)
    assert first["tracks_difference"] == {}
    gap = second["tracks_difference"]["person"]["gospa"]
    assert (gap["value"], gap["low"], gap["high"]) == pytest.approx((0.5, 0.5, 0.5))
    assert json.loads(json.dumps(result)) == result
    assert any(line.startswith("tracks of person") and "GOSPA" in line for line in text(result).splitlines())
    names, table = rows(planned, cards)
    assert names["person_gospa"] == "float"
    assert table[0]["person_gospa"] == pytest.approx(0.1)
    assert math.isnan(table[-1]["person_gospa"])


def test_seeds_in_which_nothing_was_judged_are_told() -> None:
    planned = plan(TINY, range(1, 5), ["board.k=1,2"])
    cards = [card(1.0, job.seed) for job in planned]
    for job, each in zip(planned, cards, strict=True):
        judged = each["scores"]["robots"]["agreed"]
        some = not (job.combination and job.seed in {1, 3})
        each["scores"]["objects"] |= {"solo": judged, "agreed": judged if some else each["scores"]["objects"]["agreed"]}
    result = report(planned, cards, np.random.default_rng(1))
    first, second = result["combinations"]
    assert first["judged"]["objects"] == {"solo": 4, "consensus": 0, "agreed": 4}
    assert second["judged"]["objects"]["agreed"] == 2
    assert second["not_judged"]["objects"]["agreed"] == [1, 3]
    assert json.loads(json.dumps(result)) == result
    lines = [line for line in text(result).splitlines() if "of 4 seeds" in line]
    assert lines == ["objects, board.k=2: 2 of 4 seeds (in seeds 1, 3 none was agreed on)"]
    result["combinations"] = [{**second, "label": "as it is"}]
    assert text(result).endswith("\nobjects: 2 of 4 seeds (in seeds 1, 3 none was agreed on)")


def test_a_group_that_is_not_there_is_not_told() -> None:
    planned = plan(TINY, range(1, 3), [])
    result = report(planned, [card(1.0, job.seed) for job in planned], np.random.default_rng(1))
    assert "none was agreed on" not in text(result)


def test_the_table_has_a_column_for_each_setting(tmp_path: Path) -> None:
    planned = plan(TINY, [1, 2], ["board.rule=linear,coalition", "world.vision.gain=0.05,0.1"])
    columns, table = rows(planned, [card(1.0, job.seed) for job in planned])
    assert len(table) == 8 * 2 * 3
    with table_file(tmp_path / "x.csv", columns, "--table") as write:
        for each in table:
            write(each)
    head, first, *_ = (tmp_path / "x.csv").read_text().splitlines()
    assert head.startswith(
        "board_rule,world_vision_gain,seed,group,level,n,rmse,mean,p95,max,entropy,log_score,coverage_50"
    )
    assert first == "linear,0.05,1,robots,solo,5,1.0,1.0,1.0,1.0,1.0,-1.0,0.5,0.9,0.99,PASS,h1,2.0"
    assert math.isnan(table[3]["rmse"])


def test_a_run_is_the_team_of_its_scenario() -> None:
    (job,) = plan(TINY, [5], [])
    finished = sweep.run_one(job.key, job.scenario)
    expected = InProcessTeam(TINY.changed("world", seed=5)).run()
    assert finished["card"]["hash"] == expected["hash"]
    assert finished["card"]["scores"] == expected["scores"]
    assert finished["card"]["cpu_s"] > 0


def test_finished_runs_are_kept_and_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def run_jobs(function: Any, jobs: list[Any], progress: Any, keep: Any) -> list[Any]:
        finished = []
        for number, job in enumerate(jobs, 1):
            made.append(job[0])
            finished.append({"key": job[0], "version": version(), "card": card(1.0, 1)})
            keep(finished[-1])
            progress(number, len(jobs))
        return finished

    monkeypatch.setattr(parallel, "run_jobs", run_jobs)
    file, shown = tmp_path / "runs.jsonl", list[tuple[int, int]]()

    def go(seeds: range) -> list[str]:
        made.clear()
        planned = plan(TINY, seeds, [])
        with sweep.kept_runs(file) as (done, keep):
            cards = sweep.run_all(planned, done, keep, lambda *count: shown.append(count))
        assert len(cards) == len(planned)
        return list(made)

    assert len(go(range(1, 4))) == 3
    with file.open("a") as stream:
        stream.write('{"key": "killed while it wr')
    shown.clear()
    assert len(go(range(1, 6))) == 2
    assert shown == [(4, 5), (5, 5)]
    assert go(range(1, 6)) == []
    assert len(file.read_text().splitlines()) == 5
    old = [{**json.loads(line), "version": "0.0.0"} for line in file.read_text().splitlines()]
    file.write_text("".join(json.dumps(line) + "\n" for line in old))
    assert len(go(range(1, 6))) == 5  # of another version


@pytest.mark.parametrize("content", ["no JSON\n", "[1]\n", '{"key": "x"}\n'])
def test_a_file_of_something_else_is_one_line(tmp_path: Path, content: str) -> None:
    file = tmp_path / "x.jsonl"
    file.write_text(content)
    with pytest.raises(UserError, match=r"not a file of finished runs"), sweep.kept_runs(file):
        pass
    assert file.read_text() == content
    with pytest.raises(UserError, match=r"cannot be used"), sweep.kept_runs(tmp_path / "no" / "x.jsonl"):
        pass


def test_the_picture_has_a_dot_for_each_run(tmp_path: Path) -> None:
    drawing = pytest.importorskip("blackboard.lab.sweep_drawing", reason="needs the extra `plot`")
    planned = plan(TINY, range(1, 6), ["board.k=1,2"])
    cards = [card(job.seed / 10, job.seed) for job in planned]
    result = report(planned, cards, np.random.default_rng(1))
    figure = drawing.comparison(result, planned, cards)
    dots = [line for line in figure.axes[0].get_lines() if line.get_marker() == "."]
    assert [line.get_xdata()[0] for line in dots] == [cards[i]["scores"]["robots"]["agreed"]["rmse"] for i in range(10)]
    assert figure.get_suptitle().startswith("t, seeds 1..5 (dots)")
    drawing.draw_sweep(result, planned, cards, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sweep.png", "sweep.svg"]


@pytest.mark.parametrize("command", [("sweep",), ("demo",), ("up", "demo")])
def test_where_files_go_is_checked_before_the_first_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    def run(*_: object, **__: object) -> None:
        raise AssertionError("it ran")

    monkeypatch.setattr(room, "run_all", run)
    monkeypatch.setattr("blackboard.run.launch.run_scenario", run)
    file, table = tmp_path / "file", tmp_path / "x.csv"
    file.touch()
    table.mkdir()
    for flag, value, says in (
        ("--table", tmp_path / "no" / "x.csv", f"there is no folder {tmp_path}/no; make it, or choose another place"),
        ("--table", table, "is a folder; give the name of a file"),
        ("--plot", file, "is no folder; choose another place"),
        ("--plot", file / "below", f"{file} is no folder; choose another place"),
    ):
        if flag == "--plot":
            pytest.importorskip("matplotlib", reason="needs the extra `plot`")
        with pytest.raises(UserError) as error:
            call(*command, flag, value)
        assert str(error.value).startswith(f"{flag} {value}: ")
        assert says in str(error.value)


def test_where_a_wheel_was_installed_the_cure_names_what_the_extra_needs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The package is on no registry. An extra that takes in another one names what that one needs."""
    monkeypatch.setattr("blackboard.errors.__file__", str(tmp_path / "blackboard" / "errors.py"))
    for name, needs in (("record", ["mcap"]), ("table", ["mcap", "pyarrow"])):
        with pytest.raises(UserError) as error, extra(name, "it"):
            raise ModuleNotFoundError
        _, _, packages = str(error.value).partition(f"{sys.executable} -m pip install ")
        assert [re.sub(r"\W.*", "", package.strip("'")) for package in packages.split()] == needs


def test_without_the_extra_it_is_one_line_that_can_be_pasted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "blackboard.lab.sweep_drawing", None)
    monkeypatch.setitem(sys.modules, "blackboard.lab.run_drawing", None)
    monkeypatch.delattr("blackboard.lab.run_drawing", raising=False)
    cure = f"{sys.executable} -m pip install -e '{ROOT}[plot]'"  # this is a clone
    for command in ("sweep", "demo"):
        with pytest.raises(UserError) as error:
            call(command, "--plot", tmp_path / "pictures")
        assert str(error.value) == f"--plot needs the extra `plot`: {cure}"


def test_a_sweep_prints_its_result_before_it_writes_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()

    def run_all(planned: list[Any], *_: object) -> list[dict[str, Any]]:
        folder.rmdir()  # while it ran
        return [card(1.0, job.seed) for job in planned]

    monkeypatch.setattr(room, "run_all", run_all)
    with pytest.raises(UserError, match="--table"):
        call("sweep", "--seeds", "1..2", "--table", folder / "x.csv", "--json")
    assert json.loads(capsys.readouterr().out)["seeds"] == [1, 2]
