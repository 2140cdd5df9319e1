"""The bridge as a service (`blackboard.process.service.Service`): a node of ROS that follows a team and speaks for robots.

What is agreed on is published (`publisher`). Odometry, fixes and sightings become readings of robots (`driver`), poses the
reports of others.
"""

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from blackboard.bridges.ros import convert
from blackboard.bridges.ros.driver import Driver
from blackboard.bridges.ros.names import DETECTIONS, ODOMETRY, POSE, Node
from blackboard.bridges.ros.publisher import RosPublisher
from blackboard.client.member import Member
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief
from blackboard.state.fold import Fold
from blackboard.state.team import WORLD
from blackboard.view.summary import Table
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind

log = logging.getLogger(__name__)

STATUS_PERIOD = 1.0  # seconds between two DiagnosticArrays
OWN: Table = {"name": "ros", "kind": "bridge", "state": "alive", "sub_teams": [], "tick": None, "age": None}

Take = Callable[[bytes, float], list[Envelope]]


@dataclass(frozen=True)
class RosTopics:
    """What is taken in: robot -> topic; of sightings robot and subject -> topic."""

    odometry: Mapping[str, str] = field(default_factory=dict)
    fixes: Mapping[str, str] = field(default_factory=dict)
    poses: Mapping[str, str] = field(default_factory=dict)
    sees: Mapping[tuple[str, str], str] = field(default_factory=dict)
    detects: Mapping[str, str] = field(default_factory=dict)

    @property
    def driven(self) -> set[str]:
        """The robots whose readings are made of these."""
        return {*self.odometry, *self.fixes, *self.detects, *(robot for robot, _ in self.sees)}


class RosBridge:
    """One team and one node. `members` are the robots that it speaks for, by name: those of `sources.poses`."""

    def __init__(
        self, team: str, node: Node, sources: RosTopics, members: Mapping[str, Member], namespace: str
    ) -> None:
        """`namespace`: what the topics of beliefs begin with."""
        self.node = node
        self.refused: Counter[str] = Counter()  # of what came from ROS, by reason
        self._name, self._fold, self._publisher = team, Fold(most_bytes=0), RosPublisher(node, namespace)
        self._members = members
        self._drivers = {robot: Driver(robot) for robot in sources.driven}
        self._takes: dict[str, tuple[str, Take]] = {}  # key -> topic, and what is done with a message
        for robot, topic in sources.odometry.items():
            self._listen(topic, ODOMETRY, partial(self._hear_odometry, robot))
        for robot, topic in sources.fixes.items():
            self._listen(topic, POSE, partial(self._hear_fix, robot))
        for robot, topic in sources.poses.items():
            self._listen(topic, POSE, partial(self._hear_pose, robot))
        for (robot, subject), topic in sources.sees.items():
            self._listen(topic, POSE, partial(self._hear_sighting, robot, subject))
        for robot, topic in sources.detects.items():
            self._listen(topic, DETECTIONS, partial(self._hear_detections, robot))
        self._logged: set[tuple[str, str]] = set()
        self._status_due = 0.0
        self._counters: dict[str, int] = {}

    # --- what the loop needs --------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        inputs = (endpoint.token for endpoint in self.node.subscriptions.values())
        return (self.node.token, *inputs, *(token for member in self._members.values() for token in member.tokens))

    @property
    def listens(self) -> tuple[str, ...]:
        return (f"cop/{self._name}/**", *self._takes)

    @property
    def watches(self) -> tuple[str, ...]:
        return (f"cop/{self._name}/**",)

    @property
    def done(self) -> bool:
        return False

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self._counters = counters
        for member in self._members.values():
            member.record_link_counters(counters)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.key in self._takes:
            return self._take(envelope, now)
        self._fold.hear_envelope(envelope, now)
        out = [answer for member in self._members.values() for answer in _hear(member, envelope, now)]
        return self._own(out, now) + self._publisher.beliefs(self._fold.team(self._name), now)

    def wake(self, now: float) -> list[Envelope]:
        out = []
        for member in self._members.values():
            if (due := member.wake_at(now)) is not None and due <= now:
                out += member.wake(now)
        for driver in self._drivers.values():
            out += self._drive(driver, now)
        out = self._own(out, now)
        if now >= self._status_due:
            self._status_due = now + STATUS_PERIOD
            dropped = self._counters.get("dropped", 0)
            own = OWN | {"refused": dict(self.refused), "dropped": dropped, "counters": self._counters}
            out += self._publisher.diagnostics(self._fold.team(self._name), own, now)
        return out

    def wake_at(self, now: float) -> float | None:
        due = [driver.due() for driver in self._drivers.values()]
        members = [member.wake_at(now) for member in self._members.values()]
        return min([self._status_due, *(at for at in due + members if at is not None)])

    # --- from ROS to the team -------------------------------------------------------------------------------------------

    def _listen(self, topic: str, type_name: str, take: Take) -> None:
        self._takes[self.node.subscription(topic, type_name).key] = (topic, take)

    def _take(self, envelope: Envelope, now: float) -> list[Envelope]:
        """Refuse, count and log what cannot be used."""
        topic, take = self._takes[envelope.key]
        if envelope.kind is not Kind.PUT:
            return []
        try:
            return self._own(take(envelope.payload, now), now)
        except Refused as refusal:
            self.refused[refusal.reason] += 1
            self._log(topic, refusal.reason, f"{topic}: {refusal}; not logged again for this topic and reason")
            return []

    def _hear_odometry(self, robot: str, payload: bytes, now: float) -> list[Envelope]:
        self._drivers[robot].move(convert.odometry(payload), now)
        return self._drive(self._drivers[robot], now)

    def _hear_fix(self, robot: str, payload: bytes, now: float) -> list[Envelope]:
        self._drivers[robot].fix(self._framed(convert.place(payload)))
        return self._drive(self._drivers[robot], now)

    def _hear_sighting(self, robot: str, subject: str, payload: bytes, now: float) -> list[Envelope]:
        self._drivers[robot].see(subject, convert.place(payload), now)
        return self._drive(self._drivers[robot], now)

    def _hear_detections(self, robot: str, payload: bytes, now: float) -> list[Envelope]:
        self._drivers[robot].detect(convert.detections(payload), now)
        return self._drive(self._drivers[robot], now)

    def _hear_pose(self, robot: str, payload: bytes, now: float) -> list[Envelope]:
        member, place = self._members[robot], self._framed(convert.place(payload))
        try:
            belief = Belief.from_gaussian(member.grid, (place.x, place.y), place.covariance[:2, :2])
        except ValueError as error:
            raise Refused("mass", str(error)) from None
        return member.report(f"robot/{robot}", belief, now)

    def _framed(self, place: convert.PlanarPose) -> convert.PlanarPose:
        """Refused "frame": in another frame than the team's, where both name one."""
        grid = self._fold.team(self._name).grid
        if grid is not None and grid.frame and place.frame and place.frame != grid.frame:
            raise Refused("frame", f"in {place.frame!r}, the team's is {grid.frame!r}; transform it before")
        return place

    def _drive(self, driver: Driver, now: float) -> list[Envelope]:
        readings = driver.readings(now)
        world = self._fold.team(self._name).processes.get(WORLD)
        if readings is not None and world is not None and world.alive:
            self._log(
                "world", driver.robot, f"a world gives the readings of {driver.robot}; those from ROS are left out"
            )
            readings = None
        if readings is None:
            return []
        return [Envelope(keys.READING.key(team=self._name, robot=driver.robot), encode(readings))]

    def _log(self, where: str, what: str, text: str) -> None:
        """Log once for each `where` and `what`, which are few: topics, robots and reasons."""
        if (where, what) not in self._logged:
            self._logged.add((where, what))
            log.warning("%s", text)

    def _own(self, out: list[Envelope], now: float) -> list[Envelope]:
        """Show the fold what is sent to the team, too: a process does not hear itself."""
        for envelope in out:
            self._fold.hear_envelope(envelope, now)
        return out


def _hear(member: Member, envelope: Envelope, now: float) -> list[Envelope]:
    """Hand over what such a robot subscribes to or watches, and nothing else."""
    topic, parts = keys.parse(envelope.key) or (None, {})
    peer = member.peer
    mine = parts.get("sub_team") in (None, *peer.sub_teams) and parts.get("robot") in (None, peer.robot)
    wanted = topic in (keys.CLOCK, keys.WORLD, keys.AGREED, keys.REFUSED, keys.MEMBER, keys.BOARD)
    return member.receive(envelope, now) if mine and wanted else []
