"""A headless Chromium, driven by its DevTools protocol: what a person's browser makes of the page. Nothing is downloaded for it."""

import base64
import json
import shutil
import subprocess
import tempfile
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect

from blackboard.process.clock import UnixClock
from tests.present import present

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FOUND = next((path for name in NAMES if (path := shutil.which(name))), None)
MISSING = "no Chromium on this machine (on Debian and Ubuntu the package chromium)"
SECONDS = 60.0  # that a fact may take to hold


class Browser:
    """One page. `errors` and `hosts` are what it complained of, and the hosts that it asked anything of."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._number = socket, 0
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def size(self, width: int, height: int, *, phone: bool = False, ratio: float = 1.0) -> None:
        """Set the size of the window in CSS pixels; `ratio` pixels of the screen are one of them."""
        self._call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=ratio, mobile=phone
        )

    def open(self, url: str) -> None:
        self._call("Page.navigate", url=url)

    def get(self, expression: str) -> Any:
        """The value of a JavaScript expression, a promise's once it is there. AssertionError: it raises."""
        result = self._call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait(self, expression: str) -> Any:
        """Wait until an expression of JavaScript is true, and return its value. TimeoutError: it is not after SECONDS."""
        look = f"{{ let it; try {{ it = {expression}; }} catch {{ it = null; }} if (it) done(it); else setTimeout(look, 20); }}"
        return self.get(f"new Promise((done) => {{ const look = () => {look}; look(); }})")

    def press(self, key: str) -> None:
        self.get(f"dispatchEvent(new KeyboardEvent('keydown', {{ key: {json.dumps(key)}, bubbles: true }}))")

    def screenshot(self, path: Path) -> None:
        """What the window shows, as PNG."""
        path.write_bytes(base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"]))

    def _call(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        clock = UnixClock()
        end = clock.now() + SECONDS
        while True:
            try:
                answer = json.loads(self._socket.recv(timeout=max(end - clock.now(), 0.0)))
            except TimeoutError:
                raise TimeoutError(f"after {SECONDS:g} s still no answer: {method} {parameters}") from None
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self._hear(answer.get("method", ""), answer.get("params", {}))

    def _hear(self, event: str, about: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(about["exceptionDetails"])[:500])
        elif event == "Runtime.consoleAPICalled" and about["type"] in ("error", "warning", "assert"):
            self.errors.append(json.dumps(about["args"])[:500])
        elif event == "Log.entryAdded" and about["entry"]["level"] in ("error", "warning"):
            self.errors.append(f"{about['entry']['text']} {about['entry'].get('url', '')}")
        elif event in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            url = urlsplit(about["request"]["url"] if "request" in about else about["url"])
            if url.scheme not in ("data", "blob"):
                self.hosts.add(url.netloc)


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser that is ended behind the block."""
    assert FOUND is not None, MISSING
    flags = ("--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--no-first-run")
    quiet = ("--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-proxy-server")
    with tempfile.TemporaryDirectory(prefix="browser-", ignore_cleanup_errors=True) as folder:
        command = (FOUND, *flags, *quiet, f"--user-data-dir={folder}", "about:blank")
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            try:
                port = _port(process)
                request = urllib.request.Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT")
                target = json.load(urllib.request.urlopen(request, timeout=SECONDS))
                with connect(target["webSocketDebuggerUrl"], max_size=1 << 26) as socket:
                    yield Browser(socket)
            finally:
                process.terminate()
                try:
                    process.communicate(timeout=10)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.communicate()


def _port(process: subprocess.Popen[str]) -> int:
    """The port on which the browser says that it listens. AssertionError: it ended before."""
    for said in present(process.stderr):
        if "DevTools listening on" in said:
            port = present(urlsplit(said.split()[-1]).port)
            return port
    raise AssertionError("the browser ended at once")
