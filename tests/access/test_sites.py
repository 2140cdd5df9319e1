"""Two sites with a router each and keys: what crosses the link between them, and what its certificate cannot do."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from blackboard.access import directory
from blackboard.errors import UserError
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from tests.access.doors import Enter, alive, enter, gets_through, make_keys, put
from tests.processes import Letters, Program, program, wait_until

pytestmark = pytest.mark.team


@pytest.fixture(scope="module")
def linked_keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Those of a team whose sub-team b is at another site."""
    root = make_keys(tmp_path_factory.mktemp("sites") / "keys")
    directory.add(root, "link", "site-b", ("b",), UnixClock().now(), 30.0)
    return root


@pytest.fixture(scope="module")
def routers(linked_keys: Path) -> Iterator[dict[str, tuple[str, Program]]]:
    """The routers of the sites a and b, that of b connected to that of a: where each listens, and its program."""
    at = {site: f"tls/127.0.0.1:{free_port()}" for site in "ab"}
    links = {}
    with ExitStack() as running:
        for site, more in (("a", ()), ("b", ("-e", at["a"]))):
            arguments = ("-m", "blackboard", "router", "--keys", str(linked_keys), "-l", at[site], *more)
            links[site] = at[site], running.enter_context(program(*arguments))
            links[site][1].says("ready")
        yield links


@pytest.fixture
def enter_at(routers: dict[str, tuple[str, Program]], linked_keys: Path) -> Iterator[Callable[[str], Enter]]:
    """Makes a link with a member's certificate at a site."""
    with ExitStack() as links:
        yield lambda site: lambda who: links.enter_context(enter(routers[site][0], linked_keys, who))


def test_what_members_say_and_hold_and_answer_crosses_the_link_both_ways(enter_at: Callable[[str], Enter]) -> None:
    here, there = enter_at("a"), enter_at("b")
    r1, viewer, r3, recorder = here("robot/r1"), here("viewer"), there("robot/r3"), there("recorder")
    for looking in (viewer, recorder):
        looking.subscribe("cop/**")
        looking.watch("cop/**")
    r1.token("cop/t/a/member/r1")
    r3.token("cop/t/b/member/r3")
    at_a, at_b = Letters(viewer), Letters(recorder)
    for letters in (at_a, at_b):
        letters.until(alive("cop/t/a/member/r1"), alive("cop/t/b/member/r3"))
        gets_through(r1, put("cop/t/a/status/r1"), letters)
        gets_through(r3, put("cop/t/b/status/r3"), letters)
    wait_until(lambda: [e.key for e in viewer.get("cop/t/b/status/r3")] == ["cop/t/b/status/r3"], "it is answered")
    r3.send(put("cop/t/a/status/r1", b"forged"))
    gets_through(r3, put("cop/t/b/status/r3", b"last"), at_a)
    assert b"forged" not in {e.payload for e in at_a.read + at_b.read}


def test_nobody_is_denied_where_nobody_does_wrong(
    enter_at: Callable[[str], Enter], routers: dict[str, tuple[str, Program]]
) -> None:
    r3, viewer = enter_at("b")("robot/r3"), enter_at("a")("viewer")
    viewer.subscribe("cop/**")
    gets_through(r3, put("cop/t/b/status/r3", b"again"), Letters(viewer))
    for _, router in routers.values():
        assert "link/site-b" not in router.err
        assert "router/router" not in router.err


def test_the_certificate_of_a_link_forges_nothing_of_another_site(
    enter_at: Callable[[str], Enter], routers: dict[str, tuple[str, Program]], linked_keys: Path, tmp_path: Path
) -> None:
    """Who steals it and connects as a member can say what the members of its sub-teams could, and nothing else."""
    thief = stolen(linked_keys, tmp_path, routers["a"][0])
    viewer = enter_at("a")("viewer")
    viewer.subscribe("cop/**")
    viewer.watch("cop/**")
    letters = Letters(viewer)
    with thief:
        for key in ("cop/t/a/status/r1", "cop/t/world/clock", "cop/t/a/agreed/robot/r1", "cop/t/world/truth"):
            thief.send(put(key, b"forged"))
        for token in ("cop/t/world/alive", "cop/t/a/member/r1", "cop/t/b/member/r3"):
            thief.token(token)
        letters.until(alive("cop/t/b/member/r3"))
        gets_through(thief, put("cop/t/b/status/r3", b"in its name"), letters)
        assert {e.key for e in letters.read} == {"cop/t/b/member/r3", "cop/t/b/status/r3"}


def stolen(keys: Path, folder: Path, endpoint: str) -> Link:
    """A client's session with the certificate of the link."""
    mine = keys / "link.site-b"
    tls = {"root_ca_certificate": "ca.pem", "connect_certificate": "cert.pem", "connect_private_key": "key.pem"}
    cfg = [f'transport/link/tls/{name}:"{mine / file}"' for name, file in tls.items()]
    return Link(LinkConfig(connect=(endpoint,), cfg=(*cfg, "transport/link/tls/enable_mtls:true")), "thief")


def test_a_router_connects_to_no_other_without_a_certificate_for_it(keys: Path, linked_keys: Path) -> None:
    config = LinkConfig(mode="router", connect=("tls/127.0.0.1:1",), keys=str(keys), who="router")
    with pytest.raises(UserError, match=r"link\.SITE: `blackboard keys add SITE --kind link"):
        config.build("router")
    directory.add(linked_keys, "link", "site-c", ("a",), UnixClock().now(), 30.0)
    config = LinkConfig(mode="router", connect=("tls/127.0.0.1:1",), keys=str(linked_keys), who="router")
    with pytest.raises(UserError, match="leave the folder of this site alone there, of site-b, site-c"):
        config.build("router")
