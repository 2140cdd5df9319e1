"""The settings of a session: flags before the file, `cfg` before both, our defaults where none of them sets a key."""

import json
from pathlib import Path

import pytest
import zenoh

from blackboard.net.settings import DEFAULT_ENDPOINT, PROTOCOLS, LinkConfig
from tests.mistakes import one_line


@pytest.mark.parametrize(
    ("config", "says"),
    [
        (LinkConfig(file="nowhere.json5"), r"--config nowhere\.json5: No such file"),
        (LinkConfig(connect=("nonsense",)), "nonsense: .*Endpoints must be of the form"),
        (
            LinkConfig(connect=("tcp/a:1", "http://b:7447")),
            r"^http://b:7447: http: is no protocol of an endpoint; write tcp/HOST:PORT \(the protocols are tcp/, tls/, quic/, ",
        ),
        (LinkConfig(connect=("b/7447",)), "^b/7447: b is no protocol of an endpoint; write tcp/HOST:PORT"),
        (LinkConfig(cfg=("foo/bar:1",)), r"--cfg foo/bar:1: .*unknown key"),
        (LinkConfig(cfg=("mode",)), r"--cfg mode: write KEY:VALUE"),
        (LinkConfig(cfg=("mode:client",)), r"--cfg mode:client: Zenoh does not take it"),
    ],
)
def test_what_zenoh_does_not_take_is_a_mistake_in_one_line(config: LinkConfig, says: str) -> None:
    with one_line(says) as caught:
        config.build("r1")
    assert ".rs" not in str(caught.value)


def test_endpoints_for_each_mode_are_taken() -> None:
    by_mode = '{"client":["tcp/b:1"]}'
    assert setting(LinkConfig(cfg=(f"connect/endpoints:{by_mode}",)), "connect/endpoints") == json.loads(by_mode)


@pytest.mark.parametrize("protocol", [*PROTOCOLS, "http/"])
def test_the_protocols_are_those_that_zenoh_has(protocol: str) -> None:
    """Zenoh names an unknown protocol only to a process that listens. So each one listens here, at an address that nobody can have."""
    config = zenoh.Config()
    settings = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [f"{protocol}/nowhere.invalid/x"],
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError) as caught:
        zenoh.open(config)
    assert ("not supported" in str(caught.value)) == (protocol not in PROTOCOLS)


def setting(config: LinkConfig, key: str) -> object:
    return json.loads(config.build("r1").get_json(key))


def test_without_a_word_it_is_a_client_that_finds_nobody_by_chance() -> None:
    plain = LinkConfig()
    assert setting(plain, "mode") == "client"
    assert setting(plain, "connect/endpoints") == [DEFAULT_ENDPOINT]
    assert setting(plain, "scouting/multicast/enabled") is False
    assert setting(plain, "transport/shared_memory/enabled") is False
    assert setting(plain, "timestamping/enabled") is True
    assert setting(plain, "metadata") == {"name": "r1"}
    assert setting(LinkConfig(mode="router"), "listen/endpoints") == [DEFAULT_ENDPOINT]
    assert setting(LinkConfig(mode="peer"), "listen/endpoints") == []
    assert setting(LinkConfig(mode="peer"), "connect/endpoints") == []
    assert setting(LinkConfig(multicast=True), "connect/endpoints") == []


def test_a_flag_goes_before_the_file_and_cfg_before_both(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        "{mode: 'peer', connect: {endpoints: ['tcp/127.0.0.1:1']}, scouting: {multicast: {enabled: true}},"
        " transport: {link: {tx: {lease: 500}}}}"
    )
    said = LinkConfig(file=str(file))
    assert setting(said, "mode") == "peer"
    assert setting(said, "connect/endpoints") == ["tcp/127.0.0.1:1"]
    assert setting(said, "scouting/multicast/enabled") is True
    assert setting(said, "transport/link/tx/lease") == 500
    assert setting(said, "transport/shared_memory/enabled") is False  # the file says nothing of it
    flags = LinkConfig(file=str(file), mode="client", connect=("tcp/127.0.0.1:2",), multicast=False)
    assert setting(flags, "mode") == "client"
    assert setting(flags, "connect/endpoints") == ["tcp/127.0.0.1:2"]
    assert setting(flags, "scouting/multicast/enabled") is False
    cfg = LinkConfig(file=str(file), mode="client", cfg=('mode:"router"', "transport/link/tx/lease:700"))
    assert setting(cfg, "mode") == "router"
    assert setting(cfg, "transport/link/tx/lease") == 700
