"""The terminal with textual's pilot, on the golden tape and on a team that has told nothing; and the pure map behind it."""

import asyncio
import sys
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import pytest

from blackboard.errors import UserError
from blackboard.opinion.grid import Grid
from blackboard.tape.file import read
from blackboard.view.feed import TapeFeed
from blackboard.view.tui.heat import BACK, colour, heat
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from tests.commands import call
from tests.files import GOLDEN
from tests.view.recorded import team_of

pytest.importorskip("textual", reason="no textual: pip install '.[tui]'")

from textual.pilot import Pilot
from textual.widgets import Static

from blackboard.view.tui.top import HeatMap, Top
from tests.present import present


def on_a_tape(story: Callable[[Top, Pilot[None]], Coroutine[Any, Any, None]]) -> None:
    """Let a story happen in a terminal that has read the golden tape."""
    feed = TapeFeed(read(GOLDEN))
    while not feed.done:
        feed.hear_envelopes(feed.receive())

    async def play() -> None:
        top = Top(feed, "demo")
        async with top.run_test(size=(160, 50)) as pilot:
            while not top.query("#head"):
                await pilot.pause()
            top.draw()
            await pilot.pause()
            await story(top, pilot)

    asyncio.run(play())


def said(top: Top, name: str) -> str:
    return str(top.query_one(name, Static).render())


def test_it_shows_who_is_there_and_what_is_believed() -> None:
    async def story(top: Top, pilot: Pilot[None]) -> None:
        assert said(top, "#head").startswith("team demo: ")
        for name in ("board-a", "board-b", "r1", "r2", "r3", "world"):
            assert name in said(top, "#processes")
        assert "robot/r3" in said(top, "#subjects")
        assert "begins" in said(top, "#events") or "tick" in said(top, "#events")
        view = top.query_one("#map", HeatMap)
        assert view.picture is not None
        lines = [view.render_line(y) for y in range(view.size.height)]
        assert {line.cell_length for line in lines} == {view.size.width}
        assert any("×" in line.text for line in lines)

    on_a_tape(story)


def test_keys_pause_step_choose_and_explain() -> None:
    async def story(top: Top, pilot: Pilot[None]) -> None:
        await pilot.press("space")
        assert top.tick == 15
        assert "PAUSED" in said(top, "#head")
        await pilot.press("left", "left")
        assert top.tick == 13
        assert "tick 13" in said(top, "#head")
        await pilot.press(*["right"] * 9)
        assert top.tick == 15
        first = top.chosen
        await pilot.press("right_square_bracket")
        assert top.chosen != first
        await pilot.press("left_square_bracket", "w")
        assert top.chosen == first
        assert said(top, "#why").startswith(f"{first} is believed to be at ")
        before = top.query_one("#map", HeatMap).picture
        await pilot.press("l")
        after = present(top.query_one("#map", HeatMap).picture)
        assert not np.array_equal(present(before).pixels, after.pixels)
        await pilot.press("w", "space")
        assert top.tick is None
        assert not top.query_one("#why").display

    on_a_tape(story)


def test_a_team_that_has_told_nothing_is_shown_too() -> None:
    async def play() -> None:
        top = Top(TapeFeed(iter(())), "nobody")
        async with top.run_test(size=(80, 24)) as pilot:
            while not top.query("#head"):
                await pilot.pause()
            top.draw()
            await pilot.press("space", "left", "right_square_bracket", "w", "l")
            assert "nothing is settled yet" in said(top, "#subjects")

    asyncio.run(play())


@pytest.mark.parametrize("size", [(80, 24), (100, 30), (140, 40)])
def test_subjects_and_processes_fit_the_terminal(size: tuple[int, int]) -> None:
    async def story(top: Top, pilot: Pilot[None]) -> None:
        await pilot.resize_terminal(*size)
        await pilot.pause()
        top.draw()
        await pilot.pause()
        for name, words in (("#subjects", ("object/ball", "robot/r3")), ("#processes", ("board-a", "world", "alive"))):
            place, lines = top.query_one(name).region, said(top, name).splitlines()
            assert place.bottom < size[1]
            assert max(map(len, lines)) <= place.width
            assert all(word in said(top, name) for word in words)

    on_a_tape(story)


def test_a_small_terminal_has_room_for_all_keys_and_the_beginning_of_why() -> None:
    async def story(top: Top, pilot: Pilot[None]) -> None:
        await pilot.resize_terminal(80, 24)
        await pilot.press("w")
        await pilot.pause()
        assert top.query_one("#why").region.y < 16
        keys = list(top.query("FooterKey"))
        assert [str(key.render()).strip() for key in keys] == [
            "← → tick", "q quit", "space pause", "[ ] subject", "l log/linear", "w why", "a alarms seen"
        ]  # fmt: skip
        assert max(key.region.right for key in keys) <= 80

    on_a_tape(story)


def test_the_newest_event_comes_first_because_the_last_lines_may_not_fit() -> None:
    async def story(top: Top, pilot: Pilot[None]) -> None:
        for robot in ("r1", "r2"):
            token = keys.MEMBER.key(team="demo", sub_team="a", robot=robot)
            for kind in (Kind.ALIVE, Kind.GONE):
                top.source.fold.hear_envelope(Envelope(token, kind=kind), top.source.now)
        top.draw()
        newest, *older = said(top, "#events").splitlines()
        assert newest.endswith("r2 is gone")
        assert any(line.endswith("r1 is gone") for line in older)

    on_a_tape(story)


def test_an_alarm_stays_until_it_was_looked_at() -> None:
    async def story(top: Top, pilot: Pilot[None]) -> None:
        top.fold.alarms.raise_("gone", "r2", "r2 is gone", top.source.now - 12.0)
        top.draw()
        assert "! r2 is gone, for 12 s" in said(top, "#alarms")
        await pilot.press("a")
        assert said(top, "#alarms") == ""

    on_a_tape(story)


def test_the_map_has_each_peak_where_it_is_also_when_it_is_small() -> None:
    moment = present(team_of().moments.newest)
    grid = Grid((24, 24))
    for rows, columns in ((12, 24), (24, 48), (5, 11)):
        for number, (name, about) in enumerate(moment.subjects.items()):
            assert about.best is not None
            assert about.best.drawn is not None
            alone = type(moment)(
                "", 0, 0.0, 0.0, {**dict.fromkeys([f"x/{n}" for n in range(number)], type(about)()), name: about}
            )
            picture = heat(alone, grid, "", rows, columns, log=False)
            pixels = picture.pixels.astype(int)
            assert pixels.shape[1] <= columns
            assert len(pixels) <= 2 * rows + 1
            full = np.abs(pixels - np.array(colour(number))).sum(axis=2) <= 3  # a peak has the whole colour
            assert full.any(), name
            levels = np.frombuffer(about.best.drawn.levels, np.uint8).reshape(about.best.drawn.box)
            i, j = (
                int(k) + low
                for k, low in zip(
                    np.unravel_index(int(levels.argmax()), levels.shape), about.best.drawn.lo, strict=True
                )
            )
            height, width = min(pixels.shape[1], len(pixels)), pixels.shape[1]
            row, column = height - 1 - int((j + 0.5) * height / 24), int((i + 0.5) * width / 24)
            near = full[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
            assert near.any(), name
            assert (pixels == np.array(BACK)).all(axis=2).any()
            assert "×" in picture.marks.values()


def test_without_its_extra_it_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "blackboard.view.tui.top", None)
    with pytest.raises(UserError, match="needs the extra `tui`"):
        call("top")
