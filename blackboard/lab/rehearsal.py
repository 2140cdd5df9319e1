"""Rehearsal: a team in one process, for the opinions that a board would be given. No network, no board, no feedback.

First-hand beliefs do not depend on what a board makes of them, so one rehearsal serves every rule. Robots and worlds are
named, not known: this room does not import them, as the rest of the blackboard does not.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from blackboard.config import Scenario
from blackboard.errors import Mistake
from blackboard.lab.cases import Case, Run


def rehearse(scenario: Scenario, every: float = 1.0) -> Run:
    """The cases of a simulated or recorded run, one for each subject every so many seconds, in the order of time.

    The sources of a case are the robots that have a first-hand belief about the subject, sorted. Mistake: a wrong scenario, or one
    too short.
    """
    world = importlib.import_module("sim_world.__main__").source(scenario)
    minds = _minds(scenario)
    grid, time = scenario.grid, scenario.time
    stride = max(1, round(every / time.tick))
    cases: Run = []
    for tick in range(round(time.seconds / time.tick) + 1):
        truth, readings = world.advance("rehearsal", tick)
        for reading in readings:
            minds[reading.robot] = minds[reading.robot].advance(reading)
        if tick % stride or not world.judged(tick):
            continue
        said = _said(minds)
        for subject, place in sorted(truth.positions.items()):
            if subject in said:
                sources = tuple(sorted(said[subject]))
                opinions = np.stack([said[subject][source].p for source in sources])
                cases.append(Case(grid, subject, truth.time, sources, opinions, tuple(place)))
    if not cases:
        raise Mistake(
            f"{scenario.source}: in {time.seconds:g} s nothing is judged every {every:g} s; give a longer run"
        )
    return cases


def variant(scenario: Scenario, number: int) -> Scenario:
    """The same with the seed `number` further, or with the next stretch of the recording."""
    if not number:
        return scenario
    if scenario.tables.get("world", {}).get("kind") == "mrclam":
        start = importlib.import_module("sim_world.__main__").source(scenario).start
        return scenario.changed("world", start=start + number * scenario.time.seconds)
    return scenario.changed("world", seed=scenario.tables.get("world", {}).get("seed", 1) + number)


def _minds(scenario: Scenario) -> dict[str, Any]:
    """A first-hand chain for every robot."""
    section = importlib.import_module("robot_agent.config").RobotSection
    chain = importlib.import_module("robot_agent.chain").Chain
    settings = scenario.section("robot", section)
    return {robot: chain.begin(settings, scenario.grid, robot) for robot in scenario.team.robots}


def _said(minds: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Subject -> source -> belief."""
    beliefs = importlib.import_module("robot_agent.agent").beliefs
    said: dict[str, dict[str, Any]] = {}
    for robot, mind in sorted(minds.items()):
        for subject, belief in beliefs(mind).items():
            said.setdefault(subject, {})[robot] = belief
    return said
