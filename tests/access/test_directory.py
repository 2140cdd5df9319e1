"""The files: who can read them, what is never overwritten, and what `add`, `renew` and `revoke` change."""

import json
import stat
import sys
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from blackboard.access import directory
from blackboard.access.authority import DAY, Pair, issue, new_authority
from blackboard.access.identity import find
from blackboard.access.members import CertificateHolder
from blackboard.config import TeamSection
from blackboard.errors import UserError
from blackboard.net.settings import LinkConfig
from tests.access.doors import TEAM, make_keys
from tests.mistakes import one_line

NOW = 1_800_000_000.0
R1 = CertificateHolder("t", "robot", "r1", ("a",))


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate((path / "cert.pem").read_bytes())


def common_name(path: Path) -> str:
    (name,) = certificate(path).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(name.value)


def subjects(root: Path) -> list[str]:
    said = json.loads((root / "router" / "zenoh.json5").read_bytes())
    return [name for subject in said["access_control"]["subjects"] for name in subject["cert_common_names"]]


def test_files_are_for_their_owner_alone(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys")
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (root, *root.rglob("*"))}
    assert {mode for path, mode in modes.items() if path.is_dir()} == {0o700}
    assert {mode for path, mode in modes.items() if path.is_file()} == {0o600}
    assert not list(root.rglob("*.new"))
    members = "robot.r1 robot.r2 robot.r3 board.board-a board.board-a2 board.board-b board.board-b2"
    others = "authority router world viewer recorder health"
    assert {path.name for path in root.iterdir()} == {*members.split(), *others.split()}


def test_an_authority_is_not_overwritten_unless_forced(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys")
    before = (root / "authority" / "key.pem").read_bytes()
    with pytest.raises(UserError, match="has an authority already.*--force"):
        make_keys(root)
    assert (root / "authority" / "key.pem").read_bytes() == before
    directory.init(root, TEAM, (), NOW, 1.0, force=True)
    assert (root / "authority" / "key.pem").read_bytes() != before


def test_a_certificate_says_who_for_what_and_until_when() -> None:
    authority = new_authority("t", NOW)
    signer = x509.load_pem_x509_certificate(authority.certificate)
    made, ends = issue(authority, R1, ("127.0.0.1",), NOW, 30.0)
    robot = x509.load_pem_x509_certificate(made.certificate)
    robot.verify_directly_issued_by(signer)
    assert isinstance(robot.public_key(), ec.EllipticCurvePublicKey)
    assert (
        robot.not_valid_before_utc.timestamp() <= NOW < robot.not_valid_after_utc.timestamp() == ends == NOW + 30 * DAY
    )
    purposes = robot.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert list(purposes) == [ExtendedKeyUsageOID.CLIENT_AUTH]
    assert robot.extensions.get_extension_for_class(x509.BasicConstraints).value.ca is False
    router, _ = issue(
        authority, CertificateHolder("t", "router", "router"), ("127.0.0.1", "::1", "base.local"), NOW, 30.0
    )
    server = x509.load_pem_x509_certificate(router.certificate)
    assert list(server.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value) == [
        ExtendedKeyUsageOID.SERVER_AUTH
    ]
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["base.local"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "::1"]


def test_no_certificate_outlives_its_authority() -> None:
    authority = new_authority("t", NOW)
    last = x509.load_pem_x509_certificate(authority.certificate).not_valid_after_utc.timestamp()
    _, ends = issue(authority, R1, (), last - DAY, 30.0)
    assert ends == last
    with pytest.raises(UserError, match="the authority expired on"):
        issue(authority, R1, (), last + 1.0, 30.0)


def test_an_authority_without_its_own_key_signs_nothing() -> None:
    first, second = new_authority("t", NOW), new_authority("t", NOW)
    with pytest.raises(UserError, match="does not belong to its certificate"):
        issue(Pair(first.certificate, second.key), R1, (), NOW, 1.0)
    with pytest.raises(UserError, match="cannot be read"):
        issue(Pair(first.certificate, b"nonsense"), R1, (), NOW, 1.0)


@pytest.mark.parametrize("name", ["a/b", "a b", "*.local", "", "käse"])
def test_a_host_that_is_none_is_a_mistake_and_leaves_nothing_behind(tmp_path: Path, name: str) -> None:
    with pytest.raises(UserError, match="--name .*give an address or a host name"):
        directory.init(tmp_path / "keys", TEAM, (name,), NOW, 1.0, force=False)
    assert not (tmp_path / "keys").exists()


def test_adding_and_revoking_change_the_routers_access_control(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys")
    directory.add(root, "robot", "r9", ("b",), NOW, 1.0)
    assert "robot/r9/1" in subjects(root)
    assert common_name(root / "robot.r9") == "robot/r9/1"
    directory.revoke(root, "r9")
    assert "robot/r9/1" not in subjects(root)
    assert not (root / "robot.r9").exists()
    directory.add(root, "robot", "r9", ("a",), NOW, 1.0)
    assert common_name(root / "robot.r9") == "robot/r9/2"
    assert "robot/r9/2" in subjects(root)
    with pytest.raises(UserError, match="r10: nobody of this name"):
        directory.revoke(root, "r10")
    with pytest.raises(UserError, match="router's certificate cannot be revoked"):
        directory.revoke(root, "router")


def test_renewing_keeps_who_one_is_and_makes_a_new_key(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys", now=NOW, days=1.0)
    before = {path.parent.name: path.read_bytes() for path in root.glob("*/key.pem")}
    control = subjects(root)
    _, chosen = directory.renew(root, ("r1",), ("base.local",), NOW + DAY, 30.0)
    assert sorted(member.who for member in chosen) == ["robot/r1", "router"]
    changed = {name for name, key in before.items() if (root / name / "key.pem").read_bytes() != key}
    assert changed == {"robot.r1", "router"}
    assert sorted(subjects(root)) == sorted(control)
    assert find(str(root), "robot/r1").member.not_after == NOW + 31 * DAY
    assert "tls/base.local:7447" in (root / "robot.r1" / "zenoh.json5").read_text()
    _, everybody = directory.renew(root, (), (), NOW + DAY, 30.0)
    assert len(everybody) == len(before) - 1  # but the authority


def test_one_hosts_folder_is_all_that_its_process_needs(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (root / "robot.r1").rename(elsewhere / "robot.r1")
    config = LinkConfig(keys=str(elsewhere), who="robot/r1").build("r1")
    assert json.loads(config.get_json("transport/link/tls/connect_private_key")) == str(
        elsewhere / "robot.r1" / "key.pem"
    )
    assert json.loads(config.get_json("connect/endpoints")) == ["tls/127.0.0.1:7447"]
    assert json.loads(config.get_json("transport/link/tls/enable_mtls")) is True


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ({"who": "robot/r9"}, "no certificate of robot/r9.*blackboard keys add r9 --kind robot"),
        ({"who": "player"}, "there is no certificate for a player"),
        ({"connect": ("tcp/127.0.0.1:7447",)}, "tcp/127.0.0.1:7447: with --keys write tls/127.0.0.1:7447"),
        ({"mode": "peer"}, "with --keys only `blackboard router` listens"),
        ({"listen": ("tls/127.0.0.1:7447",)}, "with --keys only `blackboard router` listens"),
        ({"who": "router", "mode": "router", "listen": ("tcp/0.0.0.0:7447",)}, "with --keys write tls/0.0.0.0:7447"),
        (
            {"who": "router", "mode": "router", "connect": ("tls/127.0.0.1:1",)},
            "with --keys a router connects to that of another site",
        ),
    ],
)
def test_what_would_leave_the_door_ajar_is_a_mistake_in_one_line(
    keys: Path, config: dict[str, object], says: str
) -> None:
    with one_line(says):
        LinkConfig(**({"keys": str(keys)} | config)).build("x")


def test_without_a_directory_the_line_says_how_to_make_one(tmp_path: Path) -> None:
    no_name = "x" * 5000  # longer than a file's name may be
    for folder, called, begin in (("nowhere", False, "--keys "), ("nowhere", True, "keys="), (no_name, True, "keys=")):
        with pytest.raises(UserError, match=f"^{begin}.*: no such directory; `blackboard keys init SCENARIO --dir"):
            LinkConfig(keys=str(tmp_path / folder), called=called).build("x")
    with pytest.raises(UserError, match="no authority there"):
        directory.load(tmp_path)


def test_a_key_that_everybody_can_read_is_not_used(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys")
    key = root / "robot.r1" / "key.pem"
    key.chmod(0o640)
    find(str(root), "robot/r1")  # a group may be what a container needs
    key.chmod(0o644)
    with pytest.raises(UserError, match="everybody can read .*key.pem: chmod o-rwx"):
        find(str(root), "robot/r1")


@pytest.mark.parametrize(
    ("tokens", "right"),
    [(("cop/t/a/member/r1",), True), (("cop/t/b/member/r1",), False), (("cop/u/a/member/r1",), False), ((), True)],
)
def test_a_process_that_would_be_denied_is_told_before_it_starts(
    keys: Path, tokens: tuple[str, ...], right: bool
) -> None:
    identity = find(str(keys), "robot/r1")
    if right:
        identity.check_tokens(tokens)
    else:
        with pytest.raises(UserError, match=r"is for team t, sub-team a, and may not hold"):
            identity.check_tokens(tokens)


def test_the_end_of_a_certificate_is_told_loudly(tmp_path: Path) -> None:
    root = make_keys(tmp_path / "keys", now=NOW, days=30.0)
    identity = find(str(root), "world")
    assert identity.check_time(NOW) is None
    assert "expires on" in str(identity.check_time(NOW + 20 * DAY))
    with pytest.raises(
        UserError, match=r"world: ITS CERTIFICATE EXPIRED on 2027-02-14 .*`blackboard keys renew world`"
    ):
        identity.check_time(NOW + 30 * DAY)


def test_without_the_library_the_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    monkeypatch.delitem(sys.modules, "blackboard.access.authority")
    with pytest.raises(UserError, match=r"extra `keys`: .* -m pip install .*\[keys\]'"):
        directory.init(tmp_path / "keys", TeamSection(), (), NOW, 1.0, force=False)
