"""The page's server over a real socket of 127.0.0.1, fed with a recorded run: files, frames, reasons, and whom it turns away."""

import json
from collections.abc import Iterator
from urllib.error import HTTPError

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from blackboard.errors import UserError
from blackboard.view.feed import Feed
from blackboard.view.web.application import FILES
from blackboard.view.web.server import Address, serve
from tests.view.recorded import read, team_of
from tests.view.serving import Clock, Recording, get, served, socket_of


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    now = Clock()
    with served(Feed(Recording(), now, "t"), "t", now) as url:
        yield url


def test_the_files_are_served_and_nothing_is_loaded_from_elsewhere(url: str) -> None:
    for name, kind in FILES.items():
        answer = get(url + name)
        text = answer.read().decode()
        assert answer.headers["content-type"] == kind
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "//" not in text.replace("://${location.host}", "").replace("// ", "").replace("//\n", ""), name
    assert get(url).read() == get(url + "index.html").read()
    with pytest.raises(HTTPError, match="404"):
        get(url + "server.py")


def test_the_newest_frame_comes_and_then_newer_ones(url: str) -> None:
    with connect(socket_of(url)) as socket:
        frames = [read(bytes(socket.recv(timeout=30)))[0] for _ in range(3)]
    numbers = [header["frame"] for header in frames]
    assert numbers == sorted(set(numbers))
    newest = team_of().moments.newest
    assert newest is not None
    assert frames[-1]["tick"] == newest.tick
    assert frames[-1]["subjects"].keys() == newest.subjects.keys()


def test_a_browser_that_chooses_a_subject_gets_all_its_beliefs(url: str) -> None:
    with connect(socket_of(url)) as socket:
        socket.recv(timeout=30)
        socket.send("robot/r2")
        header = {"chosen": ""}
        while header["chosen"] != "robot/r2":
            header = read(bytes(socket.recv(timeout=30)))[0]
    kinds = {name: {belief["kind"] for belief in subject["beliefs"]} for name, subject in header["subjects"].items()}  # type: ignore[attr-defined]
    assert "firsthand" in kinds["robot/r2"]
    assert kinds["robot/r1"] == {"agreed"}


def test_the_past_is_there_for_who_comes_late(url: str) -> None:
    with connect(socket_of(url)) as socket:
        socket.recv(timeout=30)
    answer = json.load(get(url + "past"))
    assert answer["source"] == {"tape": False, "done": False, "skipped": 0}
    ticks = [moment.tick for moment in team_of().moments]
    assert [line["tick"] for line in answer["past"]["lines"]] == ticks
    assert json.load(get(f"{url}past?from={len(ticks) - 1}"))["past"]["first"] == len(ticks) - 1
    run = answer["past"]["lines"][0]["run"]
    header, _ = read(get(f"{url}frame?run={run}&tick={ticks[1]}&subject=robot/r1").read())
    assert (header["tick"], header["chosen"]) == (ticks[1], "robot/r1")
    for query in (f"run={run}&tick=99999", f"run=x&tick={ticks[1]}", "tick=-1", ""):
        with pytest.raises(HTTPError, match="404"):
            get(f"{url}frame?{query}")


def test_reasons_are_given_for_a_moment(url: str) -> None:
    with connect(socket_of(url)) as socket:
        tick = read(bytes(socket.recv(timeout=30)))[0]["tick"]
    explained = json.load(get(f"{url}why?subject=robot/r1&tick={tick}"))
    assert explained["sentences"][0].startswith("robot/r1 is believed to be at (")
    assert explained["why"]["levels"]
    for query in ("subject=robot/r1&tick=99999", "subject=nobody", "subject=robot/r1&tick=x&run=y", ""):
        assert len(json.load(get(f"{url}why?{query}"))["sentences"]) == 1


def test_pages_of_other_sites_and_other_names_are_turned_away(url: str) -> None:
    with pytest.raises(InvalidStatus), connect(socket_of(url), origin=Origin("http://elsewhere.example")):
        pass
    with pytest.raises(HTTPError, match="400"):
        get(url, Host="elsewhere.example")


def test_a_port_that_is_taken_is_a_person_s_mistake(url: str) -> None:
    port = int(url.rstrip("/").rsplit(":", 1)[1])
    with pytest.raises(UserError, match="choose another port"):
        serve(Feed(Recording(), Clock(), "t"), "t", Clock(), Address(port=port), lambda: True, print)


def test_who_listens_for_others_says_by_which_names() -> None:
    assert Address().hosts == ["127.0.0.1", "localhost", "127.0.0.1"]
    assert Address("0.0.0.0").hosts == ["*"]
    assert Address("0.0.0.0", names=["127.0.0.1"]).hosts == ["127.0.0.1"]
