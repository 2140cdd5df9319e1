"""The door of the bench: `blackboard score` runs a recorded team, protocol by protocol, and shows what each fusion was worth."""

import csv
import io
import json
import logging
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from blackboard.config import Scenario
from blackboard.config.protocols import FAMILIES, PROTOCOLS
from blackboard.config.world import WorldSection
from blackboard.errors import UserError, extra, writing
from blackboard.judge.files import ENDINGS, check_table, table_file
from blackboard.judge.samples import COLUMNS, read_series
from blackboard.lab import bench
from blackboard.lab.comparison import IDEAL
from blackboard.lab.ideal import ideal_samples
from blackboard.run.flags import OutputFlags, RecordingFlags, TeamFlags
from blackboard.run.launch import run_scenario
from blackboard.run.progress import progress

log = logging.getLogger(__name__)

#: The columns of `--table`: a sample with the protocol and the way (`bench.DEFINITIONS`) that it comes from.
SCORED = {"protocol": "str", "way": "str", **COLUMNS}


def score(
    *,
    recording: RecordingFlags = RecordingFlags(),
    seconds: float | None = None,
    runs: Path | None = None,
    table: Path | None = None,
    summary: Path | None = None,
    pictures: Path | None = None,
    output: OutputFlags = OutputFlags(),
) -> int:
    """Run a recorded team in lockstep, once for each protocol and fusion, and score every robot and the team.

    Beside them stands the ideal: one filter with the readings of all robots, for each protocol.

    The exit status is 1 if a run did not reach its last tick, else 0 whatever the scores are.

    Parameters
    ----------
    seconds
        Length of a run, in seconds of team time [default: the scenario's].
    runs
        Keep the samples and scorecards of the runs in this folder. Without --mrclam, judge the runs that are there.
    table
        Also write every sample of every run, by protocol, way, tick, subject and level: .csv, .jsonl or .parquet
        (docs/fields.md).
    summary
        Also write what is shown into this file: Markdown, or CSV if its name ends in .csv.
    pictures
        Also draw trajectories, errors and areas of each protocol into this folder (extra `plot`).
    """
    drawing = _drawing() if pictures is not None else None
    _check(table, summary)
    if recording.mrclam is None and runs is None:
        raise UserError("--mrclam: which recording is to be replayed? give its folder, in MRCLAM format")
    finished = kept_runs(runs) if recording.mrclam is None and runs is not None else new_runs(recording, seconds, runs)
    if table is not None:
        write_samples(table, finished)
    finished += families(finished)
    told = bench.report(finished)
    if summary is not None:
        _write(summary, bench.markdown(told) if summary.suffix == ".md" else _csv(told))
    if drawing is not None and pictures is not None:
        _draw(drawing, finished, pictures)
    output.show(told, bench.text)
    return 0 if all(run.complete for run in finished) else 1


def _check(table: Path | None, summary: Path | None) -> None:
    """UserError: a file with an ending that is not written."""
    if summary is not None and summary.suffix not in (".md", ".csv"):
        raise UserError(f"--summary {summary}: it is written as .md or .csv; choose one of these endings")
    if table is not None and table.suffix == ".md":
        raise UserError(f"--table {table}: samples are written as {', '.join(ENDINGS)}; what is shown is --summary")
    if table is not None:
        check_table(table, "--table")


def _draw(drawing: ModuleType, runs: Sequence[bench.Run], folder: Path) -> None:
    for name in dict.fromkeys(run.protocol for run in runs if run.protocol not in FAMILIES):
        for what, figure in drawing.protocol(name, [run for run in runs if run.protocol == name]).items():
            drawing.save(figure, folder / f"{name}-{what}.png")


def scenarios(recording: RecordingFlags, seconds: float | None) -> list[tuple[str, str, Scenario]]:
    """Protocol, fusion and scenario of every run; `all` is every protocol that is in no family. UserError: no such protocol."""
    asked = recording.protocol
    names = list(PROTOCOLS) if asked == "all" else list(FAMILIES.get(asked or "", [asked]))
    chosen = []
    for name in names:
        one = replace(recording, protocol=name).scenario().changed("time", seconds=seconds)
        _ = one.time
        for fusion in bench.RUNS:
            protocol = one.section("world", WorldSection).protocol
            run = one if fusion == IDEAL else TeamFlags(fusion=fusion).apply(one)  # type: ignore[arg-type]
            chosen.append((protocol, fusion, run))
    return chosen


def new_runs(recording: RecordingFlags, seconds: float | None, keep: Path | None) -> list[bench.Run]:
    """Run every protocol and fusion, one after the other, each as processes of its own; the ideal in this one."""
    todo = scenarios(recording, seconds)
    finished = []
    with progress("score") as show, _folder(keep) as folder:
        done, total = 0, sum(one.time.ticks for _, fusion, one in todo if fusion != IDEAL)
        for number, (protocol, fusion, one) in enumerate(todo, 1):
            log.info("run %d of %d: %s, %s", number, len(todo), protocol, fusion)
            series = folder / f"{protocol}-{fusion}.csv"
            series.with_suffix(".json").unlink(missing_ok=True)  # a run counts once this is there
            card = None
            if fusion == IDEAL:
                with table_file(series, COLUMNS, "--runs") as write:
                    for sample in ideal_samples(one):
                        write(vars(sample))
            else:
                _, card = run_scenario(one, _moving(show, done, total), series=series)
                done += one.time.ticks
            world = one.section("world", WorldSection)
            kept = {"recording": world.dir, "start": world.start, "asked_ticks": one.time.ticks, "card": card}
            _write(series.with_suffix(".json"), json.dumps(kept) + "\n")
            finished.append(_read_run(series))
    return finished


def kept_runs(folder: Path) -> list[bench.Run]:
    """The runs that `new_runs` kept in a folder and that ended, in the order of the protocols.

    UserError: there are none, or they do not belong together.
    """
    names = [*PROTOCOLS, *(name for family in FAMILIES.values() for name in family)]
    files = [folder / f"{protocol}-{fusion}.csv" for protocol in names for fusion in bench.RUNS]
    finished = [_read_run(file) for file in files if file.with_suffix(".json").is_file()]
    if not finished:
        raise UserError(f"--runs {folder}: no runs are kept there; give --mrclam DIR to make some")
    if len({(run.recording, run.start) for run in finished}) > 1:
        raise UserError(f"--runs {folder}: runs of several recordings or starts; keep each in a folder of its own")
    return finished


def _read_run(series: Path) -> bench.Run:
    protocol, _, fusion = series.stem.rpartition("-")
    file = series.with_suffix(".json")
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
        about = {key: kept[key] for key in ("card", "asked_ticks", "recording", "start")}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{file}: not what a run left ({error}); run it again, with --mrclam") from error
    return bench.Run(protocol, fusion, read_series(series), **about)


def write_samples(file: Path, runs: Sequence[bench.Run]) -> None:
    """Write the samples of all runs, each with its protocol and way, by the ending of `file`. UserError: it cannot be written."""
    with table_file(file, SCORED, "--table") as write:
        for run in runs:
            for sample in run.samples:
                write({"protocol": run.protocol, "way": bench.way_of(run.fusion, sample.level), **vars(sample)})


def families(runs: list[bench.Run]) -> list[bench.Run]:
    """For each family of protocols with more than one run: its runs together, by fusion."""
    families = []
    for name, family in FAMILIES.items():
        for fusion in bench.RUNS:
            mine = [run for run in runs if run.protocol in family and run.fusion == fusion]
            families += [bench.together(name, mine)] if len(mine) > 1 else []
    return families


def _moving(show: Callable[[int, int], None] | None, before: int, total: int) -> Callable[[int, int], None] | None:
    """The progress of one run as that of all; `before` ticks were done in those before it."""
    return None if show is None else lambda done, _: show(before + done, total)


@contextmanager
def _folder(keep: Path | None) -> Iterator[Path]:
    """Where series are written: the folder, which is made, or one that is removed at the end. UserError: it cannot be made."""
    if keep is None:
        with tempfile.TemporaryDirectory(prefix="blackboard-score-") as folder:
            yield Path(folder)
        return
    try:
        keep.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--runs {keep}: cannot be made ({error.strerror}); choose another place") from error
    yield keep


def _csv(table: dict[str, Any]) -> str:
    records, file = bench.records(table), io.StringIO()
    writer = csv.DictWriter(file, records[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return file.getvalue()


def _write(file: Path, content: str) -> None:
    with writing(file):
        file.write_text(content, encoding="utf-8")


def _drawing() -> ModuleType:
    """`blackboard.lab.bench_drawing`. UserError: matplotlib, which it needs, is not installed."""
    with extra("plot", "--pictures"):
        from blackboard.lab import bench_drawing
    return bench_drawing
