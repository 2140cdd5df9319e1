"""The page's own code for frames and contours, run by Node.js where there is one: it reads what the server writes."""

import json
import shutil
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blackboard.view.frame import frame, line
from blackboard.wire.arrays import unpack
from tests.files import ROOT
from tests.present import present
from tests.view.recorded import team_of, within
from tests.view.screenshots import of_page

NODE = shutil.which("node")
SCRIPT = """
import { readFileSync } from "node:fs";
import { Cache, History, best, coverage, decode, lineOf } from "./frames.mjs";
import { contour, peak } from "./draw.mjs";
const read = (name) => { const it = readFileSync(name); return it.buffer.slice(it.byteOffset, it.byteOffset + it.length); };
const past = JSON.parse(readFileSync("past.json"));
const headers = past.lines.map((_, n) => decode(read(`${n}.bin`)));
const found = headers.map((header) => {
  const subjects = {};
  for (const [name, it] of Object.entries(header.subjects)) {
    const belief = best(it);
    subjects[name] = { peak: peak(belief), contour: contour(belief), level: belief.levels[0] };
  }
  return { tick: header.tick, subjects };
});
const history = new History(), late = new History(), cache = new Cache(10);
history.extend(past);
for (const n of [2, 0, 2, 1]) late.add(lineOf(headers[n]));
for (const n of [1, 2, 3]) cache.put(n, new ArrayBuffer(4));
const ticks = history.moments.map((it) => it.tick), shares = coverage(history.moments, "robot/r1");
const places = [history.index(2), history.before(0.9), history.index(-5)];
history.drop(1);
const rest = history.moments.map((it) => it.tick);
history.add({ run: "another", tick: 0, time: 0, subjects: {} });
console.log(JSON.stringify({ found, ticks, places, rest, anew: history.moments.length, asked: history.asked, coverage: shares,
  late: late.moments, lines: past.lines.slice(0, 3), kept: [...cache.kept.keys()] }));
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the page's code makes of the frames of a run."""
    if NODE is None:
        pytest.skip("no Node.js on this machine")
    folder: Path = tmp_path_factory.mktemp("page")
    for name in ("frames", "draw"):
        text = resources.files("blackboard.view.web").joinpath("page", f"{name}.js").read_text(encoding="utf-8")
        (folder / f"{name}.mjs").write_text(text, encoding="utf-8")
    team = team_of()
    for n, moment in enumerate(team.moments):
        (folder / f"{n}.bin").write_bytes(frame(team, moment, n, 0.0))
    lines = [line(moment) for moment in team.moments]
    (folder / "past.json").write_text(json.dumps({"first": 0, "made": len(lines), "lines": lines}))
    (folder / "run.mjs").write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run([NODE, "run.mjs"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page_values: dict[str, Any] = json.loads(done.stdout)
    return page_values


def test_the_history_has_each_moment_once_in_order(page: dict[str, Any]) -> None:
    ticks = [moment.tick for moment in team_of().moments]
    assert page["ticks"] == ticks
    assert page["places"] == [ticks.index(2), 1, 0]  # of tick 2, of 0.9 s (a tick has 0.5 s), and of none
    assert page["rest"] == [tick for tick in ticks if tick > 1]
    assert (page["anew"], page["asked"]) == (1, 0)


def test_the_line_of_a_frame_is_the_server_s(page: dict[str, Any]) -> None:
    assert page["late"] == page["lines"]


def test_the_cache_keeps_to_its_bytes(page: dict[str, Any]) -> None:
    assert page["kept"] == [2, 3]


def test_the_peak_is_the_peak_of_what_was_agreed(page: dict[str, Any]) -> None:
    for moment, shown in zip(team_of().moments, page["found"], strict=True):
        assert shown["tick"] == moment.tick
        for name, about in moment.subjects.items():
            p = unpack(present(about.best).message.belief).p
            assert p[tuple(shown["subjects"][name]["peak"])] == p.max()


def test_the_contour_parts_the_cells_inside_from_those_outside(page: dict[str, Any]) -> None:
    """Cells clearly denser than the edge of the 95 % region are within the contour, those clearly fainter are not."""
    for moment, shown in zip(team_of().moments, page["found"], strict=True):
        for name, about in moment.subjects.items():
            drawn = present(present(about.best).drawn)
            pieces = np.array(shown["subjects"][name]["contour"])
            levels = np.frombuffer(drawn.levels, np.uint8).reshape(drawn.box)
            for i, j in np.ndindex(*drawn.box):
                if abs(float(levels[i, j]) - drawn.edge) > 2:
                    cell = (drawn.lo[0] + i + 0.5, drawn.lo[1] + j + 0.5)
                    assert within(pieces, *cell) == (levels[i, j] > drawn.edge), (name, i, j)


def test_coverage_is_the_running_share(page: dict[str, Any]) -> None:
    held = [moment.subjects["robot/r1"].scores["agreed"].held for moment in team_of().moments]
    assert page["coverage"] == pytest.approx([np.mean(held[: n + 1]) for n in range(len(held))], rel=1e-4)


def test_the_picture_in_the_readme_is_of_this_page() -> None:
    """If not: `make screenshots`."""
    assert of_page() in (ROOT / "docs" / "view.png").read_bytes()
