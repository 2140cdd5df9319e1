"""What a team agrees on, and how its processes are, as messages of a ROS node: each agreed belief once. Pure."""

import logging
from collections.abc import Sequence

from blackboard.bridges.ros import convert
from blackboard.bridges.ros.names import DIAGNOSTICS, MAP, ODOMETRY, POINTS, POSE, TRANSFORMS, Node, part
from blackboard.errors import Refused
from blackboard.state.moments import Moment
from blackboard.state.received import Received, read
from blackboard.state.team import TeamFold
from blackboard.view.summary import Table, processes
from blackboard.wire.envelope import Envelope
from blackboard.wire.gaussians import pose_of, unpack_state, velocity_of
from blackboard.wire.messages import Consensus

log = logging.getLogger(__name__)

MAP_PERIOD = 1.0  # seconds between two maps of a subject: they are large
MAX_SUBJECTS = 256  # that are ever published: each has publishers of its own
SKEW = 30.0  # seconds by which the stamp of a team that goes by Unix time may be off
MOVING = 3  # numbers of a robot's velocity
HEADING = 2  # of the numbers of a state (docs/bytes.md, "Evidence for a joint")


class RosPublisher:
    """Publishes on `node`; the topics of beliefs begin with `namespace`. Times `now` are Unix seconds."""

    def __init__(self, node: Node, namespace: str) -> None:
        self._node, self._namespace = node, namespace
        self._moment: tuple[str, int] | None = None  # run and tick of the newest
        self._shown: dict[str, int] = {}  # subject -> tick of the belief that was published last
        self._mapped: dict[str, float] = {}  # subject -> when its last map was published
        self._holders: dict[str, str] = {}  # what topics begin with -> the subject
        self._silent: set[str] = set()  # subjects that cannot be published, and are logged

    def beliefs(self, team: TeamFold, now: float) -> list[Envelope]:
        """What the team's newest moment has that was not published."""
        moment = team.moments.newest
        if moment is None or (moment.run, moment.tick) == self._moment:
            return []
        if self._moment is None or moment.run != self._moment[0]:
            self._shown = {}
        self._moment = moment.run, moment.tick
        told = {subject: self._belief(moment, subject, now) for subject in moment.subjects}
        moved = [subject for subject, out in told.items() if out and subject.startswith("robot/")]
        return [envelope for out in told.values() for envelope in out] + self._robots(moment, moved, now)

    def diagnostics(self, team: TeamFold, own: Table, now: float) -> list[Envelope]:
        """The state of the team's processes, and of this one."""
        told = [*processes(team, now), own]
        return [self._put("diagnostics", DIAGNOSTICS, convert.diagnostics(told, f"team {team.name}", now))]

    def _belief(self, moment: Moment, subject: str, now: float) -> list[Envelope]:
        best = moment.subjects[subject].best
        if best is None or best.message.level != "agreed" or best.message.tick <= self._shown.get(subject, -1):
            return []
        agreed = best.message
        belief, topic = read(agreed.belief), self._topic(subject, len(agreed.belief.grid.shape))
        if belief is None or topic is None:
            return []
        self._shown[subject] = agreed.tick
        stamp, heading, velocity = _stamp(best), _heading(agreed), velocity_of(agreed.velocity)
        out = [self._put(f"{topic}/pose", POSE, convert.pose(belief, stamp, heading, pose_of(agreed.pose)))]
        if heading is not None and velocity is not None and len(velocity.mean) == MOVING:
            message = convert.moving(belief, stamp, topic, heading, velocity)
            out.append(self._put(f"{topic}/odometry", ODOMETRY, message))
        if now >= self._mapped.get(subject, 0.0) + MAP_PERIOD:
            self._mapped[subject] = now
            out.append(self._put(f"{topic}/map", MAP, convert.occupancy(belief, stamp)))
        return out

    def _robots(self, moment: Moment, moved: Sequence[str], now: float) -> list[Envelope]:
        """The frames of robots whose belief is new, and for each of these where all others are."""
        places, poses, stamp, frame = dict[str, tuple[float, float]](), {}, now, ""
        for subject, about in moment.subjects.items():
            if subject.startswith("robot/") and about.best is not None and about.best.drawn is not None:
                agreed, (x, y) = about.best.message, about.best.drawn.mean
                places[subject], heading = (x, y), _heading(agreed)
                if subject in moved:
                    stamp, frame = _stamp(about.best), agreed.belief.grid.frame
                    if heading is not None and (topic := self._topic(subject, 2)) is not None:
                        poses[topic] = x, y, heading[0]
        out = [self._put("tf", TRANSFORMS, convert.transforms(poses, stamp, frame))] if poses else []
        for subject in moved:
            if (topic := self._topic(subject, 2)) is not None:
                others = [place for other, place in places.items() if other != subject]
                out.append(self._put(f"{topic}/mates", POINTS, convert.points(others, stamp, frame)))
        return out

    def _topic(self, subject: str, axes: int) -> str | None:
        """What a subject's topics begin with; None for one that cannot be published."""
        topic = "/".join((self._namespace, *(part(name) for name in subject.split("/"))))
        holder = self._holders.get(topic, subject)
        wrong = ""
        if holder != subject:
            wrong = f"/{topic} is the topic of {holder}; rename one"
        elif axes < 2:
            wrong = "its grid has one axis, for which ROS has no message"
        elif topic not in self._holders and len(self._holders) >= MAX_SUBJECTS:
            wrong = f"it would be one more than {MAX_SUBJECTS} subjects since the start"
        if not wrong:
            self._holders[topic] = subject
            return topic
        if subject not in self._silent and len(self._silent) < MAX_SUBJECTS:
            self._silent.add(subject)
            log.warning("%s is not published: %s", subject, wrong)
        return None

    def _put(self, topic: str, type_name: str, message: object) -> Envelope:
        return Envelope(self._node.publisher(topic, type_name).key, convert.encode(message))


def _stamp(received: Received[Consensus]) -> float:
    """When it was agreed, in Unix seconds; where that is a world's time, by which nodes of ROS do not go, when it came."""
    return received.message.time if abs(received.message.time - received.at) < SKEW else received.at


def _heading(agreed: Consensus) -> tuple[float, float] | None:
    """The heading of a robot in a joint, mean and variance; None where nobody knows it."""
    if agreed.state is None:
        return None
    try:
        state = unpack_state(agreed.state)
    except Refused:
        return None
    return float(state.mean[HEADING]), float(state.covariance[HEADING, HEADING])
