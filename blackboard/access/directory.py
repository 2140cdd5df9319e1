"""A team's directory of keys: its authority in `authority/`, and a folder for each member, which is all that its host needs.

Folders are 0700 and files 0600: a private key is for its owner alone.
"""

import fcntl
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from blackboard.access.identity import CA, CERTIFICATE, KEY, MEMBER, ZENOH
from blackboard.access.members import NAMED, CertificateHolder, CertifiedTeam, MemberKind, members_of
from blackboard.access.rules import access_control
from blackboard.config import TeamSection
from blackboard.errors import UserError, plain

AUTHORITY, TEAM = "authority", "team.json"
LOCAL = ("127.0.0.1", "::1", "localhost")  # the router's certificate is always good for these
PORT = 7447


def init(
    root: Path, section: TeamSection, names: tuple[str, ...], now: float, days: float, *, force: bool
) -> CertifiedTeam:
    """Make an authority and a certificate for everybody in a team.

    UserError: an authority is there already (`force` replaces it, and with it every certificate), or a name is no host name.
    """
    from blackboard.access import authority

    for name in names:
        authority.check_host(name)
    folder = root / AUTHORITY
    if (folder / KEY).exists() and not force:
        raise UserError(
            f"{folder} has an authority already: use `blackboard keys add`, `renew` or `revoke`, "
            "or --force for a new one, with which no certificate of the old one works"
        )
    hosts = tuple(dict.fromkeys((*LOCAL, *names)))
    team = CertifiedTeam(section.name, tuple(section.sub_teams), hosts, members_of(section))
    _make_folder(root)
    _make_folder(folder)
    with _locked(root):
        pair = authority.new_authority(team.name, now)
        _write(folder / CERTIFICATE, pair.certificate)
        _write(folder / KEY, pair.key)
        return _issue(root, team, team.members, now, days)


def add(
    root: Path, kind: MemberKind, name: str, sub_teams: tuple[str, ...], now: float, days: float
) -> tuple[CertifiedTeam, CertificateHolder]:
    """Make a certificate for one more member, and the router's access control anew.

    UserError: it has one already, or a sub-team is not in the team.
    """
    with _locked(root):
        team = load(root)
        member = team.new_member(kind, name, sub_teams or ((team.sub_teams[0],) if kind in NAMED else ()))
        return _issue(root, team, (member,), now, days), member


def renew(
    root: Path, names: tuple[str, ...], hosts: tuple[str, ...], now: float, days: float
) -> tuple[CertifiedTeam, list[CertificateHolder]]:
    """Make new certificates for the named members, or for all: the team, and who has a new one.

    With new `hosts` the router's is among them. UserError: nobody is called so.
    """
    from blackboard.access import authority

    for host in hosts:
        authority.check_host(host)
    with _locked(root):
        team = load(root)
        team = replace(team, hosts=tuple(dict.fromkeys((*team.hosts, *hosts))))
        chosen = [team.named(name) for name in names] if names else list(team.members)
        router = team.named("router")
        if hosts and router not in chosen:
            chosen.append(router)
        return _issue(root, team, chosen, now, days), chosen


def revoke(root: Path, name: str) -> tuple[CertifiedTeam, CertificateHolder]:
    """Revoke a member's certificate: the router's access control no longer has its subject, and its folder is removed.

    UserError: there is no such member, or it is the router: its members would still trust its certificate.
    """
    with _locked(root):
        team = load(root)
        member = team.named(name)
        if member.kind == "router":
            raise UserError(
                "the router's certificate cannot be revoked: its members check the authority alone; init --force"
            )
        team = team.without(member)
        _save(root, team)
        folder = root / member.folder
        for file in sorted(folder.glob("*")):
            file.unlink()
        if folder.is_dir():
            folder.rmdir()
        return team, member


def load(root: Path) -> CertifiedTeam:
    """The team that a directory is of. UserError: the authority is not there or cannot be read."""
    path = root / AUTHORITY / TEAM
    try:
        said = json.loads(path.read_bytes())
        return CertifiedTeam(
            said["team"],
            tuple(said["sub_teams"]),
            tuple(said["hosts"]),
            tuple(CertificateHolder.from_dict(member) for member in said["members"]),
            tuple(said["revoked"]),
        )
    except FileNotFoundError:
        raise UserError(
            f"--dir {root}: no authority there; `blackboard keys init SCENARIO --dir {root}` makes one"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: cannot be read ({plain(error)})") from None


def _issue(
    root: Path, team: CertifiedTeam, members: Iterable[CertificateHolder], now: float, days: float
) -> CertifiedTeam:
    from blackboard.access.authority import Pair, issue

    folder = root / AUTHORITY
    try:
        pair = Pair((folder / CERTIFICATE).read_bytes(), (folder / KEY).read_bytes())
    except OSError as error:
        raise UserError(f"{error.filename}: the authority cannot be read ({error.strerror})") from None
    for member in members:
        made, ends = issue(pair, member, team.hosts, now, days)
        holder = replace(member, not_after=ends)
        team = team.with_member(holder)
        _make_folder(root / holder.folder)
        _write(root / holder.folder / CA, pair.certificate)
        _write(root / holder.folder / CERTIFICATE, made.certificate)
        _write(root / holder.folder / KEY, made.key)
        _write(root / holder.folder / MEMBER, _json(holder.to_dict()))
        if holder.kind not in ("router", "link"):
            _write(root / holder.folder / ZENOH, _json(member_config(team, root / holder.folder)))
    _save(root, team)
    return team


def _save(root: Path, team: CertifiedTeam) -> None:
    """Write who is in the team, and the router's configuration, which says the same."""
    said = {
        "team": team.name,
        "sub_teams": list(team.sub_teams),
        "hosts": list(team.hosts),
        "members": [member.to_dict() for member in team.members],
        "revoked": list(team.revoked),
    }
    _write(root / AUTHORITY / TEAM, _json(said))
    _write(root / "router" / ZENOH, _json(router_config(team, root / "router")))


def router_config(team: CertifiedTeam, folder: Path) -> dict[str, Any]:
    """The Zenoh configuration of a team's routers: mutual TLS, and access control by the certificates' common names."""
    tls = _tls(folder, "listen")
    return {
        "mode": "router",
        "listen": {"endpoints": [f"tls/127.0.0.1:{PORT}"]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}, "link": {"tls": tls}},
        "access_control": access_control(team.members),
    }


def member_config(team: CertifiedTeam, folder: Path) -> dict[str, Any]:
    """The Zenoh configuration of a member, a client that checks the router's certificate and the name that it connects to."""
    tls = _tls(folder, "connect") | {"verify_name_on_connect": True}
    host = next((host for host in team.hosts if host not in LOCAL), LOCAL[0])
    return {
        "mode": "client",
        "connect": {"endpoints": [f"tls/{f'[{host}]' if ':' in host else host}:{PORT}"]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}, "link": {"tls": tls}},
    }


def _tls(folder: Path, side: str) -> dict[str, Any]:
    """Zenoh's mutual TLS with the certificate in a folder, for the side of a link that is `listen` or `connect`."""
    return {
        "root_ca_certificate": str(folder.absolute() / CA),
        f"{side}_certificate": str(folder.absolute() / CERTIFICATE),
        f"{side}_private_key": str(folder.absolute() / KEY),
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }


def _json(value: object) -> bytes:
    return json.dumps(value, indent=1).encode() + b"\n"


def _make_folder(path: Path) -> None:
    """A folder for its owner alone, also where it is there already. UserError: it cannot be made."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        path.chmod(0o700)
    except OSError as error:
        raise UserError(f"{path}: cannot be made a folder for keys ({error.strerror})") from None


def _write(path: Path, content: bytes) -> None:
    """Write a file for its owner alone, at once as a whole: a reader sees the old one or the new one."""
    new = path.with_name(f".{path.name}.new")
    try:
        new.unlink(missing_ok=True)
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror})") from None


@contextmanager
def _locked(root: Path) -> Iterator[None]:
    """Keep two commands from changing the same directory at once. UserError: there is no authority."""
    try:
        held = os.open(root / AUTHORITY, os.O_RDONLY)
    except OSError:
        raise UserError(
            f"--dir {root}: no authority there; `blackboard keys init SCENARIO --dir {root}` makes one"
        ) from None
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield
    finally:
        os.close(held)
