"""One directory of keys and one router for the tests that do not change them."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.access.doors import Enter, enter, make_keys, router
from tests.processes import Program


@pytest.fixture(scope="package")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_keys(tmp_path_factory.mktemp("door") / "keys")


@pytest.fixture(scope="package")
def other_keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of another authority, for a team of the same name and people."""
    return make_keys(tmp_path_factory.mktemp("other") / "keys")


@pytest.fixture(scope="module")
def shut(keys: Path) -> Iterator[tuple[str, Program]]:
    """Where a router with keys listens, and its program."""
    with router(keys) as running:
        yield running


@pytest.fixture
def let_in(shut: tuple[str, Program], keys: Path) -> Iterator[Enter]:
    """Makes a link with a member's certificate to the router; all are closed however the test ends."""
    with ExitStack() as links:
        yield lambda who: links.enter_context(enter(shut[0], keys, who))
