"""Beliefs as messages of ROS 2, and its odometry and poses as numbers. Pure; `rosbags` has the types and the bytes (CDR).

Planes are planes: z, roll and pitch are 0, and so are their variances. A grid in cells is taken as one in metres.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from blackboard.bridges.ros.names import DETECTIONS, DIAGNOSTICS, MAP, ODOMETRY, POINTS, POSE, TRANSFORMS
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.classes import LONGEST
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Array
from blackboard.state.alarms import LIKELY_LOST
from blackboard.wire.names import SIGHTED

ANY_HEADING = math.pi**2 / 3  # variance of a heading of which nothing is known
MAX_BYTES = 1 << 16  # of a message that is taken; the ones we read have 1 kB and the names of two frames
UNIT = 0.05  # by which the length of a quaternion may miss 1

#: vision_msgs 4, which `rosbags` does not know: what each type holds.
VISION = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id",
    DETECTIONS: "std_msgs/Header header\nDetection3D[] detections",
}


@dataclass(frozen=True)
class PlanarPose:
    """A pose in the plane: x, y, yaw, and their covariance, shape (3, 3), in metres and radians."""

    stamp: float  # seconds
    frame: str
    x: float
    y: float
    yaw: float
    covariance: Array

    @property
    def heading_sigma(self) -> float | None:
        """The standard deviation of the yaw, or None where it says nothing."""
        variance = float(self.covariance[2, 2])
        return math.sqrt(variance) if 0 < variance < ANY_HEADING else None


@dataclass(frozen=True)
class Detection:
    """What a detector saw: what it is, where in the robot's frame, and how sure the detector is that something is there, 0 to 1."""

    kind: str  # a class, as `person/?`; or a subject where the detector names one of the team's, as `object/ball`
    place: PlanarPose  # with a covariance of zeros where the detector gives none, as is usual in ROS
    confidence: float


@cache
def _store() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in VISION.items():
        store.register(get_types_from_msg(text, name))
    return store


def _make(type_name: str, **fields: object) -> Any:
    return _store().types[type_name](**fields)


def encode(message: Any) -> bytes:
    """A message as bytes: CDR, little-endian, with its header."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def pose(belief: Belief, stamp: float, heading: tuple[float, float] | None = None, place: Moments | None = None) -> Any:
    """A belief's mean and covariance, that of a cell's width included. `heading`: mean and variance, where it is known.

    Without it the orientation is that of the frame, with the variance of a heading of which nothing is known.
    `place`, shape (2,) and (2, 2), is what the belief was drawn of, where that is known: it is told instead.
    """
    return _make(POSE, header=_header(stamp, belief.grid.frame), pose=_pose_of(belief, heading, place))


def moving(belief: Belief, stamp: float, child: str, heading: tuple[float, float], velocity: Moments) -> Any:
    """An Odometry: the pose in the grid's frame, and the velocity of a robot in its own frame, `child`.

    `velocity` is along x and y of the grid, and the rate of turn: mean, shape (3,), and covariance, shape (3, 3).
    """
    c, s = math.cos(heading[0]), math.sin(heading[0])
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    forward, aside, rate = (float(value) for value in turned @ velocity.mean)
    covariance = np.zeros((6, 6))
    covariance[np.ix_((0, 1, 5), (0, 1, 5))] = turned @ velocity.covariance @ turned.T
    twist = _make(
        "geometry_msgs/msg/Twist",
        linear=_make("geometry_msgs/msg/Vector3", x=forward, y=aside, z=0.0),
        angular=_make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=rate),
    )
    return _make(
        ODOMETRY,
        header=_header(stamp, belief.grid.frame),
        child_frame_id=child,
        pose=_pose_of(belief, heading),
        twist=_make(
            "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.ascontiguousarray(covariance.ravel())
        ),
    )


def transforms(poses: Mapping[str, tuple[float, float, float]], stamp: float, frame: str) -> Any:
    """Where the frames of some robots are in the team's: x, y and yaw by the name of the frame."""
    sent = []
    for child, (x, y, yaw) in poses.items():
        at = _pose(x, y, yaw)
        place = _make("geometry_msgs/msg/Vector3", x=x, y=y, z=0.0)
        turned = _make("geometry_msgs/msg/Transform", translation=place, rotation=at.orientation)
        sent.append(
            _make(
                "geometry_msgs/msg/TransformStamped",
                header=_header(stamp, frame),
                child_frame_id=child,
                transform=turned,
            )
        )
    return _make(TRANSFORMS, transforms=sent)


def points(places: Sequence[tuple[float, float]], stamp: float, frame: str) -> Any:
    """Points in the plane as a PointCloud2 of x, y and z in metres, as a costmap takes them for obstacles."""
    kind, cloud = "sensor_msgs/msg/PointField", np.zeros((len(places), 3), dtype="<f4")
    cloud[:, :2] = np.reshape(places, (-1, 2))
    fields = [
        _make(kind, name=name, offset=4 * number, datatype=_store().types[kind].FLOAT32, count=1)
        for number, name in enumerate("xyz")
    ]
    return _make(
        POINTS,
        header=_header(stamp, frame),
        height=1,
        width=len(cloud),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(cloud),
        data=np.frombuffer(cloud.tobytes(), dtype=np.uint8),
        is_dense=True,
    )


def occupancy(belief: Belief, stamp: float) -> Any:
    """A belief as a map: 100 in the likeliest cell, the others in proportion, rounded; row by row along x, as ROS has it."""
    flat = _plane(belief)
    levels = np.rint(100.0 * flat.p / flat.p.max()).astype(np.int8)
    info = _make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=_time(stamp),
        resolution=flat.grid.cell,
        width=flat.grid.shape[0],
        height=flat.grid.shape[1],
        origin=_pose(flat.grid.origin[0], flat.grid.origin[1], 0.0),
    )
    return _make(MAP, header=_header(stamp, flat.grid.frame), info=info, data=np.ascontiguousarray(levels.T.ravel()))


def diagnostics(processes: Iterable[dict[str, Any]], prefix: str, stamp: float) -> Any:
    """The processes of a team (`blackboard.view.summary.processes`): gone is ERROR, silent STALE, and who refuses WARN."""
    statuses = [_diagnosed(process, prefix) for process in processes]
    return _make(DIAGNOSTICS, header=_header(stamp, ""), status=statuses)


def odometry(payload: bytes) -> PlanarPose:
    """The pose of an Odometry in its own frame. Refused: it is no such message, or has numbers that no robot has."""
    return _place(payload, ODOMETRY)


def place(payload: bytes) -> PlanarPose:
    """A PoseWithCovarianceStamped. Refused: as there, or its matrix is no covariance, or all zeros."""
    pose = _place(payload, POSE)
    if _largest(pose.covariance, POSE) <= 0:
        raise Refused("fields", f"{POSE}: the variances of x and y are 0, which no sensor has; fill in the covariance")
    return pose


def detections(payload: bytes) -> list[Detection]:
    """What a Detection3DArray holds, of each thing the likeliest class. Refused: as of `place`, or something has no class or score.

    Where a thing's pose is not told, it is in the middle of its box. Its orientation is left out, because detectors seldom know it.
    """
    message = _decode(payload, DETECTIONS)
    frame = message.header.frame_id
    if frame.endswith("optical_frame"):
        raise Refused(
            "frame", f"in {frame!r}, where z is ahead; transform it to the robot's, where x is ahead and y to the left"
        )
    return [_detected(thing, message.header) for thing in message.detections]


def _detected(thing: Any, header: Any) -> Detection:
    best = max(thing.results, key=lambda result: float(result.hypothesis.score), default=None)
    if best is None or not 0 < best.hypothesis.score <= 1 or not best.hypothesis.class_id.strip():
        raise Refused(
            "fields", f"{DETECTIONS}: each detection needs a result with a class_id and a score above 0, at most 1"
        )
    pose, covariance = best.pose.pose, _planar(best.pose.covariance)
    if not covariance.any() and not any((pose.position.x, pose.position.y)):
        pose = thing.bbox.center
    _check([pose.position.x, pose.position.y, *covariance.ravel()], DETECTIONS)
    _largest(covariance, DETECTIONS)
    place = PlanarPose(_stamp(header), header.frame_id, pose.position.x, pose.position.y, 0.0, covariance)
    return Detection(_kind(best.hypothesis.class_id), place, float(best.hypothesis.score))


def _kind(class_id: str) -> str:
    """A detector's class as the team's: `person` as `person/?`, `sports ball` as `object/sports_ball?`, and ours as they are."""
    kind = class_id.strip().lower()
    if kind in ("robot", "person"):
        return f"{kind}/?"
    if re.fullmatch(SIGHTED, class_id) and not class_id.startswith("landmark/"):
        return class_id
    return f"object/{re.sub(r'[^a-z0-9_-]', '_', kind)[:LONGEST]}?"


def _place(payload: bytes, type_name: str) -> PlanarPose:
    message = _decode(payload, type_name)
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    covariance = _planar(message.pose.covariance)
    _check([at.x, at.y, turn.x, turn.y, turn.z, turn.w, *covariance.ravel()], type_name)
    if abs(math.hypot(turn.x, turn.y, turn.z, turn.w) - 1.0) > UNIT:
        raise Refused("fields", f"{type_name}: the orientation is no unit quaternion")
    yaw = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
    return PlanarPose(_stamp(message.header), message.header.frame_id, at.x, at.y, yaw, covariance)


def _stamp(header: Any) -> float:
    return float(header.stamp.sec + header.stamp.nanosec * 1e-9)


def _planar(covariance: Any) -> Array:
    """Of x, y and yaw, symmetric, shape (3, 3)."""
    full = np.asarray(covariance, dtype=float).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    symmetric: Array = (full + full.T) / 2
    return symmetric


def _check(numbers: Sequence[float], type_name: str) -> None:
    if not np.isfinite(numbers).all() or np.abs(numbers).max() > 1e7:
        raise Refused("fields", f"{type_name}: a number is NaN, infinite or above 1e7")


def _largest(covariance: Array, type_name: str) -> float:
    """The largest variance of a place. Refused: it is no covariance."""
    least, most = (float(value) for value in np.linalg.eigvalsh(covariance[:2, :2]))
    if least < -1e-9 * max(1.0, most) or float(covariance[2, 2]) < 0:
        raise Refused("fields", f"{type_name}: the covariance of x, y and yaw is none")
    return most


def _decode(payload: bytes, type_name: str) -> Any:
    if len(payload) > MAX_BYTES:
        raise Refused("too-large", f"{type_name}: more than {MAX_BYTES} bytes")
    try:
        return _store().deserialize_cdr(payload, type_name)
    except Exception as error:  # whatever a foreign decoder makes of foreign bytes
        raise Refused("fields", f"{type_name}: {len(payload)} bytes that are none ({type(error).__name__})") from None


def _plane(belief: Belief) -> Belief:
    """The belief about x and y alone. ValueError: its grid has one axis."""
    grid = belief.grid
    if grid.ndim < 2:
        raise ValueError(f"a grid with {grid.ndim} axis has no plane")
    if grid.ndim == 2:
        return belief
    flat = type(grid)(grid.shape[:2], grid.cell, grid.origin[:2], grid.unit, grid.frame)
    return Belief(flat, belief.p.sum(axis=tuple(range(2, grid.ndim))))


def _diagnosed(process: dict[str, Any], prefix: str) -> Any:
    kind, refused = "diagnostic_msgs/msg/DiagnosticStatus", process["refused"]
    levels = _store().types[kind]
    level, text = levels.OK, "alive"
    if process["state"] == "gone":
        level, text = levels.ERROR, "gone: it holds no liveliness token"
    elif process["state"] == "silent":
        level, text = levels.STALE, "silent: it is connected and says nothing"
    elif (lost := process.get("lost") or 0.0) >= LIKELY_LOST:
        level, text = levels.WARN, f"lost with {100 * lost:.0f} %: it may not be where the team believes"
    elif refused:
        level, text = (
            levels.WARN,
            "refuses messages: " + ", ".join(f"{name} {count}" for name, count in refused.items()),
        )
    elif process["dropped"]:
        level, text = levels.WARN, f"loses messages: {process['dropped']} so far"
    name = process["name"] if process["name"] == process["kind"] else f"{process['kind']} {process['name']}"
    told = {
        "sub-teams": " ".join(process["sub_teams"]),
        "tick": "" if process["tick"] is None else process["tick"],
        **({} if process.get("lost") is None else {"lost": f"{process['lost']:.3f}"}),
        "age [s]": "" if process["age"] is None else f"{process['age']:.1f}",
        **{f"refused {reason}": count for reason, count in refused.items()},
        **process["counters"],
    }
    values = [_make("diagnostic_msgs/msg/KeyValue", key=str(name), value=str(value)) for name, value in told.items()]
    return _make(kind, level=level, name=f"{prefix}: {name}", message=text, hardware_id=process["name"], values=values)


def _header(stamp: float, frame: str) -> Any:
    return _make("std_msgs/msg/Header", stamp=_time(stamp), frame_id=frame or "map")


def _time(stamp: float) -> Any:
    seconds = math.floor(min(max(stamp, 0.0), 2**31 - 1))
    return _make("builtin_interfaces/msg/Time", sec=seconds, nanosec=min(int((stamp - seconds) * 1e9), 999_999_999))


def _pose_of(belief: Belief, heading: tuple[float, float] | None, place: Moments | None = None) -> Any:
    if place is None:
        flat = _plane(belief)
        place = Moments(flat.mean(), flat.covariance() + np.eye(2) * belief.grid.cell**2 / 12)
    x, y = place.mean.tolist()
    yaw, variance = heading or (0.0, ANY_HEADING)
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = place.covariance
    covariance[5, 5] = min(max(variance, 0.0), ANY_HEADING)
    return _make(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=_pose(x, y, yaw),
        covariance=np.ascontiguousarray(covariance.ravel()),
    )


def _pose(x: float, y: float, yaw: float) -> Any:
    return _make(
        "geometry_msgs/msg/Pose",
        position=_make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=_make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)),
    )
