"""The laboratory as a person runs it, twice: the same table, the same figures to the byte, and the numbers of the same runs as processes."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.commands import blackboard
from tests.files import page
from tests.lab.sized import recorded, score
from tests.scenarios import SMALL_FILE


def without_time(report: dict[str, Any]) -> dict[str, Any]:
    for trial in report["trials"].values():
        for row in [*trial["rules"].values(), trial["best"]]:
            del row["ms"]
    return report


def test_the_lab_twice_with_one_seed_says_the_same(tmp_path: Path) -> None:
    small = str(tmp_path / "small.toml")
    Path(small).write_text(SMALL_FILE)
    picture = tmp_path / "lab.svg"
    arguments = ("lab", small, "--runs", "3", "--variants", "2", "--json", "--picture", str(picture))
    first, second = (blackboard(*arguments) for _ in range(2))
    assert first.returncode == 0, first.stderr
    assert [line.split(" (")[0] for line in first.stderr.splitlines()] == [f"lab: {n} of 5" for n in range(1, 6)]
    report = json.loads(first.stdout)
    assert without_time(report) == without_time(json.loads(second.stdout))
    assert len(report["trials"]) == 8  # five trials, the team, its robots, its objects
    assert report["trials"]["team scenario"]["runs"] == 2
    assert report["trials"]["team scenario"]["cases"] > 10
    assert picture.stat().st_size > 10_000


def test_a_sweep_has_the_numbers_of_the_same_runs_as_processes(tmp_path: Path) -> None:
    team = ("--robots", "2", "--seconds", "2", "--json")
    kept = tmp_path / "runs.jsonl"
    arguments = ("demo", "--seeds", "7", "--set", "board.rule=coalition,cooperative", "--runs", str(kept), *team)
    done = blackboard("sweep", *arguments)
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["combinations"]
    for sweep_run, rule in ((first, ()), (second, ("--rule", "cooperative", "--fusion", "joint"))):
        card = json.loads(blackboard("demo", "--seed", "7", *rule, *team).stdout)
        assert sweep_run["hashes"] == {"7": card["hash"]}
        assert sweep_run["scores"]["robots"]["agreed"]["rmse"]["value"] == card["scores"]["robots"]["agreed"]["rmse"]
    again = blackboard("sweep", *arguments)
    assert again.stdout == done.stdout
    assert (again.stderr, len(kept.read_text().splitlines())) == ("", 2)


def test_the_figures_twice_are_the_same_bytes(tmp_path: Path) -> None:
    small = ("--seeds", "2", "--robots", "3", "--grids", "20", "--grids", "30", "--seconds", "4", "--every", "2")
    said = []
    for name in ("first", "second"):
        done = blackboard("figures", "--out", str(tmp_path / name), *small, *(["--json"] if name == "first" else []))
        assert done.returncode == 0, done.stderr
        said.append(done.stdout)
    figures = json.loads(said[0])
    assert set(figures) == {"files", *(f"fig{n}" for n in range(1, 8))}
    *pictures, page = figures["files"]
    assert pictures == sorted(pictures, key=lambda name: (name[:-4], name[-4:] != ".svg"))
    assert [f'src="fig{n}.svg"' in Path(page).read_text() for n in range(1, 8)] == [True] * 7
    assert sorted(figures["files"]) == sorted(str(path) for path in (tmp_path / "first").iterdir())
    assert said[1].splitlines() == [name.replace("/first/", "/second/") for name in figures["files"]]
    files = sorted(path.name for path in (tmp_path / "first").iterdir())
    assert files == [*(f"fig{n}.{ending}" for n in range(1, 8) for ending in ("png", "svg")), "index.html"]
    for file in files:
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes(), file


def test_the_first_run_of_fig_7_is_the_one_that_the_pages_show() -> None:
    shown = {key: row for key, row in recorded().items() if key[2] == 0}
    assert score(0) == {key: pytest.approx(row, abs=2e-5) for key, row in shown.items()}


#: The rows of the pages' tables: how each begins there -> its rule.
OF_PAGE = {"linear": "linear", "logarithmic": "logarithmic", "cooperative": "cooperative",
           "coalition": "coalition", "median-log": "median-log"}  # fmt: skip
OF_NOTE = {"geometric mean": "geometric", "chernoff": "chernoff", "hoelder": "hoelder", "harmonic": "harmonic",
           "calibrated": "calibrated", "coalition": "coalition product", "geometric median": "geometric-median",
           "clique": "clique", "product": "channel-filter"}  # fmt: skip


def test_the_tables_of_the_page_and_its_note_are_what_the_lab_prints() -> None:
    """docs/paper.md: log score / coverage of the 95 % regions, and the median error where a source lies."""
    done = blackboard("lab", "--json")
    assert done.returncode == 0, done.stderr
    trials = json.loads(done.stdout)["trials"].values()
    told = []
    for name, rules in (("paper.md", OF_PAGE), ("notes/paper.md", OF_NOTE)):
        table = page(name).split("## All rules on the same opinions")[1].split("##")[0]
        rows = re.findall(r"^\| ([^|]+) \|(.*-\d.*)\|$", table, re.MULTILINE)
        assert len(rows) == len(rules)
        for (row, numbers), (begin, rule) in zip(rows, rules.items(), strict=True):
            assert row.strip("*").startswith(begin)
            told.append((rule, [[float(n) for n in re.findall(r"-?[\d.]+", cell)] for cell in numbers.split("|")]))
    for rule, cells in told:
        for trial, cell in zip(trials, cells, strict=True):
            printed = [trial["rules"][rule][name]["value"] for name in ("log_score", "coverage_95", "median")]
            assert cell[0] == pytest.approx(printed[0], abs=0.051 if cell[0] < -10 else 0.0051)
            assert cell[1] == pytest.approx(printed[1], abs=0.0051)
            assert cell[2:] == pytest.approx(printed[2:][: len(cell) - 2], abs=0.051)
