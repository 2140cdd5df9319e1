"""The page in a real headless Chromium, which looks at the golden tape and at a team that runs on a bus. Skipped where there is none."""

import queue
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.state.fold import Fold
from blackboard.state.moments import Moment
from blackboard.tape.file import read
from blackboard.view.feed import TapeFeed
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus
from tests.files import GOLDEN
from tests.scenarios import SCENARIO
from tests.view.browser import FOUND, MISSING, Browser, browser
from tests.view.recorded import golden_team, recorded, within
from tests.view.serving import served

pytestmark = pytest.mark.skipif(FOUND is None, reason=MISSING)

TRIES = 5


class Live:
    """A team that runs: it has told a whole run, and then whatever is put into `news`. Its time stands, so nobody falls silent."""

    done: bool | None = None
    skipped = 0

    def __init__(self) -> None:
        self.fold, self.news, self.now = Fold(), queue.Queue[Envelope](), time.time()
        for envelope, _ in recorded():
            self.fold.hear_envelope(envelope, self.now)

    def receive(self) -> Sequence[tuple[float, Envelope]]:
        try:
            return [(self.now, self.news.get(timeout=0.05))]
        except queue.Empty:
            return []

    def hear_envelopes(self, envelopes: Sequence[tuple[float, Envelope]]) -> None:
        for at, envelope in envelopes:
            self.fold.hear_envelope(envelope, at)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as started:
        started.size(1280, 800)
        yield started


@pytest.fixture
def look(chromium: Browser) -> Iterator[Callable[[str], Browser]]:
    """Open an address. At the end of the test the page must have complained of nothing, and asked nobody else."""
    hosts: set[str] = set()

    def opened(url: str) -> Browser:
        hosts.add(url.split("/")[2])
        chromium.open("about:blank")  # a change behind the # alone opens nothing
        chromium.open(url)
        chromium.wait("document.readyState === 'complete' && window.page && page.state.shown && page.state.subject")
        return chromium

    yield opened
    chromium.open("about:blank")
    errors, asked = chromium.errors[:], set(chromium.hosts)
    chromium.errors.clear()
    chromium.hosts.clear()
    # a page may ask once more while its server stops
    assert [error for error in errors if "ERR_CONNECTION_REFUSED" not in error] == []
    assert asked == hosts


@pytest.fixture
def taped(look: Callable[[str], Browser]) -> Iterator[Browser]:
    """The page of the golden tape, all of which it has read."""
    with served(TapeFeed(read(GOLDEN)), "demo") as url:
        page = look(url)
        page.wait("page.state.done && page.state.shown.name")
        yield page


def check_shown(page: Browser, moment: Moment) -> None:
    """The page draws this moment: each agreed belief's peak, and a contour around the truth where it is in the region."""
    for name, about in moment.subjects.items():
        if about.best is None or about.truth is None:
            continue
        belief = f"page.best(page.state.shown.subjects['{name}'])"
        p = unpack(about.best.message.belief).p
        assert p[tuple(page.get(f"page.peak({belief})"))] == pytest.approx(p.max(), rel=0.03), name
        grid, score = about.best.message.belief.grid, about.scores.get("agreed")
        x, y = ((place - low) / grid.cell for place, low in zip(about.truth, grid.origin, strict=True))
        if score is not None and score.denser < 0.85:  # well inside, and not at the edge of a cell
            assert around(np.array(page.get(f"page.contour({belief})")), x, y), name


def around(pieces: np.ndarray, x: float, y: float) -> bool:
    """Whether pieces (x, y, x, y) of closed lines go around a point, or near it."""
    return within(pieces, x, y) or float(np.min(np.hypot(pieces[:, 0] - x, pieces[:, 1] - y))) < 0.75


def test_a_tape_is_shown_from_its_beginning_and_scrubbed(taped: Browser) -> None:
    moments = list(golden_team().moments)
    assert taped.get("page.history.moments.map((it) => it.tick)") == [moment.tick for moment in moments]
    assert taped.get("page.state.shown.tick") == moments[0].tick
    for place in (9, 3, len(moments) - 1):
        taped.get(
            f"(() => {{ const it = document.getElementById('scrub'); it.value = {place}; it.oninput({{ target: it }}); }})()"
        )
        taped.wait(f"page.state.shown.tick === {moments[place].tick} && page.state.shown.chosen === page.state.subject")
        check_shown(taped, moments[place])
    taped.get("[...document.querySelectorAll('#subjects button')].find((it) => it.title === 'robot/r1').click()")
    taped.wait("page.state.shown.chosen === 'robot/r1' && document.getElementById('matrix').children.length >= 2")
    assert "tick=" in taped.get("location.hash")


def test_a_time_that_is_typed_is_gone_to(taped: Browser) -> None:
    moments = list(golden_team().moments)
    middle = moments[len(moments) // 2]
    taped.get(f"""(() => {{ const it = document.getElementById("moment"); it.focus(); it.value = "{middle.time + 0.01:.2f}s";
        it.dispatchEvent(new KeyboardEvent("keydown", {{ key: "Enter", bubbles: true }})); }})()""")
    taped.wait(f"window.page.state.shown?.tick === {middle.tick}")
    taped.wait(f'document.getElementById("moment").value === "{middle.time:.1f} s"')


def test_labels_of_things_at_one_place_stand_below_each_other(taped: Browser) -> None:
    heights = "(() => { const all = []; return [1, 2, 3].map(() => window.page.apart(all, 50, 60, 20)); })()"
    assert len({round(height / 14) for height in taped.get(heights)}) == 3
    assert taped.get("window.page.apart([{ x: 0, y: 60, width: 20 }], 50, 60, 20)") == 60


def test_charts_show_the_seconds_around_the_moment(taped: Browser) -> None:
    times = [moment.time for moment in golden_team().moments]
    seconds = times[6] - times[0]
    for at, first in ((0, 0), (5, 2), (8, 5), (len(times) - 1, len(times) - 7)):
        around = taped.get(f"page.history.around({times[at]}, {seconds}).map((it) => it.time)")
        assert around == pytest.approx(times[first : first + 7])


def test_a_tape_is_played_at_a_speed_to_its_end(taped: Browser) -> None:
    last = list(golden_team().moments)[-1]
    for _ in range(3):
        taped.press("+")
    assert taped.get("page.state.speed") == 10
    taped.press(" ")
    taped.wait(f"!page.state.playing && page.state.shown.tick === {last.tick}")
    taped.press("Home")
    taped.wait("page.state.shown.tick === page.history.moments[0].tick")


def test_a_link_leads_to_a_moment_and_its_reasons(look: Callable[[str], Browser]) -> None:
    moment = list(golden_team().moments)[6]
    with served(TapeFeed(read(GOLDEN)), "demo") as url:
        page = look(f"{url}#subject=robot/r2&run={moment.run}&tick={moment.tick}")
        page.wait(f"page.state.done && page.state.shown.tick === {moment.tick} && page.state.shown.name")
        check_shown(page, moment)
        reasons = "document.getElementById('why')"  # those of the newest moment stand there until these have come
        page.wait(f"document.getElementById('whytitle').textContent === 'Why, in tick {moment.tick}'")
        page.wait(f"{reasons}.children.length > 2 && {reasons}.textContent.startsWith('robot/r2 is believed to be at')")


def test_a_killed_robot_is_shown_as_gone_within_two_seconds(look: Callable[[str], Browser]) -> None:
    live = Live()
    tokens = [
        envelope.key for envelope, _ in recorded() if envelope.kind is Kind.ALIVE and envelope.key.endswith("/r2")
    ]
    with served(live, "t") as url:
        page = look(url)
        row = "[...document.querySelectorAll('#processes tr')].find((it) => it.textContent.startsWith('r2'))"
        took = []
        for _ in range(TRIES):  # a busy machine may stall in one of them
            page.wait(f"['alive', 'silent'].includes({row}.children[1].textContent.split(' ')[0])")
            killed = time.monotonic()
            for token in tokens:
                live.news.put(Envelope(token, kind=Kind.GONE))
            page.wait(f"{row}.children[1].textContent.startsWith('gone ')")
            took.append(time.monotonic() - killed)
            if took[-1] < 2.0:
                break
            for token in tokens:
                live.news.put(Envelope(token, kind=Kind.ALIVE))
        assert min(took) < 2.0
        assert page.get("document.querySelector('#pulse [title^=r2]').className") == "robot gone"
        assert "r2 is gone" in page.get("document.getElementById('latest').textContent")
        alarms = "[...document.querySelectorAll('#alarms li')]"
        alarm = f"{alarms}.find((it) => it.textContent.startsWith('r2 is gone'))"
        page.wait(alarm)
        page.get(f"{alarm}.lastChild.click()")
        page.wait(f"!{alarm}")


def test_a_robot_that_may_be_anywhere_does_not_paint_the_map(look: Callable[[str], Browser]) -> None:
    """It has a dotted outline, and its name says that it is lost."""
    live, wide = Live(), gaussian(SCENARIO.grid, (12.0, 12.0), 1000.0)
    live.fold = Fold()
    for envelope, _ in recorded():
        told = envelope
        if envelope.kind is Kind.PUT and keys.AGREED.match(envelope.key) and envelope.key.endswith("/robot/r1"):
            changes = {"belief": pack(wide), "entropy": float(np.log(wide.p.size)), "state": None, "velocity": None}
            told = Envelope(envelope.key, encode(decode(Consensus, envelope.payload).model_copy(update=changes)))
        live.fold.hear_envelope(told, live.now)
    with served(live, "t") as url:
        page = look(url)
        page.wait("window.page.state.shown && window.page.state.shown.subjects['robot/r1']")
        filled = """(() => { const it = document.getElementById("map"), data = it.getContext("2d").getImageData(0, 0, it.width, it.height).data;
            let count = 0; for (let k = 3; k < data.length; k += 4) count += data[k] > 8; return count / (data.length / 4); })()"""
        assert page.get(filled) < 0.4


def test_alarms_that_are_over_are_one_card(look: Callable[[str], Browser]) -> None:
    live = Live()
    tokens = [e.key for e, _ in recorded() if e.kind is Kind.ALIVE and e.key.endswith(("/r1", "/r2"))]
    with served(live, "t") as url:
        page = look(url)
        alarms = "[...document.querySelectorAll('#alarms li')]"
        for kind, card in ((Kind.GONE, "r1 is gone"), (Kind.ALIVE, "over: ")):
            for token in tokens:
                live.news.put(Envelope(token, kind=kind))
            page.wait(f"{alarms}.find((it) => it.textContent.startsWith('{card}'))")
        page.wait(f"{alarms}.length === 1")
        card = page.get(f"{alarms}[0].textContent")
        assert "r1 gone" in card
        assert "r2 gone" in card
        page.get(f"{alarms}[0].lastChild.click()")
        page.wait(f"{alarms}.length === 0")


def test_the_map_is_zoomed_moved_and_its_layers_hidden(taped: Browser) -> None:
    taped.press("z")
    taped.press("z")
    taped.wait("page.state.zoom === 2.25 && page.state.centre")
    taped.get(
        "document.getElementById('map').dispatchEvent(new WheelEvent('wheel', {deltaY: -500, clientX: 99, clientY: 199}))"
    )
    taped.wait("page.state.zoom > 4")
    taped.press("a")
    taped.wait("page.state.zoom === 1 && page.state.centre === null")
    drawn = "document.getElementById('map').toDataURL()"
    taped.get("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    whole = taped.get(drawn)
    button = "document.querySelector('.legend [data-layer=belief]')"
    taped.get(f"{button}.click()")
    taped.wait(f"{button}.getAttribute('aria-pressed') === 'false' && {drawn} !== {whole!r}")
    taped.get(f"{button}.click()")
    taped.wait(f"{drawn} === {whole!r}")


def test_a_live_page_goes_back_and_returns_to_now(look: Callable[[str], Browser]) -> None:
    live = Live()
    moments = list(live.fold.teams["t"].moments)
    with served(live, "t") as url:
        page = look(url)
        page.wait(f"page.history.moments.length === {len(moments)} && page.state.connected")
        check_shown(page, moments[-1])
        page.press("Home")
        page.wait(f"page.state.shown.tick === {moments[0].tick} && page.state.shown.name")
        check_shown(page, moments[0])
        assert page.get("document.getElementById('state').textContent") == "paused"
        page.press("End")
        page.wait(f"!page.state.paused && page.state.shown.tick === {moments[-1].tick}")
        assert page.get("document.getElementById('state').textContent") == "live"


@pytest.mark.parametrize(("width", "height", "phone"), [(1280, 800, False), (390, 844, True)])
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_nothing_is_wider_than_the_window(
    look: Callable[[str], Browser], width: int, height: int, phone: bool, theme: str
) -> None:
    with served(TapeFeed(read(GOLDEN)), "demo") as url:
        page = look(url)
        page.size(width, height, phone=phone)
        try:
            page.wait("page.state.done && page.state.shown.name")
            if page.get("document.documentElement.dataset.theme") != theme:
                page.press("t")
            page.wait(f"document.documentElement.dataset.theme === '{theme}'")
            sizes: list[Any] = [page.get(f"document.documentElement.{side}") for side in ("scrollWidth", "clientWidth")]
            assert sizes[0] <= sizes[1] <= width
        finally:
            page.size(1280, 800)
