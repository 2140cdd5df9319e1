"""A night that fails becomes the smallest one that does, for the same reason."""

import pytest

from tests.nights import faults
from tests.nights.night import Night, Team, draw_night
from tests.nights.shrink import candidates, shrunk

TEAM = Team({"a": ("r1", "r2"), "b": ("r3", "r4")}, "free", boards=2, guest=True, budget=600.0)
CAUSE = faults.Frozen(4.0, 6.5, "board/a/board-a")
OTHERS = (
    faults.Routerless(3.0, 5.5),
    faults.Killed(2.5, 2.8, "robot/r4"),
    faults.FullDisk(5.0, 6.0),
    faults.SecondWorld(7.0, 8.0),
)


def test_what_does_not_matter_is_left_out() -> None:
    night = Night(TEAM, (*OTHERS[:2], CAUSE, *OTHERS[2:]))
    smallest = shrunk(
        night, lambda tried: "NobodyWaits" if any(isinstance(f, faults.Frozen) for f in tried.faults) else ""
    )
    assert [type(fault) for fault in smallest.faults] == [faults.Frozen]
    assert smallest.faults[0].end - smallest.faults[0].begin <= 0.1
    assert smallest.team == Team({"a": ("r1", "r2")}, "free") or smallest.team == Team(
        {"a": ("r1",), "b": ("r3",)}, "free"
    )


def test_another_failure_is_none() -> None:
    night = Night(TEAM, (CAUSE, OTHERS[0]))
    smallest = shrunk(night, lambda tried: "NobodyDies" if len(tried.faults) > 1 else "NobodyWaits")
    assert len(smallest.faults) == 2


def test_no_more_nights_are_tried_than_are_asked_for() -> None:
    tried: list[Night] = []
    shrunk(Night(TEAM, (CAUSE, *OTHERS)), lambda night: (tried.append(night), "x")[1], tries=7)
    assert len(tried) == 8
    with pytest.raises(ValueError, match="breaks nothing"):
        shrunk(Night(TEAM), lambda night: "")


def test_every_candidate_is_a_night_that_can_be() -> None:
    for number in range(60):
        night = draw_night(6, number)
        for smaller in candidates(night):
            names = {*smaller.team.processes, "*"}
            for fault in smaller.faults:
                whom = getattr(fault, "who", None)
                assert whom is None or whom in names
            assert smaller != night
