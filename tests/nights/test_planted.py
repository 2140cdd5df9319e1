"""The planted bugs can be planted, and one of them is noticed at once."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tests.files import ROOT
from tests.nights.faults import AnotherBoard, Crowd, Frozen, Killed, Late, OneWay, Stale, WorldKilled
from tests.nights.night import CROWD, RATE, Night, Team
from tests.nights.planted import BUGS, Bug, breaks, notice
from tests.nights.run import live


@pytest.mark.parametrize("bug", BUGS.values(), ids=BUGS)
def test_every_bug_has_its_place(bug: Bug, tmp_path: Path) -> None:
    (tmp_path / bug.file).parent.mkdir(parents=True)
    shutil.copy(ROOT / bug.file, tmp_path / bug.file)
    bug.plant(tmp_path)
    compile((tmp_path / bug.file).read_text(encoding="utf-8"), bug.file, "exec")
    with pytest.raises(ValueError, match="does not have"):
        bug.plant(tmp_path)


def test_a_planted_bug_is_noticed() -> None:
    noticed = notice(BUGS["ancestors"], 10, 1)
    assert noticed is not None
    assert "ProvenanceIsWhole" in noticed


TEAM = Team({"a": ("r1", "r2"), "b": ("r3",)}, "realtime", boards=2, patience=1.0, tick=1.0, latency=0.02)

JOINT = replace(TEAM, boards=1, fusion="joint")

#: For a bug the night that it takes: its leader hangs, a newcomer hangs before anybody leads, a status of the board
#: that follows is lost, messages come again while one robot is late, a robot's token comes after its reports, strangers speak.
#: Then one token after the other comes late, mates are seen that tell a step later how they moved, a link is poor, a robot is started
#: again, and so is a world, a robot is frozen for a while.
NIGHTS = {
    "stuck": Night(TEAM, (Frozen(2.0, 8.5, "board/a/board-a"),)),
    "awaited": Night(replace(TEAM, boards=1, patience=2.0), (AnotherBoard(0.0, 8.5, "a", "a-first", hangs=True),)),
    "early": Night(replace(TEAM, mode="free"), (Killed(3.0, 6.0, "robot/r1", unseen=2.0),)),
    "crowd": Night(replace(TEAM, mode="free", boards=1), (Crowd(3.0, 4.0, "a", CROWD),)),
    "repeat": Night(replace(TEAM, mode="lockstep", latency=0.2), (OneWay(3.0, 5.0, "board/a/board-a2", "world"),)),
    "older": Night(
        replace(TEAM, mode="lockstep", boards=1, latency=0.1),
        (Late(2.0, 8.5, "robot/r1", 0.3), Stale(2.0, 8.5, "*", 1.0, 2.0)),
    ),
    "never": Night(
        replace(TEAM, mode="free", boards=1),
        (Killed(3.0, 5.0, "robot/r1", unseen=1.5), Killed(3.0, 4.5, "robot/r2", unseen=1.0)),
    ),
    "lost": Night(replace(JOINT, sub_teams={"a": ("r1", "r2"), "b": ("r3", "r4")}, mode="free", tick=0.5)),
    "unsent": Night(replace(JOINT, tick=0.5, rate=RATE)),
    "entered": Night(JOINT, (Killed(3.0, 5.0, "robot/r1"),)),
    "leftover": Night(replace(TEAM, boards=1), (WorldKilled(5.0, 5.3),)),
    "vain": Night(replace(JOINT, mode="lockstep", latency=0.2), (Frozen(2.5, 5.0, "robot/r1"),)),
}


@pytest.mark.long
@pytest.mark.parametrize("name", NIGHTS)
def test_a_bug_is_noticed_in_the_night_that_it_takes(name: str) -> None:
    assert live(NIGHTS[name]) is None
    assert breaks(BUGS[name], NIGHTS[name]).startswith((
        "SomebodySpeaks", "TheNewestCounts", "NobodyWaits", "NobodyDies", "EarlyIsTaken", "NothingGrows", "EarlyIsKept",
        "GainsAddUp", "EvidenceCountsOnce", "NothingIsFromLater", "LateAreWaitedForAgain", "SightingsAreJudged",
    ))  # fmt: skip
