"""What the bridge publishes of a recorded team: each agreed belief once, as a pose and now and then as a map, under a name that ROS takes."""

import math

import numpy as np
import pytest

pytest.importorskip("rosbags.typesys", reason="no rosbags: pip install '.[ros]'")
from blackboard.bridges.ros.names import HASHES, MAP, ODOMETRY, POINTS, POSE, TRANSFORMS, Node, key
from blackboard.bridges.ros.publisher import MAX_SUBJECTS
from blackboard.bridges.ros.service import RosBridge, RosTopics
from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Grid
from blackboard.tape.file import read
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.gaussians import pack_pose, pack_state, pack_velocity
from blackboard.wire.messages import Consensus, Status
from tests.bridges.ros.jazzy import GRID, START, of
from tests.files import GOLDEN
from tests.wire.envelopes import consensus, put, token


def new_bridge(team: str = "t") -> RosBridge:
    return RosBridge(team, Node("n", "ab", 0, lambda: START), RosTopics(), {}, team)


@pytest.fixture(scope="module")
def taped() -> tuple[list[Envelope], list[Consensus]]:
    """What the bridge sends of a recorded demo, and all that was agreed there."""
    bridge, out, agreed = new_bridge(team="demo"), list[Envelope](), list[Consensus]()
    for at, envelope in read(GOLDEN):
        out += bridge.receive(envelope, at)
        if envelope.kind is Kind.PUT and "/agreed/" in envelope.key:
            agreed.append(decode(Consensus, envelope.payload))
    return out, agreed


def test_each_agreed_belief_is_published_once(taped: tuple[list[Envelope], list[Consensus]]) -> None:
    out, agreed = taped
    assert agreed
    for subject in {belief.subject for belief in agreed}:
        published = [consensus for consensus in agreed if consensus.subject == subject]
        poses = of(out, f"demo/{subject}/pose", POSE)
        assert len(poses) == len({consensus.tick for consensus in published})
        last = max(published, key=lambda consensus: consensus.tick)
        mean = unpack(last.belief).mean() if last.pose is None else last.pose.mean
        at = poses[-1].pose.pose.position
        assert [at.x, at.y] == pytest.approx([*mean], abs=1e-6)
        maps = of(out, f"demo/{subject}/map", MAP)
        assert 1 <= len(maps) <= len(poses)
        assert all(occupancy.data.max() == 100 and occupancy.data.min() >= 0 for occupancy in maps)
    robots = {consensus.subject for consensus in agreed if consensus.subject.startswith("robot/")}
    assert {envelope.key for envelope in out} == {
        *(key(0, f"demo/{c.subject}/{what}", kind) for c in agreed for what, kind in (("pose", POSE), ("map", MAP))),
        *(key(0, f"demo/{robot}/mates", POINTS) for robot in robots),
        *(
            key(0, f"demo/{consensus.subject}/odometry", ODOMETRY)
            for consensus in agreed
            if consensus.velocity is not None and consensus.state is not None
        ),
        key(0, "tf", TRANSFORMS),
    }


def test_robots_have_frames_and_each_hears_where_all_others_are(taped: tuple[list[Envelope], list[Consensus]]) -> None:
    out, agreed = taped
    newest = {consensus.subject: consensus for consensus in agreed if consensus.subject.startswith("robot/")}
    last = of(out, "tf", TRANSFORMS)[-1].transforms
    assert {frame.child_frame_id for frame in last} == {f"demo/{robot}" for robot in newest}
    places = {}
    for frame in last:
        state = newest[frame.child_frame_id.removeprefix("demo/")].state
        assert state is not None
        yaw = 2 * math.atan2(frame.transform.rotation.z, frame.transform.rotation.w)
        assert math.remainder(yaw - state.mean[2], math.tau) == pytest.approx(0.0, abs=1e-6)
        places[frame.child_frame_id] = frame.transform.translation.x, frame.transform.translation.y
    for robot in newest:
        cloud = of(out, f"demo/{robot}/mates", POINTS)[-1]
        points = np.frombuffer(cloud.data, "<f4").reshape(cloud.width, 3)
        others = [place for name, place in places.items() if name != f"demo/{robot}"]
        assert np.sort(points[:, :2], axis=0) == pytest.approx(np.sort(others, axis=0), abs=1e-4)
        assert not points[:, 2].any()


def test_a_robot_that_moves_has_an_odometry_with_its_twist() -> None:
    state = pack_state(Moments(np.array([5.0, 5.0, math.pi / 2, *np.zeros(9)]), np.eye(12) * 0.01))
    velocity = pack_velocity(Moments(np.array([0.0, 2.0, 0.5]), np.diag([0.01, 0.04, 0.09])))
    moving = agreed("robot/r1", 1).model_copy(update={"state": state, "velocity": velocity})
    (odometry,) = of(settle(new_bridge(), [moving]), "t/robot/r1/odometry", ODOMETRY)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "t/robot/r1")
    twist = odometry.twist.twist
    assert [twist.linear.x, twist.linear.y, twist.angular.z] == pytest.approx([2.0, 0.0, 0.5])
    assert np.diag(odometry.twist.covariance.reshape(6, 6)) == pytest.approx([0.04, 0.01, 0, 0, 0, 0.09])


def test_an_object_in_a_joint_is_published_finer_than_the_cells_of_its_belief() -> None:
    place = Moments(np.array([5.3, 4.9]), np.array([[0.04, 0.01], [0.01, 0.02]]))
    ball = agreed("object/ball", 1).model_copy(update={"pose": pack_pose(place)})
    (pose,) = of(settle(new_bridge(), [ball]), "t/object/ball/pose", POSE)
    assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == (5.3, 4.9)
    assert np.array_equal(pose.pose.covariance.reshape(6, 6)[:2, :2], place.covariance)


def test_its_stamps_are_unix_time_though_a_world_has_a_time_of_its_own(
    taped: tuple[list[Envelope], list[Consensus]],
) -> None:
    out, agreed = taped
    times = [at for at, _ in read(GOLDEN)]
    assert max(consensus.time for consensus in agreed) < 1e6
    for pose in of(out, "demo/robot/r1/pose", POSE):
        assert times[0] - 1 < pose.header.stamp.sec <= times[-1]


def test_two_subjects_of_which_ros_makes_one_name_are_told_apart(caplog: pytest.LogCaptureFixture) -> None:
    bridge = new_bridge()
    consensuses = [agreed(subject, tick) for tick in (1, 2) for subject in ("object/a-b", "object/a.b")]
    out = settle(bridge, consensuses)
    poses = of(out, "t/object/a_b/pose", POSE)
    assert len(poses) == 2
    assert caplog.text.count("object/a.b is not published: /t/object/a_b is the topic of object/a-b; rename one") == 1


def test_a_grid_with_one_axis_is_not_published_and_harms_no_other(caplog: pytest.LogCaptureFixture) -> None:
    line = Belief(Grid((4,)), np.full(4, 0.25))
    out = settle(new_bridge(), [agreed("object/a", 1, line), agreed("object/b", 1), agreed("object/a", 2, line)])
    assert of(out, "t/object/b/pose", POSE)
    assert not of(out, "t/object/a/pose", POSE)
    assert caplog.text.count("object/a is not published: its grid has one axis") == 1


def test_subjects_without_end_are_not_published_without_end(caplog: pytest.LogCaptureFixture) -> None:
    bridge, published = new_bridge(), set[str]()
    for first in range(0, 3 * MAX_SUBJECTS, 100):
        consensuses = [agreed(f"object/o{first + n}", 1 + first) for n in range(100)]
        published |= {
            envelope.key for envelope in settle(bridge, consensuses) if envelope.key.endswith(f"RIHS01_{HASHES[POSE]}")
        }
    assert len(published) == MAX_SUBJECTS
    assert caplog.text.count("is not published") == MAX_SUBJECTS  # and no more lines than that


def agreed(subject: str, tick: int, belief: Belief | None = None) -> Consensus:
    belief = belief or Belief.from_gaussian(GRID, (3, 4), np.eye(2))
    return consensus(belief, subject, board="desk", tick=tick, time=START + tick)


def settle(bridge: RosBridge, consensuses: list[Consensus]) -> list[Envelope]:
    """A board tells this, tick by tick."""
    out = bridge.receive(token(keys.BOARD, "desk"), START)
    for tick in sorted({message.tick for message in consensuses}):
        now = [consensus for consensus in consensuses if consensus.tick == tick]
        for message in now:
            out += bridge.receive(put(message), START + tick)
        subjects = sorted(consensus.subject for consensus in now)
        status = Status(process="desk", kind="board", tick=tick, time=START + tick, phase="agreed", subjects=subjects)
        out += bridge.receive(put(status), START + tick)
    return out
