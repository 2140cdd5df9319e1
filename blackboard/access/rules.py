"""What each member may write and read, taken from the topic table, and the access control of a router made of it.

A rule of Zenoh allows kinds of messages on key expressions in one direction as the router sees it: ingress is what a member sends.
Whatever no rule allows is denied.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from blackboard.access.members import ROLES, CertificateHolder
from blackboard.wire import keys
from blackboard.wire.keys import Topic

ALL = "cop/**"  # for those who read every topic; other teams have other authorities, so no other team is on this router
DOORS = "door/**"
TELLS = ["put", "delete", "reply"]
ASKS = ["declare_subscriber", "query"]
LOOKS = ["declare_liveliness_subscriber", "liveliness_query"]
#: What a router passes on to every member so that it knows what others want of it; these carry no content.
WANTS = ["declare_subscriber", "declare_queryable", "query", "declare_liveliness_subscriber", "liveliness_query"]


@dataclass(frozen=True)
class Grant:
    """Key expressions of what a member may put and reply, be asked for, hold as tokens, read, and watch as tokens."""

    writes: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()  # those of `writes` as queryables are declared: with `**` for a subject
    tokens: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()


def grant(member: CertificateHolder) -> Grant:
    """What a member may do. A kind without a role in the topic table (router, health) may do nothing of a team's."""
    if member.kind == "bridge":
        return replace(grant(replace(member, kind="robot")), reads=(ALL,), watches=(ALL,))
    role = ROLES.get(member.kind)
    if role is None:
        return Grant()
    written = [topic for topic in keys.TOPICS if role in topic.writers]
    read = [topic for topic in keys.TOPICS if role in topic.readers]
    own = _distinct(e for topic in written if topic.message != "token" for e in _read_back(topic, member))
    everything = len(read) == len(keys.TOPICS)
    return Grant(
        writes=_distinct(e for t in written if t.message != "token" for e in _own(t, member, "*/*")),
        answers=_distinct(e for t in written if t.message != "token" for e in _own(t, member, "**")),
        tokens=_distinct(e for t in written if t.message == "token" for e in _own(t, member, "*/*")),
        reads=(ALL,)
        if everything
        else _distinct((*(e for t in read if t.message != "token" for e in _read(t, member)), *own)),
        watches=(ALL,) if everything else _distinct(e for t in read if t.message == "token" for e in _read(t, member)),
    )


def _own(topic: Topic, member: CertificateHolder, subject: str) -> list[str]:
    """The keys of a topic that a member writes: its name is where the table has the owner, its sub-teams where they are named."""
    name = "*" if member.kind == "world" else member.name  # a world writes the readings of every robot
    owners = dict.fromkeys(("robot", "source", "board", "process", "recorder"), name)
    parts = owners | {"team": member.team, "subject": subject}
    if member.kind == "board":
        parts["robot"] = "*"  # it publishes to every robot what it refused
    return [topic.key(**parts, sub_team=sub_team) for sub_team in member.sub_teams or ("*",)]


def _read(topic: Topic, member: CertificateHolder) -> list[str]:
    """The keys of a topic that a member reads: a robot's readings and refusals are its own, and it reads of its own sub-teams alone.

    A board reads the reports and memories of its own sub-team, and what boards and robots of the others say to all.
    """
    robot = member.name if topic in (keys.READING, keys.REFUSED) and member.kind == "robot" else "*"
    mine = member.kind == "robot" or (member.kind == "board" and topic in (keys.REPORT, keys.MEMORY))
    parts = dict.fromkeys(("source", "board", "process"), "*") | {"robot": robot, "team": member.team, "subject": "**"}
    return [topic.key(**parts, sub_team=s) for s in (member.sub_teams if mine else ("*",))]


def _read_back(topic: Topic, member: CertificateHolder) -> list[str]:
    """What a robot or board wrote itself, in whichever sub-team, so that its health check can ask for it."""
    if member.kind not in ("robot", "board") or topic.owner == "sub_team":
        return []
    parts = dict.fromkeys(("robot", "source", "board", "process"), member.name)
    return [topic.key(**parts, team=member.team, sub_team="*", subject="**")]


def _distinct(expressions: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(expressions))


def link_grant(link: CertificateHolder, members: Iterable[CertificateHolder]) -> Grant:
    """What a link may pass on to the router that it connects to: what boards, robots and bridges of its sub-teams may write.

    It reads everything, because everything is wanted at some site.
    """
    there = [
        grant(m) for m in members if m.kind in ("board", "robot", "bridge") and set(m.sub_teams) & set(link.sub_teams)
    ]
    return Grant(
        writes=_distinct(e for may in there for e in may.writes),
        answers=_distinct(e for may in there for e in may.answers),
        tokens=_distinct(e for may in there for e in may.tokens),
        reads=(ALL,),
        watches=(ALL,),
    )


def access_control(members: Iterable[CertificateHolder]) -> dict[str, Any]:
    """The section `access_control` of a router's Zenoh configuration: one subject for each member, and deny for everything else.

    Where there are links it is that of the routers of all sites. A router with a link knows the other by the name of the
    routers' certificate, with which no process can connect. It takes everything from it.
    """
    members = list(members)
    links = [member for member in members if member.kind == "link"]
    rules: list[dict[str, Any]] = [_rule("wants", "egress", WANTS, ("**",))]
    subjects, policies = [], []
    for member in members:
        if member.kind == "router":
            mine = _rules_between(member, Grant((ALL,), (ALL,), (ALL,), (ALL,), (ALL,))) if links else []
        elif member.kind == "link":
            mine = _rules_between(member, link_grant(member, members))
        else:
            mine = _rules(member)
        if not mine:
            continue  # a router's certificate opens no session
        rules += mine
        subjects.append({"id": member.who, "cert_common_names": [member.common_name]})
        wants = [] if member.kind in ("router", "link") else ["wants"]
        policies.append({"rules": [*wants, *(rule["id"] for rule in mine)], "subjects": [member.who]})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _rules(member: CertificateHolder) -> list[dict[str, Any]]:
    may, who = grant(member), member.who
    door = DOORS if member.kind == "viewer" else member.door
    rows = [
        ("writes", "ingress", TELLS, may.writes),
        ("answers", "ingress", ["declare_queryable"], may.answers),
        ("holds", "ingress", ["liveliness_token"], may.tokens),
        ("asks", "ingress", ASKS, (*may.reads, door)),
        ("hears", "egress", TELLS, (*may.reads, door)),
        ("looks", "ingress", LOOKS, may.watches),
        ("sees", "egress", ["liveliness_token"], may.watches),
    ]
    # Zenoh takes no empty list of key expressions
    return [_rule(f"{who} {what}", flow, messages, topics) for what, flow, messages, topics in rows if topics]


def _rules_between(other: CertificateHolder, may: Grant) -> list[dict[str, Any]]:
    """The rules for another site's router. Doors stay at their own site, so that no process hears the wrong router."""
    who = other.who
    rows = [
        ("writes", "ingress", TELLS, may.writes),
        ("answers", "ingress", ["declare_queryable"], may.answers),
        ("holds", "ingress", ["liveliness_token"], may.tokens),
        ("asks", "ingress", [*ASKS, *LOOKS], may.reads),
        ("hears", "egress", [*TELLS, *ASKS, *LOOKS, "declare_queryable", "liveliness_token"], (ALL,)),
    ]
    return [_rule(f"{who} {what}", flow, messages, topics) for what, flow, messages, topics in rows if topics]


def _rule(name: str, flow: str, messages: list[str], expressions: Iterable[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": list(expressions)}
