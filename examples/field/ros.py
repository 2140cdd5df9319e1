"""A robot of client.py that speaks ROS 2: this program is its nodes, `blackboard ros` and a `robot-agent` put it into the team.

    blackboard router -l tcp/127.0.0.1:7447
    blackboard serve --scenario examples/field/field.toml --sub-team a -e tcp/127.0.0.1:7447
    robot-agent --scenario examples/field/field.toml --id r1 -e tcp/127.0.0.1:7447
    blackboard ros --scenario examples/field/field.toml -e tcp/127.0.0.1:7447 --odometry r1=/r1/odom --fix r1=/r1/fix \
        --sees r1:robot/r2=/r1/sees/robot/r2 --sees r1:robot/r3=/r1/sees/robot/r3 --sees r1:object/ball=/r1/sees/object/ball
    python -m examples.field.ros -e tcp/127.0.0.1:7447 --seconds 30 --robots r1

Its messages are CDR bytes on the keys of rmw_zenoh (extra `ros`), so no ROS is needed. At the end it prints how far off it was.
"""

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

from blackboard.bridges.ros.names import ODOMETRY, POSE, key
from examples.field.client import each_step, parser, report
from examples.field.world import Said, Truth, World

STORE = get_typestore(Stores.ROS2_JAZZY)
DOMAIN = 0


def made(name: str, **fields: Any) -> Any:
    return STORE.types[name](**fields)


class Nodes:
    """The nodes of one robot: topics of odometry, fixes and sightings out, and the team's belief about it and about the ball in."""

    def __init__(self, session: zenoh.Session, robot: str, truth: Truth) -> None:
        self.robot, self.truth = robot, truth
        self.odom = np.zeros(3)  # x, y, heading in a frame that begins where it starts
        self.heard: dict[str, Any] = {}
        self._put = session.put
        self._kept = [self._listen(session, subject) for subject in (f"robot/{robot}", "object/ball")]

    def tell(self, said: Said) -> None:
        truth, c, s = self.truth, math.cos(self.odom[2] + said.turn / 2), math.sin(self.odom[2] + said.turn / 2)
        self.odom += said.distance * c, said.distance * s, said.turn
        none = made("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = made("geometry_msgs/msg/Twist", linear=none, angular=none)
        still = made("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
        odom = {"header": header("odom"), "pose": pose((*self.odom,), np.zeros((3, 3)))}
        self._say("odom", ODOMETRY, child_frame_id="base", twist=still, **odom)
        if said.start is not None:
            at = pose(said.start, np.diag(np.square([truth.start, truth.start, truth.start_heading])))
            self._say("fix", POSE, header=header("map"), pose=at)
        elif said.gps is not None:
            unknown = math.pi**2  # GPS knows no heading
            at = pose((*said.gps, 0.0), np.diag([truth.gps**2, truth.gps**2, unknown]))
            self._say("fix", POSE, header=header("map"), pose=at)
        for sighting in said.seen:
            ahead = np.array([math.cos(sighting.bearing), math.sin(sighting.bearing)])
            turned = np.array([ahead, [-ahead[1], ahead[0]]])  # along and across the line of sight
            covariance = np.diag([0.0, 0.0, math.pi**2])
            covariance[:2, :2] = turned.T @ np.diag([truth.range**2, (sighting.range * truth.bearing) ** 2]) @ turned
            place = pose((*(sighting.range * ahead), 0.0), covariance)
            self._say(f"sees/{sighting.subject}", POSE, header=header("base"), pose=place)

    def _say(self, topic: str, kind: str, **fields: Any) -> None:
        payload = bytes(STORE.serialize_cdr(made(kind, **fields), kind))
        self._put(key(DOMAIN, f"/{self.robot}/{topic}", kind), payload)

    def _listen(self, session: zenoh.Session, subject: str) -> Any:
        def hear(sample: zenoh.Sample) -> None:
            at = STORE.deserialize_cdr(bytes(sample.payload), POSE).pose.pose.position  # type: ignore[attr-defined]
            self.heard[subject] = np.array([at.x, at.y])

        return session.declare_subscriber(key(DOMAIN, f"/field/{subject}/pose", POSE), hear)


def header(frame: str) -> Any:
    nanoseconds = time.time_ns()
    stamp = made("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def pose(at: Sequence[float], covariance: np.ndarray) -> Any:
    """A pose in the plane: x, y and yaw, with their covariance."""
    x, y, yaw = at
    full = np.zeros((6, 6))
    full[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    turned = made("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    place = made("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)
    message = made("geometry_msgs/msg/Pose", position=place, orientation=turned)
    return made("geometry_msgs/msg/PoseWithCovariance", pose=message, covariance=full.ravel())


if __name__ == "__main__":
    args, off = parser(__doc__).parse_args(), dict[str, list[float]]()
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{args.connect}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    world = World(args.seed)
    with zenoh.open(config) as session:
        robots = {name: Nodes(session, name, world.truth) for name in args.robots}
        for _, said in each_step(world, args):
            for name, nodes in robots.items():
                nodes.tell(said[name])
                if (place := nodes.heard.get(f"robot/{name}")) is not None:
                    off.setdefault(name, []).append(math.dist(place, world.poses[name][:2]))
        for name, nodes in robots.items():
            report(name, off[name], nodes.heard["object/ball"])
