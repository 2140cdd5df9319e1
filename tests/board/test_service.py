"""The board process without a network: when it settles, what it refuses, and that nothing kills it."""

from __future__ import annotations

import numpy as np
import pytest

from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.service import BoardService
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MAX_BYTES, Clock, Consensus, PackedBelief, Report, Status

GRID = Grid((30, 20))
NOW = 1_000_000.0


class Desk:
    """One board process under test, and what it said."""

    def __init__(self, **settings: object) -> None:
        self.it = BoardService(
            team="t", sub_team="a", board="a", grid=GRID, settings=BoardSection.model_validate(settings)
        )
        self.now = NOW
        self.said: list[Envelope] = []

    def tell(self, *envelopes: Envelope) -> list[Envelope]:
        said = [answer for envelope in envelopes for answer in self.it.receive(envelope, self.now)]
        self.said += said
        return said

    def wait(self, seconds: float) -> list[Envelope]:
        self.now += seconds
        said = self.it.wake(self.now)
        self.said += said
        return said

    def register(self, *robots: str) -> None:
        self.tell(*(Envelope(keys.MEMBER.key(team="t", sub_team="a", robot=r), kind=Kind.ALIVE) for r in robots))

    def status(self) -> Status:
        self.wait(1.5)
        found = [decode(Status, e.payload) for e in self.said if "/status/" in e.key]
        return found[-1]


def clock(tick: int, *robots: str, run: str = "one", **more: object) -> Envelope:
    message = Clock(run=run, tick=tick, time=0.2 * tick, mode="lockstep", robots={"a": list(robots), **more})  # type: ignore[dict-item]
    return Envelope(keys.CLOCK.key(team="t"), encode(message))


def ball(x: float = 10, sigma: float = 2) -> Belief:
    return gaussian(GRID, (x, 10), sigma)


def report(source: str, tick: int, belief: Belief | None = None, *, time: float | None = None) -> Envelope:
    message = Report(
        source=source,
        subject="object/ball",
        tick=tick,
        time=0.2 * tick if time is None else time,
        belief=pack(belief or ball()),
    )
    return Envelope(keys.REPORT.key(team="t", sub_team="a", source=source, subject="object/ball"), encode(message))


def reported(source: str, tick: int, *subjects: str) -> Envelope:
    status = Status(process=source, kind="robot", tick=tick, time=0.2 * tick, phase="reported", subjects=list(subjects))
    return Envelope(keys.STATUS.key(team="t", sub_team="a", process=source), encode(status))


def levels(said: list[Envelope]) -> list[str]:
    return [e.key.split("/")[3] for e in said if "/consensus/" in e.key or "/agreed/" in e.key]


def test_a_tick_is_settled_once_everybody_named_has_spoken() -> None:
    desk = Desk()
    desk.register("r1", "r2")
    desk.tell(clock(0, "r1", "r2"))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"), reported("r2", 0, "object/ball"))) == []
    said = desk.tell(report("r2", 0))
    assert levels(said) == ["consensus", "agreed"]
    consensus = decode(Consensus, said[0].payload)
    assert [u.source for u in consensus.used] == ["r1", "r2"]
    assert decode(Status, said[-1].payload).subjects == ["object/ball"]


def test_a_repeated_clock_is_answered_with_the_same_words() -> None:
    desk = Desk()
    desk.tell(clock(0, "r1"))
    said = desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))
    assert desk.tell(clock(0, "r1")) == said


def test_a_dead_robot_is_not_waited_for() -> None:
    desk = Desk()
    desk.register("r1", "r2")
    desk.tell(clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    gone = Envelope(keys.MEMBER.key(team="t", sub_team="a", robot="r2"), kind=Kind.GONE)
    assert levels(desk.tell(gone)) == ["consensus", "agreed"]


def test_a_silent_robot_is_waited_for_until_patience_ends() -> None:
    desk = Desk(patience=2.0)
    desk.register("r1", "r2")
    desk.tell(clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    assert levels(desk.wait(1.9)) == []
    assert levels(desk.wait(0.2)) == ["consensus", "agreed"]
    assert desk.status().counters["late"] == 1


def test_the_exchange_waits_for_the_other_sub_team() -> None:
    desk = Desk()
    desk.tell(clock(0, "r1", b=["r4"]))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))) == ["consensus"]
    theirs = Consensus(
        board="b", sub_team="b", level="consensus", subject="object/ball", tick=0, time=0.0, belief=pack(ball(12)),
        ancestors={"r4": 0.0}, used=[], entropy=1.0, conflict=False, rule="cooperative",
    )  # fmt: skip
    done = Status(process="b", kind="board", tick=0, time=0.0, phase="consensus", subjects=["object/ball"])
    told = desk.tell(Envelope(keys.STATUS.key(team="t", sub_team="b", process="b"), encode(done)))
    assert levels(told) == []
    told = desk.tell(Envelope(keys.CONSENSUS.key(team="t", sub_team="b", subject="object/ball"), encode(theirs)))
    assert levels(told) == ["agreed"]
    assert set(decode(Consensus, told[0].payload).ancestors) == {"r1", "r4"}


def test_a_new_run_forgets_the_old_one() -> None:
    desk = Desk()
    desk.tell(clock(5, "r1"), report("r1", 5), reported("r1", 5, "object/ball"))
    said = desk.tell(clock(0, "r1", run="two"), reported("r1", 0))
    assert levels(said) == []
    assert decode(Status, said[-1].payload).tick == 0


def test_without_a_world_it_settles_by_unix_time() -> None:
    desk = Desk(period=0.5)
    desk.register("r1")
    desk.tell(report("r1", 7, time=NOW))
    assert levels(desk.wait(0.6)) == ["consensus", "agreed"]
    assert levels(desk.wait(0.5)) == ["consensus", "agreed"]  # what a silent robot said last stands, and spreads


def hostile() -> list[tuple[str, Envelope]]:
    """One envelope for each thing that can be wrong, by the reason it must be counted under."""
    good = report("r1", 0)
    key = good.key
    packed = pack(ball())
    grid = packed.grid

    def with_mass(value: float) -> Envelope:
        cells = np.full(GRID.shape, 1.0 / GRID.size, dtype="<f4")
        cells[3, 4] = value
        belief = PackedBelief(grid=grid, lo=(0, 0), box=GRID.shape, coding="f32", data=cells.tobytes())
        return Envelope(key, encode(Report(source="r1", subject="object/ball", tick=0, time=0.0, belief=belief)))

    return [
        ("not-msgpack", Envelope(key, b"\xc1 not msgpack")),
        ("not-msgpack", Envelope(key, b"")),
        ("version", Envelope(key, good.payload.replace(b"\xa7version\x01", b"\xa7version\x02"))),
        ("fields", Envelope(key, b"\x81\xa7version\x01")),
        ("grid", report("r1", 0, gaussian(Grid((31, 20)), (3, 3), 1))),
        ("mass", with_mass(float("nan"))),
        ("mass", with_mass(-0.5)),
        ("mass", with_mass(float("inf"))),
        ("too-large", Envelope(key, bytes(64 * MAX_BYTES))),
        ("future", report("r1", 0, time=1e9)),
        ("past", report("r1", 0, time=-1e9)),
        ("impostor", Envelope(key.replace("/r1/", "/r2/"), good.payload)),
        ("wild-key", Envelope(key.replace("/r1/", "/*/"), good.payload)),
        ("unregistered", report("r9", 0)),
    ]


@pytest.mark.parametrize(("reason", "envelope"), hostile(), ids=lambda x: x if isinstance(x, str) else "")
def test_bad_input_is_counted_and_changes_nothing(reason: str, envelope: Envelope) -> None:
    calm, disturbed = Desk(), Desk()
    for desk in (calm, disturbed):
        desk.register("r1", "r2")
        desk.tell(clock(0, "r1", "r2"), report("r2", 0), reported("r2", 0, "object/ball"))
    disturbed.tell(envelope)
    end = report("r1", 0, ball(12)), reported("r1", 0, "object/ball")
    said = [[e for e in desk.tell(*end) if "/status/" not in e.key] for desk in (calm, disturbed)]
    assert said[0] == said[1]
    assert len(said[0]) == 2
    assert disturbed.status().refused == {reason: 1}
    assert calm.status().refused == {}


def test_the_status_shows_the_rules_in_force() -> None:
    desk = Desk(gamma=0.25, subjects={"object/ball": {"rule": "median-log"}, "robot/*": {"gamma": 0.5}})
    assert desk.status().settings == {
        "rule": "coalition",
        "k": 2.0,
        "gamma": 0.25,
        "independence": 0.2,
        "feedback": "guarded",
        "object/ball.rule": "median-log",
        "robot/*.rule": "coalition",
        "robot/*.k": 2.0,
        "robot/*.gamma": 0.5,
        "robot/*.independence": 0.2,
    }
