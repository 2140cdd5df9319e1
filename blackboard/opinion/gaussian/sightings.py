"""Named sightings into the joint: of mates, of objects that it knows, and of objects that enter by them."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from blackboard.opinion.believed import MOST_NOISE
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.chain import Chain
from blackboard.opinion.gaussian.contacts import Claim
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
from blackboard.opinion.gaussian.joint import Factor, Innovation, Joint, Moments, squared_distance
from blackboard.opinion.gaussian.late import as_it_was
from blackboard.opinion.gaussian.linearising import linearise, linearise_all
from blackboard.opinion.gaussian.relation import NEAREST, Relative
from blackboard.opinion.gaussian.rings import SURE, Ring, line_of
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.strayed import displacement_of
from blackboard.opinion.gaussian.vehicle import ANYWHERE, AXES, FLAT, HEADING, Motion, correct
from blackboard.opinion.grid import Array

MAX_RINGS = 16  # objects of which only ranges or bearings are known
TOGETHER = 32  # sightings that are taken in one update, and as many as one robot has
STRAIGHT = 0.01  # of its sigma: what a straight line may miss of a sighting before that is linearised anew
FARTHEST = 10.0  # widths of the map: what is said to be farther away is no sighting of an object
ALONE = 4  # objects that one robot alone has seen and that tell it how it moved: together less than its odometry does


def see(
    team: TeamState,
    news: Sequence[Evidence],
    motions: Mapping[str, Motion],
    heard: set[str],
    doubts: Sequence[Relative] = (),
    apart: frozenset[str] = frozenset(),
) -> None:
    """All that some robots see in a tick: linearised, held against where the joint has it, and then taken.

    Sightings of mates are taken together, but for those that move one end alone; then the others are, one by one. `doubts` are
    sightings of which it is not clear whose they are: they are held against the joint, too. `apart` are objects to be set aside.
    """
    told = [sighting for evidence in news if evidence.robot in heard for sighting in _own(evidence)]
    seen = [team.as_found(sighting) for sighting in told if not _tells_nothing(team, sighting)]
    team.tally.silent += len(told) - len(seen)
    doubts = [team.as_found(sighting) for sighting in doubts]
    known = {name for sighting in (*seen, *doubts) for name in (sighting.observer, sighting.subject)} & {
        *heard,
        *team.seen,
    }
    known = {name for name in known if team.knows(name)}
    # How fresh a sighting is shows by the noise of its sensor alone, without what its object may have moved since.
    clear = [
        replace(sighting, strayed=0.0) if sighting.strayed else sighting
        for sighting in (*seen, *doubts)
        if sighting.observer in known and sighting.subject in known
    ]
    pairs = list(zip(clear, linearise_all(team.joint, clear, motions), strict=True))
    by_observer: dict[str, list[tuple[Relative, Factor]]] = {}
    for sighting, factor in pairs:
        by_observer.setdefault(sighting.observer, []).append((sighting, factor))
    for robot, its in by_observer.items():
        if robot not in team.left_out:
            with team.blaming(robot):
                _compare_with_joint(team, robot, its, motions, heard)
    own = {id(sighting) for sighting in seen if sighting.subject in heard}
    mates = [(sighting, factor) for sighting, factor in pairs if id(sighting) in own and not factor.priors]
    mates = [(sighting, factor) for sighting, factor in mates if team.moved_by_sighting(sighting) is None]
    done = {id(sighting) for sighting, _ in mates}
    while mates:
        left = _take_together(team, mates)
        mates = list(zip(left, linearise_all(team.joint, left, motions), strict=True))
    for sighting in seen:
        if id(sighting) in done:
            continue
        with team.blaming(sighting.observer):
            if sighting.subject in apart:
                set_aside(team, sighting, motions)
            else:
                take_sighting(team, sighting, motions, heard)


def batches(news: Iterable[Evidence]) -> Iterator[list[Evidence]]:
    """The evidence of a tick in parts, in which robots see as many mates and objects as are taken together."""
    part: list[Evidence] = []
    for evidence in news:
        part.append(evidence)
        if sum(len(evidence.relatives) for evidence in part) >= TOGETHER:
            yield part
            part = []
    if part:
        yield part


def _tells_nothing(team: TeamState, sighting: Relative) -> bool:
    """Whether it claims errors as large as if nothing had been seen, or is of an object farther away than any sensor can see.

    A joint cannot hold the variances that lead back from there, and whoever sees the subject next would be to blame.
    """
    fresh = sighting.without_profile()
    if fresh.kind == "bearing":
        return fresh.bearing_variance > ANYWHERE
    along = fresh.range_variance + sum(bias.sigma**2 for bias in fresh.biases)
    across = fresh.bearing_variance * max(fresh.range, NEAREST) ** 2
    away = 0.0 if fresh.subject.startswith("robot/") else fresh.range
    return max(along, across) > FLAT or away**2 > FARTHEST**2 * team.naming.area


def _own(evidence: Evidence) -> list[Relative]:
    """What a robot says that it sees itself, of each subject the oldest first."""
    own = [relative for relative in evidence.relatives if relative.observer == evidence.robot != relative.subject]
    return sorted(own, key=lambda r: (r.subject, -r.age, r.range, r.bearing, r.kind))


def _compare_with_joint(
    team: TeamState,
    robot: str,
    seen: Sequence[tuple[Relative, Factor]],
    motions: Mapping[str, Motion],
    heard: set[str],
) -> None:
    """Hold all that a robot sees in a tick against where the joint has it, before any of it moves that."""
    moving = {robot for robot, motion in motions.items() if motion.moving}
    for sighting, factor in seen:
        if moving & {robot, sighting.subject}:  # where both stand, an exact sensor says the same again and again
            team.freshness.on_sighting(sighting, factor.widened(1.0 / sighting.noisier))
    mates = [(sighting.subject, factor) for sighting, factor in seen if sighting.subject in heard]
    team.offsets.on_sightings(robot, team.joint, mates, aims=any(sighting.kind != "range" for sighting, _ in seen))


def _take_together(team: TeamState, seen: Sequence[tuple[Relative, Factor]]) -> list[Relative]:
    """Take sightings of mates in one update; each is judged given those before it that are taken.

    Returned are those that are left, because these have moved what is expected so far that it is to be linearised anew.
    """
    chain, noted, left = Chain(team.joint, [factor for _, factor in seen]), list[Relative](), list[Relative]()
    for relative, factor in seen:
        innovation = chain.next()
        moved = float(np.square(innovation.residual - factor.residual).sum())
        if moved > 2 * STRAIGHT * team.distance(relative) * math.sqrt(float(factor.noise.trace()) / innovation.freedom):
            left.append(relative)
            continue
        wider = _judged(team, relative, factor, innovation)
        if wider is not None:
            chain.add(wider)
            noted.append(relative)
    taken = chain.taken()
    if taken is not None:
        with team.blaming(""):
            together, expected = taken
            only = team.bounded(seen[0][0].observer, together, None, expected)
            correct(team.joint, together, only, expected)
    for relative in noted:
        team.note_errors(relative)
    return left


def take_sighting(team: TeamState, relative: Relative, motions: Mapping[str, Motion], heard: set[str]) -> None:
    """Take a relative belief into the joint; an object of which nothing is known enters with its first sighting."""
    with as_it_was(team, relative) as told:
        _take_sighting(team, told, motions, heard)


def _take_sighting(team: TeamState, relative: Relative, motions: Mapping[str, Motion], heard: set[str]) -> None:
    observer, subject = relative.observer, relative.subject
    robot = subject.startswith("robot/")
    if subject == observer or (robot and subject not in team.joint):
        return
    if subject not in team.joint and observer in team.left_out:
        return
    if not relative.places and not (team.knows(observer) and team.knows(subject)):
        team.tally.silent += 1
        may_place = team.knows(observer) and observer not in team.left_out and not robot and not team.knows(subject)
        if may_place and _has_room(team, subject, observer):
            ring = team.rings.setdefault(subject, Ring(team.drift_of(subject), observer, team.limits.sharpest))
            ring.add(line_of(team.joint.moments(observer), relative, motions.get(observer), team.elapsed))
        return
    if robot and subject not in heard:
        known = team.known[subject]
        if not 0.0 <= relative.age + relative.ahead <= known.motion.covered:  # how far it had moved then is not known
            team.tally.silent += 1
            return
        motions = {**motions, subject: known.motion}
    factor = linearise(team.joint, relative, motions)
    if not robot:
        factor = _as_disputed(team, relative, of_object(team, relative, factor, motions), motions)
        if team.waits(observer, subject):
            team.tally.silent += 1
            return
    expected = team.joint.expected(factor)
    wider = _judged(team, relative, factor, expected.innovation(factor))
    if wider is None:
        return
    # A doubted robot may be the only one that sees the object, so its sighting is taken, with a larger variance.
    if not robot and team.freshness.doubts(observer):
        wider = wider.widened(MOST_NOISE)
    # A factor that begins new blocks changes the joint, so what was expected before it no longer holds.
    now = None if wider.priors else expected
    only = team.bounded(observer, wider, team.moved_by_sighting(relative), now)
    correct(team.joint, wider, only, now)
    team.note_errors(relative)
    if not robot:
        team.seen[subject] = 0.0
        team.walks.sighted(subject)


def _has_room(team: TeamState, subject: str, observer: str) -> bool:
    """Whether there is room for the ring of a subject; where all is full, the newest of who found the most goes for one of less."""
    if subject in team.rings or len(team.rings) < MAX_RINGS:
        return True
    found = Counter(ring.finder for ring in team.rings.values())
    greediest = max(sorted(found), key=found.__getitem__)
    if found[greediest] <= found[observer] + 1:
        return False
    del team.rings[[name for name, ring in team.rings.items() if ring.finder == greediest][-1]]
    return True


def _judged(team: TeamState, relative: Relative, factor: Factor, innovation: Innovation) -> Factor | None:
    """What is taken of a sighting, with the noise that its observer's have shown to have; None: nothing."""
    observer, subject = relative.observer, relative.subject
    majority, squared = team.majority(observer, subject), innovation.squared
    if majority != 0:  # what is in dispute does not count with its observer's noise
        factor, squared = team.weighed((observer, "relative"), factor, innovation, relative.noisier)
    by = team.outvoted(subject, observer) or team.outvoted(observer, subject)
    fits = squared <= quantile(GATE, innovation.freedom)
    agrees = fits and not by and not team.contradict(observer, subject)
    # Of two robots that contradict each other, the one that placed the object first is believed, until they dispute it.
    if not subject.startswith("robot/"):
        first = not any(team.contacts.contradict(observer, o) for o in team.vouching(subject, observer))
        agrees = agrees and majority >= 0 and (first or majority == 0)
    believed = not {observer, subject} & team.left_out
    taken = agrees and believed
    if subject.startswith("robot/") and relative.mark is None and believed and not team.doubts(observer):
        for robot, mate in ((observer, subject), (subject, observer)):
            if taken:
                team.strayed.confirm(robot, mate)
            elif not fits:
                team.strayed.contradict(robot, mate, displacement_of(factor.jacobians[robot][:, AXES], factor.residual))
    if taken and subject.startswith("robot/") and team.known[observer].turned is not None:
        _hold_against_compass(team, observer, factor, innovation)
    if relative.mark is None and (taken or subject in team.joint):  # a wrong name is held against nobody
        team.trust.judge(observer, subject, agrees)
    team.add_verdict(Verdict(observer, subject, "relative", squared, innovation.freedom, taken, by))
    return factor if taken else None


def _hold_against_compass(team: TeamState, observer: str, factor: Factor, innovation: Innovation) -> None:
    """Take a sighting of a mate that fits as evidence against a compass whose readings were left out.

    It is such evidence if it would not fit once its observer were turned as the compass says. Then these readings are forgotten.
    """
    known = team.known[observer]
    assert known.turned is not None
    residual = innovation.residual - factor.jacobians[observer][:, HEADING] * known.turned.off
    if squared_distance(residual, innovation.covariance) > quantile(GATE, len(residual)):
        team.known[observer] = replace(known, turned=None)


def of_object(team: TeamState, relative: Relative, factor: Factor, motions: Mapping[str, Motion]) -> Factor:
    """Update the estimate of how an object moves by a sighting; returned is the sighting's factor, linearised anew if that moved it.

    Sightings of robots that are left out or doubted do not update it, nor does a range or bearing alone of an object not in the joint.
    """
    observer, subject = relative.observer, relative.subject
    moves = team.moved_by_sighting(relative)
    is_doubted = team.freshness.doubts(observer) or (moves is not None and subject not in moves)
    is_doubted = is_doubted or team.majority(observer, subject) <= 0
    if observer in team.left_out or is_doubted or not (relative.places or subject in team.joint):
        return factor
    if not relative.places:
        team.walks.begin(subject, team.marginal(subject))
    seen = _placed(team, relative, factor, motions)
    pushed = team.walks.judge(subject, seen, relative.mark is None, alone=team.is_alone(observer, subject))
    if pushed is None or subject not in team.joint:
        return factor
    team.shift(subject, pushed)
    return _linearised_at(seen.mean, team, relative, motions)


def _as_disputed(team: TeamState, relative: Relative, factor: Factor, motions: Mapping[str, Motion]) -> Factor:
    """A sighting of an object, held against what others see of it: in a dispute both count the same, however sure they are.

    An object that only doubted robots have placed begins anew where another one sees it.
    """
    observer, subject = relative.observer, relative.subject
    unknown = subject not in team.joint or relative.mark is not None
    if len(factor.residual) > 2 or unknown or team.doubts(observer):
        return factor
    innovation, usual = team.joint.innovation(factor), factor
    if relative.places and innovation.squared > quantile(GATE, innovation.freedom):
        if team.rests_on_doubted(subject, observer):
            team.forget_object(subject)
            return linearise(team.joint, relative, motions)
        factor = _linearised_at(projected(team.joint, relative, motions.get(observer)).mean, team, relative, motions)
        innovation = team.joint.innovation(factor)
    way = displacement_of(factor.jacobians[subject][:, AXES], innovation.residual).vector
    if way @ way > team.naming.area:  # no place on the map
        return usual
    place, lasting = team.marginal(subject).mean + way, float(np.trace(team.marginal(observer).covariance))
    team.disputes.on_sighting(observer, subject, factor, innovation, place, lasting)
    if team.majority(observer, subject) != 0:
        return usual
    team.walks.forget(subject)
    beyond = squared_distance(way, team.marginal(subject).covariance)
    if beyond > 1.0:  # where another one sees it is within its error
        team.shift(subject, Moments(np.zeros(2), (1.0 - 1.0 / beyond) * np.outer(way, way)))
    rows = factor.jacobians[subject][:, AXES]
    return replace(factor, noise=team.disputes.noise(subject) * rows @ rows.T)


def _linearised_at(place: Array, team: TeamState, relative: Relative, motions: Mapping[str, Motion]) -> Factor:
    """A sighting of an object, linearised where it puts that, shape (2,), which may be far from where the joint has it."""
    way = place - team.joint.moments(relative.subject).mean
    team.shift(relative.subject, Moments(way, np.zeros((2, 2))))
    factor = linearise(team.joint, relative, motions)
    team.shift(relative.subject, Moments(-way, np.zeros((2, 2))))
    return replace(factor, residual=factor.residual + dict(factor.jacobians)[relative.subject] @ way)


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
    team.influence.drop(subject)
    team.joint.add(subject, place)
    team.seen[subject] = 0.0
    team.walks.sighted(subject)
    team.add_verdict(Verdict(observer, subject, "relative", 0.0, 2, True))


def _placed(team: TeamState, relative: Relative, factor: Factor, motions: Mapping[str, Motion]) -> Moments:
    """Where a sighting alone puts an object, shape (2,) and (2, 2): all that its observer is unsure of is counted."""
    rows = dict(factor.jacobians)
    by = rows.pop(relative.subject)
    before = team.joint.moments(relative.subject) if relative.subject in team.joint else factor.priors[relative.subject]
    spread = team.joint.innovation(Factor(factor.residual, rows, factor.noise, factor.priors)).covariance
    weighed = by.T @ np.linalg.inv(spread)
    # The information of a range or a bearing alone has rank one; a flat prior makes it invertible.
    covariance = np.linalg.inv(weighed @ by + (0.0 if relative.places else 1.0 / FLAT) * np.eye(2))
    way = covariance @ weighed @ factor.residual
    far = squared_distance(way, before.covariance + covariance) > quantile(GATE, 2)
    if far and relative.places:  # too far for what was linearised where it was expected
        return projected(team.joint, relative, motions.get(relative.observer))
    return Moments(before.mean + way, covariance)


def close_rings(team: TeamState) -> None:
    """Let an object enter once its rings and rays leave one place; its error is then taken for independent of all others."""
    for subject, ring in list(team.rings.items()):
        places = ring.places() if ring.newest == team.elapsed else ()
        if team.knows(subject) or team.elapsed - ring.newest > team.objects.kept:
            del team.rings[subject]
        elif places and places[0].weight > SURE:
            if subject in team.joint:  # with a variance beyond `KNOWN`
                team.forget_object(subject)
            team.joint.add(subject, places[0].moments)
            team.seen[subject] = 0.0
            del team.rings[subject]


def projected(joint: Joint, relative: Relative, motion: Motion | None) -> Moments:
    """Where a sighting puts its subject, of which nothing else is known: mean, shape (2,), and covariance, shape (2, 2).

    `motion` is the observer's in the tick. KeyError: the observer is not in the joint.
    """
    (claim,) = claimed(joint, [relative], {} if motion is None else {relative.observer: motion})
    return claim.place()


def claimed(joint: Joint, sightings: Sequence[Relative], motions: Mapping[str, Motion]) -> list[Claim]:
    """Where each sighting that places its subject puts it, by where a joint has its observer and nothing else."""
    if not sightings:
        return []
    factors, claims = linearise_all(joint, sightings, motions, alone=True), []
    rows = [dict(factor.jacobians) for factor in factors]
    by_places = [its.pop(seen.subject) for its, seen in zip(rows, sightings, strict=True)]
    without = [
        Factor(factor.residual, its, np.zeros((2, 2)), factor.priors) for factor, its in zip(factors, rows, strict=True)
    ]
    covariances = [innovation.covariance for innovation in joint.innovations(without)]
    backs = np.linalg.inv(by_places)  # of nothing known, the sighting alone decides
    for seen, factor, back, lasting in zip(sightings, factors, backs, covariances, strict=True):
        place = factor.priors[seen.subject].mean + back @ factor.residual
        claims.append(Claim(place, back @ lasting @ back.T, back @ factor.noise @ back.T))
    return claims
