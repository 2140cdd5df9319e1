"""A router on a free port of 127.0.0.1, and links to it that are closed however a test ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from blackboard.launch import free_port
from blackboard.link import Link, LinkConfig


@pytest.fixture
def endpoint() -> Iterator[str]:
    where = f"tcp/127.0.0.1:{free_port()}"
    with Link(LinkConfig(mode="router", listen=(where,)), "router"):
        yield where


@pytest.fixture
def connect(endpoint: str) -> Iterator[Callable[[str], Link]]:
    """Makes a link of a given name to the router."""
    with ExitStack() as links:
        yield lambda name: links.enter_context(Link(LinkConfig(connect=(endpoint,)), name))
