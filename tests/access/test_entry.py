"""Real sessions at a real router's door: who gets in, and the one line that says why somebody does not."""

import shutil
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

from blackboard.access import directory
from blackboard.config import TeamSection
from blackboard.errors import UserError
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope, Kind
from tests.access.doors import Enter, Shut, alive, denied, enter, gets_through, make_keys, mixed, put, router
from tests.processes import Letters, introduce, program, wait_until

pytestmark = [pytest.mark.team, pytest.mark.xdist_group("door")]  # one directory of keys, and one router
OWN = "cop/t/a/report/r1/robot/r1"


# --- who gets in ---------------------------------------------------------------------------------------------------------


def test_without_a_certificate_the_line_asks_for_one(shut: Shut, keys: Path) -> None:
    plain = shut[0].replace("tls/", "tcp/")
    with pytest.raises(UserError, match=rf"^r1: {plain}: the router there asks for certificates: give --keys"):
        Link(LinkConfig(connect=(plain,)), "r1", patience=0.0)
    with pytest.raises(UserError, match=f": give keys=, and endpoint={shut[0]}$"):
        Link(LinkConfig(connect=(plain,), called=True), "r1", patience=0.0)
    ca = f'transport/link/tls/root_ca_certificate:"{keys / "viewer" / "ca.pem"}"'
    with pytest.raises(UserError):
        Link(LinkConfig(connect=(shut[0],), cfg=(ca,)), "r1", patience=0.0)
    shut[1].says("peer sent no certificates")


def test_with_another_authoritys_certificate_the_line_says_so(
    shut: Shut, keys: Path, other_keys: Path, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="the router's certificate is not of this team's authority"):
        enter(shut[0], other_keys, "robot/r1")
    # it believes the router, and not the other way
    forged = mixed(tmp_path, "robot/r1", certificate=other_keys, ca=keys)
    with pytest.raises(UserError, match="signed by another authority than the router's"):
        enter(shut[0], forged, "robot/r1")
    shut[1].says("a connection was refused: invalid peer certificate")


def test_the_routers_certificate_opens_no_session(shut: Shut, keys: Path, tmp_path: Path) -> None:
    stolen = tmp_path / "robot.r1"
    shutil.copytree(keys / "robot.r1", stolen)
    for file in ("cert.pem", "key.pem"):
        shutil.copy(keys / "router" / file, stolen / file)
    with pytest.raises(UserError, match="not made for connecting to a router"):
        enter(shut[0], tmp_path, "robot/r1")


def test_a_router_under_a_name_that_its_certificate_does_not_have(shut: Shut, keys: Path) -> None:
    endpoint = shut[0].replace("127.0.0.1", "127.0.0.2")
    with (
        router_on(keys, endpoint),
        pytest.raises(UserError, match=r"not for 127\.0\.0\.2: `blackboard keys renew router --name"),
    ):
        enter(endpoint, keys, "robot/r1")


def router_on(keys: Path, endpoint: str) -> Link:
    """A router in this process; it answers at no door, so nobody gets in there."""
    return Link(LinkConfig(mode="router", listen=(endpoint,), keys=str(keys), who="router"), "router")


def test_a_robot_cannot_pose_as_the_router(keys: Path, tmp_path: Path) -> None:
    shutil.copytree(keys / "router", tmp_path / "router")
    for file in ("cert.pem", "key.pem"):
        shutil.copy(keys / "robot.r1" / file, tmp_path / "router" / file)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with router_on(tmp_path, endpoint), pytest.raises(UserError, match="the router's certificate is not"):
        enter(endpoint, keys, "robot/r2")


def test_a_plain_router_where_one_with_keys_is_expected(endpoint: str, keys: Path) -> None:
    with pytest.raises(UserError, match="does not speak TLS: start `blackboard router` with --keys"):
        enter(endpoint.replace("tcp/", "tls/"), keys, "robot/r1", patience=0.0)


def test_where_nobody_listens_it_still_says_that_no_router_answers(keys: Path) -> None:
    with pytest.raises(UserError, match="no Zenoh router answers at tls/127.0.0.1:1"):
        enter("tls/127.0.0.1:1", keys, "robot/r1", patience=0.0)


def test_an_expired_certificate_says_so_also_where_its_folder_says_otherwise(
    shut: Shut, keys: Path, tmp_path: Path
) -> None:
    root = tmp_path / "keys"
    shutil.copytree(keys, root)
    directory.renew(root, ("r1",), (), UnixClock().now() - 10 * 86400.0, 1.0)
    with pytest.raises(UserError, match="robot/r1: ITS CERTIFICATE EXPIRED on .* UTC"):
        enter(shut[0], root, "robot/r1")
    member = root / "robot.r1" / "member.json"
    member.write_bytes((keys / "robot.r1" / "member.json").read_bytes())
    with pytest.raises(UserError, match="the certificate has expired"):
        enter(shut[0], root, "robot/r1")


def test_a_certificate_that_ends_closes_its_connection_and_the_process_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = make_keys(tmp_path / "keys")
    with router(root) as (endpoint, running), enter(endpoint, root, "viewer") as viewer:
        viewer.watch("cop/**")
        with brief(endpoint, root, "robot/r1") as r1:
            r1.token("cop/t/a/member/r1")
            Letters(viewer).until(alive("cop/t/a/member/r1"), Envelope("cop/t/a/member/r1", kind=Kind.GONE))
            wait_until(lambda: r1.counters and "ITS CERTIFICATE EXPIRED" in caplog.text, "it says so")
        running.says("certificate chain expired")


def brief(endpoint: str, root: Path, who: str) -> Link:
    """A link whose certificate ends soon; later on a machine that is too slow to open it before."""
    for seconds in (2.0, 10.0, 30.0):
        directory.renew(root, (who,), (), UnixClock().now(), seconds / 86400.0)
        with suppress(UserError):
            return enter(endpoint, root, who)
    raise AssertionError("no session within 30 s")


# --- revoked --------------------------------------------------------------------------------------------------------------


def test_a_revoked_certificate_does_nothing_once_the_router_is_started_again(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys", TeamSection(name="t", sub_teams={"a": ["r1", "r3"]}))
    stolen = tmp_path / "stolen"
    shutil.copytree(root / "robot.r3", stolen / "robot.r3")
    directory.revoke(root, "r3")
    with router(root) as (endpoint, running), enter(endpoint, root, "viewer") as viewer:
        says = r"the router lets robot/r3/1 of team t do nothing: its certificate is revoked, or the router was not started again"
        with pytest.raises(UserError, match=says):
            enter(endpoint, stolen, "robot/r3")
        running.says("a certificate that is revoked, or not known to this router, opened a session")
        viewer.subscribe("cop/**")
        letters, key = Letters(viewer), "cop/t/a/report/r3/robot/r3"
        config = LinkConfig(connect=(endpoint,), keys=str(stolen), who="robot/r3").build("r3")
        with zenoh.open(config) as session, enter(endpoint, root, "robot/r1") as r1:
            session.put(key, b"revoked")
            mine = put("cop/t/a/report/r1/robot/r1")
            gets_through(r1, mine, letters)
        assert key not in {e.key for e in letters.read}
    directory.add(root, "robot", "r3", ("a",), UnixClock().now(), 1.0)
    with router(root) as (endpoint, _), enter(endpoint, root, "robot/r3") as r3:
        assert denied(r3) == 0
        with pytest.raises(UserError, match="robot/r3/1 of team t do nothing"):
            enter(endpoint, stolen, "robot/r3")


def test_everybody_comes_back_by_itself_when_the_router_is_started_again(keys: Path) -> None:
    with router(keys) as (endpoint, _):
        r1 = enter(endpoint, keys, "robot/r1")
    with r1, program("-m", "blackboard", "router", "--keys", str(keys), "-l", endpoint) as running:
        running.says("ready")
        with enter(endpoint, keys, "viewer") as viewer:
            viewer.subscribe("cop/**")
            letters, mine = Letters(viewer), put(OWN)
            gets_through(r1, mine, letters)


def test_introducing_needs_no_door(connect: Enter) -> None:
    """Without keys nothing of this is in the way: no door is asked, and nothing is counted."""
    a, b = connect("a"), connect("b")
    introduce(a, b)
    assert a.denials() is None
    assert "denied" not in a.counters
