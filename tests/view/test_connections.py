"""Connections to the page's server that are silent, stop in the middle, or send what is no text: none is held, none is logged."""

import logging
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect
from websockets.typing import Origin

from blackboard.view.feed import Feed
from blackboard.view.web import connections
from tests.view.serving import Clock, Recording, get, served, socket_of

HALVES = {
    "silent": b"",
    "half a line": b"GET / HT",
    "half a head": b"GET /page.js HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Y: ",
    "half a body": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100\r\n\r\nhalf",
    "half of the next": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET / HT",
    "half an upgrade": b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n",
}


@pytest.fixture
def url() -> Iterator[str]:
    with served(Feed(Recording(), Clock(), "t"), "t", Clock()) as url:
        yield url


def opened(url: str) -> socket.socket:
    at = urlsplit(url)
    return socket.create_connection((at.hostname, at.port), timeout=30)


def read_to_its_end(connection: socket.socket) -> bytes:
    """All that comes until the other side closes. TimeoutError: it does not."""
    received = b""
    try:
        while more := connection.recv(1 << 16):
            received += more
    except ConnectionResetError:
        pass
    return received


@pytest.mark.parametrize("half", HALVES)
def test_what_does_not_come_to_its_point_is_closed(monkeypatch: pytest.MonkeyPatch, url: str, half: str) -> None:
    monkeypatch.setattr(connections, "PATIENCE", 0.3)
    with opened(url) as connection:
        connection.sendall(HALVES[half])
        received = read_to_its_end(connection)
    assert (b"200 OK" in received) == (half == "half of the next")


def test_the_one_that_waits_longest_is_closed_for_newer_ones(monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    monkeypatch.setattr(connections, "MOST", 8)
    with ExitStack() as stack:
        held = [stack.enter_context(opened(url)) for _ in range(20)]
        for connection in held[:12]:
            assert read_to_its_end(connection) == b""
        with connect(socket_of(url)) as browser:  # neither counts among them nor is closed for them
            browser.recv(timeout=30)
            held += [stack.enter_context(opened(url)) for _ in range(12)]
            assert get(url).read()
            browser.recv(timeout=30)


def test_a_text_that_is_none_ends_the_connection_and_is_no_line_of_the_log(
    url: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.DEBUG, "uvicorn.error"), connect(socket_of(url)) as browser:
        browser.recv(timeout=30)
        browser.socket.sendall(Frame(Opcode.TEXT, b"\xff\xfe").serialize(mask=True))
        with pytest.raises(ConnectionClosedError, match="1007"):
            list(browser)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING or record.exc_info]


@pytest.mark.parametrize("answered", [False, True], ids=["at once", "after the answer"])
def test_a_body_that_is_none_has_one_answer_and_no_traceback(
    url: str, caplog: pytest.LogCaptureFixture, answered: bool
) -> None:
    with caplog.at_level(logging.DEBUG), opened(url) as connection:
        head = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n"
        connection.sendall(head if answered else head + b"zz\r\n")
        received = connection.recv(1) if answered else b""
        connection.sendall(b"zz\r\n" if answered else b"")
        received += read_to_its_end(connection)
    assert received.count(b"HTTP/1.1 ") == 1
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


@pytest.mark.parametrize("origin", ["http://[", "http://[::1", "null", "http://127.0.0.1]", "//", ""])
def test_an_origin_that_is_no_address_is_turned_away(url: str, caplog: pytest.LogCaptureFixture, origin: str) -> None:
    with caplog.at_level(logging.DEBUG, "uvicorn.error"), pytest.raises(InvalidStatus, match="403"):
        connect(socket_of(url), origin=Origin(origin))
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_a_browser_that_reads_nothing_any_more_is_not_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "PING", 0.3)
    monkeypatch.setattr("blackboard.view.web.application.MAX_BROWSERS", 1)
    with served(Feed(Recording(), Clock(), "t"), "t", Clock()) as url, opened(url) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        key = b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        deaf.sendall(HALVES["half an upgrade"] + key + b"\r\n")
        deadline = time.monotonic() + 30
        while True:
            try:
                with connect(socket_of(url)) as browser:
                    browser.recv(timeout=30)
                    break
            except Exception:
                assert time.monotonic() < deadline, "its place is still taken"
