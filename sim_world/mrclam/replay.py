"""A recorded real team (`sim_world.mrclam.files`), replayed tick by tick: robots r1, r2, ..., landmarks landmark/6, ...

Positions and ranges are in metres, angles in radians; team time is seconds since the start. What a robot is given at
time t rests on nothing stamped later than t.

Time stamps are corrected here: the commands lead the motion by `odometry_lag`, so a step holds the commands from that much
earlier, and a sighting carries its age. Scales and biases of the sensors are left to the robot's models.
"""

import math
from collections.abc import Sequence

from blackboard.config.protocols import SightingProtocol, protocol_of
from blackboard.config.world import WorldSection
from blackboard.errors import UserError
from blackboard.wire.messages import Fix, Odometry, Readings, Sighting, Truth
from blackboard.wire.types import MAX_OPINIONS
from sim_world.mrclam.files import Recording, RobotFiles

START_SIGMA, START_HEADING_SIGMA = 0.05, 0.03  # metres, radians: how well the start pose is known
JUDGED_EVERY = 1.0  # seconds from one judged tick to the next


class MrclamSource:
    """A recording as a `sim_world.sources.SensorSource`."""

    def __init__(
        self, settings: WorldSection, recording: Recording, robots: Sequence[str], dt: float, seconds: float
    ) -> None:
        """`dt` is a tick, `seconds` the length of the run. UserError: robots, start, seconds or tick that do not fit."""
        self.settings, self.recording, self.dt = settings, recording, dt
        self.protocol = protocol_of(settings.protocol) or SightingProtocol()
        numbers = {robot: recording.number(robot) for robot in robots}
        self.numbers = {robot: number for robot, number in numbers.items() if number != self.protocol.unknown}
        self.start = recording.first if settings.start is None else settings.start
        self.stride = stride_of(dt)
        self._check_window(seconds)
        self._check_unknown()

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

    def _check_unknown(self) -> None:
        unknown = self.protocol.unknown
        if unknown is not None and unknown not in {*self.recording.landmarks, *self.recording.tracks}:
            raise UserError(
                f"world.protocol: {self.settings.protocol} is about {unknown}, which is not in the recording"
            )

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(self.numbers)

    def admit(self, robot: str) -> bool:
        return robot in self.numbers

    def judged(self, tick: int) -> bool:
        """Whole seconds; where there is an object, those in which at least two robots saw it."""
        return tick > 0 and tick % self.stride == 0 and (self.protocol.unknown is None or self._seen_by(tick) >= 2)

    def _seen_by(self, tick: int) -> int:
        """How many robots saw the object in the last second."""
        now = self.start + tick * self.dt
        seen = (self.recording.tracks[number].sightings_in(now - JUDGED_EVERY, now) for number in self.numbers.values())
        return sum(any(int(subject) == self.protocol.unknown for _, subject, _, _ in rows) for rows in seen)

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        now = self.start + tick * self.dt
        poses = {number: track.pose(now) for number, track in self.recording.tracks.items()}
        places = {self._name(number): pose[:2] for number, pose in poses.items() if pose is not None}
        landmark = self.recording.landmarks.get(self.protocol.unknown or 0)
        if landmark is not None:
            places[self._name(self.protocol.unknown or 0)] = landmark
        headings = {self._name(number): pose[2] for number, pose in poses.items() if pose is not None}
        truth = Truth(run=run, tick=tick, time=tick * self.dt, positions=places, headings=headings)
        return truth, [self._sense(robot, truth) for robot in self.robots]

    def _sense(self, robot: str, truth: Truth) -> Readings:
        number = self.numbers[robot]
        track = self.recording.tracks[number]
        now, before = self.start + truth.tick * self.dt, self.start + (truth.tick - 1) * self.dt
        lost = self.protocol.lost(number)
        pose = track.pose(now)
        odometry, fix = None, None
        if truth.tick:
            lag = self.settings.odometry_lag
            distance, turn, curved, driven = track.commanded(before - lag, now - lag)
            odometry = Odometry(distance=distance, turn=turn, dt=self.dt, curved=curved, driven=driven)
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

    def _sightings(self, number: int, track: RobotFiles, before: float, now: float) -> list[Sighting]:
        """What was stamped in (before, now] and the protocol allows, in time order."""
        sightings = []
        for stamp, seen, distance, bearing in track.sightings_in(before, now):
            subject = int(seen)
            place = None if subject == self.protocol.unknown else self.recording.landmarks.get(subject)
            if place is None or self.protocol.allows(number, subject, stamp - self.start):
                age = now - stamp + self.settings.sighting_latency
                sightings.append(
                    Sighting(subject=self._name(subject), range=distance, bearing=bearing, landmark=place, age=age)
                )
        return sightings[-MAX_OPINIONS:]

    def _name(self, number: int) -> str:
        """The subject of a robot or a landmark, which is an object where the protocol makes it one."""
        robot = number not in self.recording.landmarks
        if number == self.protocol.unknown:
            return f"object/robot{number}" if robot else f"object/landmark{number}"
        return f"robot/r{number}" if robot else f"landmark/{number}"


def stride_of(dt: float) -> int:
    """How many ticks of `dt` seconds follow each other from one judged tick to the next. UserError: they do not fit."""
    stride = round(JUDGED_EVERY / dt)
    if abs(stride * dt - JUDGED_EVERY) > 1e-9 or not stride:
        raise UserError(f"time.tick: {dt:g} s does not divide a second, and whole seconds are judged; use 0.5 or 1.0")
    return stride
