"""The terminal that shows a team live, by textual: who is there, what is believed, a heat map, and why."""

import asyncio
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import Footer, Static

from blackboard.errors import UserError
from blackboard.process.columns import shortened
from blackboard.process.printable import printable
from blackboard.state.moments import Moment
from blackboard.state.team import TeamFold
from blackboard.view.feed import Source
from blackboard.view.summary import (
    Table,
    alarm_lines,
    process_lines,
    subject_lines,
    team_line,
    team_summary,
    unnamed_lines,
)
from blackboard.view.tui.heat import Heat, heat
from blackboard.view.why import explain
from blackboard.view.words import sentences

PERIOD = 0.5  # seconds between two pictures
EVENTS = 6  # lines
SMALL = 40  # lines of a terminal below which nothing is left empty
MAX_LINE = 400  # characters of an event


class HeatMap(Widget):
    """A heat map, a line at a time: the upper half of a character is one pixel, its lower half another."""

    picture: Heat | None = None

    def show(self, picture: Heat | None) -> None:
        self.picture = picture
        self.refresh()

    def render_line(self, y: int) -> Strip:
        picture = self.picture
        if picture is None or 2 * y + 1 >= len(picture.pixels):
            return Strip.blank(self.size.width)
        segments = []
        for column, (upper, lower) in enumerate(zip(picture.pixels[2 * y], picture.pixels[2 * y + 1], strict=True)):
            letter = picture.marks.get((y, column))
            style = Style(color="#ffffff" if letter else _rgb(upper), bgcolor=_rgb(lower))
            segments.append(Segment(letter or "▀", style))
        return Strip(segments).adjust_cell_length(self.size.width)


class Top(App[None]):
    """Follows a source. Keys: see `BINDINGS`."""

    TITLE = "blackboard top"
    CSS = """
    #map { width: 1fr; min-width: 24; }
    #right { width: 1.2fr; min-width: 52; scrollbar-size-vertical: 1; }
    #head { height: 1; text-style: bold; }
    #alarms { height: auto; max-height: 4; color: $error; }
    #processes, #subjects, #why, #events { height: auto; margin-bottom: 1; }
    .-small #processes, .-small #subjects, .-small #why { margin-bottom: 0; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        ("q", "quit", "quit"),
        ("space", "pause", "pause"),
        Binding("left", "step(-1)", "tick", key_display="← →", priority=True),
        Binding("right", "step(1)", show=False, priority=True),
        Binding("left_square_bracket", "choose(-1)", "subject", key_display="[ ]"),
        Binding("right_square_bracket", "choose(1)", show=False),
        ("l", "scale", "log/linear"),
        ("w", "why", "why"),
        ("a", "seen", "alarms seen"),
    ]
    ENABLE_COMMAND_PALETTE = False  # its key takes the place of others in a footer of 80 columns

    def __init__(self, source: Source, team: str, drift: float = 1.0) -> None:
        """`drift` as in `explain`."""
        super().__init__()
        self.source, self.team_name, self.drift = source, team, drift
        self.chosen = ""
        self.log_scale, self.with_why = True, False
        self.table: Table = {"alarms": []}  # what is shown
        self.tick: int | None = None  # of the moment that is shown while paused
        self._seen: set[tuple[str, str, float]] = set()  # alarms that were looked at: what, who, since when

    def compose(self) -> ComposeResult:
        yield Static(id="head")
        yield Static(id="alarms")
        with Horizontal():
            yield HeatMap(id="map")
            with VerticalScroll(id="right"), Vertical():
                yield Static(id="subjects")
                yield Static(id="why")
                yield Static(id="processes")
                yield Static(id="events")
        yield Footer()

    def on_mount(self) -> None:
        self.run_worker(self._follow())
        self.set_interval(PERIOD, self.draw)

    async def _follow(self) -> None:
        """Take in what arrives, and rest as long as that took."""
        loop = asyncio.get_running_loop()
        while not self.source.done:
            envelopes = await asyncio.to_thread(self.source.receive)
            begin = loop.time()
            self.source.hear_envelopes(envelopes)
            await asyncio.sleep(loop.time() - begin)

    @property
    def fold(self) -> TeamFold:
        """What is known of the team."""
        return self.source.fold.team(self.team_name)

    def moment(self) -> Moment | None:
        """The moment that is shown: the newest, or the one at which it was paused while that is kept."""
        moment = None if self.tick is None else self.fold.moments.at(self.tick)
        return moment or self.fold.moments.newest

    def draw(self) -> None:
        if not self.query("#head"):
            return  # on a slow machine it is time to draw before the widgets are there
        fold, moment = self.fold, self.moment()
        table = self.table = team_summary(fold, self.source.now, moment)
        self.screen.set_class(self.size.height < SMALL, "-small")
        width = self.query_one("#right", VerticalScroll).scrollable_content_region.width or None
        state = "" if self.tick is None else "   PAUSED"
        self._show("head", [f"{team_line(table)}{state}"])
        table["alarms"] = [alarm for alarm in table["alarms"] if _name(alarm) not in self._seen]
        alarms = alarm_lines(table, self.size.width)
        self._show("alarms", alarms)
        self.query_one("#alarms").display = bool(alarms)
        self._show("processes", [*process_lines(table, width), *unnamed_lines(table, width)])
        names = list(table["subjects"])
        if self.chosen not in names:
            self.chosen = next((name for name in names if table["subjects"][name]["mean"] is not None), "")
        subjects = _text(subject_lines(table, width) if names else ["nothing is settled yet"])
        if self.chosen:
            subjects.highlight_regex(rf"(?m)^{self.chosen} .*$", "reverse")
        self.query_one("#subjects", Static).update(subjects)
        events = [
            f"tick {event.tick}  {event.text}{' is ' + event.what if event.what in ('here', 'gone') else ''}"
            for event in fold.events
        ]
        self._show("events", [shortened(event, width or MAX_LINE) for event in events[: -EVENTS - 1 : -1]])
        self.query_one("#why", Static).update(
            Text("\n".join(map(printable, self._why(moment))) if self.with_why else "")
        )
        self.query_one("#why").display = self.with_why
        view = self.query_one("#map", HeatMap)
        size = view.size
        if moment is None or fold.grid is None or len(fold.grid.shape) != 2 or not size.height:
            view.show(None)
        else:
            view.show(heat(moment, fold.grid, self.chosen, size.height, size.width, self.log_scale))

    def _show(self, name: str, lines: list[str]) -> None:
        self.query_one(f"#{name}", Static).update(_text(lines))

    def _why(self, moment: Moment | None) -> list[str]:
        if moment is None or not self.chosen:
            return []
        try:
            return sentences(explain(self.fold, moment, self.chosen, self.drift))
        except UserError as error:
            return [str(error)]

    # --- keys -----------------------------------------------------------------------------------------------------------

    def action_pause(self) -> None:
        newest = self.fold.moments.newest
        self.tick = newest.tick if self.tick is None and newest is not None else None
        self.draw()

    def action_step(self, by: int) -> None:
        """Show an earlier or a later moment that is kept."""
        ticks, shown = self.fold.moments.ticks, self.moment()
        if shown is not None:
            at = ticks.index(shown.tick) + by
            self.tick = ticks[max(0, min(at, len(ticks) - 1))]
            self.draw()

    def action_choose(self, by: int) -> None:
        moment = self.moment()
        names = [] if moment is None else list(moment.subjects)
        if names:
            at = names.index(self.chosen) if self.chosen in names else 0
            self.chosen = names[(at + by) % len(names)]
            self.draw()

    def action_scale(self) -> None:
        self.log_scale = not self.log_scale
        self.draw()

    def action_seen(self) -> None:
        """The alarms that are shown were looked at; one that begins anew is shown again."""
        self._seen = {*self._seen, *map(_name, self.table["alarms"])}
        self.draw()

    def action_why(self) -> None:
        self.with_why = not self.with_why
        self.draw()


def _name(alarm: Table) -> tuple[str, str, float]:
    return alarm["what"], alarm["who"], alarm["since"]


def _text(lines: list[str]) -> Text:
    return Text("\n".join(map(printable, lines)), no_wrap=True, overflow="crop")


def _rgb(pixel: npt.NDArray[np.uint8]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*pixel.tolist())
