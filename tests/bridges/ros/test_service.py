"""The bridge among a board and its robots on a bus: what it takes in from ROS, refuses, and says of itself."""

import math
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("rosbags.typesys", reason="no rosbags: pip install '.[ros]'")
from blackboard.board.service import BoardService
from blackboard.bridges.ros import convert
from blackboard.bridges.ros.names import DETECTIONS, DIAGNOSTICS, ODOMETRY, POSE, Node, key
from blackboard.bridges.ros.service import RosBridge, RosTopics
from blackboard.client.member import Member
from blackboard.config import BoardSection
from blackboard.net.bus import Bus
from blackboard.net.scheduler import Scheduler
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.process.service import Service
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Readings, Status
from tests.bridges.ros.detections import detected, result
from tests.bridges.ros.jazzy import GRID, JAZZY, START, of


def new_bridge(sources: RosTopics) -> RosBridge:
    members = {
        robot: Member(team="t", sub_teams=("a",), robot=robot, grid=GRID, settings=BoardSection())
        for robot in sources.poses
    }
    return RosBridge("t", Node("n", "ab", 0, lambda: START), sources, members, "t")


def pose(x: float, y: float, variance: float = 1.0, frame: str = "map") -> bytes:
    message = convert.pose(Belief.from_gaussian(Grid((60, 60)), (x, y), variance * np.eye(2)), START, (0.0, 0.01))
    object.__setattr__(message.header, "frame_id", frame)
    return convert.encode(message)


def moved(stamp: float, x: float) -> bytes:
    types, plain = JAZZY.types, JAZZY.deserialize_cdr(pose(10, 10), POSE)
    plain.pose.pose.position.__dict__["x"] = x
    object.__setattr__(plain.header.stamp, "sec", int(stamp))
    object.__setattr__(plain.header.stamp, "nanosec", round((stamp % 1) * 1e9))
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
    )
    return convert.encode(types[ODOMETRY](header=plain.header, child_frame_id="base", pose=plain.pose, twist=twist))


def team(*services: Service) -> tuple[Callable[[float], list[Envelope]], Bus]:
    """Services on a bus; a call lets so many seconds pass, and returns what all of them sent."""
    running, sent = Scheduler(START), list[Envelope]()
    running.bus.spies.append(sent.append)
    for service in services:
        running.join(service)

    def run(seconds: float) -> list[Envelope]:
        sent.clear()
        running.run_for(seconds)
        return list(sent)

    return run, running.bus


def test_a_pose_is_reported_as_the_robots_own_belief_and_comes_back_as_agreed() -> None:
    bridge = new_bridge(RosTopics(poses={"r7": "/amcl_pose"}))
    board = BoardService(team="t", sub_team="a", board="desk", grid=GRID, settings=BoardSection())
    run, bus = team(board, bridge)
    assert bridge.tokens[0] == bridge.node.token
    assert "cop/t/a/member/r7" in bridge.tokens
    assert any("/MS/" in token and "%amcl_pose" in token for token in bridge.tokens)
    run(1.0)
    bus.send(Envelope(key(0, "amcl_pose", POSE), pose(12, 8, 2.0)))
    out = run(2.0)
    poses = of(out, "t/robot/r7/pose", POSE)
    assert poses
    assert [poses[-1].pose.pose.position.x, poses[-1].pose.pose.position.y] == pytest.approx([12, 8], abs=0.2)
    assert poses[0].pose.covariance[0] == pytest.approx(2.0, rel=0.3)
    assert poses[-1].pose.covariance[0] > poses[0].pose.covariance[0]  # an old belief spreads
    assert poses[-1].pose.covariance[35] == pytest.approx(math.pi**2 / 3)  # a belief about a place says no heading
    states = of(out, "diagnostics", DIAGNOSTICS)[-1].status
    assert [(state.name, state.level) for state in states] == [
        ("team t: board desk", 0),
        ("team t: robot r7", 0),
        ("team t: bridge ros", 0),
    ]
    assert not bridge.refused
    assert board.intake.refused == {}


def test_odometry_and_fixes_become_the_readings_of_a_robot() -> None:
    bridge = new_bridge(RosTopics(odometry={"r1": "r1/odom"}, fixes={"r1": "/initialpose"}))
    run, bus = team(bridge)
    bus.send(Envelope(key(0, "initialpose", POSE), pose(5, 6)))
    for n in range(21):
        bus.send(Envelope(key(0, "r1/odom", ODOMETRY), moved(100 + n / 20, n / 10)))
        if n == 0:
            sent = run(0.05)
    sent += run(1.0)
    readings = [decode(Readings, envelope.payload) for envelope in sent if envelope.key == "cop/t/world/reading/r1"]
    assert [reading.tick for reading in readings] == list(range(len(readings)))
    assert [
        None if reading.fix is None else reading.fix.position for reading in readings if reading.fix is not None
    ] == [pytest.approx((5, 6), abs=0.1)]
    assert sum(reading.odometry.distance for reading in readings if reading.odometry is not None) == pytest.approx(2.0)
    assert sum(reading.odometry.dt for reading in readings if reading.odometry is not None) == pytest.approx(1.0)


def test_what_a_detector_sees_goes_with_the_robots_readings_and_bad_messages_are_counted() -> None:
    bridge = new_bridge(RosTopics(detects={"r1": "r1/detections"}))
    run, bus = team(bridge)
    run(0.1)
    where = key(0, "r1/detections", DETECTIONS)
    bus.send(Envelope(where, detected(([result("person", 0.7, 5.0, 6.0, 0.25)], (0.0, 0.0)))))
    bus.send(Envelope(where, detected(([], (1.0, 1.0)))))
    readings = [decode(Readings, envelope.payload) for envelope in run(1.0) if envelope.key == "cop/t/world/reading/r1"]
    (sighted,) = [sighting for reading in readings for sighting in reading.seen]
    assert (sighted.subject, sighted.kind) == ("person/?", "position")
    assert (sighted.values, sighted.confidence) == ((5.0, 6.0), 0.7)
    assert bridge.refused == {"fields": 1}


def test_what_a_robot_sees_goes_with_its_readings_of_a_robot_with_the_heading() -> None:
    bridge = new_bridge(RosTopics(sees={("r1", "object/ball"): "r1/ball", ("r1", "robot/r2"): "r1/mate"}))
    run, bus = team(bridge)
    run(0.1)
    bus.send(Envelope(key(0, "r1/ball", POSE), pose(5, 6, 0.5, frame="r1/base_link")))
    bus.send(Envelope(key(0, "r1/mate", POSE), pose(7, 8)))
    sent = run(0.1)
    bus.send(Envelope(key(0, "r1/ball", POSE), pose(9, 9)))
    bus.send(Envelope(key(0, "r1/ball", POSE), pose(4, 3)))  # of each subject the newest counts
    sent += run(1.0)
    readings = [decode(Readings, envelope.payload) for envelope in sent if envelope.key == "cop/t/world/reading/r1"]
    sightings = [sighting for reading in readings for sighting in reading.seen]
    assert [(sighting.subject, sighting.kind) for sighting in sightings] == [
        ("object/ball", "position"),
        ("robot/r2", "pose"),
        ("object/ball", "position"),
    ]
    assert sightings[0].values == pytest.approx((5, 6), abs=0.1)
    assert sightings[0].covariance == pytest.approx((0.5, 0.0, 0.5), abs=0.2)
    assert sightings[1].values == pytest.approx((7, 8, 0), abs=0.1)
    assert sightings[2].values == pytest.approx((4, 3), abs=0.1)
    assert all(0.0 <= sighting.age <= 0.3 for sighting in sightings)
    assert not bridge.refused


@pytest.mark.parametrize(
    ("topic", "type_name", "payload", "reason"),
    [
        ("r1/odom", ODOMETRY, b"", "fields"),
        ("r1/odom", ODOMETRY, b"\0\1\0\0" + b"\xff" * 400, "fields"),
        ("r1/odom", ODOMETRY, bytes(1 << 20), "too-large"),
        ("initialpose", POSE, pose(5, 6, frame="odom"), "frame"),
        ("amcl_pose", POSE, pose(5, 6, frame="odom"), "frame"),
        ("amcl_pose", POSE, pose(50, 6), "mass"),
        ("amcl_pose", POSE, pose(5, 6)[:-8] + b"\xff" * 8, "fields"),
    ],
)
def test_what_cannot_be_used_is_counted_named_once_and_told(
    topic: str, type_name: str, payload: bytes, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    bridge = new_bridge(RosTopics({"r1": "r1/odom"}, {"r1": "/initialpose"}, {"r7": "amcl_pose"}))
    board = BoardService(team="t", sub_team="a", board="desk", grid=GRID, settings=BoardSection())
    run, bus = team(board, bridge)
    run(2.0)  # the board tells the team's grid and its frame
    for _ in range(3):
        bus.send(Envelope(key(0, topic, type_name), payload))
    out = run(2.0)
    assert bridge.refused == {reason: 3}
    assert caplog.text.count(f"{topic}: {reason}: ") == 1
    assert not [envelope for envelope in out if envelope.key.startswith(("cop/t/world/", "cop/t/a/report/"))]
    (own,) = [state for state in of(out, "diagnostics", DIAGNOSTICS)[-1].status if state.name == "team t: bridge ros"]
    assert own.level == 1
    assert own.message == f"refuses messages: {reason} 3"


def test_while_a_world_gives_the_readings_those_from_ros_are_left_out(caplog: pytest.LogCaptureFixture) -> None:
    bridge = new_bridge(RosTopics(odometry={"r1": "r1/odom"}))
    steps = [Envelope(key(0, "r1/odom", ODOMETRY), moved(100 + n / 2, n / 2)) for n in range(5)]
    assert not bridge.receive(steps[0], START)
    assert len(bridge.receive(steps[1], START + 1)) == 1
    bridge.receive(Envelope("cop/t/world/alive", kind=Kind.ALIVE), START + 1)
    assert not [envelope for n in (2, 3) for envelope in bridge.receive(steps[n], START + n)]
    assert caplog.text.count("a world gives the readings of r1; those from ROS are left out") == 1
    bridge.receive(Envelope("cop/t/world/alive", kind=Kind.GONE), START + 3.5)
    (again,) = bridge.receive(steps[4], START + 4)
    odometry = decode(Readings, again.payload).odometry
    assert odometry is not None
    assert odometry.distance == pytest.approx(0.5)  # what the robot did in the world is not told again


def test_a_delete_on_its_topics_is_ignored() -> None:
    bridge = new_bridge(RosTopics({"r1": "r1/odom"}))
    assert bridge.receive(Envelope(key(0, "r1/odom", ODOMETRY), kind=Kind.DELETE), START) == []
    assert not bridge.refused


def test_a_robot_that_it_speaks_for_answers_a_world_that_waits() -> None:
    bridge = new_bridge(RosTopics(poses={"r7": "amcl_pose"}))
    bridge.receive(Envelope("cop/t/world/alive", kind=Kind.ALIVE), START)
    clocks = [Clock(run="w", tick=tick, time=tick / 5, mode="lockstep") for tick in (3, 4)]
    bridge.receive(Envelope("cop/t/world/clock", encode(clocks[0])), START)
    sent = bridge.receive(Envelope(key(0, "amcl_pose", POSE), pose(5, 6)), START)
    assert [envelope.key for envelope in sent] == ["cop/t/a/report/r7/robot/r7", "cop/t/a/status/r7"]
    answers = bridge.receive(Envelope("cop/t/world/clock", encode(clocks[1])), START + 0.2)
    assert [e.key for e in answers] == ["cop/t/a/report/r7/robot/r7", "cop/t/score/solo/r7", "cop/t/a/status/r7"]
    assert decode(Status, answers[-1].payload).tick == 4
