"""Who has a certificate in a team, and under which name a router knows the holder."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

from blackboard.errors import UserError
from blackboard.wire.keys import Role
from blackboard.wire.names import NAME

if TYPE_CHECKING:
    from blackboard.config import TeamSection

#: `viewer` looks on (why, status, echo, hz, view, the launcher of demo and up), `recorder` makes tapes, `health` only opens sessions,
#: with a `link` the router of another site connects to this one. A `bridge` speaks for the robot of its name, and gives it readings.
MemberKind = Literal["router", "world", "board", "robot", "bridge", "link", "viewer", "recorder", "health"]
KINDS: tuple[MemberKind, ...] = get_args(MemberKind)
# Of the other kinds a team has one certificate each.
NAMED: tuple[MemberKind, ...] = ("board", "robot", "bridge", "link")
ROLES: dict[MemberKind, Role] = {
    "world": "world",
    "board": "board",
    "robot": "robot",
    "viewer": "operator",
    "recorder": "operator",
}
LONGEST = 64  # characters of a certificate's common name (X.520)


@dataclass(frozen=True)
class CertificateHolder:
    """The holder of one certificate.

    `generation` goes up when a certificate is revoked, so that a name can be used again and its old certificate cannot.
    """

    team: str
    kind: MemberKind
    name: str  # for a kind that is not `NAMED` the kind itself
    sub_teams: tuple[str, ...] = ()  # of a robot, its bridge or a board; of a link those whose members are at its site
    generation: int = 1
    not_after: float = 0.0  # Unix time in seconds when its certificate ends

    def __post_init__(self) -> None:
        """UserError: a name that cannot be part of a key, or is too long for a certificate."""
        for what in (self.team, self.name, *self.sub_teams):
            if not re.fullmatch(NAME, what):
                raise UserError(
                    f"{what!r}: use up to 64 letters, digits, '.', '_' and '-', it becomes part of a Zenoh key"
                )
        if len(self.common_name) > LONGEST:
            raise UserError(
                f"{self.kind} {self.name}: too long for a certificate, use at most {LONGEST - 10} characters"
            )

    @property
    def who(self) -> str:
        """The name by which a process looks for its certificate: "robot/r1", or the kind alone where a team has one of it."""
        return f"{self.kind}/{self.name}" if self.kind in NAMED else self.kind

    @property
    def folder(self) -> str:
        """The name of its folder in a directory of keys; a kind has no dot, so no two members share one."""
        return self.who.replace("/", ".", 1)

    @property
    def common_name(self) -> str:
        """The subject of its certificate, by which a router knows it."""
        return f"{self.kind}/{self.name}/{self.generation}"

    @property
    def door(self) -> str:
        """The key on which the router answers this member: what it may do, and what of it was denied."""
        return f"door/{self.team}/{self.common_name}"

    def to_dict(self) -> dict[str, Any]:
        """The member as a JSON object."""
        return {**vars(self), "sub_teams": list(self.sub_teams)}

    @staticmethod
    def from_dict(said: dict[str, Any]) -> CertificateHolder:
        """The member of a table that `to_dict` made. KeyError, TypeError, ValueError: it is not one."""
        if said["kind"] not in KINDS:
            raise ValueError(f"no kind {said['kind']!r}")
        sub_teams, generation = tuple(map(str, said["sub_teams"])), int(said["generation"])
        return CertificateHolder(
            said["team"], said["kind"], said["name"], sub_teams, generation, float(said["not_after"])
        )


@dataclass(frozen=True)
class CertifiedTeam:
    """A team as its authority keeps it: who is in it, who was revoked, and the hosts that the router goes by."""

    name: str
    sub_teams: tuple[str, ...]
    hosts: tuple[str, ...] = ()
    members: tuple[CertificateHolder, ...] = ()
    revoked: tuple[str, ...] = field(default=())  # common names, never issued again

    def find(self, kind: MemberKind, name: str) -> CertificateHolder | None:
        return next((m for m in self.members if (m.kind, m.name) == (kind, name)), None)

    def named(self, name: str) -> CertificateHolder:
        """The one member of a name, or of "kind/name". UserError: no member, or several, have this name."""
        matching = [m for m in self.members if name in (m.name, f"{m.kind}/{m.name}")]
        if len(matching) != 1:
            said = ", ".join(m.who for m in matching or self.members)
            raise UserError(
                f"{name}: {'which one' if matching else 'nobody of this name'}; team {self.name} has {said}"
            )
        return matching[0]

    def with_member(self, member: CertificateHolder) -> CertifiedTeam:
        """The team with this member, instead of the one of the same kind and name."""
        others = tuple(m for m in self.members if (m.kind, m.name) != (member.kind, member.name))
        return replace(self, members=(*others, member))

    def new_member(self, kind: MemberKind, name: str, sub_teams: tuple[str, ...]) -> CertificateHolder:
        """A member to be added, of the next generation where this name was revoked. UserError: it is there, or a sub-team is not."""
        if self.find(kind, name):
            raise UserError(f"{kind} {name} has a certificate already; `blackboard keys renew {name}` makes a new one")
        for sub_team in sub_teams:
            if sub_team not in self.sub_teams:
                raise UserError(f"--sub-team {sub_team}: team {self.name} has {', '.join(self.sub_teams)}")
        before = [int(cn.rsplit("/", 1)[1]) for cn in self.revoked if cn.rsplit("/", 1)[0] == f"{kind}/{name}"]
        return CertificateHolder(self.name, kind, name, sub_teams, 1 + max(before, default=0))

    def without(self, member: CertificateHolder) -> CertifiedTeam:
        """The team after a member's certificate is revoked."""
        members = tuple(m for m in self.members if m != member)
        return replace(self, members=members, revoked=(*self.revoked, member.common_name))


def members_of(team: TeamSection) -> tuple[CertificateHolder, ...]:
    """Everybody whom a scenario's team needs: its robots, for each sub-team its boards, at least one that leads and one that
    stands by, and one of every other kind.
    """
    boards_of = team.model_copy(update={"boards": max(2, team.boards)}).boards_of
    single = (CertificateHolder(team.name, kind, kind) for kind in KINDS if kind not in NAMED)
    boards = (CertificateHolder(team.name, "board", name, (s,)) for s in team.sub_teams for name in boards_of(s))
    robots = (CertificateHolder(team.name, "robot", robot, tuple(team.of(robot))) for robot in team.robots)
    return (*single, *boards, *robots)
