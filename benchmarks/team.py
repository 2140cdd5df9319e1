"""How does a tick of the whole team grow with the robots, and with the grid? `python benchmarks/team.py`.

The demo's robots, boards and world as services in one process, without Zenoh: processor milliseconds a tick of all of them together,
which is what the machine has to do, however many cores it has. Two sub-teams, joint fusion, as `blackboard demo`.

In one arena more robots also see more of each other, so that what they say grows faster than they do. So the growth is told twice: in
the arena of the demo, and in one that has as much room for each robot. What a board does is told alone, too, because each one takes
the sightings of all robots; its growth is by their number.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from fleet import Counted
from ratios import Measured, show

from blackboard.config import Scenario, load
from blackboard.lab.team import InProcessTeam
from blackboard.opinion.gaussian.once import settle_alone
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Readings

ROBOTS = (6, 12, 24, 48)
FIRST = ROBOTS[0]
TICKS = {6: 15, 12: 10, 24: 6, 48: 4}


def demo(robots: int, side: int = 50) -> Scenario:
    names = [f"r{i + 1}" for i in range(robots)]
    half = (robots + 1) // 2
    scenario = load("demo").changed("team", sub_teams={"a": names[:half], "b": names[half:]})
    scenario = scenario.changed("grid", shape=[side, side])
    return scenario.changed("time", seconds=TICKS.get(robots, 4) * scenario.time.tick)


@dataclass(frozen=True)
class Tick:
    """The means over the ticks of a run, all processes together."""

    ms: float  # processor time
    messages: float  # that were sent
    seen: float  # sightings of robots and objects, of which each board takes all


def tick(scenario: Scenario) -> Tick:
    team, sent, sightings = InProcessTeam(scenario), [0], [0]

    def count(envelope: Envelope) -> None:
        sent[0] += 1
        if envelope.kind is Kind.PUT and keys.READING.match(envelope.key):
            sightings[0] += sum(sighting.landmark is None for sighting in decode(Readings, envelope.payload).sightings)

    team.bus.spies.append(count)
    begin = time.process_time()
    ticks = team.run()["ticks"]
    return Tick(1e3 * (time.process_time() - begin) / ticks, sent[0] / ticks, sightings[0] / ticks)


def board_tick(scenario: Scenario) -> float:
    """Milliseconds of processor time a tick of one board, the mean of the two, which share no work as they would in one process."""
    team = InProcessTeam(scenario, settle=settle_alone)
    boards = [Counted(board) for board in team.boards.values()]
    for board in boards:
        team.leave(board.inner)
        team.join(board)
    ticks = team.run()["ticks"]
    return 1e3 * sum(board.spent.seconds for board in boards) / len(boards) / float(ticks)


def growth(measured: Sequence[tuple[float, float]]) -> float:
    """The power of the first to which the second of each pair grows."""
    sizes, costs = np.log(measured).T
    return float(np.polyfit(sizes, costs, 1)[0])


def rows() -> Iterator[Measured]:
    first = tick(demo(FIRST))
    yield Measured(f"a tick of {FIRST} robots on 50 x 50, all processes", first.ms, "ms")
    for where, side in (("in the same arena", lambda share: 50), ("in room for each", lambda share: 50 * share**0.5)):
        measured = {FIRST: first} | {n: tick(demo(n, round(side(n / FIRST)))) for n in ROBOTS[1:]}
        for robots in ROBOTS[1:]:
            share, cost = robots / FIRST, measured[robots]
            yield Measured(
                f"a tick of {robots} robots / {share:g} times that of {FIRST}, {where}", cost.ms / first.ms / share
            )
            yield Measured(f"its messages / {share:g} times those of {FIRST}", cost.messages / first.messages / share)
            yield Measured(f"its sightings / {share:g} times those of {FIRST}", cost.seen / first.seen / share)
        for last in (24, 48):
            some = [n for n in ROBOTS if n <= last]
            power = growth([(n, measured[n].ms) for n in some])
            yield Measured(
                f"a tick grows as the robots to the power of, {where}, {FIRST} to {last}", power, "", most=1.0
            )
        if where == "in the same arena":
            boards = {n: board_tick(demo(n)) for n in ROBOTS}
            grown = growth([(measured[n].seen, boards[n]) for n in ROBOTS])
            yield Measured(f"a board grows as the sightings to the power of, {where}", grown, "", most=1.2)
            question = f"a tick of one board of {ROBOTS[-1]} robots, {where}, at 5 Hz on one core"
            yield Measured(question, boards[ROBOTS[-1]], "ms", most=200.0)
    large = tick(demo(FIRST, 200)).ms
    yield Measured(f"a tick of {FIRST} robots on 200 x 200 / on 50 x 50", large / first.ms)
    yield Measured(
        f"{FIRST} robots on 200 x 200: team time / processor time, so at most twice that on 2 cores", 200.0 / large
    )


if __name__ == "__main__":
    show(rows())
