"""Open a page in the browser of this machine's user, if this machine has a display."""

import subprocess
import sys
from collections.abc import Callable, Mapping

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # of X and of Wayland; macOS and Windows have theirs anyway


def can_open(*, terminal: bool, environment: Mapping[str, str], platform: str = sys.platform) -> bool:
    """Whether a browser would be seen: standard output is a `terminal`, and there is a display."""
    return terminal and (platform in ("darwin", "win32") or any(environment.get(name) for name in DISPLAYS))


def open_page(url: str, start: Callable[..., object] = subprocess.Popen) -> None:
    """Open a page in the browser, by a process that holds none of our streams; where none opens nothing happens."""
    nothing = subprocess.DEVNULL
    start(
        (sys.executable, "-m", "webbrowser", "-t", url),
        stdin=nothing,
        stdout=nothing,
        stderr=nothing,
        start_new_session=True,
    )
