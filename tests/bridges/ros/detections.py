"""What a detector publishes, made by rosbags' types of another distribution."""

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from blackboard.bridges.ros.convert import VISION
from blackboard.bridges.ros.names import DETECTIONS

HUMBLE = get_typestore(Stores.ROS2_HUMBLE)
for name, text in VISION.items():
    HUMBLE.register(get_types_from_msg(text, name))


def _made(type_name: str, **fields: Any) -> Any:
    return HUMBLE.types[type_name](**fields)


def _pose_at(x: float, y: float) -> Any:
    """Without an orientation, as most detectors leave it."""
    return _made(
        "geometry_msgs/msg/Pose",
        position=_made("geometry_msgs/msg/Point", x=x, y=y, z=0.4),
        orientation=_made("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=0.0),
    )


def result(class_id: str, score: float, x: float = 0.0, y: float = 0.0, variance: float = 0.0) -> Any:
    hypothesis = _made("vision_msgs/msg/ObjectHypothesis", class_id=class_id, score=score)
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = np.eye(2) * variance
    placed = _made("geometry_msgs/msg/PoseWithCovariance", pose=_pose_at(x, y), covariance=covariance.ravel())
    return _made("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=placed)


def detected(*things: tuple[list[Any], tuple[float, float]], frame: str = "r1/base_link") -> bytes:
    """Detections: the results of each, and the middle of its box."""
    header = _made("std_msgs/msg/Header", stamp=_made("builtin_interfaces/msg/Time", sec=12, nanosec=0), frame_id=frame)
    size = _made("geometry_msgs/msg/Vector3", x=1.0, y=1.0, z=1.0)
    arrays = [
        _made(
            "vision_msgs/msg/Detection3D",
            header=header,
            results=results,
            bbox=_made("vision_msgs/msg/BoundingBox3D", center=_pose_at(*middle), size=size),
            id="",
        )
        for results, middle in things
    ]
    return bytes(HUMBLE.serialize_cdr(_made(DETECTIONS, header=header, detections=arrays), DETECTIONS))
