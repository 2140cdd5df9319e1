"""What a robot does on news of the team clock, as a table. Pure. `python -m blackboard.process.reactions` prints it."""

from collections.abc import Mapping
from enum import Enum

from blackboard.process.columns import columns
from blackboard.process.team_clock import News


class Place(Enum):
    """Where a robot stands when the team clock has news."""

    ELSEWHERE = "in another run"  # or in none
    BEHIND = "behind the tick"
    DONE = "done with the tick"


class Cue(Enum):
    """What news of the team clock mean for a robot."""

    BEGIN = "begin"  # another run: everything is forgotten
    JOIN = "join"  # from this tick on a world gives the ticks of the run that the robot is in
    TICK = "tick"  # a tick of a world begins
    REPEAT = "repeat"  # the world asks again for what was said
    FREE = "free"  # the world is gone: stamps are Unix time from now on


#: What follows, one after the other. The first Clock of a run may come after its tick was done on the readings alone.
REACTIONS: Mapping[tuple[News, Place], tuple[Cue, ...]] = {
    (News.RUN, Place.ELSEWHERE): (Cue.BEGIN, Cue.TICK),
    (News.RUN, Place.BEHIND): (Cue.JOIN, Cue.TICK),
    (News.RUN, Place.DONE): (Cue.JOIN, Cue.REPEAT),
    (News.TICK, Place.BEHIND): (Cue.TICK,),
    (News.TICK, Place.DONE): (),
    (News.REPEATED, Place.BEHIND): (),
    (News.REPEATED, Place.DONE): (Cue.REPEAT,),
    (News.FREE, Place.ELSEWHERE): (Cue.FREE,),
}


def text() -> str:
    rows = [
        (news.value, place.value, ", ".join(cue.value for cue in cues) or "-")
        for (news, place), cues in REACTIONS.items()
    ]
    return "\n".join(columns([("news", "robot", "then"), *rows]))


if __name__ == "__main__":
    print(text())  # noqa: T201
