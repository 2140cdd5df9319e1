"""A robot's ROS odometry, absolute poses and sightings as the Readings of its `robot-agent`. Pure."""

import math
from collections import deque
from collections.abc import Sequence

from blackboard.bridges.ros.convert import Detection, PlanarPose
from blackboard.errors import Refused
from blackboard.opinion.gaussian.relation import upper
from blackboard.wire.evidence import Seen
from blackboard.wire.gaussians import one_way
from blackboard.wire.messages import Fix, Odometry, Readings, Sighting
from blackboard.wire.types import LEAST, MAX_OPINIONS

PERIOD = 0.2  # seconds between two Readings at least
GAP = 10.0  # seconds without odometry, or back in its stamps, after which it begins anew
FASTEST = 50.0  # metres per second: no robot of a team is faster
OLDEST = 2.0  # seconds: a message that seems to be older has a stamp of another clock, and is taken as of its arrival
WINDOW = 50  # messages; the one with the least delay among them gives the offset of the robot's clock


class Driver:
    """Sums up odometry, which may come faster than Readings go; fixes and sightings go with the next ones.

    `now` is Unix time in seconds. Readings are of the time at which their odometry was measured: a robot whose messages come late has
    not driven unmeasured. The clock of its stamps may be any, as one of a simulation.
    """

    def __init__(self, robot: str) -> None:
        self.robot = robot
        self._run = ""
        self._tick = 0
        self._last: PlanarPose | None = None
        self._odometry: Odometry | None = None  # since the last Readings
        self._fix: PlanarPose | None = None
        self._seen: dict[str, tuple[float, Seen]] = {}  # by subject, with the Unix time at which it was measured
        self._detected: list[tuple[float, Seen | Sighting]] = []  # by a detector, in its newest message
        self._behind: deque[float] = deque(maxlen=WINDOW)  # seconds that stamps were behind their arrival
        self._moved_at: float | None = None  # Unix time to which the odometry since the last Readings goes
        self._told_at = self._sent_at = -math.inf  # Unix time of the last Readings, and at which they went

    def move(self, place: PlanarPose, now: float) -> None:
        """Take a pose of the odometry, in any frame that stays. Refused "past": not newer than the last one."""
        last, self._last = self._last, place
        if last is None or abs(dt := place.stamp - last.stamp) > GAP:
            self._behind.clear()
            self._behind.append(now - place.stamp)
            return  # where it begins; a robot that did not tell how it moved is taken as one that stood
        if dt <= 0:
            self._last = last
            raise Refused("past", f"odometry of {self.robot} is not newer than the last: {place.stamp:.3f}")
        if math.hypot(place.x - last.x, place.y - last.y) > FASTEST * max(dt, 0.1):
            return  # its source began anew, at a place of its own
        self._behind.append(now - place.stamp)
        self._moved_at = self._measured(place, now)
        turn = math.remainder(place.yaw - last.yaw, math.tau)
        way = last.yaw + turn / 2
        dx, dy, c, s = place.x - last.x, place.y - last.y, math.cos(way), math.sin(way)
        piece = Odometry(distance=dx * c + dy * s, aside=dy * c - dx * s, turn=turn, dt=max(dt, LEAST))
        self._odometry = piece if self._odometry is None else one_way(self._odometry, piece)

    def fix(self, place: PlanarPose) -> None:
        """Take an absolute pose, in the team's frame."""
        self._fix = place

    def see(self, subject: str, place: PlanarPose, now: float) -> None:
        """Take where something is in the robot's own frame, of a robot also its heading; of each subject the newest counts.

        Refused "fields": its covariance is none that a sensor has.
        """
        is_pose = subject.startswith("robot/") and place.heading_sigma is not None
        size = 3 if is_pose else 2
        try:
            seen = Seen(
                subject=subject,
                kind="pose" if is_pose else "position",
                values=(place.x, place.y, place.yaw)[:size],
                covariance=upper(place.covariance[:size, :size]),
            )
        except ValueError:
            raise Refused("fields", f"{subject}: the covariance of x, y and yaw must be positive definite") from None
        self._seen[subject] = self._measured(place, now), seen

    def detect(self, things: Sequence[Detection], now: float) -> None:
        """Take all that a detector saw in one frame; of several frames the newest counts.

        What has no covariance becomes a range and a bearing, with the errors of the robot's camera model. Refused "fields": too many
        detections, the robot itself among them, or a covariance that is not positive definite.
        """
        if any(thing.kind == f"robot/{self.robot}" for thing in things):
            raise Refused("fields", f"a detection of {self.robot} by itself; of itself give --fix")
        if len(things) > MAX_OPINIONS // 2:
            raise Refused(
                "fields", f"{len(things)} detections of {self.robot} at once are more than {MAX_OPINIONS // 2}"
            )
        try:
            self._detected = [(self._measured(thing.place, now), _sighting(thing)) for thing in things]
        except ValueError:
            raise Refused(
                "fields", "the covariance of x and y of a detection must be positive definite, or all 0"
            ) from None

    def readings(self, now: float) -> Readings | None:
        """What is to be sent now, or None: nothing came, or too little time has passed."""
        if now < self._sent_at + PERIOD or not self._waits:
            return None
        self._run = self._run or f"ros since {now:.0f}"
        time = min(now, max(now if self._moved_at is None else self._moved_at, self._told_at))
        waiting = (*self._seen.values(), *self._detected)
        aged = [sighting.model_copy(update={"age": max(0.0, time - at)}) for at, sighting in waiting]
        readings = Readings(
            run=self._run,
            robot=self.robot,
            tick=self._tick,
            time=time,
            odometry=self._odometry,
            fix=self._fixed(),
            sightings=[sighting for sighting in aged if isinstance(sighting, Sighting)],
            seen=[sighting for sighting in aged if isinstance(sighting, Seen)],
        )
        self._seen, self._detected, self._moved_at = {}, [], None
        self._odometry = None
        self._fix, self._told_at, self._sent_at = None, time, now
        self._tick += 1
        return readings

    def due(self) -> float | None:
        """When the next Readings can go, in Unix seconds; None while nothing waits."""
        return self._sent_at + PERIOD if self._waits else None

    def _measured(self, place: PlanarPose, now: float) -> float:
        """The Unix time at which something was measured that arrives now, as far as odometry has told the offset of its clock."""
        at = min(now, place.stamp + min(self._behind, default=math.inf))
        return now if at < now - OLDEST else at

    @property
    def _waits(self) -> bool:
        return self._odometry is not None or self._fix is not None or bool(self._seen or self._detected)

    def _fixed(self) -> Fix | None:
        place = self._fix
        if place is None:
            return None
        sigma = max(math.sqrt(self._variance(place)), 1e-6)
        heading = place.heading_sigma
        if heading is None:
            return Fix(position=(place.x, place.y), sigma=sigma)
        return Fix(position=(place.x, place.y), sigma=sigma, heading=place.yaw, heading_sigma=max(heading, 1e-6))

    @staticmethod
    def _variance(place: PlanarPose) -> float:
        """The larger variance of the position: the wire's fix is round."""
        xx, yy, xy = place.covariance[0, 0], place.covariance[1, 1], place.covariance[0, 1]
        return float((xx + yy) / 2 + math.hypot((xx - yy) / 2, xy))


def _sighting(thing: Detection) -> Seen | Sighting:
    """ValueError: its covariance is neither positive definite nor all zeros."""
    x, y, covariance = thing.place.x, thing.place.y, thing.place.covariance[:2, :2]
    if not covariance.any():
        return Sighting(
            subject=thing.kind, range=math.hypot(x, y), bearing=math.atan2(y, x), confidence=thing.confidence
        )
    return Seen(
        subject=thing.kind, kind="position", values=(x, y), covariance=upper(covariance), confidence=thing.confidence
    )
