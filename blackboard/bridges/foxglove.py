"""A tape for Foxglove: an MCAP file with its well-known schemas, written by its own library (extra `foxglove`).

    /belief/{subject}   foxglove.Grid           the belief that stands for a subject, with a colour for the eye; what is faint is clear
    /agreed, /truth     foxglove.PosesInFrame   where all subjects are believed, and where they are
    /pose/{subject}     foxglove.PoseInFrame    the mean of one
    /log                foxglove.Log            who came and went, conflicts, who was left out

All is in the frame that the team's grid names, or "map", in the grid's unit, with z = 0. Times are those at which the recorder saw
a tick settled.
"""

from pathlib import Path
from typing import Any

import numpy as np

from blackboard.bridges.stream import TeamStream, agreed, corner, masses
from blackboard.errors import UserError, extra, writing
from blackboard.state.moments import Moment, Point
from blackboard.state.team import Event, TeamFold
from blackboard.view.taped import Taped

LATEST = 2.0**32 - 1  # Unix seconds, in the year 2106: no schema says a later time
FRAME = "map"  # where the team's grid names none
TROUBLE = {"gone", "conflict", "left out", "refused", "namesake"}  # events that are warnings
COLOURS = ((230, 159, 0), (86, 180, 233), (0, 158, 115), (204, 121, 167), (213, 94, 0), (0, 114, 178))  # Okabe and Ito
CELL = np.dtype([("probability", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")])


def export(taped: Taped, out: Path) -> int:
    """Write a tape into a new file, and return how many messages that has. UserError: it is there already, or the extra is missing."""
    with extra("foxglove", "the export"):
        import foxglove
    if out.exists():
        raise UserError(f"{out}: is there already; choose another name")
    with writing(out):
        context = foxglove.Context()
        writer = foxglove.open_mcap(out, context=context)
    with writer:
        sink = _File(foxglove, context)
        stream = TeamStream(taped.feed, taped.team)
        taped.read_on(lambda: _ignore(stream.new(sink)))
    return sink.messages


def _ignore(_: int) -> None:
    """How many moments were new does not matter here."""


class _File:
    """Moments and events as messages of a file (`blackboard.bridges.stream.Sink`)."""

    def __init__(self, foxglove: Any, context: Any) -> None:
        self._messages, self._channels, self._context = foxglove.messages, foxglove.channels, context
        self._open: dict[str, Any] = {}
        self._colours: dict[str, tuple[int, int, int]] = {}
        self._frame = FRAME
        self.messages = 0

    def show(self, team: TeamFold, moment: Moment) -> None:
        self._frame = (team.grid.frame if team.grid is not None else "") or FRAME
        places: dict[str, Point] = {}
        for name, _, drawn in agreed(moment):
            places[name] = drawn.mean[0], drawn.mean[1]
            colour = self._colours.setdefault(name, COLOURS[len(self._colours) % len(COLOURS)])
            x, y, cell = corner(moment, name, drawn)
            self._write(
                f"/belief/{name}",
                "Grid",
                moment.at,
                pose=self._pose((x, y)),
                column_count=drawn.box[0],
                cell_size=self._messages.Vector2(x=cell, y=cell),
                row_stride=drawn.box[0] * CELL.itemsize,
                cell_stride=CELL.itemsize,
                fields=self._fields(),
                data=cells(masses(drawn), colour),
            )
            self._write(f"/pose/{name}", "PoseInFrame", moment.at, pose=self._pose(places[name]))
        truths = [about.truth for about in moment.subjects.values() if about.truth is not None]
        self._write("/agreed", "PosesInFrame", moment.at, poses=[self._pose(place) for place in places.values()])
        if truths:
            self._write("/truth", "PosesInFrame", moment.at, poses=[self._pose(place) for place in truths])

    def note(self, event: Event) -> None:
        level = self._messages.LogLevel
        text = f"{event.text} is {event.what}" if event.what in ("here", "gone") else event.text
        kind = level.Warning if event.what in TROUBLE else level.Info
        self._log(
            "/log",
            event.at,
            self._messages.Log(timestamp=self._time(event.at), level=kind, message=text, name=event.who),
        )

    def _write(self, topic: str, schema: str, at: float, **fields: Any) -> None:
        message = getattr(self._messages, schema)(timestamp=self._time(at), frame_id=self._frame, **fields)
        self._log(topic, at, message)

    def _log(self, topic: str, at: float, message: Any) -> None:
        if topic not in self._open:
            channel = getattr(self._channels, f"{type(message).__name__}Channel")
            self._open[topic] = channel(topic, context=self._context)
        self._open[topic].log(message, log_time=round(at * 1e9))
        self.messages += 1

    def _time(self, at: float) -> Any:
        return self._messages.Timestamp.from_epoch_secs(min(at, LATEST))

    def _pose(self, place: Point) -> Any:
        m = self._messages
        position = m.Vector3(x=place[0], y=place[1], z=0.0)
        return m.Pose(position=position, orientation=m.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))

    def _fields(self) -> list[Any]:
        kind, field = self._messages.PackedElementFieldNumericType, self._messages.PackedElementField
        kinds = {"probability": kind.Float32}
        offsets = {name: CELL.fields[name][1] for name in CELL.names or ()} if CELL.fields else {}
        return [field(name=name, offset=at, type=kinds.get(name, kind.Uint8)) for name, at in offsets.items()]


def cells(p: np.ndarray, colour: tuple[int, int, int]) -> bytes:
    """The cells of a box (x, y) in rows of y, each its probability and a colour that is clearer the less likely the cell is."""
    values = np.zeros(p.T.shape, CELL)
    values["probability"] = p.T
    for name, value in zip(("red", "green", "blue"), colour, strict=True):
        values[name] = value
    values["alpha"] = np.rint(230.0 * np.sqrt(p.T / max(float(p.max()), 1e-300)))
    return values.tobytes()
