"""Who is missing is asked, and only who lost something is asked to repeat it: a slow team is not given more work."""

import pytest

from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Status
from tests.holdings import grown, holdings
from tests.sim_world.desk import Desk
from tests.wire.envelopes import put


class Quiet(Desk):
    """A team that keeps what a Clock asks: who is `asked` tells a status, who is named in `again` repeats its answers."""

    def __init__(self, **more: object) -> None:
        super().__init__(**more)  # type: ignore[arg-type]
        self.lacks: list[str] = []  # of the board, which then has not agreed
        self.repeated: list[str] = []

    def answers(self, clock: Clock) -> list[Envelope]:
        if clock.asked is None:
            envelopes = super().answers(clock)
            return [e for e in envelopes if not self.lacks or "/solo/" in e.key]
        out = [self.reported(name, clock.tick) for name in clock.asked if name != "board/a/a"]
        if "board/a/a" in clock.asked:
            waiting = Status(process="a", kind="board", tick=0, time=0, lacks=self.lacks)
            done = decode(Status, self.status("a", "agreed", ["robot/r1", "robot/r2"], clock.tick).payload)
            said = waiting if self.lacks else done
            out.append(put(said, team="demo"))
        for name in clock.again or []:
            self.repeated.append(name)
            mine = "/a/" if name == "board/a/a" else "/solo/" + name.removeprefix("robot/")
            out += [e for e in super().answers(clock) if mine in e.key]
        if self.repeated and self.lacks:  # what the board lacked is there now
            self.lacks = []
            out += [e for e in super().answers(clock) if "/a/" in e.key]
        return out

    def reported(self, name: str, tick: int) -> Envelope:
        robot = name.removeprefix("robot/")
        said = Status(process=robot, kind="robot", tick=tick, time=0, phase="reported")
        return put(said, team="demo")


@pytest.mark.parametrize(("lost", "who"), [("/solo/r2", "robot/r2"), ("/a/agreed/robot/r1", "board/a/a")])
def test_only_those_whose_answers_were_lost_are_asked_to_repeat_them_and_once(lost: str, who: str) -> None:
    desk = Quiet()
    lose = [lost]
    desk.lose = lambda envelope: bool(lose) and lose[0] in envelope.key and bool(lose.pop())
    desk.tokens(Kind.ALIVE)
    assert desk.ticks == [0]
    desk.wait(2.1)
    assert desk.repeated == []  # its answers may be on their way
    desk.wait(2.0)
    assert desk.repeated == [who]
    assert desk.card["verdict"] == "PASS"
    assert desk.card["counters"]["repeated"] == 2  # asked for a status, and for the answers


def test_whose_messages_a_board_lacks_are_asked_to_repeat_them() -> None:
    desk = Quiet()
    desk.lacks = ["robot/r1", "robot/stranger"]
    desk.tokens(Kind.ALIVE)
    assert desk.ticks == [0]
    desk.tell(desk.reported("robot/r1", 0), desk.reported("robot/stranger", 0))
    desk.wait(4.1)
    assert desk.repeated == ["robot/r1"]
    assert desk.world.tick > 0


def test_what_strangers_lack_is_not_kept() -> None:
    desk = Quiet()
    desk.silent = {"r1", "r2", "a"}
    desk.tokens(Kind.ALIVE)
    before = holdings(desk.world, "world")
    for n in range(100):
        said = Status(process=f"x{n}", kind="board", tick=0, time=0, lacks=[f"robot/y{n}", "robot/r1"])
        desk.tell(put(said, team="demo"))
    kept = grown(before, holdings(desk.world, "world"))
    assert all(path.startswith("world.traffic.") for path in kept), "but what each sent, which is bounded"


def test_who_is_slow_repeats_nothing() -> None:
    desk = Quiet()
    desk.lacks = [""]
    desk.tokens(Kind.ALIVE)
    desk.wait(9.0)
    assert desk.repeated == []
    assert [clock.asked for clock in desk.clocks] == [None, ["board/a/a"], ["board/a/a"], ["board/a/a"]]
    desk.lacks = []
    desk.tell(*Desk.answers(desk, desk.clocks[0]))
    assert desk.world.tick > 0
