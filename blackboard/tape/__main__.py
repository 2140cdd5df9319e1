"""The door of the tapes: `blackboard record`, `blackboard replay` and `blackboard tape info | recover | cut | table`."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import App, Parameter

from blackboard.config import Scenario
from blackboard.errors import RunFailed, UserError
from blackboard.judge.card import scorecard, text
from blackboard.judge.files import check_table, table_file
from blackboard.judge.paired import paired
from blackboard.judge.paired import text as paired_text
from blackboard.judge.samples import Keep, Sample, series_file
from blackboard.net.bus import intersects
from blackboard.process.clock import UnixClock
from blackboard.process.columns import columns
from blackboard.run import door
from blackboard.run.flags import MemberFlags, OutputFlags, TeamFlags
from blackboard.run.logs import quiet
from blackboard.run.overrides import parse_set, path_of, with_settings
from blackboard.run.progress import progress
from blackboard.tape.compare import side_by_side, verdict_lines
from blackboard.tape.content import Tape, load_tape, summary
from blackboard.tape.content import cut as cut_out
from blackboard.tape.file import TapeWriter, copy, create
from blackboard.tape.judge import Course, course, judge, match, recorded
from blackboard.tape.lies import lying, parse_lies
from blackboard.tape.player import Part, Player
from blackboard.tape.recorder import Recorder
from blackboard.tape.replay import replay as replay_tape
from blackboard.tape.table import COLUMNS, rows
from blackboard.tape.whatif import what_if
from blackboard.wire.raw import VERSION

LIBRARIES = ("numpy", "eclipse-zenoh", "mcap", "msgpack", "pydantic")  # whose versions a tape keeps
NOTE = (
    "Compare with `unchanged`: the same boards on what the recorder received. Robots do not hear the changed boards: "
    "what they report as informed is that of the recorded run."
)

tape = App(name="tape", help="Look at a tape, mend it, cut it, make a table of it, or export it.")
#: Loaded when it is asked for.
tape.command(
    "blackboard.bridges.__main__:export", name="export", help="Write a tape for other people's viewers: Foxglove."
)


def record(file: Path, *, which: MemberFlags = MemberFlags(), flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Record every message and token of a running team onto a tape, until a signal comes.

    The scenario is kept on the tape, for replays.

    Parameters
    ----------
    file
        The tape (MCAP); a file that is there already is not overwritten.
    """
    chosen = which.chosen()
    name = chosen.team.name
    with create(file) as out:
        writer = TapeWriter(out, _about(name, chosen if which.scenario else None))
        writer.check(file)
        door.serve(Recorder(name, writer), "recorder", flags, linger=1.0)
        writer.close()
    if writer.missing:
        why = f" ({writer.trouble})" if writer.trouble else ""
        cure = f"; `blackboard tape recover {file}` saves the others" if writer.trouble else ""
        of = writer.missing + writer.kept
        raise RunFailed(f"{file}: {writer.missing} of {of} messages are missing, because the disk was full{why}{cure}")
    skipped = sum(writer.skipped.values())
    sys.stderr.write(f"{file}: {writer.messages} messages" + (f", {skipped} left out\n" if skipped else "\n"))
    return 0


@dataclass(frozen=True)
class Changes:
    """What is to be different from the recorded run."""

    without: Annotated[list[str], Parameter(negative="", show_default=False)] = field(default_factory=list)
    "Without this robot; may be given again."
    rule: str | None = None
    "Another rule of the boards; implies --fusion opinions."
    fusion: Literal["opinions", "joint"] | None = None
    "Pool opinions, or keep a joint belief of the team."
    set: Annotated[list[str], Parameter(negative="", show_default=False)] = field(default_factory=list)
    "Another setting of the boards, as board.gate=8; may be given again."
    lie: Annotated[list[str], Parameter(negative="", show_default=False)] = field(default_factory=list)
    "A robot that reports everything so far along x from where it believes it, as r2=6 (grid's unit); may be given again."
    loss: float = 0.0
    "Share of the messages to boards that is lost, Clocks and tokens aside."
    seed: int = 1
    "Seed of what is lost."

    @property
    def given(self) -> dict[str, object]:
        """The changes that were asked for, by their names."""
        defaults = Changes()
        return {
            f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != getattr(defaults, f.name)
        }

    def apply(self, tape: Tape) -> Scenario:
        """The scenario of a tape with these changes. UserError: what cannot be changed on it."""
        scenario = tape.scenario
        unknown = sorted(set(self.without) - set(scenario.team.robots))
        if unknown:
            raise UserError(f"--without {unknown[0]}: no such robot; on the tape are {', '.join(scenario.team.robots)}")
        parse_lies(self.lie, scenario.team.robots)
        if not 0.0 <= self.loss <= 1.0:
            raise UserError(f"--loss {self.loss:g}: give a share from 0 to 1")
        scenario = TeamFlags(rule=self.rule, fusion=self.fusion).apply(scenario)
        scenario = _with_boards(scenario, self.set)
        if scenario.board.fusion == "joint" and tape.scenario.board.fusion != "joint":
            raise UserError(
                '--fusion joint: the robots of this tape sent no evidence; record a team with fusion = "joint"'
            )
        return scenario


def replay(
    file: Path,
    *,
    changes: Annotated[Changes, Parameter(name="*")] = Changes(),
    speed: float | None = None,
    only: Annotated[list[Part], Parameter(negative="", show_default=False)] | None = None,
    scenario: str | None = None,
    table: Path | None = None,
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Replay a tape into boards, or into a live network (`blackboard.__main__` says more).

    Parameters
    ----------
    file
        The tape.
    speed
        Send the tape into the network at this speed; 1 is as recorded.
    only
        With --speed, who is played: world, robots, boards; may be given again [default: all].
    scenario
        The team's scenario, instead of the one on the tape.
    table
        Also write every sample that a referee judges into this file (.csv, .jsonl, .parquet), as `demo --table` does.
    """
    tape = load_tape(file, scenario)
    if table is not None:
        check_table(table, "--table")
    if speed is not None:
        door.serve(Player(tape, speed, only or ("world", "robots", "boards")), "player", flags, linger=0.0)
        return 0
    if only or flags != door.ZenohFlags():
        raise UserError("--only, and where the network is, are for --speed; without it nothing is sent")
    if len(tape.runs) > 1:
        sys.stderr.write(f"{file}: {len(tape.runs)} runs; the last one is judged\n")
    story = course(tape, tape.runs[-1] if tape.runs else "")
    with quiet(), series_file(table) as keep:
        if changes.given:
            return _what_if(tape, story, changes, output, keep)
        return _again(tape, story, output, keep)


def _with_boards(scenario: Scenario, sets: Sequence[str]) -> Scenario:
    """A scenario with settings KEY=VALUE of its boards. UserError: of something else, or several values."""
    settings = {}
    for given in sets:
        key, values = parse_set(given)
        if path_of(key)[0] != "board" or len(values) > 1:
            raise UserError(f"--set {given}: only boards are run again; say board.KEY=VALUE, as board.gate=8")
        settings[key] = values[0]
    return with_settings(scenario, settings)


def _again(tape: Tape, story: Course, output: OutputFlags, keep: Keep | None) -> int:
    clock = UnixClock()
    began = clock.now()
    with _moving(sum(len(life.events) for life in tape.lives)) as moved:
        again = replay_tape(tape, moved)
    matched = match(story.run, recorded(tape), again.output, story.ended)
    lines = verdict_lines(again, matched)
    card = scorecard(judge(tape.scenario, story, again.output, clock.now() - began, record=keep))
    output.show(card, lambda card: "\n".join([text(card), "", *lines]))
    if not matched.exact and output.as_json:
        sys.stderr.writelines(f"{line}\n" for line in lines)
    return 0 if matched.exact else 1


def _what_if(tape: Tape, story: Course, changes: Changes, output: OutputFlags, keep: Keep | None) -> int:
    scenario, rng, clock = changes.apply(tape), np.random.default_rng(changes.seed), UnixClock()
    began = clock.now()
    lies = lying(parse_lies(changes.lie, scenario.team.robots))
    lose = lambda _: bool(changes.loss) and rng.random() < changes.loss  # noqa: E731
    ones, others = list[Sample](), list[Sample]()
    with _moving(2 * len(tape.envelopes)) as moved:
        changed = what_if(tape, scenario, changes.without, lose, lies, moved)
        wall, without = clock.now() - began, changes.without
        unchanged = what_if(tape, tape.scenario, moved=moved)
    cards = {
        "recorded": scorecard(judge(tape.scenario, story, recorded(tape), 0.0, without)),
        "unchanged": scorecard(judge(tape.scenario, story, unchanged, 0.0, without, ones.append)),
        "what if": scorecard(judge(scenario, story, changed, wall, without, others.append)),
    }
    for sample in others if keep is not None else ():
        keep(sample)  # type: ignore[misc]  # not None where there are any
    differences = paired(ones, others)
    result: dict[str, object] = {"changes": changes.given, "paired": differences, "note": NOTE}
    result |= {name.replace(" ", "_"): card for name, card in cards.items()}
    told_all = f"{side_by_side(cards)}\n\n{paired_text(differences, cards['what if']['unit'])}\n\n{NOTE}"
    output.show(result, lambda _: told_all)
    return 0


@contextmanager
def _moving(total: int) -> Iterator[Callable[[], None]]:
    """A function that moves the progress of a replay, on standard error, by one of `total`."""
    count = 0
    with progress("replay") as show:

        def moved() -> None:
            nonlocal count
            count += 1
            if show is not None:
                show(count, total)

        yield moved


@tape.command
def info(file: Path, *, output: OutputFlags = OutputFlags()) -> int:
    """Show what is on a tape: of which team, how long, what of it, and what its recorder lost."""
    output.show(summary(load_tape(file, scenario="demo")), _info)
    return 0


@tape.command
def recover(file: Path, out: Path | None = None) -> int:
    """Save what is whole of a broken tape, as of one whose recorder was killed, into a new one.

    Parameters
    ----------
    file
        The broken tape; it stays as it is.
    out
        The new tape [default: beside it, as run-whole.mcap for run.mcap].
    """
    out = out or file.with_name(f"{file.stem}-whole{file.suffix}")
    broken: list[int] = []
    count = copy(file, out, broken=broken)
    sys.stderr.write(f"{out}: {count} messages; {sum(broken)} bytes of {file} could not be read\n")
    return 0


@tape.command
def cut(file: Path, out: Path, *, start: float = 0.0, end: float = float("inf"), key: str = "**") -> int:
    """Keep a part of a tape.

    Parameters
    ----------
    start
        Seconds after the beginning of the tape. Tokens that are held then are kept.
    end
        Seconds after the beginning of the tape.
    key
        A key expression: what others carry is left out.
    """
    count = copy(file, out, lambda envelopes: cut_out(envelopes, start, end, lambda one: intersects(key, one)))
    sys.stderr.write(f"{out}: {count} messages\n")
    return 0


@tape.command
def table(file: Path, *, out: Path | None = None, scenario: str | None = None) -> int:
    """Write a row for each tick, subject and level, with the error where the tape has the truth.

    Parameters
    ----------
    out
        A file that ends in .csv, .jsonl or .parquet (extra `table`) [default: CSV on standard output].
    scenario
        The team's scenario, instead of the one on the tape.
    """
    opened = load_tape(file, scenario)
    with table_file(out, COLUMNS, "--out") as write:
        for row in rows(opened):
            write(row)
    return 0


def _info(info: dict[str, Any]) -> str:
    """A summary as text."""
    rows = [(name, str(value)) for name, value in info.items() if not isinstance(value, dict | list)]
    rows += [("link", ", ".join(f"{count} {name}" for name, count in info["link"].items()))]
    rows += [("run", run) for run in info["runs"]]
    for board in info["boards"]:
        whole = "from its beginning" if board["whole"] else "the beginning is missing"
        rows.append(("board", f"{board['board']}: {board['events']} events, {board['gaps']} gaps, {whole}"))
    counted = ("messages", "bytes", "events")
    topics = [(name, *(str(counts[key]) for key in counted)) for name, counts in sorted(info["topics"].items())]
    return "\n".join([*columns(rows), "", *columns([("topic", *counted), *topics], numbers=range(1, 4))])


def _about(team: str, scenario: Scenario | None) -> dict[str, str]:
    """What a tape says about itself."""
    about = {"team": team, "started": f"{UnixClock().now():.6f}", "package": door.version(), "protocol": str(VERSION)}
    about |= {name: version(name) for name in LIBRARIES} | {"python": sys.version.split()[0]}
    return about if scenario is None else {**about, "name": scenario.name, "scenario": scenario.to_json()}
