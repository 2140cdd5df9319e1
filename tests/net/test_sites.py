"""Two routers, each with the configuration in examples/: what crosses the link between two sites, and how often."""

from collections import Counter
from contextlib import ExitStack
from pathlib import Path

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope
from tests.processes import Letters, introduce, wait_until

EXAMPLES = Path(__file__).parents[2] / "examples"
STAYS = (
    "cop/demo/a/report/r1/robot/r1",
    "cop/demo/a/journal/board-a",
    "cop/demo/score/solo/r1",
    "cop/demo/world/truth",
    "cop/demo/world/reading/r1",
)
TIMES = 20  # that each is sent in a round
THINNED = ("cop/demo/a/consensus/robot/r1", "cop/demo/a/consensus/object/ball")
WHOLE = ("cop/demo/world/clock", "cop/demo/a/status/board-a", "cop/demo/a/forward/board-a")


def config(site: str, folder: Path, here: int, there: int) -> LinkConfig:
    """The sample of a site on 127.0.0.1, where the link between the sites is on the same interface as all else."""
    text = (EXAMPLES / f"site-{site}.json5").read_text(encoding="utf-8")
    other = "b" if site == "a" else "a"
    for before, after in {
        "tcp/0.0.0.0:7447": f"tcp/127.0.0.1:{here}",
        f"tcp/site-{other}:7447": f"tcp/127.0.0.1:{there}",
        '"wg0"': '"lo"',
    }.items():
        assert before in text, before
        text = text.replace(before, after)
    file = folder / f"site-{site}.json5"
    file.write_text(text, encoding="utf-8")
    return LinkConfig(mode="router", file=str(file))


def test_a_slow_link_carries_what_the_other_site_needs(tmp_path: Path) -> None:
    ports = {"a": free_port(), "b": free_port()}
    with ExitStack() as links:
        for site, other in ("ab", "ba"):
            links.enter_context(Link(config(site, tmp_path, ports[site], ports[other]), f"router-{site}"))
        here, there = (
            links.enter_context(Link(LinkConfig(connect=(f"tcp/127.0.0.1:{ports[site]}",)), site)) for site in "ab"
        )
        there.subscribe("cop/**")
        introduce(there, here)
        came = Letters(there)
        rounds, clock = 0, UnixClock()
        began = clock.now()

        def another() -> bool:
            nonlocal rounds
            rounds += 1
            for i in range(TIMES):
                for key in (*STAYS, *THINNED, *WHOLE):
                    here.send(Envelope(key, f"{rounds} {i}".encode()))
            here.send(Envelope("cop/demo/a/forward/board-a2", bytes(40_000)))
            here.send(Envelope(f"cop/demo/a/forward/round{rounds}", b"last"))
            came.until(Envelope(f"cop/demo/a/forward/round{rounds}", b"last"))
            return all(Counter(e.key for e in came.read)[key] >= 2 for key in THINNED)

        wait_until(another, "both consensuses come a second time, a second later")
        took = clock.now() - began
    counts = Counter(envelope.key for envelope in came.read)
    assert [counts[key] for key in WHOLE] == [TIMES * rounds] * len(WHOLE)
    assert [counts[key] for key in STAYS] == [0] * len(STAYS)
    assert all(counts[key] <= 2 + took for key in THINNED), "one a second"
    assert TIMES * rounds > 4 * (2 + took), "or the machine is too slow for this test to say anything"
    assert counts["cop/demo/a/forward/board-a2"] == 0, "it is larger than the link may carry"


def test_an_exchange_resumes_by_itself_when_a_site_s_router_is_back(tmp_path: Path) -> None:
    """Site b's router is lost and comes back; meanwhile the members of site a go on with each other."""
    ports = {"a": free_port(), "b": free_port()}
    where = {site: f"tcp/127.0.0.1:{port}" for site, port in ports.items()}
    routers = {
        "a": LinkConfig(mode="router", listen=(where["a"],)),
        "b": LinkConfig(mode="router", listen=(where["b"],), connect=(where["a"],)),
    }
    clock = "cop/demo/world/clock"
    with ExitStack() as links:
        links.enter_context(Link(routers["a"], "router-a"))
        at = [LinkConfig(connect=(where[site],)) for site in "aab"]
        with Link(routers["b"], "router-b"):
            speaker, neighbour, far = (links.enter_context(Link(there, "x")) for there in at)
            heard = [Letters(neighbour), Letters(far)]
            for listener in (neighbour, far):
                listener.subscribe(clock)
                introduce(listener, speaker)
            speaker.send(Envelope(clock, b"before"))
            for letters in heard:
                letters.until(Envelope(clock, b"before"))
        speaker.send(Envelope(clock, b"meanwhile"))
        heard[0].until(Envelope(clock, b"meanwhile"))
        assert Envelope(clock, b"meanwhile") not in heard[1].take()
        with Link(routers["b"], "router-b again"):
            again = Envelope(clock, b"again")
            wait_until(lambda: [speaker.send(again), again in heard[1].take()][1], "the far site hears again")
