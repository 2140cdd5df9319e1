"""Beliefs as messages and back, read by rosbags' types of another distribution; bytes that are none are refused and harm nobody."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

typesys = pytest.importorskip("rosbags.typesys", reason="no rosbags.typesys: pip install '.[ros]'")
from blackboard.bridges.ros import convert
from blackboard.bridges.ros.names import DIAGNOSTICS, MAP, ODOMETRY, POSE
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from tests.bridges.ros.detections import detected, result

HUMBLE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
GRID = Grid((40, 30), 0.5, (-4.0, 2.0), "m", "map")


def sent(message: Any, type_name: str) -> Any:
    payload = convert.encode(message)
    assert payload[:4] == b"\0\1\0\0"
    return HUMBLE.deserialize_cdr(payload, type_name)


def new_pose(**changes: Any) -> bytes:
    """A pose whose numbers are changed by name: x, y, z, w (of the quaternion), covariance."""
    message = convert.pose(Belief.from_gaussian(GRID, (3, 9), [[2, 0.5], [0.5, 1]]), 12.25, (math.pi / 2, 0.04))
    for name, value in changes.items():
        where = message.pose.pose.orientation if name in ("qz", "qw") else message.pose.pose.position
        if name == "covariance":
            message.pose.covariance[:] = value
        else:
            object.__setattr__(where, name.removeprefix("q"), value)
    return convert.encode(message)


def test_a_belief_is_a_pose_with_the_covariance_of_its_cells() -> None:
    belief = Belief.from_gaussian(GRID, (3, 9), [[2, 0.5], [0.5, 1]])
    pose = sent(convert.pose(belief, 12.25, (math.pi / 2, 0.04)), POSE)
    assert (pose.header.frame_id, pose.header.stamp.sec, pose.header.stamp.nanosec) == ("map", 12, 250_000_000)
    at, turn = pose.pose.pose.position, pose.pose.pose.orientation
    assert [at.x, at.y] == pytest.approx(belief.mean().tolist())
    assert (at.z, turn.x, turn.y) == (0, 0, 0)
    assert [turn.z, turn.w] == pytest.approx([math.sqrt(0.5), math.sqrt(0.5)])
    expected = np.zeros((6, 6))
    expected[:2, :2] = belief.covariance() + np.eye(2) * 0.25 / 12
    expected[5, 5] = 0.04
    assert pose.pose.covariance.reshape(6, 6) == pytest.approx(expected)


def test_a_heading_that_nobody_knows_has_the_variance_of_any_heading() -> None:
    pose = sent(convert.pose(Belief.from_gaussian(Grid((9, 9)), (3, 3), np.eye(2)), 0.0), POSE)
    assert pose.pose.covariance[35] == pytest.approx(math.pi**2 / 3)
    assert pose.pose.pose.orientation.w == 1
    assert pose.header.frame_id == "map"  # of a grid whose frame nobody named


def test_a_pose_comes_back_as_it_went() -> None:
    place = convert.place(new_pose())
    assert (place.stamp, place.frame) == (12.25, "map")
    assert [place.x, place.y, place.yaw] == pytest.approx([3, 9, math.pi / 2], abs=0.01)
    assert place.covariance[:2, :2] == pytest.approx(np.array([[2, 0.5], [0.5, 1]]), abs=0.1)
    assert place.heading_sigma == pytest.approx(0.2)


def test_a_map_has_100_where_the_belief_is_densest_and_goes_row_by_row_along_x() -> None:
    p = np.zeros(GRID.shape)
    p[3, 1], p[4, 1], p[3, 2] = 0.8, 0.2, 0.004
    occupancy = sent(convert.occupancy(Belief(GRID, p / p.sum()), 1.0), MAP)
    info = occupancy.info
    assert (info.width, info.height, info.resolution) == (40, 30, 0.5)
    assert (info.origin.position.x, info.origin.position.y, info.origin.orientation.w) == (-4.0, 2.0, 1.0)
    assert occupancy.data.dtype == np.int8
    cells = {(i % 40, i // 40): int(value) for i, value in enumerate(occupancy.data) if value}
    assert cells == {(3, 1): 100, (4, 1): 25}  # 0.5 of 100 is rounded to 0


def test_of_a_grid_with_a_heading_the_plane_is_told() -> None:
    p = np.zeros((5, 4, 8))
    p[2, 1], p[3, 1] = 0.1, 0.025
    belief = Belief(Grid((5, 4, 8), 1.0, (0.0, 0.0, 0.0)), p)
    assert [*sent(convert.occupancy(belief, 0.0), MAP).data[5:10]] == [0, 0, 100, 25, 0]
    assert sent(convert.pose(belief, 0.0), POSE).pose.pose.position.x == pytest.approx(2.7)
    with pytest.raises(ValueError, match="one axis|1 axis"):
        convert.pose(Belief(Grid((4,)), np.full(4, 0.25)), 0.0)


def test_the_state_of_processes() -> None:
    row = {
        "kind": "robot",
        "sub_teams": ["a"],
        "tick": 3,
        "age": 0.04,
        "dropped": 0,
        "counters": {"heard": 7},
        "refused": {},
    }
    rows = [
        {**row, "name": "r1", "state": "alive"},
        {**row, "name": "r2", "state": "gone", "tick": None, "age": None},
        {**row, "name": "r3", "state": "silent"},
        {**row, "name": "r4", "state": "alive", "refused": {"future": 2}},
        {**row, "name": "r5", "state": "alive", "dropped": 4},
        {**row, "name": "r6", "state": "alive", "lost": 0.62},
        {**row, "name": "world", "kind": "world", "state": "alive"},
    ]
    states = sent(convert.diagnostics(rows, "team t", 2.0), DIAGNOSTICS).status
    assert [(state.name, state.level) for state in states] == [
        ("team t: robot r1", 0),
        ("team t: robot r2", 2),
        ("team t: robot r3", 3),
        ("team t: robot r4", 1),
        ("team t: robot r5", 1),
        ("team t: robot r6", 1),
        ("team t: world", 0),
    ]
    assert "lost with 62 %" in states[5].message
    assert "0.620" in [value.value for value in states[5].values if value.key == "lost"]
    assert {value.key: value.value for value in states[0].values} == {
        "sub-teams": "a",
        "tick": "3",
        "age [s]": "0.0",
        "heard": "7",
    }
    assert "future 2" in states[3].message


BAD = {
    "empty": b"",
    "only a header": b"\0\1\0\0",
    "big-endian": b"\0\0" + new_pose()[2:],
    "cut off": new_pose()[:-1],
    "too long": new_pose() + bytes(16),
    "a frame of 4 GiB": b"\0\1\0\0" + bytes(8) + struct.pack("<I", 0xFFFFFFFF) + bytes(500),
    "a frame that is no text": b"\0\1\0\0" + bytes(8) + struct.pack("<I", 4) + b"\xff\xfe\xfd\0" + bytes(344),
    "NaN": new_pose(x=math.nan),
    "infinite": new_pose(y=math.inf),
    "far": new_pose(x=1e8),
    "NaN covariance": new_pose(covariance=math.nan),
    "no covariance": new_pose(covariance=0.0),
    "negative covariance": new_pose(covariance=-np.eye(6).ravel()),
    "no positive definite covariance": new_pose(covariance=(np.eye(6) + 3 * np.eye(6)[[1, 0, 2, 3, 4, 5]]).ravel()),
    "no quaternion": new_pose(qz=0.0, qw=0.0),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_pose_is_refused(name: str) -> None:
    with pytest.raises(Refused, match="geometry_msgs/msg/PoseWithCovarianceStamped: ") as refusal:
        convert.place(BAD[name])
    assert refusal.value.reason == "fields"
    assert "\n" not in str(refusal.value)


def test_what_is_too_large_is_not_looked_at() -> None:
    with pytest.raises(Refused, match="^too-large:"):
        convert.odometry(bytes(convert.MAX_BYTES + 1))


@given(st.binary(max_size=900), st.booleans())
def test_whatever_comes_is_a_place_or_refused(payload: bytes, header: bool) -> None:
    for read in (convert.odometry, convert.place):
        try:
            place = read(b"\0\1\0\0" * header + payload)
        except Refused:
            continue
        assert np.isfinite([place.x, place.y, place.yaw]).all()


@given(st.integers(0, len(new_pose()) - 1), st.integers(0, 255))
def test_a_pose_with_one_byte_changed_is_a_place_or_refused(at: int, value: int) -> None:
    changed = bytearray(new_pose())
    changed[at] = value
    try:
        place = convert.place(bytes(changed))
    except Refused:
        return
    assert np.isfinite(place.covariance).all()
    assert place.covariance[0, 0] >= 0


def test_odometry_needs_no_covariance() -> None:
    types = HUMBLE.types
    still = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](
            linear=types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0),
            angular=types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0),
        ),
        covariance=np.zeros(36),
    )
    plain = HUMBLE.deserialize_cdr(new_pose(covariance=0.0), POSE)
    odometry = types[ODOMETRY](header=plain.header, child_frame_id="base_link", pose=plain.pose, twist=still)
    place = convert.odometry(bytes(HUMBLE.serialize_cdr(odometry, ODOMETRY)))
    assert [place.x, place.y, place.yaw] == pytest.approx([3, 9, math.pi / 2], abs=0.01)


def test_of_each_detection_the_likeliest_class_counts_where_it_is_told_or_in_the_middle_of_its_box() -> None:
    payload = detected(
        ([result("dog", 0.2, 8.0, 8.0), result("person", 0.7, 3.0, -1.0, 0.25)], (9.0, 9.0)),
        ([result("sports ball", 0.5)], (2.0, 1.0)),
    )
    man, ball = convert.detections(payload)
    assert (man.kind, man.confidence, man.place.stamp, man.place.x, man.place.y) == ("person/?", 0.7, 12.0, 3.0, -1.0)
    assert man.place.covariance[:2, :2] == pytest.approx(np.eye(2) * 0.25)
    assert (ball.kind, ball.place.x, ball.place.y) == ("object/sports_ball?", 2.0, 1.0)
    assert not ball.place.covariance.any()


@pytest.mark.parametrize(
    ("class_id", "kind"),
    [
        ("Robot", "robot/?"),
        ("object/ball", "object/ball"),
        ("object/ball?", "object/ball?"),
        ("été", "object/_t_?"),
        ("x" * 90, f"object/{'x' * 32}?"),
        ("3", "object/3?"),
        ("landmark/a", "object/landmark_a?"),
    ],
)
def test_any_name_of_a_class_becomes_one_of_the_teams(class_id: str, kind: str) -> None:
    (only,) = convert.detections(detected(([result(class_id, 1.0, 1.0)], (0.0, 0.0))))
    assert only.kind == kind


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (detected(([], (1.0, 1.0))), "fields"),
        (detected(([result("person", 0.0, 1.0)], (1.0, 1.0))), "fields"),
        (detected(([result("person", 1.5, 1.0)], (1.0, 1.0))), "fields"),
        (detected(([result(" ", 0.5, 1.0)], (1.0, 1.0))), "fields"),
        (detected(([result("person", math.nan, 1.0)], (1.0, 1.0))), "fields"),
        (detected(([result("person", 0.5, math.inf)], (1.0, 1.0))), "fields"),
        (detected(([result("person", 0.5, 1.0, 0.0, -1.0)], (1.0, 1.0))), "fields"),
        (detected(frame="r1/camera_optical_frame"), "frame"),
        (detected()[:20], "fields"),
        (detected(*[([result("person", 0.5, 1.0)], (1.0, 1.0))] * 300), "too-large"),
    ],
)
def test_detections_that_no_detector_makes_are_refused(payload: bytes, reason: str) -> None:
    with pytest.raises(Refused, match=f"^{reason}:"):
        convert.detections(payload)


def test_nothing_seen_is_no_mistake() -> None:
    assert convert.detections(detected()) == []
