"""A page is opened in the browser where somebody would see it, and nowhere else; no browser is opened here."""

import subprocess
import sys
from typing import Any

import pytest

import blackboard.__main__
from blackboard.run import browser, launch
from blackboard.run.browser import can_open, open_page
from blackboard.view import __main__ as room


@pytest.mark.parametrize(
    ("terminal", "environment", "platform", "opens"),
    [
        (True, {"DISPLAY": ":0"}, "linux", True),
        (True, {"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        (True, {}, "linux", False),
        (True, {"DISPLAY": ""}, "linux", False),
        (False, {"DISPLAY": ":0"}, "linux", False),
        (True, {}, "darwin", True),
        (False, {}, "darwin", False),
    ],
)
def test_a_page_is_opened_before_a_display_and_from_a_terminal(
    terminal: bool, environment: dict[str, str], platform: str, opens: bool
) -> None:
    assert can_open(terminal=terminal, environment=environment, platform=platform) == opens


def test_the_browser_is_started_by_a_process_that_holds_no_stream_of_ours() -> None:
    started: list[tuple[tuple[str, ...], dict[str, Any]]] = []
    open_page("http://127.0.0.1:8642/", lambda command, **how: started.append((command, how)))
    ((command, how),) = started
    assert command == (sys.executable, "-m", "webbrowser", "-t", "http://127.0.0.1:8642/")
    assert {how[stream] for stream in ("stdin", "stdout", "stderr")} == {subprocess.DEVNULL}
    assert how["start_new_session"]


def test_a_page_that_is_to_be_opened_is_opened_once_it_is_served(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(room, "open_page", opened.append)
    room.announce("http://127.0.0.1:1/", opened=False)
    assert opened == []
    room.announce("http://127.0.0.1:1/", opened=True)
    assert opened == ["http://127.0.0.1:1/"]


@pytest.mark.parametrize(
    ("given", "can", "opens"), [(["--view"], True, True), (["--view"], False, False), ([], True, False)]
)
def test_a_demo_opens_its_page_where_that_can_be(
    given: list[str], can: bool, opens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    def run_scenario(*_: object, **how: Any) -> tuple[int, dict[str, Any]]:
        asked.append(how)
        return 0, {}

    monkeypatch.setattr(launch, "run_scenario", run_scenario)
    monkeypatch.setattr(browser, "can_open", lambda **_: can)
    command, bound, _ = blackboard.__main__.app.parse_args(
        ["demo", "--json", *given], exit_on_error=False, print_error=False
    )
    command(*bound.args, **bound.kwargs)
    assert asked == [{"view": bool(given), "open_page": opens}]
