"""Errors of a team's sensors that are found: whose prior what is believed contradicts, and what follows from it (`priors`)."""

from collections.abc import Iterator, Sequence
from statistics import median

import numpy as np

from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.priors import (
    COMPASS_FOUND,
    FEWEST,
    FOUND,
    WIDE,
    Contradiction,
    by_wide_prior,
    contradicted,
    contradicted_alike,
    is_refuted,
    replace_prior,
    spread_of_means,
    widen,
    with_one_prior,
)
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, drive

#: Robots, of one or of several that err alike, and the error that contradicts their prior.
Found = tuple[Sequence[str], Contradiction]


def widen_priors(team: TeamState) -> None:
    """Replace priors of sensor errors (scales, camera direction) that sightings contradict by wide ones (`priors`), each once.

    That may be the prior of one robot's error, or of the mean over robots that were told the same of a sensor.
    What contradicts one prior has moved the errors of mates, too. So the worst is replaced first, and the others judged after it.
    One robot alone cannot tell its errors from the motion of what it sees. Compasses are judged where odometry is believed.
    """
    _widen_compass(team)
    while len(team.known) > 1 and (worst := _most_contradicted(team)) is not None:
        robots, error = worst
        for robot in robots:
            team.widened[robot] = (*team.widened.get(robot, ()), error.state)
        with team.blaming(robots[0] if len(robots) == 1 else ""):
            _widen_prior(team, robots, _states(team, robots, error.state), error, WIDE[error.state])


def restore_errors(team: TeamState, robot: str, wider: float) -> None:
    """Give a robot that has entered again the errors that it had been found to have (`kept`); all else follows by regression.

    The belief with which it enters rests on the prior that was contradicted. The variances are `wider` times what they were, because
    its mates rest on the same evidence; that of the wide prior is the largest. Robots of one make (`alike`) enter with the scales that
    their mates have learned, also from this robot.
    """
    kept = team.kept.pop(robot, {})
    for state, (mean, variance) in kept.items() if not team.known[robot].nuisance.alike else ():
        at = team.joint.blocks[robot].start + state
        replace_prior(team.joint, at, mean, min(wider * variance, WIDE[state] ** 2))
        team.widened[robot] = (*team.widened.get(robot, ()), state)


def predict_entered(team: TeamState, robot: str, motion: Motion, nuisance: Nuisance) -> None:
    """Predict the lasting errors with which a robot entered: scales are random walks. `widen_priors` compares with these."""
    if robot in team.entered:
        alone = Joint.of({robot: team.entered[robot]})
        drive(alone, robot, Motion(dt=motion.dt, moving=motion.moving), nuisance)
        team.entered[robot] = alone.moments(robot)


def errors_found(team: TeamState, robot: str) -> dict[str, float]:
    """The estimates of those sensor errors of a robot whose prior was contradicted, by name (`priors.FOUND`)."""
    first = team.joint.blocks[robot].start
    found = {FOUND[state]: float(team.joint.mean[first + state]) for state in team.widened.get(robot, ())}
    mount = team.compasses.get(robot)
    if mount is not None and (mount.found or team.north.found):
        found[COMPASS_FOUND] = float(mount.known(team.joint).mean[0] + team.north.known(team.joint).mean[0])
    return found


def _states(team: TeamState, robots: Sequence[str], state: int) -> list[int]:
    """Where a state of the blocks of some robots stands in the joint."""
    return [team.joint.blocks[robot].start + state for robot in robots]


def _most_contradicted(team: TeamState) -> Found | None:
    """The robot and the error of its sensors whose prior is contradicted most, or the robots that have such an error alike."""
    found: list[Found] = [
        ([robot], error)
        for robot in filter(team.knows, sorted(team.known))
        if (
            error := contradicted(
                team.joint.moments(robot), team.entered[robot], team.known[robot].nuisance, team.widened.get(robot, ())
            )
        )
    ]
    found += _contradicted_together(team)
    return max(found, key=lambda one: one[1].beyond, default=None)


def _contradicted_together(team: TeamState) -> Iterator[Found]:
    """What robots with one prior of an error show together: their mean contradicts it, or it was wrong for so many of them."""
    known = {robot: team.known[robot].nuisance for robot in filter(team.knows, sorted(team.known))}
    for (state, middle, _), group in with_one_prior(known).items():
        wide = middle, WIDE[state]
        others = [robot for robot in group if state not in team.widened.get(robot, ())]
        heard = [robot for robot in others if team.is_heard(robot)]
        if is_refuted(len(group) - len(others), len(group)):
            for robot in heard:
                before, now = team.entered[robot].of(state), team.joint.moments(robot).of(state)
                squared, mean, variance = by_wide_prior(before, now, wide)
                if squared:
                    yield [robot], Contradiction(state, mean, variance, 0.0)
        elif others == group and len(heard) >= FEWEST:
            at = _states(team, heard, state)
            means, variances = zip(*(team.entered[robot].of(state) for robot in heard), strict=True)
            prior = Moments(np.array(means), np.diag(variances))
            believed = Moments(team.joint.mean[at], team.joint.covariance[np.ix_(at, at)])
            if (error := contradicted_alike(state, prior, believed, wide)) is not None:
                yield heard, error


def _widen_compass(team: TeamState) -> None:
    """Give a wide prior to the error of one compass, or to the common error of all, whichever measurements contradict most."""
    robots = [robot for robot in sorted(team.compasses) if team.knows(robot) and robot not in team.distrust]
    mounts = [(robot, team.compasses[robot]) for robot in robots]
    # The median, so that one robot whose noise is unknown, or that says so, cannot prevent the test of the common error.
    doubt = median([mount.doubt for _, mount in mounts] or [1.0])
    told = [(mount.contradicted(team.joint, mount.doubt), robot, mount) for robot, mount in mounts]
    told += [(team.north.contradicted(team.joint, doubt), robot, team.north) for robot in robots[:1]]
    contradicted = [(worst, robot, mount) for worst, robot, mount in told if worst is not None]
    if contradicted:
        worst, robot, mount = max(contradicted, key=lambda one: one[0].beyond)
        mount.found |= {worst.state}
        with team.blaming(robot):
            _widen_prior(team, [robot], [team.joint.blocks[mount.block].start + worst.state], worst, mount.wide)


def _widen_prior(team: TeamState, robots: Sequence[str], at: Sequence[int], error: Contradiction, wide: float) -> None:
    """The mean of some robots' lasting errors gets the mean and variance of the wide prior; all else follows by regression.

    The errors are at these indices. Where mates would move farther than an honest robot may move them (`influence`), only the
    errors move, and a robot whose error it is alone.
    """
    coefficients, (mean, variance) = team.joint.regression(at), team.joint.mean_of(at)
    moved = coefficients * (error.mean - mean)
    if team.influence.is_counted(len(team.known)):
        sigmas = coefficients * spread_of_means(variance, error.variance, wide)
        after = team.influence.after_shift(team.joint, robots, moved, sigmas)
        if team.influence.beyond(team.joint, after):
            team.tally.bounded += 1
            alone = np.zeros_like(moved)
            alone[at] = moved[at]
            if len(robots) == 1:
                own = team.joint.blocks[robots[0]]
                alone[own] = moved[own]
            moved, after = alone, team.influence.after_shift(team.joint, robots, alone, np.zeros_like(alone))
        team.influence.on_factor(after)
    widen(team.joint, at, error.variance, moved)
