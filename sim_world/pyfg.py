"""A recorded real team as a factor graph (`blackboard.config.pyfg`), replayed tick by tick.

Team time is seconds since the start. What a robot is given at time t rests on nothing stamped later than t. A robot gets its
start with an error that is drawn. Its odometry is dead reckoning over the ticks, and each measurement carries its age.
"""

import math
from collections.abc import Sequence

import numpy as np

from blackboard.config.pyfg import FactorGraph, RecordedRobot
from blackboard.config.world import WorldSection
from blackboard.errors import UserError
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Odometry, Readings, Truth
from blackboard.wire.types import MAX_OPINIONS
from sim_world.mrclam.files import LONGEST_GAP, interpolated
from sim_world.mrclam.replay import stride_of
from sim_world.world import Streams


class GraphReplay:
    """A factor graph as a `sim_world.sources.SensorSource`."""

    def __init__(
        self,
        settings: WorldSection,
        graph: FactorGraph,
        robots: Sequence[str],
        dt: float,
        seconds: float,
        streams: Streams,
    ) -> None:
        """`dt` is a tick, `seconds` the length of the run. UserError: robots, start, seconds or tick that do not fit."""
        self.settings, self.graph, self.dt, self.robots, self.streams = settings, graph, dt, tuple(robots), streams
        self.stride = stride_of(dt)
        unknown = sorted(set(robots) - set(graph.tracks))
        if unknown:
            known = ", ".join(graph.tracks)
            raise UserError(f"team.sub_teams: {graph.path} has no robot {unknown[0]}; it has {known}")
        self.start = graph.first if settings.start is None else settings.start
        if not graph.first <= self.start < graph.last:
            raise UserError(
                f"world.start: {self.start:.1f} is not in {graph.path}; use {graph.first:.1f} to {graph.last:.1f}"
            )
        if self.start + seconds > graph.last:
            raise UserError(
                f"time.seconds: {seconds:g} s reach beyond the recording; use at most {math.floor(graph.last - self.start)}"
            )

    def admit(self, robot: str) -> bool:
        return robot in self.robots

    def judged(self, tick: int) -> bool:
        """Whole seconds."""
        return tick > 0 and tick % self.stride == 0

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        now = self.start + tick * self.dt
        poses = {robot: _pose(self.graph.tracks[robot], now) for robot in self.robots}
        places = {f"robot/{robot}": pose[:2] for robot, pose in poses.items() if pose is not None}
        headings = {f"robot/{robot}": pose[2] for robot, pose in poses.items() if pose is not None}
        truth = Truth(run=run, tick=tick, time=tick * self.dt, positions=places, headings=headings)
        return truth, [self._sense(robot, truth, now) for robot in self.robots]

    def _sense(self, robot: str, truth: Truth, now: float) -> Readings:
        track = self.graph.tracks[robot]
        first = truth.tick == 0
        return Readings(
            run=truth.run,
            robot=robot,
            tick=truth.tick,
            time=truth.time,
            odometry=None if first else _moved(track, now - self.dt, now),
            fix=self._told(robot, track) if first else None,
            seen=[] if first else self._seen(track, now),
        )

    def _told(self, robot: str, track: RecordedRobot) -> Fix | None:
        """The start that a robot gets, with an error."""
        pose = _pose(track, self.start)
        if pose is None:
            return None
        sigma, turned = self.settings.start_sigma, self.settings.start_heading
        off = self.streams(f"start/{robot}").normal(size=3) * [sigma, sigma, turned]
        x, y, heading = (np.array(pose) + off).tolist()
        return Fix(position=(x, y), sigma=sigma, heading=heading, heading_sigma=turned)

    def _seen(self, track: RecordedRobot, now: float) -> list[Seen]:
        """What was measured in the tick before `now`."""
        sightings = []
        for time, kind, subject, values, covariance in track.seen:
            if now - self.dt < time <= now:
                place = self.graph.points.get(subject.removeprefix("landmark/"))
                sighting = Seen(
                    subject=subject, kind=kind, values=values, covariance=covariance, landmark=place, age=now - time
                )
                sightings.append(sighting)
        return sightings[-MAX_OPINIONS:]


def _pose(track: RecordedRobot, time: float) -> tuple[float, float, float] | None:
    """The true pose at a time; None outside the file, and in a gap of more than twice the usual time between poses."""
    return interpolated(track.truth, time, max(LONGEST_GAP, 2.0 * track.interval))


def _moved(track: RecordedRobot, since: float, until: float) -> Odometry:
    """The step of a tick by dead reckoning: along and to the left of the direction of half the turn."""
    times = track.odometry[:, 0]
    (x0, y0, h0), (x1, y1, h1) = (
        [float(np.interp(time, times, column)) for column in track.odometry[:, 1:].T] for time in (since, until)
    )
    middle = (h0 + h1) / 2
    (dx, dy), c, s = (x1 - x0, y1 - y0), math.cos(middle), math.sin(middle)
    return Odometry(distance=c * dx + s * dy, turn=h1 - h0, dt=until - since, aside=c * dy - s * dx)
