"""One message, or a handful, from a member that is broken or from a stranger: nobody ends, and the run goes on to its end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from blackboard.wire import keys
from blackboard.wire.messages import Informed, Report, Status
from tests.hostile.attack import JOINT, SCENARIO, Attack, calm, report_key, status_key
from tests.wire.messages import as_map

READING = keys.READING.key(team="t", robot="r2")
CLOCK = keys.CLOCK.key(team="t")
MANY = {f"x{i}": 1.0 for i in range(256)}
LAST = 2**53 - 1


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
        subjects = ["robot/r2", *(f"object/a{i}" for i in range(400))]
        return [(report_key("r2", s), said.model_copy(update={"subject": s})) for s in subjects]

    attack.instead(report_key("r2", "robot/r2"), change)


def subjects_of_another_board(attack: Attack) -> None:
    """255 of one's own and 2 of the others were enough."""
    subjects_of_a_member(attack)

    def change(said: Any) -> list[tuple[str, Any]]:
        subjects = ["robot/r3", *(f"object/b{i}" for i in range(300))]
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


def clock(**changes: Any) -> Callable[[Attack], None]:
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
    for i in range(300):
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
    "400 subjects of a member": subjects_of_a_member,
    "300 subjects of another board": subjects_of_another_board,
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
    "a clock's tick 2^53-1": clock(tick=LAST),
    "a clock's tick": clock(tick=20, time=10.0),
    "a clock's run": clock(run="other", tick=0, time=0.0),
    "a clock's time": clock(tick=4, time=1e300),
    "a robot as a board": board_named_like_a_robot,
    "statuses of nobody": statuses_of_nobody,
    "agreed of nobody": agreed_of_nobody,
}
#: Those that must not change a bit: they come from nobody, or contradict what holds.
HARMLESS = ["a clock's tick 2^53-1", "a clock's tick", "a clock's run", "a clock's time", "a run of a reading", "a tick of a reading",
            "a robot as a board", "statuses of nobody", "agreed of nobody"]  # fmt: skip


@pytest.mark.parametrize("name", ATTACKS)
@pytest.mark.parametrize("scenario", [SCENARIO, JOINT], ids=["opinions", "joint"])
def test_nobody_ends_and_the_run_goes_on(scenario: Any, name: str) -> None:
    attack = Attack(scenario)
    ATTACKS[name](attack)
    attack.goes_on()
    if name in HARMLESS:
        assert attack.hash == undisturbed(scenario)


HASHES: dict[int, str] = {}


def undisturbed(scenario: Any) -> str:
    return HASHES.setdefault(id(scenario), "") or HASHES.setdefault(id(scenario) + 1, calm(scenario))
