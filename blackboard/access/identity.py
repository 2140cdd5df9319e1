"""The certificate of one process: found in a directory of keys by the kind and name of the process, and what it may be used for.

This needs no `cryptography`: a robot carries files, and Zenoh reads them.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from blackboard.access.members import KINDS, CertificateHolder
from blackboard.access.rules import grant
from blackboard.errors import UserError
from blackboard.process.clock import utc

CA, CERTIFICATE, KEY, MEMBER, ZENOH = "ca.pem", "cert.pem", "key.pem", "member.json", "zenoh.json5"
SOON = 14 * 86400.0  # seconds before the end in which a process warns


@dataclass(frozen=True)
class Identity:
    """A member's folder: the authority's certificate, its own, its private key, and its Zenoh configuration."""

    member: CertificateHolder
    folder: Path

    @property
    def ca(self) -> Path:
        return self.folder / CA

    @property
    def certificate(self) -> Path:
        return self.folder / CERTIFICATE

    @property
    def key(self) -> Path:
        return self.folder / KEY

    def settings(self) -> dict[str, Any]:
        """What of its Zenoh configuration is about security, by Zenoh's configuration key; paths are those of this folder.

        UserError: the file is missing or no JSON.
        """
        try:
            said = json.loads((self.folder / ZENOH).read_bytes())
            tls = said["transport"]["link"]["tls"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(
                f"{self.folder / ZENOH}: cannot be used ({error}); `blackboard keys renew` writes it"
            ) from None
        known = {f"transport/link/tls/{name}": self._here(name, value) for name, value in tls.items()}
        if "access_control" in said:
            known["access_control"] = said["access_control"]
        return known

    def _here(self, name: str, value: object) -> object:
        path = name.endswith(("_certificate", "_private_key"))
        return str(self.folder / Path(str(value)).name) if path else value

    def check_time(self, now: float) -> str | None:
        """A warning in one line that the certificate ends soon, or None. UserError: its time is over."""
        ends, who = self.member.not_after, self.member.who
        cure = (
            f"`blackboard keys renew {self.member.name}` where the authority is, then restart {who} with its new folder"
        )
        if ends <= now:
            raise UserError(f"{who}: ITS CERTIFICATE EXPIRED on {utc(ends):%Y-%m-%d %H:%M} UTC ({self.folder}): {cure}")
        if ends <= now + SOON:
            return f"{who}: its certificate expires on {utc(ends):%Y-%m-%d %H:%M} UTC: {cure}"
        return None

    def check_tokens(self, tokens: tuple[str, ...]) -> None:
        """UserError: the certificate does not allow one of these tokens, so the process would be denied in silence."""
        may = grant(self.member).tokens
        for token in tokens:
            if token not in may:
                mine = " and ".join(self.member.sub_teams)
                of = f"team {self.member.team}" + (f", sub-team {mine}" if mine else "")
                raise UserError(
                    f"{self.member.who}: its certificate in {self.folder} is for {of}, and may not hold {token}; "
                    "say the team and sub-teams of the certificate, or make another (`blackboard keys revoke`, then `add`)"
                )


def find_link(directory: str) -> Identity:
    """The certificate with which a router connects to that of another site. UserError: there is none in the directory, or several."""
    links = sorted(folder.name.partition(".")[2] for folder in Path(directory).glob("link.*"))
    if len(links) != 1:
        cure = (
            f"leave the folder of this site alone there, of {', '.join(links)}"
            if links
            else f"`blackboard keys add SITE --kind link --sub-team S --dir {directory}` makes one"
        )
        raise UserError(
            f"--connect: with --keys a router connects to that of another site with a certificate for this, link.SITE: {cure}"
        )
    return find(directory, f"link/{links[0]}")


def find(directory: str, who: str, given: str = "--keys ") -> Identity:
    """The identity of a process, `who` being "robot/r1", "board/board-a" or a kind of which a team has one.

    UserError: there is none, or its private key may be read by everybody or not by this process. Its text begins with the flag or
    argument that gave the directory, `given`.
    """
    root = Path(directory)
    folder = root / who.replace("/", ".", 1)
    if not os.path.isdir(root):  # Path.is_dir raises OSError where the name is too long
        raise UserError(
            f"{given}{directory}: no such directory; `blackboard keys init SCENARIO --dir {directory}` makes it"
        )
    kind, _, name = who.partition("/")
    if kind not in KINDS:
        raise UserError(
            f"{given}{directory}: there is no certificate for a {kind}; leave --keys out, for a router without keys"
        )
    try:
        member = CertificateHolder.from_dict(json.loads((folder / MEMBER).read_bytes()))
        mode = (folder / KEY).stat().st_mode
        for file in (CA, CERTIFICATE, KEY):
            (folder / file).open("rb").close()
    except FileNotFoundError as error:
        add = f"`blackboard keys add {name or kind} --kind {kind} --dir {directory}` makes one"
        raise UserError(f"{given}{directory}: no certificate of {who} ({error.filename} is missing); {add}") from None
    except PermissionError as error:
        raise UserError(
            f"{given}{directory}: {error.filename} cannot be read by user {os.geteuid()}; run as the owner of the keys"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{given}{directory}: {folder / MEMBER} cannot be used ({error})") from None
    if mode & 0o007:
        raise UserError(f"{given}{directory}: everybody can read {folder / KEY}: chmod o-rwx {folder / KEY}")
    if member.who != who:
        raise UserError(f"{given}{directory}: {folder} holds the certificate of {member.who}, not of {who}")
    return Identity(member, folder)
