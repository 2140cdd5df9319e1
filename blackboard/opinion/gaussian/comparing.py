"""What robots tell of themselves into the joint: how they enter, their increments, and their beliefs held against each other."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.alike import add_alike
from blackboard.opinion.gaussian.coalitions import KNOWN
from blackboard.opinion.gaussian.contacts import Claim
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
from blackboard.opinion.gaussian.finding import restore_errors
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.mounts import USUAL, Beyond, Mount, compass_of, correct_heading, reading_factor
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.sightings import claimed
from blackboard.opinion.gaussian.state import Known, TeamState
from blackboard.opinion.gaussian.strayed import PATIENCE, TakenIncrement
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, Motion, correct
from blackboard.opinion.grid import Array

#: Times the covariance of a robot that enters again: its mates keep what they learned of it before. Half of it counts, as in a
#: covariance intersection with equal weights (Julier and Uhlmann, ACC 1997).
AGAIN = 2.0
#: Seconds for which robots return what an earlier joint knew of them: after a board came, and after the first robot entered a joint.
RETURNING = 3.0


def compare(team: TeamState, news: Mapping[str, Evidence], motions: Mapping[str, Motion]) -> set[str]:
    """Hold the robots' first-hand beliefs against each other, about themselves and all that they saw.

    Two robots that agreed and now contradict each other have spoilt each other's place in the joint: both enter again by
    their first-hand beliefs, of which only half counts. So does a robot that is no longer contradicted: its place in the joint
    rests on what was, nobody has corrected it since, and `trust` judged it by that place. Who entered is returned.
    Of who is refuted here nothing counts from this tick on: its mates have just become less sure of their places.
    """
    said: dict[str, dict[str, Claim]] = {}
    sure: dict[str, Moments] = {}
    seen: list[Relative] = []
    for robot, evidence in news.items():
        own = evidence.belief
        if own is None or np.trace(own.covariance[AXES, AXES]) > KNOWN:
            continue
        with team.blaming(robot):
            team.contacts.correct(robot, own, evidence.increment)
        if not team.contacts.is_reckoned(robot):
            sure[robot] = own
            said[robot] = {robot: Claim(own.mean[AXES], own.covariance[AXES, AXES], np.zeros((2, 2)))}
            seen += [r for r in evidence.relatives if r.observer == robot and r.subject != robot and r.places]
    pairs = {(robot, robot) for robot in sure} | {(sighting.subject, sighting.observer) for sighting in seen}
    speakers = Counter(subject for subject, _ in pairs)
    # A contradiction takes two: where only one robot sees something, there is nothing to compare.
    seen = [sighting for sighting in seen if speakers[sighting.subject] > 1]
    with team.blaming(""):
        claims = claimed(Joint.of(sure), seen, motions)
    for relative, claim in zip(seen, claims, strict=True):
        said.setdefault(relative.subject, {})[relative.observer] = claim
    parted = team.contacts.judge(*(by_source for _, by_source in sorted(said.items())))
    refuted = team.refuted_now() if parted or team.refuted else frozenset()
    team.leave_out(team.left_out | refuted)
    back = team.refuted - refuted
    back = frozenset(robot for robot in back if robot in said.get(robot, {}))
    team.refuted -= back
    for robot in sorted(back):
        team.trust.forget(robot)
        team.offsets.forget(robot)
    again = {robot for robot in parted | back if robot in team.joint}
    for robot in sorted(again):
        team.drop(robot, again=True)
        belief = news[robot].belief
        assert belief is not None
        entering = team.limits.entering(robot, belief)
        _add(team, news[robot], Moments(entering.mean, AGAIN * entering.covariance))
    return again


def enter(team: TeamState, evidence: Evidence) -> bool:
    """A robot enters with its first-hand belief, once per epoch: what it adds later are increments.

    A new epoch rests on new evidence alone, so its belief is independent of everything in the joint. A robot that is
    not in the joint though its epoch is not new (a board that was restarted) enters in the same way, or by what it returns. What was
    learned of a robot stays: who could begin with a clean record would do so after each lie.
    """
    robot, known = evidence.robot, team.known.get(evidence.robot)
    if known is None or known.epoch != evidence.epoch:
        team.known[robot] = Known(evidence.epoch, evidence.travelled, nuisance=evidence.nuisance)
        team.drop(robot)
        team.contacts.begin(robot)
        if known is None or known.nuisance != evidence.nuisance:
            team.kept.pop(robot, None)
    if robot in team.joint or evidence.belief is None:
        return False
    own = team.limits.entering(robot, evidence.belief)
    returned = _returned(team, evidence) if known is None else None
    if returned is None and evidence.epoch <= 1000 * team.returned_at:
        own = Moments(own.mean, AGAIN * own.covariance)
    if returned is None:
        _add(team, evidence, own)
    else:
        team.joint.add(robot, returned)
        team.entered[robot] = returned
    return True


def _add(team: TeamState, evidence: Evidence, belief: Moments) -> None:
    """Add a robot by a belief of its own, whose scales are alike those of the robots that tell the same `Nuisance`."""
    nuisance = evidence.nuisance
    like = [other for other in sorted(team.known) if other in team.joint and team.known[other].nuisance == nuisance]
    with team.blaming(evidence.robot):
        add_alike(team.joint, evidence.robot, belief, nuisance, like if nuisance.alike else [])
        team.entered[evidence.robot] = team.joint.moments(evidence.robot)
        restore_errors(team, evidence.robot, AGAIN)
        if evidence.compass is not None:
            mount = _compass(team, evidence)
            team.joint.begin({error.block: error.known(team.joint) for error in (mount, team.north)})
            correct_heading(team.joint, evidence.robot, evidence.compass, mount, team.north)


def _returned(team: TeamState, evidence: Evidence) -> Moments | None:
    """What an earlier joint knew of a robot, where that counts: while this joint begins. It takes the place of the first-hand belief.

    It rests on evidence of others, too, and their beliefs of themselves rest on the same. So with the first one half of each belief
    that is in the joint counts, as of those that enter later. The robot has left the other half for that (`PackedEvidence.returned`).
    """
    team.first_entry = team.elapsed if team.first_entry is None else team.first_entry
    if evidence.returned is None or team.elapsed - team.first_entry > RETURNING:
        return None
    if team.returned_at == -math.inf:
        team.joint.covariance *= AGAIN
    team.returned_at = max(team.returned_at, evidence.time)
    return Moments(evidence.returned.mean, team.limits.blunted(evidence.returned.covariance))


def take_compass(team: TeamState, evidence: Evidence) -> None:
    """Take a reading of a compass into the joint, if the gate lets it through."""
    robot, reading = evidence.robot, evidence.compass
    if reading is None:
        return
    mount = _compass(team, evidence)
    mount.on_noise(team.joint, reading.noise**2, reading.most**2)
    factor = reading_factor(team.joint, robot, reading, mount, team.north)
    team.joint.begin(factor.priors)
    expected = team.joint.expected(factor)
    innovation = expected.innovation(factor)
    factor, squared = team.weighed((robot, "compass"), factor, innovation)
    taken = squared <= quantile(GATE, 1)
    team.add_verdict(Verdict(robot, robot, "compass", squared, 1, taken))
    if taken:
        correct(team.joint, factor, team.bounded(robot, factor, team.moved_by(robot), expected), expected)
    known = team.known[robot]
    turned = None
    if not taken:
        before = known.turned or Beyond(evidence.time, evidence.time, 0)
        turned = before.plus(evidence.time, float(innovation.residual[0]))
        if turned.is_lasting:
            team.widen(robot)
            turned = None
    team.known[robot] = replace(known, turned=turned)


def _compass(team: TeamState, evidence: Evidence) -> Mount:
    """The mounting error of a robot's compass in the joint. Its first prior is at least `USUAL`, whatever the robot claims."""
    robot, reading = evidence.robot, evidence.compass
    assert reading is not None
    if robot not in team.compasses:
        team.compasses[robot] = compass_of(robot, max(USUAL, reading.sigma, reading.bias_sigma), reading.bias)
    return team.compasses[robot]


def multiply(team: TeamState, evidence: Evidence) -> None:
    """Take an increment into the joint, if the gate lets it through."""
    robot = evidence.robot
    factor = None if evidence.increment is None else likelihood(team.joint, robot, evidence.increment)
    if factor is None or evidence.increment is None:
        return
    expected, told = team.joint.expected(factor), _told(team.joint, robot, evidence.increment)
    factor, squared = team.weighed((robot, "increment"), factor, expected.innovation(factor))
    by, freedom = team.outvoted(robot, robot), len(factor.residual)
    taken = squared <= quantile(GATE, freedom) and not by
    team.add_verdict(Verdict(robot, robot, "increment", squared, freedom, taken, by))
    if taken:
        only = team.bounded(robot, factor, team.moved_by(robot), expected)
        correct(team.joint, factor, only, expected)
        if not team.contacts.is_reckoned(robot):
            fit = TakenIncrement(expected.innovation(factor), factor.jacobians[robot][:, AXES])
            team.strayed.confirm_itself(robot, fit)
    _count_left_out(team, robot, told, taken=taken)


def _count_left_out(team: TeamState, robot: str, told: Array, *, taken: bool) -> None:
    """Count increments in a row that were left out, separately for x, y and heading.

    `told`, shape (3,), is how much this one says about each, as a share. After `PATIENCE` the robot's pose is widened.
    """
    left_out = team.known[robot].left_out
    left_out = left_out * (1.0 - told) if taken else left_out + told
    if left_out.max() >= PATIENCE:
        team.widen(robot)
        left_out = np.zeros(HEADING + 1)
    team.known[robot] = replace(team.known[robot], left_out=left_out)


def _told(joint: Joint, robot: str, increment: Increment) -> Array:
    """How much an increment reduces the variances of x, y and heading, shape (3,), relative to the one that it reduces most."""
    pose = slice(joint.blocks[robot].start, joint.blocks[robot].start + HEADING + 1)
    gain = np.diag(increment.information)[: HEADING + 1] * joint.variances[pose]
    share = gain / (1.0 + gain)
    return np.asarray(share / max(float(share.max()), np.finfo(float).tiny))
