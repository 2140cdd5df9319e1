"""How rmw_zenoh names things on Zenoh: keys of topics, liveliness tokens of nodes and endpoints, attachments. Pure.

After docs/design.md of ros2/rmw_zenoh; the golden strings of the tests were taken by `hiroz`, another implementation.
"""

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import xxhash

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
MAP = "nav_msgs/msg/OccupancyGrid"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
POINTS = "sensor_msgs/msg/PointCloud2"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
DETECTIONS = "vision_msgs/msg/Detection3DArray"

#: SHA-256 of each type's description (REP-2016): who has another one hears nothing. As rosbags computes them, and hiroz.
HASHES = {
    POSE: "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    MAP: "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    ODOMETRY: "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    TRANSFORMS: "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    POINTS: "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    DETECTIONS: "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
    DIAGNOSTICS: "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}

RELIABLE = "::,10:,:,:,,"  # volatile, keep the last 10: a subscription of ours
LATCHED = ":1:,1:,:,:,,"  # reliable, transient local, keep the last one: a publisher of ours
NODE = 0  # the entity of our node
MAX_DOMAIN = 232  # above, DDS has no ports; rmw_zenoh keeps that bound

_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def is_topic(name: str) -> bool:
    """Whether ROS takes a name of a topic, absolute or in the root namespace."""
    return _TOPIC.fullmatch(name) is not None


def part(name: str) -> str:
    """One of the team's names as a part of a topic: what ROS does not take becomes an underscore."""
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return text if re.match(r"[A-Za-z_]", text) else f"_{text}"


def key(domain: int, topic: str, type_name: str) -> str:
    return f"{domain}/{topic.strip('/')}/{_mangled(type_name)}/{_hash(type_name)}"


def gid(token: str) -> bytes:
    """The 16 bytes that identify a publisher: XXH3-128 of its token, low half first."""
    return xxhash.xxh3_128_digest(token.encode())[::-1]


def attachment(sequence: int, time: int, source: bytes) -> bytes:
    """What is attached to a message, 33 bytes: its number, counted from 1, Unix time in nanoseconds, and who published it."""
    return struct.pack("<qqB", sequence, time, len(source)) + source


def token(domain: int, session: str, entity: int, node: str) -> str:
    """The liveliness token of a node. `session`: Zenoh's name of the session that holds it, in which `entity` is unique."""
    return f"@ros2_lv/{domain}/{session}/{NODE}/{entity}/NN/%/%/{node}"


def endpoint_token(
    domain: int, session: str, entity: int, node: str, kind: str, topic: str, type_name: str, qos: str
) -> str:
    """The liveliness token of a publisher ("MP") or a subscription ("MS") of a node in the root namespace."""
    head, name = f"@ros2_lv/{domain}/{session}/{NODE}/{entity}/{kind}/%/%/{node}", topic.strip("/").replace("/", "%")
    return f"{head}/%{name}/{_mangled(type_name)}/{_hash(type_name)}/{qos}"


def _mangled(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def _hash(type_name: str) -> str:
    return f"RIHS01_{HASHES[type_name]}"


@dataclass
class Endpoint:
    """A publisher or a subscription: its key, its liveliness token, and the attachments of what it publishes."""

    key: str
    token: str
    now: Callable[[], float]
    sequence: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._gid = gid(self.token)

    def attach(self) -> bytes:
        """The attachment of the next message."""
        self.sequence += 1
        return attachment(self.sequence, int(self.now() * 1e9), self._gid)


class Node:
    """A node of a ROS graph, in the root namespace: its token, and its endpoints by key. `now` gives Unix time in seconds."""

    def __init__(self, name: str, session: str, domain: int, now: Callable[[], float]) -> None:
        """`session`: Zenoh's name of the session that holds the tokens."""
        self.domain, self._name, self._session, self._now = domain, name, session, now
        self.token = token(domain, session, NODE, name)
        self.publishers: dict[str, Endpoint] = {}  # by key
        self.subscriptions: dict[str, Endpoint] = {}

    def publisher(self, topic: str, type_name: str) -> Endpoint:
        """A new publisher, or the one that there is."""
        return self._endpoint(self.publishers, "MP", topic, type_name, LATCHED)

    def subscription(self, topic: str, type_name: str) -> Endpoint:
        """A new subscription, or the one that there is."""
        return self._endpoint(self.subscriptions, "MS", topic, type_name, RELIABLE)

    def _endpoint(self, known: dict[str, Endpoint], kind: str, topic: str, type_name: str, qos: str) -> Endpoint:
        where = key(self.domain, topic, type_name)
        if where not in known:
            entity = NODE + len(self.publishers) + len(self.subscriptions) + 1
            held = endpoint_token(self.domain, self._session, entity, self._name, kind, topic, type_name, qos)
            known[where] = Endpoint(where, held, self._now)
        return known[where]
