"""`blackboard ros`: every mistake on its command line is one line that says where, what and the cure."""

import re
import sys

import pytest

from blackboard.errors import UserError
from tests.commands import call
from tests.mistakes import one_line


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--domain", "233"), "--domain 233: give 0 to 232"),
        (("--domain", "-1"), "--domain -1: give 0 to 232"),
        (("--odometry", "r1"), "--odometry r1: write ROBOT=TOPIC, as r1=/r1/odom"),
        (("--odometry", "r1=/r1/od-om"), "--odometry r1=/r1/od-om: write ROBOT=TOPIC"),
        (("--fix", "r 1=/initialpose"), "--fix 'r 1': use up to 64 letters"),
        (("--pose", "r1=/a", "--pose", "r1=/b"), "--pose r1=/b: this robot or topic was given before"),
        (("--pose", "r1=/a", "--pose", "r2=a"), "--pose r2=a: this robot or topic was given before"),
        (
            ("--pose", "r1=/a", "--odometry", "r1=/b"),
            "--pose r1: --odometry, --fix, --sees and --detects are for a robot with a `robot-agent`",
        ),
        (
            ("--pose", "r1=/a", "--sees", "r1:object/ball=/b"),
            "--pose r1: --odometry, --fix, --sees and --detects are for a robot with a `robot-agent`",
        ),
        (("--sees", "r1=/r1/ball"), "--sees r1=/r1/ball: write ROBOT:SUBJECT=TOPIC, as r1:object/ball=/r1/ball"),
        (("--sees", "r1:ball=/r1/ball"), "--sees r1:ball=/r1/ball: write ROBOT:SUBJECT=TOPIC"),
        (("--sees", "r1:robot/r1=/r1/me"), "--sees r1:robot/r1=/r1/me: a robot sees others; of itself give --fix"),
        (
            ("--sees", "r1:object/ball=/a", "--sees", "r1:object/ball=/b"),
            "--sees r1:object/ball=/b: this subject of this robot was given before",
        ),
        (("--sees", "r1:object/ball=/a", "--sees", "r1:object/can=/a"), "/a: a topic is taken in once"),
        (("--fix", "r1=/a", "--pose", "r2=/a"), "/a: a topic is taken in once"),
        (("--detects", "r1=/a", "--sees", "r1:object/ball=/a"), "/a: a topic is taken in once"),
        (
            ("--detects", "r1=/a", "--pose", "r1=/b"),
            "--pose r1: --odometry, --fix, --sees and --detects are for a robot with a `robot-agent`",
        ),
        (("--namespace", "a b"), "--namespace 'a b': use letters, digits, '_' and '/'"),
        (("--team", "a/b"), "--team 'a/b': use up to 64 letters"),
        (("--keys", "keys"), "--keys: nodes of ROS have no certificates; name their own router"),
        (
            ("--keys", "keys", "--ros-router", "tcp/127.0.0.1:1", "--pose", "r1=/a", "--fix", "r2=/b"),
            "--keys: a certificate is one robot; run a bridge for each of r1, r2",
        ),
    ],
)
def test_a_mistake_is_one_line(arguments: tuple[str, ...], text: str) -> None:
    pytest.importorskip("rosbags", reason="no rosbags: pip install '.[ros]'")
    with one_line(f"^{re.escape(text)}"):
        call("ros", *arguments)


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("blackboard.bridges.ros")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(UserError, match=r"needs the extra `ros`: .* -m pip install .*\[ros\]'"):
        call("ros")
