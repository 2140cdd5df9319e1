"""Bugs that are planted in a copy of the sources, to see whether nights notice: `python -m tests.nights.planted --count 300`.

Each is a mistake that a person could make, as one text of a file and what stands there instead.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.files import ROOT
from tests.nights.night import Night

COPIED = ("blackboard", "robot_agent", "sim_world", "tests")


@dataclass(frozen=True)
class Bug:
    """What is wrong, in which file, and the text before and after."""

    what: str
    file: str
    before: str
    after: str

    def plant(self, root: Path) -> None:
        """Put it into a copy of the project. ValueError: its text is not there."""
        path = root / self.file
        text = path.read_text(encoding="utf-8")
        if self.before not in text:
            raise ValueError(f"{self.file} does not have: {self.before}")
        path.write_text(text.replace(self.before, self.after), encoding="utf-8")


ROSTER, LEAD, SERVICE = "blackboard/process/roster.py", "blackboard/board/lead.py", "blackboard/board/service.py"
DESK, ROLL_CALL = "blackboard/board/joint/desk.py", "blackboard/process/roll_call.py"

BUGS = {
    "goodbye": Bug(
        "a token that vanished counts for ever",
        ROSTER,
        "self._until[token] = now + self._grace",
        "self._until[token] = math.inf",
    ),
    "away": Bug(
        "while the router is away everybody's token expires",
        ROSTER,
        "return math.inf if self.away else min(self._until.values(), default=math.inf)",
        "return min(self._until.values(), default=math.inf)",
    ),
    "early": Bug(
        "a board drops what comes before its sender's token",
        SERVICE,
        "out += self._retry(now) if envelope.kind is Kind.ALIVE else []",
        "out += []",
    ),
    "crowd": Bug(
        "what came too early is kept, however much of it there is",
        "blackboard/process/intake.py",
        "while len(self._early) > MAX_EARLY or self._early_bytes",
        "while self._early_bytes",
    ),
    "skipped": Bug(
        "a tick that was not settled is not counted",
        SERVICE,
        'self.counters["skipped"] += self.rounds.phase != "settled"',
        'self.counters["skipped"] += 0',
    ),
    "anew": Bug(
        "a board keeps what it knew when another run begins",
        SERVICE,
        "        if news is not News.TICK:\n            self._begin()\n",
        "        if news is not News.TICK:\n",
    ),
    "outranked": Bug(
        "a leader does not yield to a better claim",
        LEAD,
        "if leaders and (-self.term, since, self.board) > min(leaders):",
        "if leaders and not self.leads and (-self.term, since, self.board) > min(leaders):",
    ),
    "stuck": Bug(
        "a leader that hangs is never given up",
        LEAD,
        "return max([self._kept[0][0], *waited]) + self.silent",
        "return math.inf",
    ),
    "listed": Bug(
        "a source counts as heard before all that it lists is here",
        ROLL_CALL,
        "return self.answered(source) == tick",
        "return source in self._lists and self._lists[source][0] == tick",
    ),
    "newer": Bug(
        "a source that is a tick further is waited for as if it lacked this one",
        ROLL_CALL,
        "return all(known.get(subject, -1) >= tick for subject in subjects)",
        "return all(known.get(subject, -1) == tick for subject in subjects)",
    ),
    "ancestors": Bug(
        "a joint does not name one of the robots that it rests on",
        DESK,
        "return {name: until[name] for name in sorted(until) if",
        "return {name: until[name] for name in sorted(until)[:-1] if",
    ),
    "twice": Bug(
        "evidence that comes a second time counts a second time",
        "blackboard/board/joint/queue.py",
        "tick <= taken.get(packed.epoch, -1)",
        "tick < taken.get(packed.epoch, -1)",
    ),
    "epoch": Bug(
        "a robot that is started again numbers its epochs from 0",
        "robot_agent/gaussian/filter.py",
        "self.epoch = max(self.epoch + 1, round(1000 * time))",
        "self.epoch = self.epoch + 1",
    ),
    "order": Bug(
        "a joint takes evidence in the order of its arrival",
        "blackboard/opinion/gaussian/team.py",
        "for evidence in sorted(reports, key=lambda e: (e.robot, e.epoch, e.tick)):",
        "for evidence in reports:",
    ),
    "unjournaled": Bug(
        "a journal does not say when its board was woken",
        "blackboard/tape/journal.py",
        'self._note(now, "wake", "")',
        "pass",
    ),
    "older": Bug(
        "a report that was overtaken replaces a newer one",
        "blackboard/board/entries.py",
        "elif entry.time < known.time:",
        "elif False:",
    ),
    "stranger": Bug(
        "the Clock of another run is never followed while the first one is remembered",
        "blackboard/process/team_clock.py",
        "return ClockEvent.RUN if silent or self.roster.worlds > self._token_seen else ClockEvent.RIVAL",
        "return ClockEvent.RIVAL",
    ),
    "awaited": Bug(
        "a board that says nothing is waited for until it does",
        LEAD,
        "if any(now < until for until in self._unknown.values()):",
        "if self._unknown:",
    ),
    "rests": Bug(
        "a robot does not name itself among those on whom what it believes rests",
        "robot_agent/estimator.py",
        "ancestors={**self.ancestors, self.robot: readings.time},",
        "ancestors={**self.ancestors},",
    ),
    "same": Bug(
        "a Clock that is repeated begins its tick again",
        "blackboard/process/team_clock.py",
        "return same and 0 < ticks <= most and 0 <= seconds <= SLOWEST * ticks",
        "return same and 0 <= ticks <= most and 0 <= seconds <= SLOWEST * max(1, ticks)",
    ),
    "repeat": Bug(
        "a board that follows does not answer when the world asks again",
        "blackboard/board/publisher.py",
        "return list(self._sent) if self.lead.leads else [self._followed(said, now) for said in self._said]",
        "return list(self._sent)",
    ),
    "unreleased": Bug(
        "a board that takes over does not publish what the one before left",
        "blackboard/board/publisher.py",
        "return self._in_full(released, now) or [self.status(now)]",
        "return [self.status(now)]",
    ),
    "source": Bug(
        "what is multiplied is remembered by its source, not by its ancestors",
        "blackboard/opinion/provenance.py",
        "taken |= opinion.ancestors.keys()",
        "taken.add(opinion.source)",
    ),
    "slots": Bug(
        "what was said in a slot is said again in the next",
        "robot_agent/slots.py",
        "self._last, self._waiting = self._slot(time), []",
        "self._last = self._slot(time)",
    ),
    "disk": Bug(
        "what a full disk does not take is dropped",
        "blackboard/tape/backlog.py",
        "self.trouble = error.strerror or str(error)",
        "self.trouble = str(error.strerror or error); self._waiting.clear()",
    ),
    "sign": Bug(
        "the offset of a clock has the wrong sign",
        "blackboard/board/clocks.py",
        "return stamp - ahead",
        "return stamp + ahead",
    ),
    "waiting": Bug(
        "of the evidence that waits to be settled the newest of each robot alone is kept",
        "blackboard/board/joint/queue.py",
        "if len(waiting) > MAX_WAITING:",
        "if len(waiting) > 1:",
    ),
    "passed_on": Bug(
        "a board passes on the newest evidence of each robot alone",
        "blackboard/board/joint/passing.py",
        "for then, one in each]",
        "for then, one in [each[-1]]]",
    ),
    "uncounted": Bug(
        "what the last robot gains by itself is not multiplied in",
        "blackboard/opinion/gaussian/team.py",
        "for robot in sorted(set(motions) - entered):",
        "for robot in sorted(set(motions) - entered)[:-1]:",
    ),
    "lost": Bug(
        "of the sightings that wait until mates have told how they moved only the first is kept",
        "blackboard/opinion/gaussian/team.py",
        "self.early[robot] = now, tuple(waiting)",
        "self.early[robot] = now, tuple(waiting[:1])",
    ),
    "never": Bug(
        "what comes too early is forgotten when it still is so at the next try",
        "blackboard/process/intake.py",
        "self._early[key] = early\n                self._early_bytes += len(early.envelope.payload)",
        "pass",
    ),
    "unsent": Bug(
        "what a robot gained and did not send is lost",
        "robot_agent/gaussian/unsent.py",
        "self.before = prediction if self.joint is None else self.joint.moments(self.robot)",
        "self.before = prediction",
    ),
    "entered": Bug(
        "a robot that begins an epoch keeps its place in the joint",
        "blackboard/opinion/gaussian/comparing.py",
        "        team.drop(robot)\n        team.contacts.begin(robot)",
        "        team.contacts.begin(robot)",
    ),
    "leftover": Bug(
        "a robot keeps what was agreed in the run before",
        "robot_agent/service.py",
        "Sequencer(), Gathered()",
        'Sequencer(), getattr(self, "_agreed", None) or Gathered()',
    ),
    "vain": Bug(
        "who was waited for in vain is never waited for again",
        "blackboard/process/in_vain.py",
        "Debt(debt.times, debt.left - 1, tick)",
        "Debt(debt.times, debt.left, tick)",
    ),
}

FOUND = re.compile(r"night \d+/(\d+) of [^:]*: (.*)")


LIVE = """
from tests.nights.faults import *
from tests.nights.night import Night, Team
from tests.nights.run import live
print(live({night!r}) or "")
"""


@contextmanager
def planted(bug: Bug) -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    """Meanwhile what is given runs Python with some arguments, in a copy of the project that has a bug."""
    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        root = Path(folder)
        for name in COPIED:
            shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
        bug.plant(root)
        settings = {"cwd": root, "env": {**os.environ, "PYTHONPATH": folder}, "capture_output": True, "text": True}
        yield lambda *arguments: subprocess.run([sys.executable, *arguments], check=False, **settings)  # type: ignore[call-overload,no-any-return]


def notice(bug: Bug, count: int, seed: int) -> str | None:
    """Live through nights with a bug: the first that fails, and what it breaks; None: none of them does."""
    nights = ["-m", "tests.nights", "--no-shrink", "--first-failure", "--workers", "1"]
    with planted(bug) as python:
        ran = python(*nights, "--count", str(count), "--seed", str(seed))
    if match := FOUND.search(ran.stdout):
        return f"after {int(match[1]) + 1} nights: {match[2]}"
    return None if ran.returncode == 0 else f"the coverage: {ran.stdout.strip().splitlines()[0]}"


def breaks(bug: Bug, night: Night) -> str:
    """What a night breaks with a bug; "": nothing."""
    with planted(bug) as python:
        ran = python("-c", LIVE.format(night=night))
    ran.check_returncode()
    return ran.stdout.strip()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.nights.planted", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="nights for each bug")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default=",".join(BUGS), help="names, with commas between them")
    args = parser.parse_args()
    noticed = 0
    names = args.only.split(",")
    for name in names:
        how = notice(BUGS[name], args.count, args.seed)
        noticed += how is not None
        print(f"{name:<10} {BUGS[name].what}: {how or f'not noticed in {args.count} nights'}", flush=True)
    print(f"{noticed} of {len(names)} are noticed within {args.count} nights of seed {args.seed}")
    return 0 if noticed == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())
