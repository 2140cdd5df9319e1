"""The supervisor with small real processes: their lines, their deaths, and that none is left behind."""

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from blackboard.errors import UserError
from blackboard.run.supervisor import CHUNK, ProcessRow, Supervisor
from tests.processes import LONG, children, is_running, program, wait_until

pytestmark = pytest.mark.system

ENDLESS = "import sys, threading; print('up', file=sys.stderr, flush=True); threading.Event().wait()"
STUBBORN = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN);" + ENDLESS

#: A launcher of two processes: one as usual, one that ignores SIGTERM.
LAUNCHER = f"""
import asyncio, sys
from blackboard.run.supervisor import ProcessRow, Supervisor
async def main():
    async with Supervisor(stop_seconds=0.2) as supervisor:
        for name, text in (("usual", {ENDLESS!r}), ("stubborn", {STUBBORN!r})):
            code = "from blackboard.run.door import follow_parent; follow_parent();" + text
            supervisor.keep_running(ProcessRow(name, (sys.executable, "-c", code)))
        supervisor.release()
        await asyncio.Event().wait()
asyncio.run(main())
"""


def python(name: str, code: str, *arguments: str) -> ProcessRow:
    return ProcessRow(name, (sys.executable, "-S", "-c", code, *arguments))


class Diary:
    """What was told, and by whom."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []
        self._news = asyncio.Event()

    def __call__(self, name: str, line: str) -> None:
        self.lines.append((name, line))
        self._news.set()

    async def has(self, name: str, line: str) -> None:
        """Wait until this was told."""
        async with asyncio.timeout(LONG):
            while (name, line) not in self.lines:
                self._news.clear()
                await self._news.wait()


def supervise(body: Callable[[Supervisor, Diary], Awaitable[object]], released: bool = True) -> Diary:
    """Run a body inside a supervisor with a short grace; nothing is held back unless asked for."""
    diary = Diary()

    async def main() -> None:
        async with Supervisor(diary, stop_seconds=0.2) as supervisor:
            if released:
                supervisor.release()
            await body(supervisor, diary)

    asyncio.run(main())
    return diary


def test_a_result_is_kept_and_a_log_is_passed_on() -> None:
    lines: list[tuple[int, str]] = []
    code = "import sys; print('a\\nb', file=sys.stderr); print('{\\n}', end=''); sys.stderr.write('end'); sys.exit(3)"

    async def body(supervisor: Supervisor, diary: Diary) -> None:
        lines.append(await supervisor.run(python("world", code)))

    diary = supervise(body)
    assert lines == [(3, "{\n}")]
    assert diary.lines == [("world", "a"), ("world", "b"), ("world", "end")]


@pytest.mark.parametrize(("said", "heaps"), [(None, "2"), ("5", "5")])
def test_processes_have_few_heaps_unless_the_environment_says_how_many(
    said: str | None, heaps: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MALLOC_ARENA_MAX", raising=False)
    if said is not None:
        monkeypatch.setenv("MALLOC_ARENA_MAX", said)

    async def body(supervisor: Supervisor, diary: Diary) -> None:
        code = "import os, sys; print(os.environ['MALLOC_ARENA_MAX'], file=sys.stderr)"
        await supervisor.run(python("world", code))

    assert supervise(body).lines == [("world", heaps)]


def test_a_line_without_an_end_is_broken_and_what_is_no_text_is_shown_as_such() -> None:
    code = f"import sys; sys.stderr.buffer.write(b'\\xff' + b'x' * {3 * CHUNK})"

    async def body(supervisor: Supervisor, diary: Diary) -> None:
        await supervisor.run(python("world", code))

    lines = [line for _, line in supervise(body).lines]
    assert len(lines) > 1
    assert "".join(lines) == "\N{REPLACEMENT CHARACTER}" + "x" * 3 * CHUNK


def test_a_process_that_dies_is_started_again(tmp_path: Path) -> None:
    code = "import os, sys; open(sys.argv[1], 'a').write('.'); os.kill(os.getpid(), 9)"
    count = tmp_path / "starts"

    async def body(supervisor: Supervisor, diary: Diary) -> None:
        supervisor.keep_running(python("r1", code, str(count)))
        await diary.has("r1", "ended with status -9; starting it again in 0.5 s")

    supervise(body)
    assert count.read_text() == ".."


def test_a_mistake_of_one_stops_all_and_is_told() -> None:
    async def body(supervisor: Supervisor, diary: Diary) -> None:
        supervisor.keep_running(python("r1", ENDLESS))
        await diary.has("r1", "up")
        supervisor.keep_running(
            python("r2", "import sys; print('error: r2.x: no such key', file=sys.stderr); sys.exit(2)")
        )
        await asyncio.Event().wait()

    with pytest.raises(UserError, match=r"^r2\.x: no such key$"):
        supervise(body)


def test_before_the_release_a_mistake_stands_alone() -> None:
    diaries: list[Diary] = []

    async def body(supervisor: Supervisor, diary: Diary) -> None:
        diaries.append(diary)
        await supervisor.run(python("r1", "import sys; print('up', file=sys.stderr)"))
        await supervisor.run(python("r2", "import sys; print('error: no such key', file=sys.stderr); sys.exit(2)"))

    with pytest.raises(UserError, match=r"^no such key$"):
        supervise(body, released=False)
    assert diaries[0].lines == []


@pytest.mark.parametrize("code", ["", "raise SystemExit(1)"])
def test_what_was_held_back_is_shown_at_the_end_or_at_a_death(code: str) -> None:
    async def body(supervisor: Supervisor, diary: Diary) -> None:
        await supervisor.run(python("r1", "import sys; print('up', file=sys.stderr)"))
        assert diary.lines == []
        if code:
            supervisor.keep_running(python("r2", code))
            await diary.has("r2", "ended with status 1; starting it again in 0.2 s")
            assert diary.lines[0] == ("r1", "up")

    assert supervise(body, released=False).lines[0] == ("r1", "up")


def test_a_mistake_without_a_word_names_the_process() -> None:
    async def body(supervisor: Supervisor, diary: Diary) -> None:
        await supervisor.run(python("world", "raise SystemExit(2)"))

    with pytest.raises(UserError, match="world ended with status 2"):
        supervise(body)


def test_all_are_stopped_when_the_body_fails_the_stubborn_too(tmp_path: Path) -> None:
    pids: list[int] = []

    async def body(supervisor: Supervisor, diary: Diary) -> None:
        for name, code in (("usual", ENDLESS), ("stubborn", STUBBORN)):
            supervisor.keep_running(python(name, f"import os, sys; print(os.getpid(), file=sys.stderr); {code}"))
            await diary.has(name, "up")
        pids.extend(int(line) for _, line in diary.lines if line.isdigit())
        assert all(is_running(pid) for pid in pids)
        raise RuntimeError("ours")

    with pytest.raises(RuntimeError, match="ours"):
        supervise(body)
    assert len(pids) == 2
    assert not any(is_running(pid) for pid in pids)


def test_one_that_is_stopped_while_it_is_being_started_ends_in_order(tmp_path: Path) -> None:
    code = """
import signal, sys
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
print("up", file=open(sys.argv[1], "a"))
signal.sigwait([signal.SIGTERM])
print("ended", file=open(sys.argv[1], "a"))
"""
    file, before = tmp_path / "said", set(children(os.getpid()))

    async def main() -> None:
        async with Supervisor() as supervisor:
            running = asyncio.create_task(supervisor.run(python("recorder", code, str(file))))
            while not set(children(os.getpid())) - before:
                await asyncio.wait([running], timeout=0)
            # The process goes on while the event loop of its supervisor stands still.
            wait_until(lambda: file.is_file() and file.read_text(), "it is up")
            running.cancel()
            await asyncio.wait([running])
            assert running.cancelled()

    asyncio.run(main())
    assert file.read_text() == "up\nended\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL, signal.SIGTERM], ids=lambda number: number.name)
def test_nobody_outlives_the_launcher(number: signal.Signals) -> None:
    with program("-c", LAUNCHER) as launcher:
        launcher.says("usual | up")
        launcher.says("stubborn | up")
        family = children(launcher.running.pid)
        assert len(family) == 2
        launcher.running.send_signal(number)
        launcher.ends()
        wait_until(lambda: not any(is_running(pid) for pid in family), "the children are gone")


def test_a_child_whose_parent_died_before_it_could_follow_ends_at_once() -> None:
    set_up = "import os; os.environ['BLACKBOARD_PARENT'] = str(os.getpid())"  # nobody is its own parent
    with program(
        "-c", f"{set_up}; from blackboard.run.door import follow_parent; follow_parent(); print('on')"
    ) as orphan:
        assert orphan.ends() == 0
        assert orphan.out == ""
