"""Waiting for facts, and processes that are surely stopped."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from blackboard.net.bus import BusLink
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.run.door import PARENT
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus
from tests.files import ROOT

AnyLink = Link | BusLink
LONG = 60.0  # seconds: a deadline that only a broken program misses, however slow the machine

#: Runs Python with these arguments as a shell script does in the background: SIGINT is ignored when it starts.
IN_THE_BACKGROUND = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def wait_until(fact: Callable[[], object], what: Callable[[], object] | str, seconds: float = LONG) -> None:
    """Look again and again until a fact holds; fails with `what` after a deadline."""
    clock, pause = UnixClock(), threading.Event()
    end = clock.now() + seconds
    while not fact():
        assert clock.now() < end, f"after {seconds:g} s still not so: {what if isinstance(what, str) else what()}"
        pause.wait(0.01)


class Letters:
    """What a link has received so far."""

    def __init__(self, link: AnyLink) -> None:
        self._link = link
        self.read: list[Envelope] = []

    def until(self, *wanted: Envelope) -> list[Envelope]:
        """Receive until all of these have come."""
        wait_until(lambda: set(wanted) <= set(self.take()), lambda: f"{wanted} among {self.read}")
        return self.read

    def take(self) -> list[Envelope]:
        """All that it has received so far."""
        self.read += self._link.receive(0.05)
        return self.read


def introduce(listener: AnyLink, speaker: AnyLink) -> None:
    """Wait until the speaker knows what the listener has subscribed to: a token that comes last says so."""
    ready = f"ready/{id(listener)}/{id(speaker)}"
    listener.token(ready)
    speaker.watch(ready)
    wait_until(lambda: Envelope(ready, kind=Kind.ALIVE) in speaker.receive(0.05), "the token is seen")


@contextmanager
def silent_server() -> Iterator[tuple[socket.socket, str]]:
    """Somebody who takes connections and says nothing, and the endpoint."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        silent.settimeout(LONG)
        yield silent, f"tcp/127.0.0.1:{silent.getsockname()[1]}"


def is_running(pid: int) -> bool:
    """Whether a process lives; one that nobody has buried yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def children(parent: int) -> list[int]:
    """The processes that were told to follow this one, whoever their parent is by now."""
    variable = f"{PARENT}={parent}".encode()
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if variable in (folder / "environ").read_bytes().split(b"\0") and is_running(int(folder.name)):
                pids.append(int(folder.name))
        except (FileNotFoundError, ProcessLookupError, PermissionError):
            continue
    return pids


class Program:
    """A running program whose lines are read as they come."""

    def __init__(self, running: subprocess.Popen[str]) -> None:
        self.running = running
        self.out, self.err = "", ""
        self._readers = [threading.Thread(target=self._read, args=(name,), daemon=True) for name in ("out", "err")]
        for reader in self._readers:
            reader.start()

    def _read(self, name: str) -> None:
        stream = self.running.stdout if name == "out" else self.running.stderr
        assert stream is not None
        for line in stream:
            setattr(self, name, getattr(self, name) + line)

    def says(self, text: str) -> None:
        """Wait until it has said something on standard error."""
        wait_until(
            lambda: text in self.err or self.running.poll() is not None, lambda: f"it says {text!r}; it said {self.err}"
        )
        assert text in self.err, f"it ended with status {self.running.returncode}: {self.err}"

    def ends(self) -> int:
        """Wait until it has ended and all is read; its exit status."""
        wait_until(lambda: self.running.poll() is not None, lambda: f"it ends; it said {self.err}")
        self.read_all()
        return self.running.returncode

    def read_all(self) -> None:
        """Wait until all that it said is read."""
        for reader in self._readers:
            reader.join(LONG)


@contextmanager
def program(*arguments: str, keep: Sequence[str] = ()) -> Iterator[Program]:
    """Run Python with these arguments; killed at the end, with all who were told to follow it.

    Of what the environment says about us only `keep` is passed on.
    """
    with command(sys.executable, *arguments, keep=keep) as running:
        yield running


@contextmanager
def command(
    *words: str, keep: Sequence[str] = (), cwd: Path = ROOT, environment: Mapping[str, str] = os.environ
) -> Iterator[Program]:
    """Run a command in the same way, in a folder and an environment."""
    ours = {PARENT, "RUST_LOG", "LOG_FORMAT", "LOG_LEVEL"} - set(keep)
    kept = {key: value for key, value in environment.items() if key not in ours}
    with subprocess.Popen(
        words, cwd=cwd, env=kept, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as running:
        started = Program(running)
        try:
            yield started
        finally:
            for pid in (running.pid, *children(running.pid)):
                if is_running(pid):
                    os.kill(pid, signal.SIGKILL)
            started.read_all()


def seconds_to_end(started: Program) -> float:
    """How long a program takes to end at a SIGTERM, without the time in which others had the processor that it waited for."""
    clock, pid = UnixClock(), started.running.pid
    began = clock.now() - _seconds_kept_waiting(pid)
    started.running.send_signal(signal.SIGTERM)
    wait_until(lambda: not is_running(pid), "it ends")
    seconds = clock.now() - began - _seconds_kept_waiting(pid)
    started.running.wait()
    return seconds


def _seconds_kept_waiting(pid: int) -> float:
    """How long the first thread of a process, which may have ended, could have run and did not, as Linux counts it; else 0."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except (FileNotFoundError, IndexError):
        return 0.0


def wait_for_consensus(link: Link, robots: set[str], said: Callable[[], str]) -> None:
    """Wait until a board of sub-team a of team t takes all robots for the ball, and each for its own place."""
    link.subscribe("cop/t/a/consensus/**")
    used: dict[str, set[str]] = {}

    def all_of_them() -> bool:
        for c in (decode(Consensus, e.payload) for e in link.receive(0.1)):
            used[c.subject] = {opinion.source for opinion in c.used}
        return used.get("object/ball") == robots and all(used.get(f"robot/{r}") == {r} for r in robots)

    wait_until(all_of_them, lambda: f"each is in the consensus; used are {used}; {said()}")
