"""Keys, tokens and attachments of rmw_zenoh. The golden strings are those of ../shared/ros2.md, taken by `hiroz` 0.2.1 with ROS 2 Jazzy."""

import struct

import pytest

xxhash = pytest.importorskip("xxhash", reason="no xxhash: pip install '.[ros]'")
typesys = pytest.importorskip("rosbags.typesys", reason="no rosbags.typesys: pip install '.[ros]'")
from blackboard.bridges.ros import names
from blackboard.bridges.ros.convert import VISION
from blackboard.bridges.ros.names import LATCHED, MAP, ODOMETRY, POSE, RELIABLE, Node

HASH = "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e"
SESSION = "6f95d63ee1ea62cb0805a4666746bcbe"


def test_the_key_of_a_topic() -> None:
    golden = f"0/cop/agreed/r1/geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/{HASH}"
    assert names.key(0, "/cop/agreed/r1", POSE) == names.key(0, "cop/agreed/r1", POSE) == golden
    assert names.key(7, "/r1/odom", ODOMETRY).startswith("7/r1/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_3cc97dc7")


@pytest.mark.parametrize("type_name", names.HASHES)
@pytest.mark.parametrize("store", ["ROS2_HUMBLE", "ROS2_JAZZY", "LATEST"])
def test_the_hashes_are_those_that_rosbags_computes(type_name: str, store: str) -> None:
    types = typesys.get_typestore(getattr(typesys.Stores, store))
    for name, text in VISION.items():
        types.register(typesys.get_types_from_msg(text, name))
    assert types.hash_rihs01(type_name) == f"RIHS01_{names.HASHES[type_name]}"


def test_the_tokens_of_a_node_and_of_a_publisher() -> None:
    assert names.token(0, SESSION, 0, "python_bridge") == f"@ros2_lv/0/{SESSION}/0/0/NN/%/%/python_bridge"
    golden = f"@ros2_lv/0/{SESSION}/0/10/MP/%/%/python_bridge/%cop%agreed%r1/geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/{HASH}/::,10:,:,:,,"
    assert names.endpoint_token(0, SESSION, 10, "python_bridge", "MP", "/cop/agreed/r1", POSE, "::,10:,:,:,,") == golden
    # volatile and the last 10; transient local and the last
    assert (RELIABLE, LATCHED) == ("::,10:,:,:,,", ":1:,1:,:,:,,")


def test_an_attachment() -> None:
    source = bytes.fromhex("e4fca7529b9c7a597f18ccd508675247")
    golden = "0100000000000000" + "fb4c03327713ea18" + "10" + "e4fca7529b9c7a597f18ccd508675247"
    assert names.attachment(1, 1795268804121677051, source).hex() == golden


def test_a_publisher_is_identified_by_the_hash_of_its_token_low_half_first() -> None:
    number = xxhash.xxh3_128_intdigest(b"a token")
    assert names.gid("a token") == struct.pack("<QQ", number & (2**64 - 1), number >> 64)


def test_a_node_numbers_its_endpoints_and_each_its_messages() -> None:
    node = Node("n", SESSION, 3, lambda: 1.5)
    pose, odometry = node.publisher("a/pose", POSE), node.subscription("/odom", ODOMETRY)
    assert node.token == f"@ros2_lv/3/{SESSION}/0/0/NN/%/%/n"
    assert pose.token.startswith(f"@ros2_lv/3/{SESSION}/0/1/MP/%/%/n/%a%pose/geometry_msgs::msg::dds_::")
    assert pose.token.endswith(LATCHED)
    assert odometry.token.startswith(f"@ros2_lv/3/{SESSION}/0/2/MS/%/%/n/%odom/nav_msgs::msg::dds_::Odometry_/")
    assert odometry.token.endswith(RELIABLE)
    assert node.publisher("/a/pose", POSE) is pose
    assert node.publisher("a/pose", MAP) is not pose
    assert [pose.attach() for _ in (1, 2)] == [
        names.attachment(n, 1_500_000_000, names.gid(pose.token)) for n in (1, 2)
    ]
    assert node.publishers.keys() == {names.key(3, "a/pose", POSE), names.key(3, "a/pose", MAP)}
    assert node.subscriptions.keys() == {names.key(3, "odom", ODOMETRY)}


def test_names_that_ros_takes() -> None:
    assert all(names.is_topic(name) for name in ("odom", "/r1/odom", "_a/b2", "/initialpose"))
    assert not any(
        names.is_topic(name) for name in ("", "/", "a//b", "a/", "1a", "/a/2b", "a-b", "a b", "*", "a/**", "ä")
    )
    assert [names.part(name) for name in ("r1", "r-1.x", "9", "_")] == ["r1", "r_1_x", "_9", "_"]
