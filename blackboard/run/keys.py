"""The door of a team's keys: `blackboard keys init | add | renew | revoke | list | watch`."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from blackboard.access import directory
from blackboard.access.members import NAMED, MemberKind
from blackboard.access.watch import DenialWatch
from blackboard.config import load
from blackboard.errors import UserError
from blackboard.process.clock import UnixClock, utc
from blackboard.process.columns import columns
from blackboard.process.printable import printable
from blackboard.run import door
from blackboard.run.flags import TeamFlags

SHORTEST, LONGEST = 1.0 / 24, 3650.0  # days of a certificate

app = door.new_app("keys", "Make and revoke the certificates that shut a team's door (extra `keys`).")
Directory = Annotated[Path, Parameter(name="--dir", help="The directory of the team's keys.")]
Names = Annotated[list[str] | None, Parameter(name="--name", negative="")]


@app.command
def init(
    scenario: str = "demo",
    *,
    dir: Annotated[Path, Parameter(name="--dir")] = Path("keys"),
    name: Names = None,
    robots: int | None = None,
    days: float = 365.0,
    force: Annotated[bool, Parameter(negative="", show_default=False)] = False,
) -> int:
    """Make an authority for a team, and a certificate and a Zenoh configuration for each of its processes.

    Parameters
    ----------
    scenario
        A scenario file, or the name of one that comes with the package: who is in the team.
    dir
        The directory; made for its owner alone.
    name
        A host name or address under which people reach the router, besides 127.0.0.1 and localhost; may be given again.
    robots
        Another number of robots, as in demo and up.
    days
        How long a certificate is valid.
    force
        Replace an authority that is there; then no certificate of the old one works any more.
    """
    team = TeamFlags(robots=robots).apply(load(scenario)).team
    made = directory.init(dir, team, tuple(name or ()), UnixClock().now(), _days(days), force=force)
    _say(
        f"{dir}: an authority for team {made.name} and {len(made.members)} certificates, valid for {days:g} days",
        f"{dir}/{directory.AUTHORITY} stays here; each host gets the folders of its own processes, the router's {dir}/router",
        f"next: blackboard up {scenario} --keys {dir}",
    )
    return 0


@app.command
def add(
    name: str,
    *,
    dir: Directory = Path("keys"),
    kind: MemberKind = "robot",
    sub_team: Annotated[list[str] | None, Parameter(negative="")] = None,
    days: float = 365.0,
) -> int:
    """Make a certificate for one more member of the team.

    Parameters
    ----------
    name
        Its name in the team; that of a kind of which a team has one is the kind.
    kind
        What it is.
    sub_team
        Of a robot, its bridge or a board: the sub-team whose keys it may write; of a link: one whose members are at its site. May be
        given again [default: the team's first].
    days
        How long its certificate is valid.
    """
    if kind not in NAMED and (name != kind or sub_team):
        raise UserError(f"{name}: a team has one {kind}, `blackboard keys add {kind} --kind {kind}`")
    team, member = directory.add(dir, kind, name, tuple(sub_team or ()), UnixClock().now(), _days(days))
    where = " and ".join(team.named(member.who).sub_teams)
    if kind == "link":
        _say(
            f"{dir / member.folder}: a certificate with which the router of site {name} connects to another one, for sub-team {where}",
            f"its host gets this folder and {dir}/router; there: blackboard router --keys {dir} -l tls/HERE:7447 -e tls/THERE:7447",
            f"restart the other routers with {dir}/router: they do not let it in before",
        )
        return 0
    _say(
        f"{dir / member.folder}: a certificate for {member.who}" + (f" in sub-team {where}" if where else ""),
        f"restart the router with {dir}/router, which says who may do what: it does not let {member.who} in before",
        "nobody else: every other process connects again by itself",
    )
    return 0


@app.command
def renew(*names: str, dir: Directory = Path("keys"), name: Names = None, days: float = 365.0) -> int:
    """Make new certificates before the old ones end: for the members named, or for all.

    Parameters
    ----------
    names
        Whose, as r1 or robot/r1 [default: everybody's].
    name
        One more host name or address under which people reach the router.
    days
        How long the new certificates are valid.
    """
    _, chosen = directory.renew(dir, names, tuple(name or ()), UnixClock().now(), _days(days))
    _say(
        f"{dir}: {len(chosen)} new certificates, valid for {days:g} days",
        "restart, with their new folders: " + ", ".join(sorted(member.who for member in chosen)),
        "one after the other, in any order: the old certificates work until they end",
    )
    return 0


@app.command
def revoke(name: str, *, dir: Directory = Path("keys")) -> int:
    """Revoke a member's certificate: the router denies it everything once it was started again.

    Parameters
    ----------
    name
        Whose, as r3 or robot/r3.
    """
    _, member = directory.revoke(dir, name)
    _say(
        f"{member.who}: its certificate ({member.common_name}) is revoked, and is never issued again",
        f"restart the router with {dir}/router: UNTIL THEN {member.who.upper()} MAY STILL DO EVERYTHING IT COULD",
        "nobody else: every other process connects again by itself, and keeps its certificate",
        f"`blackboard keys add {member.name} --kind {member.kind}` makes a new one; the old one stays revoked",
    )
    return 0


@app.command(name="list")
def list_members(*, dir: Directory = Path("keys")) -> int:
    """List who has a certificate, until when, and who was revoked."""
    team, now, rows = directory.load(dir), UnixClock().now(), []
    for member in sorted(team.members, key=lambda m: (m.kind, m.name)):
        left = "EXPIRED" if member.not_after <= now else f"{(member.not_after - now) / 86400:.0f} days"
        sub_teams = " ".join(member.sub_teams) or "-"
        rows.append((member.who, sub_teams, f"until {utc(member.not_after):%Y-%m-%d %H:%M} UTC ({left})"))
    rows += [(name, "", "revoked") for name in team.revoked]
    for line in columns(rows) if rows else ():
        _say(line)
    return 0


@app.command
def watch(*, team: str = "demo", flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Print what the router of a team has denied so far and denies now, who tried it, and how often, until it is interrupted.

    Parameters
    ----------
    team
        The team.
    """
    door.check_name("--team", team)
    if flags.keys is None:
        raise UserError("keys watch: give --keys, and it looks on with the certificate of the viewer there")
    service = DenialWatch(team, _say)
    door.serve(service, "viewer", flags, asks=service.listens[0])
    return 0


def _days(days: float) -> float:
    if not SHORTEST <= days <= LONGEST:
        raise UserError(f"--days {days:g}: give {SHORTEST:.2f} to {LONGEST:g}")
    return days


def _say(*lines: str) -> None:
    sys.stdout.writelines(f"{printable(line)}\n" for line in lines)
    sys.stdout.flush()
