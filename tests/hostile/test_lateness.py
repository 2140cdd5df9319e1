"""A member that answers the world and not its board, or only sometimes: a lockstep run loses a few waits by it, not one in each tick."""

from collections.abc import Callable
from typing import Any

import pytest

from blackboard.wire import keys
from tests.hostile.attack import Attack, report_key, status_key
from tests.scenarios import SCENARIO
from tests.wire.messages import as_map

TICKS = 20
LONGER = SCENARIO.changed("time", seconds=TICKS * SCENARIO.time.tick)
SOLO = keys.SOLO.key(team="t", robot="r2")
REPORT, STATUS = report_key("r2", "robot/r2"), status_key("r2")


def without(said: Any) -> list[dict[str, Any]]:
    return []


def of_wrong_types(said: Any) -> list[dict[str, Any]]:
    return [{**as_map(said), "time": "x"}]


def lists_another(said: Any) -> list[dict[str, Any]]:
    return [{**as_map(said), "subjects": [*said.subjects, "object/none"]}]


def of_the_next_tick(said: Any) -> list[dict[str, Any]]:
    return [{**as_map(said), "tick": said.tick + 1}]


#: What is sent instead of what is sent on a key.
LATE: dict[str, tuple[str, Callable[[Any], list[dict[str, Any]]]]] = {
    "no reports": (REPORT, without),
    "reports of wrong types": (REPORT, of_wrong_types),
    "no statuses": (STATUS, without),
    "statuses that list what it does not report": (STATUS, lists_another),
    "statuses of the next tick": (STATUS, of_the_next_tick),
    "no beliefs of its own": (SOLO, without),
    "beliefs of its own of the next tick": (SOLO, of_the_next_tick),
}


@pytest.mark.parametrize(
    ("name", "every", "waits"),
    [*((name, 1, 1) for name in LATE), ("no statuses", 2, 3), ("no beliefs of its own", 2, 3)],
)
def test_who_never_answers_properly_is_late_a_few_times(name: str, every: int, waits: int) -> None:
    key, change = LATE[name]
    attack = Attack(LONGER)
    board, world = SCENARIO.board, attack.team.world

    def sometimes(said: Any) -> list[tuple[str, Any]]:
        return [(key, one) for one in (change(said) if said.tick % every == 0 else [as_map(said)])]

    attack.instead(key, sometimes)
    attack.goes_on()
    late = attack.team.boards["a"].counters["late"]
    assert attack.team.boards["b"].counters["late"] == 0  # the board that waited is not late itself
    given_up = world.counters["given_up"]
    assert 1 <= late + given_up <= waits
    assert attack.card["wall_s"] < waits * (world.settings.give_up if given_up else board.patience) + TICKS / 2
