"""Who may do what, held against the topic table in words of its own, and against what the services really ask for."""

import json

import pytest
import zenoh

from blackboard.access.members import CertificateHolder, CertifiedTeam, members_of
from blackboard.access.rules import access_control, grant
from blackboard.board.service import BoardService
from blackboard.config import BoardSection, Scenario
from blackboard.errors import UserError
from blackboard.wire import keys
from blackboard.wire.keys import TOPICS, Topic
from robot_agent.config import RobotSection
from robot_agent.service import AgentService
from tests.access.doors import TEAM

MEMBERS = {member.who: member for member in (*members_of(TEAM), CertificateHolder("t", "bridge", "r1", ("a",)))}
PARTS = {
    "team": ("t", "u"),
    "sub_team": ("a", "b"),
    "robot": ("r1", "r2", "r3"),
    "source": ("r1", "r2", "r3"),
    "board": ("board-a", "board-b"),
    "process": ("r1", "r3", "board-a", "board-b"),
    "recorder": ("viewer", "recorder"),
    "subject": ("robot/r1", "object/ball"),
}


def included(key: str, expressions: tuple[str, ...]) -> bool:
    """As Zenoh decides: whether one expression includes all of the key, or of the key expression."""
    return any(zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key)) for expression in expressions)


def all_keys(topic: Topic) -> list[tuple[str, dict[str, str]]]:
    parts_of_keys: list[dict[str, str]] = [{}]
    for part, values in PARTS.items():
        if f"{{{part}}}" in topic.pattern:
            parts_of_keys = [{**parts, part: value} for parts in parts_of_keys for value in values]
    return [(topic.key(**parts), parts) for parts in parts_of_keys]


def should_write(member: CertificateHolder, topic: Topic, parts: dict[str, str]) -> bool:
    """The oracle: of its own team and sub-teams, under its own name."""
    if parts["team"] != "t":
        return False
    if member.kind == "world":
        return topic.name in ("clock", "reading", "truth", "world")
    own_sub_team = parts.get("sub_team") in (None, *member.sub_teams)
    if member.kind in ("robot", "bridge"):
        owner = {"reading": "robot", "solo": "robot", "report": "source", "member": "robot", "status": "process"}
        return topic.name in owner and own_sub_team and parts[owner[topic.name]] == member.name
    if member.kind == "board":
        if topic.name in ("consensus", "agreed", "refused"):
            return own_sub_team
        owner = {"forward": "board", "journal": "board", "memory": "board", "board": "board", "status": "process"}
        return topic.name in owner and own_sub_team and parts[owner[topic.name]] == member.name
    return topic.name == "disk" and member.kind in ("viewer", "recorder") and parts["recorder"] == member.name


def should_read(member: CertificateHolder, topic: Topic, parts: dict[str, str]) -> bool:
    """The oracle: what it needs; who looks on reads all of every team on the router, which is one."""
    own_sub_team = parts.get("sub_team") in (None, *member.sub_teams)
    if member.kind in ("viewer", "recorder", "bridge") or parts["team"] != "t" or member.kind in ("router", "health"):
        return member.kind in ("viewer", "recorder", "bridge")
    if member.kind == "world":
        return topic.name not in ("reading", "report", "forward", "journal", "memory", "refused", "disk")
    if member.kind == "board":
        mine = topic.name in ("forward", "journal", "memory", "status") and member.name in parts.values()
        if topic.name in ("report", "memory"):
            return own_sub_team or mine
        return mine or topic.name not in ("reading", "truth", "solo", "journal", "refused", "disk")
    if topic.name == "refused":
        return own_sub_team and parts["robot"] == member.name
    mine = (
        topic.name in ("reading", "solo", "report", "status")
        and topic.owner != ""
        and parts[topic.owner] == member.name
    )
    return mine or (
        topic.name not in ("reading", "truth", "solo", "report", "forward", "journal", "memory", "disk")
        and own_sub_team
    )


@pytest.mark.parametrize("who", MEMBERS)
@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_everybody_may_do_what_the_table_says_and_nothing_else(who: str, topic: Topic) -> None:
    member = MEMBERS[who]
    may = grant(member)
    token = topic.message == "token"
    for key, parts in all_keys(topic):
        assert included(key, may.tokens if token else may.writes) == should_write(member, topic, parts), (
            f"{who} writes {key}"
        )
        assert included(key, may.watches if token else may.reads) == should_read(member, topic, parts), (
            f"{who} reads {key}"
        )
        assert not included(key, may.writes if token else may.tokens)


@pytest.mark.parametrize("who", [who for who in MEMBERS if who != "world"])
def test_nobody_writes_for_several_at_once(who: str) -> None:
    may = grant(MEMBERS[who])
    for wild in (
        "cop/**",
        "cop/t/**",
        "cop/t/a/**",
        "cop/t/a/report/**",
        "cop/t/a/report/*/*/*",
        "cop/t/*/status/r1",
        "cop/t/a/member/*",
    ):
        assert not included(wild, may.writes)
        assert not included(wild, may.tokens)


def services() -> dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]]:
    """What every service listens to, watches and holds."""
    grid = Scenario({}).grid
    by_name: dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {}
    for fusion in ("opinions", "joint"):
        settings = BoardSection.model_validate({"fusion": fusion})
        board = BoardService(team="t", sub_team="a", board="board-a", grid=grid, settings=settings)
        by_name[f"board/board-a {fusion}"] = board.listens, board.watches, board.tokens
    robot = AgentService(team="t", sub_teams=["a"], robot="r1", grid=grid, settings=RobotSection())
    by_name["robot/r1"] = robot.listens, robot.watches, robot.tokens
    names = [
        t.key(team="t", sub_team="*", process="*", subject="**", robot="*")
        for t in (keys.SOLO, keys.CONSENSUS, keys.AGREED, keys.STATUS)
    ]
    tokens = [t.key(team="t", sub_team="*", board="*", robot="*") for t in (keys.WORLD, keys.MEMBER, keys.BOARD)]
    by_name["world"] = tuple(names), tuple(tokens), (keys.WORLD.key(team="t"),)
    by_name["viewer"] = ("cop/*/**", "cop/t/**", "cop/**"), ("cop/*/**",), ()
    return by_name


@pytest.mark.parametrize("who", services())
def test_every_service_may_listen_to_what_it_listens_to(who: str) -> None:
    """A subscription that is not included as a whole in one allowed expression is denied, in silence."""
    listens, watches, tokens = services()[who]
    may = grant(MEMBERS[who.split(maxsplit=1)[0]])
    assert [key for key in listens if not included(key, may.reads)] == []
    assert [key for key in watches if not included(key, may.watches)] == []
    assert [key for key in tokens if not included(key, may.tokens)] == []


def test_a_health_check_may_ask_for_what_its_process_wrote() -> None:
    asked = keys.REPORT.key(team="t", sub_team="*", source="r1", subject="robot/r1")
    assert included(asked, grant(MEMBERS["robot/r1"]).reads)
    assert not included(asked, grant(MEMBERS["robot/r2"]).reads)
    assert included(keys.STATUS.key(team="t", sub_team="*", process="board-a"), grant(MEMBERS["board/board-a"]).reads)


def test_zenoh_takes_the_access_control_and_whoever_it_does_not_name_is_denied() -> None:
    made = access_control(MEMBERS.values())
    config = zenoh.Config()
    config.insert_json5("access_control", json.dumps(made))
    assert made["default_permission"] == "deny"
    assert {rule["permission"] for rule in made["rules"]} == {"allow"}
    names = [name for subject in made["subjects"] for name in subject["cert_common_names"]]
    assert sorted(names) == sorted(m.common_name for m in MEMBERS.values() if m.kind != "router")
    assert len({rule["id"] for rule in made["rules"]}) == len(made["rules"])


def test_a_name_that_was_revoked_comes_back_as_another_generation() -> None:
    team = CertifiedTeam("t", ("a", "b"), (), members_of(TEAM))
    first = team.named("r3")
    team = team.without(first)
    again = team.new_member("robot", "r3", ("b",))
    assert (first.common_name, again.common_name) == ("robot/r3/1", "robot/r3/2")
    assert first.common_name not in json.dumps(access_control((*team.members, again)))
    team = team.with_member(again).without(again)
    assert team.new_member("robot", "r3", ("b",)).generation == 3


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda team: team.new_member("robot", "r1", ("a",)), "r1 has a certificate already.*renew"),
        (lambda team: team.new_member("robot", "r9", ("c",)), "--sub-team c: team t has a, b"),
        (lambda team: team.new_member("robot", "r/9", ("a",)), "becomes part of a Zenoh key"),
        (lambda team: team.new_member("robot", "x" * 60, ("a",)), "too long for a certificate"),
        (lambda team: team.named("r9"), "r9: nobody of this name; team t has .*robot/r1"),
    ],
)
def test_a_mistake_about_a_name_is_told(call: object, says: str) -> None:
    with pytest.raises(UserError, match=says):
        call(CertifiedTeam("t", ("a", "b"), (), members_of(TEAM)))  # type: ignore[operator]
