"""The opinions that the boards of a team would be given, and what a whole team agrees on. For the former, robots and world run
in one process, without network, board or feedback.

First-hand beliefs do not depend on what a board makes of them, so the cases of one run serve every rule.
"""

from collections.abc import Collection

import numpy as np

from blackboard.config import Scenario
from blackboard.config.world import WorldSection
from blackboard.errors import UserError
from blackboard.lab.cases import Case, Run
from blackboard.lab.ideal import Asked
from blackboard.lab.team import InProcessTeam, played
from blackboard.opinion.belief import Belief, uniform
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus
from robot_agent.team import estimator_of
from sim_world.sources import replayed_from


def first_hand_cases(scenario: Scenario, every: float = 1.0) -> Run:
    """The cases of a simulated or recorded run, one for each subject every `every` seconds, in the order of time.

    The sources of a case are the robots that have a first-hand belief about the subject, sorted. UserError: a wrong scenario, or one
    too short.
    """
    grid, time = scenario.grid, scenario.time
    estimators = {robot: estimator_of(scenario, robot) for robot in scenario.team.robots}
    stride = max(1, round(every / time.tick))
    cases: Run = []
    for tick in played(scenario):
        for reading in tick.readings:
            estimators[reading.robot] = estimators[reading.robot].advance(reading)
        if tick.number % stride or not tick.judged:
            continue
        by_subject: dict[str, dict[str, Belief]] = {}
        for robot, estimator in estimators.items():
            for subject, belief in estimator.beliefs().items():
                by_subject.setdefault(subject, {})[robot] = belief
        for subject, position in sorted(tick.truth.positions.items()):
            if subject in by_subject:
                sources = tuple(sorted(by_subject[subject]))
                opinions = np.stack([by_subject[subject][name].p for name in sources])
                cases.append(Case(grid, subject, tick.truth.time, sources, opinions, tuple(position)))
    if not cases:
        raise UserError(
            f"{scenario.where}: in {time.seconds:g} s nothing is judged every {every:g} s; give a longer run"
        )
    return cases


def agreed_beliefs(scenario: Scenario, wanted: Collection[Asked]) -> dict[Asked, Belief]:
    """What the boards of a whole team agree on, with its exchange and its feedback, for each subject and time asked for.

    All boards agree on the same, but for what each heard late: it is the first sub-team's that is taken, uniform where there is
    none. The run must be in lockstep for its readings to be those of `first_hand_cases`. UserError: a wrong scenario.
    """
    team, grid, asked = InProcessTeam(scenario), scenario.grid, set(wanted)
    first = next(iter(scenario.team.sub_teams))
    beliefs = {name: uniform(grid) for name in asked}

    def take(envelope: Envelope) -> None:
        if f"/{first}/agreed/" in envelope.key:
            consensus = decode(Consensus, envelope.payload)
            name = round(consensus.time, 3), consensus.subject
            if name in asked:
                beliefs[name] = unpack(consensus.belief, grid)

    team.bus.spies.append(take)
    team.run()
    return beliefs


def variant(scenario: Scenario, number: int) -> Scenario:
    """The scenario with its seed plus `number`, or with the stretch of the recording that is `number` lengths later."""
    if not number:
        return scenario
    start = replayed_from(scenario)
    if start is not None:
        return scenario.changed("world", start=start + number * scenario.time.seconds)
    return scenario.changed("world", seed=scenario.section("world", WorldSection).seed + number)
