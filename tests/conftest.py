"""What all tests share: Hypothesis without chance or deadlines, marks, signals as a program expects them, and a router."""

from __future__ import annotations

import gc
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from blackboard.net.link import Link

settings.register_profile(
    "house",
    derandomize=True,
    deadline=None,
    max_examples=60,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],  # how fast the machine is proves nothing
)
settings.load_profile("house")


#: What a file has where several of its tests read one run.
SHARES = re.compile(r'scope="module"|^@cache$', re.MULTILINE)


def pytest_configure() -> None:
    """Give the programs that tests start the default disposition of SIGINT, also where this run was started to ignore it.

    A shell script starts what it puts into the background (`make test &`) with SIGINT ignored, and every child would inherit
    that. A handler is not inherited; this one does nothing, so that the test run itself goes on ignoring the signal.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: None)
    gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Folders mark their tests, so that only what takes milliseconds runs among the unit tests (Makefile).

    Real processes come first, then whole teams: on several cores nobody waits for one long test at the end. Tests of one file that
    read one costly run stay in one process, which makes it once.
    """
    here = Path(__file__).parent
    shared = {path for path in {item.path for item in items} if SHARES.search(path.read_text(encoding="utf-8"))}
    for item in items:
        if item.path in shared:
            item.add_marker(pytest.mark.xdist_group(str(item.path.relative_to(here))))
        room = item.path.relative_to(here).parts[0]
        if room in ("system", "compose", "long"):
            item.add_marker(room)
        elif room in ("bridges", "flow", "hostile", "lab", "net", "nights", "state", "tape", "view"):
            item.add_marker("team")
    items.sort(
        key=lambda item: next((k for k, name in enumerate(("system", "team")) if item.get_closest_marker(name)), 2)
    )


def pytest_collection_finish(session: pytest.Session) -> None:
    """What was collected is no garbage: a third of the collection's time went into looking for it there.

    RuntimeError: a worker of pytest-xdist was told to keep the tests of a group together, and does not.
    """
    apart = (item for item in session.items if item.get_closest_marker("xdist_group") and "@" not in item.nodeid)
    if getattr(session.config.option, "loadgroup", False) and next(apart, None):
        raise RuntimeError("pytest-xdist does not group tests with this pytest: each worker would make each costly run")
    gc.enable()
    gc.freeze()


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Where a Zenoh router of this test listens: a free port of 127.0.0.1."""
    from blackboard.net.link import Link
    from blackboard.net.settings import LinkConfig
    from blackboard.run.launch import free_port

    where = f"tcp/127.0.0.1:{free_port()}"
    with Link(LinkConfig(mode="router", listen=(where,)), "router"):
        yield where


@pytest.fixture
def connect(endpoint: str) -> Iterator[Callable[[str], Link]]:
    """Makes a link of a given name to the router; all are closed however the test ends."""
    from blackboard.net.link import Link
    from blackboard.net.settings import LinkConfig

    with ExitStack() as links:
        yield lambda name: links.enter_context(Link(LinkConfig(connect=(endpoint,)), name))
