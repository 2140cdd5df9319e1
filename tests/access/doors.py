"""A directory of keys, a router that goes by it, and people at its door."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from blackboard.access import directory
from blackboard.config import TeamSection
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope, Kind
from tests.processes import Letters, Program, program, wait_until

TEAM = TeamSection(name="t", sub_teams={"a": ["r1", "r2"], "b": ["r3"]})
Shut = tuple[str, Program]  # where a router with keys listens, and its program
Enter = Callable[..., Link]  # enter("robot/r1"): a link with this member's certificate


def make_keys(root: Path, team: TeamSection = TEAM, *, now: float | None = None, days: float = 30.0) -> Path:
    """A team's directory, made now or at another time (Unix, seconds)."""
    directory.init(root, team, (), UnixClock().now() if now is None else now, days, force=False)
    return root


def mixed(target: Path, who: str, *, certificate: Path, ca: Path) -> Path:
    """A directory in which `who` has the certificate of one folder and believes in the authority of another."""
    folder = target / who.replace("/", ".")
    shutil.copytree(certificate / who.replace("/", "."), folder)
    shutil.copy(ca / who.replace("/", ".") / "ca.pem", folder / "ca.pem")
    return target


@contextmanager
def router(keys: Path) -> Iterator[tuple[str, Program]]:
    """A `blackboard router` with keys, ready: where it listens, and the program."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with program("-m", "blackboard", "router", "--keys", str(keys), "-l", endpoint) as running:
        running.says("ready")
        yield endpoint, running


def enter(endpoint: str, keys: Path, who: str, patience: float = 10.0) -> Link:
    """A link with the certificate of a member."""
    return Link(LinkConfig(connect=(endpoint,), keys=str(keys), who=who), who, patience=patience)


def put(key: str, payload: bytes = b"x") -> Envelope:
    return Envelope(key, payload)


def alive(key: str) -> Envelope:
    return Envelope(key, kind=Kind.ALIVE)


def denied(link: Link) -> int:
    """How many messages of it the router says that it has denied."""
    return link.counters.get("denied", 0)


def gets_through(sender: Link, envelope: Envelope, letters: Letters) -> None:
    """Send again and again until it has arrived: a publisher sends nothing before it has heard of a subscriber."""
    wait_until(lambda: sender.send(envelope) or envelope in letters.take(), f"{envelope.key} gets through")
