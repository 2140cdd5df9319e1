"""Named sightings into the joint: of mates, of objects that it knows, and of objects that enter by them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from blackboard.opinion.believed import MOST_NOISE
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.contacts import Claim
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.relation import Relative, linearise
from blackboard.opinion.gaussian.rings import SURE, Ring, line_of
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.vehicle import Motion, correct

MAX_RINGS = 16  # objects of which only ranges or bearings are known
ALONE = 4  # objects that one robot alone has seen and that tell it how it moved: together less than its odometry does


def compare_with_joint(team: TeamState, evidence: Evidence, motions: Mapping[str, Motion], heard: set[str]) -> None:
    """Hold all that a robot sees in a tick against where the joint has it, before any of it moves that."""
    robot, noise = evidence.robot, team.innovations.variance((evidence.robot, "relative"))
    if team.again or robot not in heard or robot in team.left_out or not team.knows(robot):
        return
    known = {it for it in {*heard, *team.seen} - {robot} if team.knows(it)}
    seen = [it for it in evidence.relatives if it.observer == robot and it.subject in known]
    factors = [(it, linearise(team.joint, it, motions)) for it in seen]
    moving = {it for it, motion in motions.items() if motion.moving}
    for sighting, factor in factors:
        if moving & {robot, sighting.subject}:  # where both stand, an exact sensor says the same again and again
            team.freshness.hear(sighting, factor)
    mates = [(it.subject, factor.widened(noise)) for it, factor in factors if it.subject in heard]
    team.offsets.hear(robot, team.joint, mates)


def take_sighting(team: TeamState, relative: Relative, motions: Mapping[str, Motion], heard: set[str]) -> None:
    """Take a relative belief into the joint; an object of which nothing is known enters with its first sighting."""
    observer, subject = relative.observer, relative.subject
    robot = subject.startswith("robot/")
    if observer not in heard or subject == observer or (robot and subject not in team.joint):
        return
    if subject not in team.joint and observer in team.left_out:
        return
    if not relative.places and not (team.knows(observer) and team.knows(subject)):
        team.tally.silent += 1
        room = subject in team.rings or len(team.rings) < MAX_RINGS
        if not robot and subject not in team.joint and team.knows(observer) and room:
            ring = team.rings.setdefault(subject, Ring(team.drift_of(subject)))
            ring.add(line_of(team.joint.moments(observer), relative, motions.get(observer), team.elapsed))
        return
    if robot and subject not in heard:
        known = team.known[subject]
        if not 0.0 <= relative.age + relative.ahead <= known.motion.dt:  # how far it had moved then is not known
            team.tally.silent += 1
            return
        motions = {**motions, subject: known.motion}
    factor = linearise(team.joint, relative, motions)
    if not robot:
        factor = _of_object(team, relative, factor, motions)
    factor, squared = team.weighed((observer, "relative"), factor)
    by = team.outvoted(subject, observer) or team.outvoted(observer, subject)
    freedom = len(factor.residual)
    agrees = squared <= quantile(GATE, freedom) and not by and not team.contradict(observer, subject)
    if not robot:  # of two robots that contradict each other, the one that placed the object first is believed about it
        agrees = agrees and not any(team.contacts.contradict(observer, o) for o in team.trust.observers(subject))
    taken = agrees and not {observer, subject} & team.left_out
    if relative.mark is None and (taken or subject in team.joint):  # a wrong name is held against nobody
        team.trust.judge(observer, subject, agrees)
    team.add_verdict(Verdict(observer, subject, "relative", squared, freedom, taken, by))
    if taken:
        if not robot and team.freshness.lacks(relative):  # nobody else may see the object, so it counts for a little
            factor = factor.widened(MOST_NOISE)
        correct(team.joint, factor, team.moved_by_sighting(relative))
        team.note_errors(relative)
        if not robot:
            team.seen[subject] = 0.0


def _of_object(team: TeamState, relative: Relative, factor: Factor, motions: Mapping[str, Motion]) -> Factor:
    """A sighting of an object, once it has told how that moves; a range alone does not, and what is no news does not."""
    observer, subject = relative.observer, relative.subject
    if observer in team.left_out or len(factor.residual) < 2 or team.freshness.lacks(relative):
        return factor
    pushed = team.walks.judge(subject, _placed(team, subject, factor))
    if pushed is None or subject not in team.joint:
        return factor
    team.shift(subject, pushed)
    return linearise(team.joint, relative, motions)


def seen_by_one(team: TeamState) -> frozenset[str]:
    """The objects that one robot alone has seen, but for the first `ALONE` of each robot."""
    observers, aside, number = team.trust.by_subject(), set[str](), Counter[str]()
    for name in team.seen:
        if len(of := observers.get(name, ())) == 1:
            number.update(of)
            if number[min(of)] > ALONE:
                aside.add(name)
    return frozenset(aside)


def set_aside(team: TeamState, relative: Relative, motions: Mapping[str, Motion]) -> None:
    """An object is where the newest sighting puts it, and that tells its observer nothing.

    Many objects that go where their observer goes would tell it, and its mates, that it stands.
    """
    observer, subject = relative.observer, relative.subject
    if observer in team.left_out or not relative.places:
        return
    place = projected(team.joint, relative, motions.get(observer, Motion()))
    team.joint.drop(subject)
    team.joint.add(subject, place)
    team.seen[subject] = 0.0
    team.add_verdict(Verdict(observer, subject, "relative", 0.0, 2, True))


def _placed(team: TeamState, subject: str, factor: Factor) -> Moments:
    """Where a sighting alone puts an object, shape (2,) and (2, 2): all that its observer is unsure of is counted."""
    rows = dict(factor.jacobians)
    by = rows.pop(subject)
    before = team.joint.moments(subject) if subject in team.joint else factor.priors[subject]
    spread = team.joint.innovation(Factor(factor.residual, rows, factor.noise, factor.priors)).covariance
    weighed = by.T @ np.linalg.inv(spread)
    covariance = np.linalg.inv(weighed @ by)
    return Moments(before.mean + covariance @ weighed @ factor.residual, covariance)


def close_rings(team: TeamState) -> None:
    """Let an object enter once its rings and rays leave one place; its error is then taken for independent of all others."""
    for subject, ring in list(team.rings.items()):
        places = ring.places() if ring.newest == team.elapsed else ()
        if subject in team.joint or team.elapsed - ring.newest > team.objects.kept:
            del team.rings[subject]
        elif places and places[0].weight > SURE:
            team.joint.add(subject, places[0].moments)
            team.seen[subject] = 0.0
            del team.rings[subject]


def projected(joint: Joint, relative: Relative, motion: Motion | None) -> Moments:
    """Where a sighting puts its subject, of which nothing else is known: mean, shape (2,), and covariance, shape (2, 2).

    `motion` is the observer's in the tick. KeyError: the observer is not in the joint.
    """
    claim = claimed(joint.moments(relative.observer), relative, motion)
    return Moments(claim.mean, claim.lasting + claim.fresh)


@lru_cache(maxsize=256)  # what rests on first-hand evidence alone is the same in all joints of one process
def claimed(observer: Moments, relative: Relative, motion: Motion | None) -> Claim:
    """Where a sighting that places its subject puts it, by an observer's block and its motion in the tick."""
    alone = Joint()
    alone.add(relative.observer, observer)
    seen = linearise(alone, relative, {} if motion is None else {relative.observer: motion})
    rows = dict(seen.jacobians)
    back = np.linalg.inv(rows.pop(relative.subject))  # of nothing known, the sighting alone decides
    lasting = alone.innovation(Factor(seen.residual, rows, np.zeros((2, 2)), seen.priors)).covariance
    place = seen.priors[relative.subject].mean + back @ seen.residual
    return Claim(place, back @ lasting @ back.T, back @ seen.noise @ back.T)
