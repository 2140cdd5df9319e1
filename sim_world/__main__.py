"""The door of the world: `sim-world SCENARIO.toml`, a simulated team or a recorded one, and a scorecard at the end."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import numpy as np
from cyclopts import App, Parameter

from blackboard import door
from blackboard.config import Scenario, load
from sim_world import recording
from sim_world.mrclam import Replay
from sim_world.referee import Referee
from sim_world.scenario import WorldSection
from sim_world.scorecard import scorecard, text
from sim_world.service import WorldService
from sim_world.world import Source, World

app = App(name="sim-world", help="Simulate a robot team, or replay a recorded one, and judge what it believes.")


def source(scenario: Scenario) -> Source:
    """Where the sensor data of a scenario come from."""
    settings = scenario.section("world", WorldSection)
    robots, time = scenario.team.robots, scenario.time
    if settings.kind == "mrclam":
        return Replay(settings, recording.load(settings.dir), robots, time.tick, time.seconds)
    seed = settings.seed
    return World(
        settings,
        scenario.grid,
        robots,
        time.tick,
        lambda name: np.random.default_rng([seed, *name.encode()]),
    )


@app.default
def sim_world(
    scenario: str | None = None,
    *,
    flags: door.ZenohFlags | None = None,
    seed: int | None = None,
    seconds: float | None = None,
    realtime: Annotated[bool, Parameter(negative="")] = False,
    mrclam: str | None = None,
    start: float | None = None,
    protocol: str | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run the world of a scenario.

    Parameters
    ----------
    scenario
        A scenario file (TOML or JSON), or the name of one that comes with the package [default: demo, or mrclam].
    seed
        Another seed than the scenario's.
    seconds
        Length of the run, in seconds of team time.
    realtime
        Pace by the wall clock instead of waiting for everybody.
    mrclam
        Replay the recording in this folder (MRCLAM format).
    start
        Where the replay begins, Unix time.
    protocol
        Which landmark sightings may be used, as A_all or C_blind12.
    as_json
        Print the scorecard as one JSON object.
    """
    chosen = load(scenario or ("mrclam" if mrclam else "demo"))
    kind = "mrclam" if mrclam else None
    chosen = chosen.changed("world", seed=seed, kind=kind, dir=mrclam, start=start, protocol=protocol)
    chosen = chosen.changed("time", seconds=seconds, mode="realtime" if realtime else None)
    settings = chosen.section("world", WorldSection)
    service = WorldService(chosen, source(chosen), Referee(chosen.grid, settings.check, chosen.team.robots))
    door.serve(service, "world", flags or door.ZenohFlags())
    card = scorecard(service)
    sys.stdout.write((json.dumps(card) if as_json else text(card)) + "\n")
    return 0 if card["verdict"] == "PASS" else 1


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
