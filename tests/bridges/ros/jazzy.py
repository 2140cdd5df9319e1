"""What a node of ROS 2 Jazzy reads of what the bridge sends."""

from typing import Any

from rosbags.typesys import Stores, get_typestore

from blackboard.bridges.ros.names import key
from blackboard.opinion.grid import Grid
from blackboard.wire.envelope import Envelope

JAZZY: Any = get_typestore(Stores.ROS2_JAZZY)
GRID = Grid((30, 20), 1.0, (0.0, 0.0), "m", "map")
START = 1.8e9  # Unix seconds


def of(out: list[Envelope], topic: str, type_name: str) -> list[Any]:
    """The messages on a topic among what was sent."""
    where = key(0, topic, type_name)
    return [JAZZY.deserialize_cdr(envelope.payload, type_name) for envelope in out if envelope.key == where]
