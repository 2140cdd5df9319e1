"""One message, or a handful, from a member that is broken or from a stranger: nobody ends, and the run goes on to its end."""

from collections.abc import Callable
from typing import Any

import pytest

from blackboard.board.fusion import fuse_opinions
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Informed, Report, Status
from tests.board.desk import NOW, Desk, clock, report, reported
from tests.hostile.attack import Attack, calm, report_key, status_key
from tests.robot_agent.services import kinds, new_service, readings
from tests.scenarios import JOINT, SCENARIO
from tests.wire.envelopes import put
from tests.wire.messages import as_map

READING = keys.READING.key(team="t", robot="r2")
CLOCK = keys.CLOCK.key(team="t")
MANY = {f"x{i}": 1.0 for i in range(256)}
LAST = 2**53 - 1
SCENARIOS = {"opinions": SCENARIO, "joint": JOINT}


def ancestors_in_a_report(attack: Attack) -> None:
    """As many as a message may name: the union with others' is more."""

    def change(said: Report) -> list[tuple[str, Any]]:
        more = {"ancestors": MANY, "informed": Informed(belief=said.belief, ancestors=MANY)}
        ball = {"subject": "object/ball"}
        own = (report_key("r2", "robot/r2"), said.model_copy(update=more))
        return [own, (report_key("r2", "object/ball"), own[1].model_copy(update=ball))]

    attack.instead(report_key("r2", "robot/r2"), change)


def subjects_of_a_member(attack: Attack) -> None:
    def change(said: Report) -> list[tuple[str, Any]]:
        subjects = ["robot/r2", *(f"object/a{i}" for i in range(260))]
        return [(report_key("r2", s), said.model_copy(update={"subject": s})) for s in subjects]

    attack.instead(report_key("r2", "robot/r2"), change)


def subjects_of_another_board(attack: Attack) -> None:
    """255 of one's own and 2 of the others were enough."""
    subjects_of_a_member(attack)

    def change(said: Any) -> list[tuple[str, Any]]:
        subjects = ["robot/r3", *(f"object/b{i}" for i in range(40))]
        keyed = [(keys.CONSENSUS.key(team="t", sub_team="b", subject=s), s) for s in subjects]
        return [(key, said.model_copy(update={"subject": subject})) for key, subject in keyed]

    attack.instead(keys.CONSENSUS.key(team="t", sub_team="b", subject="robot/r3"), change)


def numbers_of_a_reading(**changes: Any) -> Callable[[Attack], None]:
    """Readings with fields that nobody can measure."""
    return lambda attack: attack.instead(READING, lambda said: [(READING, {**as_map(said), **changes})])


def tick_of_a_reading(attack: Attack) -> None:
    attack.say(READING, attack.message(READING).model_copy(update={"tick": LAST}))


def run_of_a_reading(attack: Attack) -> None:
    attack.say(READING, attack.message(READING).model_copy(update={"run": "other", "tick": 0}))


def false_clock(**changes: Any) -> Callable[[Attack], None]:
    return lambda attack: attack.say(CLOCK, attack.message(CLOCK).model_copy(update=changes))


def board_named_like_a_robot(attack: Attack) -> None:
    for tick in (3, 4):
        said = Status(
            process="r2", kind="board", tick=tick, time=0.5 * tick, phase="consensus", subjects=["object/ball"]
        )
        attack.say(status_key("r2"), said)
        attack.say(status_key("r3", "b"), said.model_copy(update={"process": "r3"}))


def statuses_of_nobody(attack: Attack) -> None:
    """Of invented robots and boards, with lists as long as they may be."""
    for i in range(40):
        for kind, phase in (("robot", "reported"), ("board", "consensus"), ("board", "agreed")):
            for sub_team in ("a", f"z{i}"):
                said = Status(process=f"x{i}", kind=kind, tick=3, time=1.5, phase=phase, subjects=["robot/r1"])  # type: ignore[arg-type]
                attack.say(status_key(f"x{i}", sub_team), said)


def agreed_of_nobody(attack: Attack) -> None:
    """A belief by a board that holds no token, which robots would fold back."""
    for tick in range(2, 8):
        said = attack.message(keys.AGREED.key(team="t", sub_team="a", subject="robot/r3"))
        changes = {"board": "a-first", "subject": "robot/r1", "tick": tick}
        attack.say(keys.AGREED.key(team="t", sub_team="a", subject="robot/r1"), said.model_copy(update=changes))


def sighting(i: int, **changes: Any) -> dict[str, Any]:
    return {"subject": f"object/s{i}", "range": 3.0, "bearing": 0.1, **changes}


ATTACKS: dict[str, Callable[[Attack], None]] = {
    "256 ancestors": ancestors_in_a_report,
    "260 subjects of a member": subjects_of_a_member,
    "subjects of another board": subjects_of_another_board,
    "sigma 1e200": numbers_of_a_reading(fix={"position": [3.0, 3.0], "sigma": 1e200}),
    "sigma 1e-200": numbers_of_a_reading(fix={"position": [3.0, 3.0], "sigma": 1e-200}),
    "position 1e300": numbers_of_a_reading(fix={"position": [1e300, 3.0], "sigma": 1.0}),
    "turn 1.7e308": numbers_of_a_reading(odometry={"distance": 1.0, "turn": 1.7e308, "dt": 0.5}),
    "distance 1.7e308": numbers_of_a_reading(odometry={"distance": 1.7e308, "turn": 0.0, "dt": 0.5}),
    "dt 1e-320": numbers_of_a_reading(odometry={"distance": 1.0, "turn": 0.0, "dt": 1e-320}),
    "256 sightings": numbers_of_a_reading(sightings=[sighting(i) for i in range(256)]),
    "range 1e300": numbers_of_a_reading(sightings=[sighting(1, range=1e300)]),
    "bearing 1e300": numbers_of_a_reading(sightings=[sighting(1, bearing=1e300)]),
    "age 1e300": numbers_of_a_reading(sightings=[sighting(1, age=1e300)]),
    "compass 1e300": numbers_of_a_reading(compass=1e300),
    "time 1e300": numbers_of_a_reading(time=1e300),
    "a tick of a reading": tick_of_a_reading,
    "a run of a reading": run_of_a_reading,
    "a clock's tick 2^53-1": false_clock(tick=LAST),
    "a clock's tick": false_clock(tick=20, time=10.0),
    "a clock's run": false_clock(run="other", tick=0, time=0.0),
    "a clock's time": false_clock(tick=4, time=1e300),
    "a robot as a board": board_named_like_a_robot,
    "statuses of nobody": statuses_of_nobody,
    "agreed of nobody": agreed_of_nobody,
}
#: Those that must not change a bit: they come from nobody, or contradict what holds.
HARMLESS = ["a clock's tick 2^53-1", "a clock's tick", "a clock's run", "a clock's time", "a run of a reading", "a tick of a reading",
            "a robot as a board", "statuses of nobody", "agreed of nobody"]  # fmt: skip


#: Those that concern the joint, which is run as well.
OF_THE_JOINT = [
    name
    for name in ATTACKS
    if "1e" in name or "turn" in name or name in ("256 ancestors", "256 sightings", "agreed of nobody")
]


#: A few of them are unit tests; all others belong to `make fuzz`.
QUICK = [
    "256 ancestors",
    "sigma 1e200",
    "turn 1.7e308",
    "a clock's tick 2^53-1",
    "a clock's run",
    "a robot as a board",
    "agreed of nobody",
]


@pytest.mark.parametrize(
    ("fusion", "name"),
    [
        pytest.param(fusion, name, marks=[] if (fusion, name in QUICK) == ("opinions", True) else pytest.mark.hostile)
        for fusion, names in (("opinions", list(ATTACKS)), ("joint", OF_THE_JOINT))
        for name in names
    ],
)
def test_nobody_ends_and_the_run_goes_on(fusion: str, name: str) -> None:
    attack = Attack(SCENARIOS[fusion])
    ATTACKS[name](attack)
    attack.goes_on()
    if name in HARMLESS:
        assert attack.hash == calm(SCENARIOS[fusion])


@pytest.mark.parametrize(
    "key",
    [report_key("r2", "robot/r2"), status_key("r2"), keys.CONSENSUS.key(team="t", sub_team="b", subject="robot/r3")],
)
def test_a_message_that_is_lost_once_is_asked_for_again_and_changes_not_a_bit(key: str) -> None:
    attack, left = Attack(), 1

    def lose(envelope: Envelope) -> bool:
        nonlocal left
        left -= envelope.key == key
        return envelope.key == key and left == 0

    attack.team.bus.lose = lose
    attack.goes_on()
    assert left <= 0
    assert attack.hash == calm()


def test_readings_of_another_run_or_far_ahead_are_believed_with_the_second_ones() -> None:
    robot = new_service()
    for tick in range(3):
        robot.receive(readings(tick, time=NOW + tick), NOW + tick)
    agent = robot.agent
    for false in (readings(LAST, time=NOW), readings(0, run="z"), readings(LAST, run="z", time=NOW)):
        assert robot.receive(false, NOW + 3) == []
        assert (robot.tick, robot.run, robot.agent) == (2, "x", agent)
        robot.receive(readings(2, time=NOW + 2), NOW + 3)  # the true ones come again
    assert robot.receive(readings(0, run="z", time=NOW + 4), NOW + 4) == []
    assert kinds(robot.receive(readings(1, run="z", time=NOW + 5), NOW + 5)) == ["Report", "Status"] * 2  # none is lost
    assert (robot.tick, robot.run) == (1, "z")
    assert robot.agent is not agent


def test_after_a_false_jump_the_true_readings_are_followed_again() -> None:
    robot = new_service()
    robot.receive(readings(0, time=NOW), NOW)
    for tick in (5000, 5001):
        robot.receive(readings(tick, time=NOW), NOW)
    assert robot.tick == 5001
    for tick in (1, 2):
        robot.receive(readings(tick, time=NOW + tick), NOW + tick)
    assert robot.tick == 2


def test_an_agent_that_fails_again_and_again_begins_anew(caplog: pytest.LogCaptureFixture) -> None:
    robot = new_service()
    robot.receive(readings(0, time=NOW), NOW)
    broken = robot.agent
    broken.tick = lambda readings, agreed: 1 // 0  # type: ignore[assignment, method-assign, return-value]
    said = [kinds(robot.receive(readings(tick, time=NOW + tick), NOW + tick)) for tick in range(1, 6)]
    assert said == [["Status"]] * 3 + [["Report", "Status"]] * 2
    assert robot.counters["failed"] == 3
    assert "ZeroDivisionError" in caplog.text


def test_a_subject_that_cannot_be_fused_does_not_stop_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    desk.register("r1")
    desk.tell(clock(0, "r1"))

    def fails(opinions: Any, grid: Any, settings: Any, subject: str, *more: Any) -> Any:
        if subject == "object/ball":
            raise FloatingPointError("overflow")
        return fuse_opinions(opinions, grid, settings, subject, *more)

    monkeypatch.setattr("blackboard.board.board.fuse_opinions", fails)
    own = decode(Report, report("r1", 0).payload).model_copy(update={"subject": "robot/r1"})
    desk.tell(report("r1", 0), put(own))
    said = desk.tell(reported("r1", 0, "object/ball", "robot/r1"))
    assert [e.key for e in said if "/status/" not in e.key] == ["cop/t/a/consensus/robot/r1", "cop/t/a/agreed/robot/r1"]
    assert desk.status().counters["failed"] == 1
