"""The bound of a team: what one filter on the readings of all robots believes (`robot_agent.gaussian.ideal`).

In a simulated world the filter knows the world's own noise. Only what a Gaussian cannot represent is approximated: the walls,
and a sighting's sigma that depends on the true distance. On a recording, whose noise is unknown, it is the centralised extended
Kalman filter with the sensor models of the robots.
"""

import math
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from blackboard.config import Scenario
from blackboard.config.world import WorldSection
from blackboard.judge.instant import who_saw_landmarks
from blackboard.judge.samples import Sample, Sampler
from blackboard.lab.team import played
from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score
from robot_agent.gaussian.ideal import Ideal, of_noise, of_team
from sim_world.sensors import FAR, NEAR, vision_sigma

#: In units: where the filter samples the world's sigma of a sighting (VI-.1).
DISTANCES = np.linspace(NEAR + 0.01, FAR - 0.01, 121)

#: A subject at a time (seconds, rounded to milliseconds): what beliefs are asked for and found by.
Asked = tuple[float, str]


def ideal(scenario: Scenario) -> Ideal:
    """The centralised filter for a scenario: with the world's own noise if it is simulated, else with the robots' sensor models.

    UserError: a section that is wrong.
    """
    world = scenario.section("world", WorldSection)
    if world.kind != "simulated":
        return of_team(scenario)
    variances = [
        (float(d), (vision_sigma(float(d), world.vision.scale, world.vision.floor) or 0.0) ** 2) for d in DISTANCES
    ]
    # Each true step is speed * dt long, so its error's variance follows from that and not from the measured distance.
    along = world.odometry.along * math.sqrt(world.speed)
    drifts = {f"object/{name}": thing.drift for name, thing in world.objects.items()}
    return of_noise(along, world.odometry.turn, world.odometry.compass, tuple(variances), drifts)


def assumed(scenario: Scenario) -> dict[str, Any]:
    """What the robots of a scenario take their noise for, as `blackboard.calibrate.model.Noise.alike` takes it.

    Sigmas along, across and of the turn in a second of motion; the share of them while standing; of sightings. UserError: a wrong
    section.
    """
    wheels, camera = (sensors := of_team(scenario).sensors).wheels, sensors.camera
    floor, share = math.hypot(camera.floor, camera.lasting_floor), math.hypot(camera.share, camera.lasting_share)
    bearing = camera.bearing
    if camera.profile:  # of a seen position, whatever the direction
        floor, share = math.sqrt(float(np.median([variance for _, variance in camera.profile]))), 0.0
        bearing = floor / float(np.median([distance for distance, _ in camera.profile]))
    moving = wheels.along, wheels.across, wheels.heading
    return {"moving": moving, "standing": wheels.standing, "floor": floor, "share": share, "bearing": bearing}


def ideal_beliefs(scenario: Scenario, wanted: Collection[Asked]) -> dict[Asked, Belief]:
    """What the ideal filter of a scenario believes, on the grid, for each subject and time asked for; uniform where it knows nothing.

    The readings are those that the robots of the scenario get. UserError: a wrong scenario.
    """
    best = ideal(scenario)
    at: dict[float, list[Asked]] = {}
    for asked in wanted:
        at.setdefault(asked[0], []).append(asked)
    beliefs = {}
    for tick in played(scenario):
        best.step(tick.dt, tick.readings)
        for asked in at.get(round(tick.truth.time, 3), ()):
            beliefs[asked] = _drawn(best, asked[1], scenario.grid)
    return beliefs


def ideal_samples(scenario: Scenario) -> Iterator[Sample]:
    """What the referee would say of the ideal filter of a scenario if a team agreed on its beliefs; objects once it knows where.

    UserError: a wrong scenario.
    """
    best, sampler = ideal(scenario), Sampler()
    for tick in played(scenario):
        best.step(tick.dt, tick.readings)
        sampler.begin_tick(tick.truth, who_saw_landmarks(tick.readings))
        if not tick.judged:
            continue
        places = tick.truth.positions
        known = [subject for subject in places if subject.startswith("object/") and best.belief(subject) is not None]
        for robot in (readings.robot for readings in tick.readings):
            for subject in (f"robot/{robot}", *known):
                if subject in places:
                    belief, score = _drawn(best, subject, scenario.grid), Score()
                    score.add(belief, places[subject])
                    about = {"sub_team": "", "level": "agreed", "sources": len(tick.readings)}
                    yield sampler.sample(belief, score, robot, subject, **about)


def _drawn(best: Ideal, subject: str, grid: Grid) -> Belief:
    moments = best.belief(subject)
    return uniform(grid) if moments is None else draw(grid, moments)
