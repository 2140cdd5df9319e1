"""How does a tick of the whole team grow with the robots, and with the grid? `python benchmarks/team.py`.

The demo's robots, boards and world as services in one process, without Zenoh: processor milliseconds a tick of all of them together,
which is what the machine has to do, however many cores it has. Two sub-teams, joint fusion, as `blackboard demo`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from ratios import Row, show

from blackboard.config import Scenario, load
from blackboard.lab.team import Team

ROBOTS = (6, 12, 24)
TICKS = {6: 15, 12: 10, 24: 6, 48: 4}


def demo(robots: int, side: int = 50) -> Scenario:
    names = [f"r{i + 1}" for i in range(robots)]
    half = (robots + 1) // 2
    scenario = load("demo").changed("team", sub_teams={"a": names[:half], "b": names[half:]})
    scenario = scenario.changed("grid", shape=[side, side])
    return scenario.changed("time", seconds=TICKS.get(robots, 4) * scenario.time.tick)


def tick(scenario: Scenario) -> tuple[float, float]:
    """Processor milliseconds a tick, and messages a tick."""
    team, sent = Team(scenario), [0]

    def count(_: object) -> None:
        sent[0] += 1

    team.bus.spies.append(count)
    begin = time.process_time()
    ticks = team.run()["ticks"]
    return 1e3 * (time.process_time() - begin) / ticks, sent[0] / ticks


def rows() -> Iterator[Row]:
    measured = {robots: tick(demo(robots)) for robots in ROBOTS}
    first = measured[ROBOTS[0]]
    yield Row(f"a tick of {ROBOTS[0]} robots on 50 x 50, all processes", first[0], "ms")
    for robots in ROBOTS[1:]:
        share = robots / ROBOTS[0]
        yield Row(
            f"a tick of {robots} robots / {share:g} times that of {ROBOTS[0]}", measured[robots][0] / first[0] / share
        )
        yield Row(
            f"messages of {robots} robots / {share:g} times those of {ROBOTS[0]}",
            measured[robots][1] / first[1] / share,
        )
    times = [measured[robots][0] for robots in ROBOTS]
    slope = float(np.polyfit(np.log(ROBOTS), np.log(times), 1)[0])
    yield Row(f"a tick grows as the robots to the power of, {ROBOTS[0]} to {ROBOTS[-1]}", slope, "", most=1.0)
    large = tick(demo(6, 200))[0]
    yield Row("a tick of 6 robots on 200 x 200 / on 50 x 50", large / first[0])
    yield Row(
        "6 robots on 200 x 200: team time / processor time, so at most twice that on 2 cores", 200.0 / large, most=None
    )


if __name__ == "__main__":
    show(rows())
