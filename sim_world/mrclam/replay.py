"""A recorded real team (`sim_world.mrclam.files`), replayed tick by tick: robots r1, r2, ..., landmarks landmark/6, ...

Positions and ranges are in metres, angles in radians; team time is seconds since the start. What a robot is given at
time t rests on nothing stamped later than t.

Time stamps are corrected here: the commands lead the motion by `odometry_lag`, so a step holds the commands from that much
earlier, and a sighting carries its age. Scales and biases of the sensors are left to the robot's models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from blackboard.errors import UserError
from blackboard.wire.messages import Fix, Odometry, Readings, Sighting, Truth
from blackboard.wire.types import MAX_OPINIONS
from sim_world.mrclam.files import Recording, Track
from sim_world.mrclam.protocols import PROTOCOLS
from sim_world.scenario import WorldSection

START_SIGMA, START_HEADING_SIGMA = 0.05, 0.03  # metres, radians: how well the start pose is known
JUDGED_EVERY = 1.0  # seconds from one judged tick to the next


class Replay:
    """A recording as a `sim_world.sources.SensorSource`."""

    def __init__(
        self, settings: WorldSection, recording: Recording, robots: Sequence[str], dt: float, seconds: float
    ) -> None:
        """`dt` is a tick, `seconds` the length of the run. UserError: robots, start, seconds or tick that do not fit."""
        self.settings, self.recording, self.dt = settings, recording, dt
        self.protocol = PROTOCOLS[settings.protocol]
        self.numbers = {robot: recording.number(robot) for robot in robots}
        self.start = recording.first if settings.start is None else settings.start
        self.stride = round(JUDGED_EVERY / dt)
        if abs(self.stride * dt - JUDGED_EVERY) > 1e-9 or not self.stride:
            raise UserError(
                f"time.tick: {dt:g} s does not divide a second, and whole seconds are judged; use 0.5 or 1.0"
            )
        self._check_window(seconds)

    def _check_window(self, seconds: float) -> None:
        first, last = self.recording.first, self.recording.last
        if not first <= self.start < last:
            raise UserError(
                f"world.start: {self.start:.1f} is not in {self.recording.folder}; use {first:.0f} to {last:.0f}"
            )
        if self.start + seconds > last:
            raise UserError(
                f"time.seconds: {seconds:g} s reach beyond the recording; use at most {math.floor(last - self.start)}"
            )
        for robot, number in self.numbers.items():
            if self.recording.tracks[number].pose(self.start) is None:
                raise UserError(f"world.start: the ground truth of {robot} has a gap there; move the start by a second")

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(self.numbers)

    def admit(self, robot: str) -> bool:
        return robot in self.numbers

    def judged(self, tick: int) -> bool:
        return tick > 0 and tick % self.stride == 0

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        now = self.start + tick * self.dt
        poses = {number: track.pose(now) for number, track in self.recording.tracks.items()}
        places = {f"robot/r{number}": pose[:2] for number, pose in poses.items() if pose is not None}
        truth = Truth(run=run, tick=tick, time=tick * self.dt, positions=places)
        return truth, [self._sense(robot, truth) for robot in self.robots]

    def _sense(self, robot: str, truth: Truth) -> Readings:
        number = self.numbers[robot]
        track = self.recording.tracks[number]
        now, before = self.start + truth.tick * self.dt, self.start + (truth.tick - 1) * self.dt
        lost = self.protocol.lost(number)
        pose = track.pose(now)
        odometry, fix = None, None
        if truth.tick:
            distance, turn = track.commanded(before - self.settings.odometry_lag, now - self.settings.odometry_lag)
            odometry = Odometry(distance=distance, turn=turn, dt=self.dt)
        elif pose is not None and not lost:
            x, y, heading = pose
            fix = Fix(position=(x, y), sigma=START_SIGMA, heading=heading, heading_sigma=START_HEADING_SIGMA)
        return Readings(
            run=truth.run,
            robot=robot,
            tick=truth.tick,
            time=truth.time,
            odometry=odometry,
            compass=pose[2] if pose is not None and lost else None,
            fix=fix,
            sightings=self._sightings(number, track, before, now) if truth.tick else [],
        )

    def _sightings(self, number: int, track: Track, before: float, now: float) -> list[Sighting]:
        """What was stamped in (before, now] and the protocol allows, in time order."""
        found = []
        for stamp, seen, distance, bearing in track.sightings_in(before, now):
            subject = int(seen)
            place = self.recording.landmarks.get(subject)
            if place is None or self.protocol.allows(number, subject, stamp - self.start):
                name = f"robot/r{subject}" if place is None else f"landmark/{subject}"
                age = now - stamp + self.settings.sighting_latency
                found.append(Sighting(subject=name, range=distance, bearing=bearing, landmark=place, age=age))
        return found[-MAX_OPINIONS:]
