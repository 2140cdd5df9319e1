"""The picture of the page in the README: `make screenshots`, or `python -m tests.view.screenshots OUT.png [TAPE.mcap [TICK [SUBJECT]]]`.

Without a tape it records one: the demo of 40 s. Other sizes and themes for one's own eyes: `--all FOLDER`. A picture tells of which
page it is, so that a test can say when it is old.
"""

import hashlib
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

from blackboard.tape.file import read
from blackboard.view.feed import TapeFeed
from tests.files import ROOT
from tests.view.browser import FOUND, MISSING, Browser, browser
from tests.view.serving import served

HEADER = 33  # bytes of a PNG before its second chunk
TICK, SUBJECT = 150, "robot/r1"
SIZES = ((1280, 800, False), (390, 844, True), (1920, 1080, False), (2560, 1300, False))


def of_page() -> bytes:
    """A text chunk of a PNG that names the page's files as they are now."""
    digest = hashlib.sha256()
    for file in sorted((ROOT / "blackboard" / "view" / "web" / "page").iterdir()):
        digest.update(file.read_bytes())
    chunk = b"tEXtpage\0" + digest.hexdigest().encode()
    return (len(chunk) - 4).to_bytes(4) + chunk + zlib.crc32(chunk).to_bytes(4)


def show(page: Browser, url: str, tick: int, subject: str, theme: str) -> None:
    """Open a moment of a tape, and wait until all of it is drawn."""
    page.open("about:blank")
    page.open(f"{url}#subject={subject}&tick={tick}")
    page.wait("window.page && page.state.done && page.state.shown && page.state.shown.name")
    page.get(f"(() => {{ page.state.light = {str(theme == 'light').lower()}; dispatchEvent(new Event('resize')); }})()")
    page.wait(f"page.state.shown.tick === {tick} && document.documentElement.dataset.theme === '{theme}'")
    page.wait("document.getElementById('why').children.length > 2 && document.getElementById('matrix').children.length")
    page.get("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def main() -> None:
    if FOUND is None:
        sys.exit(MISSING)
    every = sys.argv[1] == "--all"
    out, *rest = sys.argv[2 if every else 1 :]
    with tempfile.TemporaryDirectory() as folder:
        tape = Path(rest[0]) if rest else Path(folder) / "demo.mcap"
        if not rest:
            command = (sys.executable, "-m", "blackboard", "demo", "--seconds", "40", "--record", str(tape), "--json")
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        tick, subject = int(rest[1]) if len(rest) > 1 else TICK, rest[2] if len(rest) > 2 else SUBJECT
        with served(TapeFeed(read(tape)), "demo") as url, browser() as page:
            for width, height, phone in SIZES if every else SIZES[:1]:
                for theme in ("dark", "light") if every else ("dark",):
                    page.size(width, height, phone=phone, ratio=2 if phone else 1)
                    show(page, url, tick, subject, theme)
                    picture = Path(out) / f"{width}-{theme}.png" if every else Path(out)
                    page.screenshot(picture)
                    png = picture.read_bytes()
                    picture.write_bytes(png[:HEADER] + of_page() + png[HEADER:])


if __name__ == "__main__":
    main()
