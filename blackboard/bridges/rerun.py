"""A team in the Rerun viewer (extra `rerun`): each settled tick on the timelines `tick` and `team_time`.

    map/beliefs        DepthImage    the likeliest that any subject is in a cell, as the logarithm: 0 is nothing, 65535 a certainty
    map/agreed, /truth Points2D      where all subjects are believed, with their names, and where they are
    map/trails         LineStrips2D  of the last minute
    map/sightings      LineStrips2D  who sees whom
    entropy/{subject}, error/{subject}  Scalars   nats, and the grid's unit where the truth is told
    log                TextLog       who came and went, conflicts, who was left out

Pictures are in cells, row 0 at the top, so places are too: x to the right, and y downwards from the upper edge.
"""

import math
from collections import defaultdict, deque
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.bridges.stream import TRAIL, agreed, masses
from blackboard.errors import UserError, extra
from blackboard.opinion.grid import Grid
from blackboard.state.moments import Moment, Point
from blackboard.state.team import Event, TeamFold

DEPTH = 9.0  # nats below the highest peak that are shown
TROUBLE = {"gone", "conflict", "left out", "refused", "namesake"}  # events that are warnings


def open_viewer(team: str, save: Path | None, viewer: str | None) -> "RerunSink":
    """A file, a viewer that runs (`rerun+http://127.0.0.1:9876/proxy`), or else one that is started here. UserError: no extra."""
    with extra("rerun", "the bridge"):
        import rerun
    recording = rerun.RecordingStream(f"cop-blackboard {team}")
    if save is not None:
        if save.exists():
            raise UserError(f"--save {save}: is there already; choose another name")
        recording.save(save)
    elif viewer is not None:
        try:
            recording.connect_grpc(viewer)
        except Exception as error:  # whatever the library makes of an address
            raise UserError(f"--viewer {viewer}: {error}; say as rerun+http://127.0.0.1:9876/proxy") from error
    else:
        recording.spawn()
    return RerunSink(rerun, recording)


class RerunSink:
    """Moments and events as Rerun shows them (`blackboard.bridges.stream.Sink`)."""

    def __init__(self, rerun: Any, recording: Any) -> None:
        self._rerun, self._recording = rerun, recording
        self._trails: dict[str, deque[tuple[float, Point]]] = defaultdict(deque)
        self._run = ""

    def show(self, team: TeamFold, moment: Moment) -> None:
        grid = team.grid
        if grid is None or len(grid.shape) != 2:
            return
        if moment.run != self._run:
            self._run = moment.run
            self._trails.clear()
        rr = self._rerun
        self._recording.set_time("tick", sequence=moment.tick)
        self._recording.set_time("team_time", duration=moment.time)
        where = {name: (drawn.mean[0], drawn.mean[1]) for name, _, drawn in agreed(moment)}
        truths = [about.truth for about in moment.subjects.values() if about.truth is not None]
        self._log("map/beliefs", rr.DepthImage(_picture(moment, grid), depth_range=(0, 65535), colormap="viridis"))
        places = [_cell(place, grid) for place in where.values()]
        self._log("map/agreed", rr.Points2D(places, labels=[name.split("/", 1)[1] for name in where], radii=0.3))
        self._log("map/truth", rr.Points2D([_cell(place, grid) for place in truths], radii=0.2, colors=[255, 255, 255]))
        seen = [
            [_cell(where[a], grid), _cell(where[b], grid)] for a, b in moment.sightings if a in where and b in where
        ]
        self._log("map/sightings", rr.LineStrips2D(seen, radii=0.03, colors=[154, 167, 180]))
        self._log("map/trails", rr.LineStrips2D(self._trails_until(moment, where, grid), radii=0.06))
        for name, about in moment.subjects.items():
            if about.best is not None:
                self._log(f"entropy/{name}", rr.Scalars(about.best.message.entropy))
            if "agreed" in about.scores:
                self._log(f"error/{name}", rr.Scalars(about.scores["agreed"].error))

    def note(self, event: Event) -> None:
        text = f"{event.text} is {event.what}" if event.what in ("here", "gone") else event.text
        self._log("log", self._rerun.TextLog(text, level="WARN" if event.what in TROUBLE else "INFO"))

    def close(self) -> None:
        """Hand over what was not sent yet."""
        self._recording.flush()
        self._recording.disconnect()

    def _trails_until(self, moment: Moment, places: dict[str, Point], grid: Grid) -> list[list[Point]]:
        for name, place in places.items():
            self._trails[name].append((moment.time, place))
        for trail in self._trails.values():
            while trail and trail[0][0] < moment.time - TRAIL:
                trail.popleft()
        return [[_cell(place, grid) for _, place in trail] for trail in self._trails.values() if len(trail) > 1]

    def _log(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what)


def _picture(moment: Moment, grid: Grid) -> npt.NDArray[np.uint16]:
    """The highest probability of any subject in each cell as a logarithm, rows of y from the top."""
    highest = np.zeros(grid.shape)
    for _, _, drawn in agreed(moment):
        (i, j), (n, m) = drawn.lo, drawn.box
        part = highest[i : i + n, j : j + m]
        np.maximum(part, masses(drawn), out=part)
    nats = np.log(np.maximum(highest, 1e-300)) - math.log(max(float(highest.max()), 1e-300))
    levels = np.rint(65535.0 * np.clip(1.0 + nats / DEPTH, 0.0, 1.0)).astype(np.uint16)
    return np.ascontiguousarray(levels.T[::-1])


def _cell(place: Point, grid: Grid) -> Point:
    """A place in the pixels of the picture."""
    x, y = ((at - low) / grid.cell for at, low in zip(place, grid.origin, strict=True))
    return x, grid.shape[1] - y
