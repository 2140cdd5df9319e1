"""Unnamed sightings into the joint: as those of a known subject where that is clear, or else in the mean."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from blackboard.opinion.classes import ROBOTS, could_be, is_class
from blackboard.opinion.gaussian.assignment import CLEAR
from blackboard.opinion.gaussian.evidence import Evidence, end_of_tick
from blackboard.opinion.gaussian.late import with_way
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.naming import Odds, Unnamed, clear
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.sightings import of_object
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.tracking import begin, near, places, watch
from blackboard.opinion.gaussian.tracks import LIKELY
from blackboard.opinion.gaussian.vehicle import Motion, correct

MOST_SEEN = 16  # unnamed sightings of a robot in a tick, the newest first; of more nothing is worked out

#: What excludes each other: sightings, each as one of a subject, with their probabilities. The rest is that none of them is so.
Doubt = list[tuple[float, Relative]]


def identified(
    team: TeamState,
    evidence: Evidence,
    news: Mapping[str, Evidence],
    motions: Mapping[str, Motion],
    unclear: list[Doubt],
) -> list[Relative]:
    """Of the unnamed sightings of a robot those that clearly are of a known subject, as sightings of it, the newest of each.

    What an observer sees in one frame, at one age, are different things. Those of the newest frame of their class that are of nobody
    known begin tracks. `unclear` gets those that may be of several, and which these are, where no clearer or newer one of the tick is
    of any of them. Of a frame with two of these it gets none: a liar could take all its mates along in one tick, before it is doubted.
    What it alone takes for a robot of no team is one of the two. Tracks take nobody along: what may be of a mate or a track is of
    nobody, as far as it is of the track. What may be of several tracks is taken for the likeliest; `unclear` gets it where it may be
    of none, or of another one that is told of.
    """
    observer, chosen, doubts = evidence.robot, dict[str, Relative](), list[tuple[float, Doubt]]()
    lonely = set[float]()  # ages of frames that may show a robot that nobody else has seen
    named = {sighting.subject for sighting in evidence.relatives if not is_class(sighting.subject)}
    every = _unnamed(evidence)
    unnamed, cut = every[:MOST_SEEN], {sighting.age for sighting in every[MOST_SEEN:]}
    team.tally.tracks["unnamed_left_out"] += len(every) - len(unnamed)
    if not unnamed:
        watch(team, observer, evidence.time, [], [])
    newer = set[str]()  # classes of which a newer frame shows something
    for age in sorted({sighting.age for sighting in unnamed}):
        frame = [sighting for sighting in unnamed if sighting.age == age]
        candidates = _candidates(team, evidence, frame, news, motions)
        odds = _odds(team, observer, frame, candidates, motions)
        watch(team, observer, evidence.time, frame, odds, whole=age not in cut)
        of_tracks: list[tuple[float, Doubt]] = []  # of some track with this probability
        for sighting, its, all_odds in zip(frame, candidates, odds, strict=True):
            share = None if all_odds is None else all_odds.subjects
            taken = clear(share)
            team.tally.unnamed.append(
                _of_named_tracks(team, Unnamed(observer, evidence.time, sighting.mark or 0, share, taken))
            )
            lonely |= {age for one in share or () if one.startswith(ROBOTS) and team.tracks.is_alone(observer, one)}
            if taken is not None and taken not in named:
                chosen.setdefault(taken, its[taken])
            elif taken is None and share and set(share) <= set(team.tracks):
                if sighting.subject not in newer:
                    of_tracks.append((sum(share.values()), [(p, its[one]) for one, p in share.items()]))
            elif taken is None and share:
                doubts.append((age, [(p, its[one]) for one, p in share.items() if one not in team.tracks]))
        told = {one for one in team.tracks if team.tracks.is_told(one)}
        for some, one in _apart(of_tracks, set(chosen), told):
            if some >= CLEAR:
                chosen[one.subject] = one
            else:
                unclear.append([(some, one)])
        chosen |= begin(team, frame, odds, newer)
        newer |= {sighting.subject for sighting in frame}
    used = named | set(chosen) | {sighting.subject for doubt in unclear for _, sighting in doubt}
    unclear += _one_a_frame(doubts, used, lonely)
    return [chosen[subject] for subject in sorted(chosen)]


def _one_a_frame(doubts: Sequence[tuple[float, Doubt]], used: set[str], lonely: Collection[float]) -> list[Doubt]:
    """Of each frame the one doubt about subjects that nothing newer, and none of those `used`, shows; of `lonely` frames none.

    Each doubt has the age of its frame (s). Where a frame has two such doubts it has none.
    """
    left = []
    for age in sorted({age for age, _ in doubts}):
        fresh = [doubt for its, doubt in doubts if its == age and used.isdisjoint(one.subject for _, one in doubt)]
        used = used.union(one.subject for doubt in fresh for _, one in doubt)
        left += fresh if len(fresh) == 1 and age not in lonely else []
    return left


def _apart(
    doubts: Sequence[tuple[float, Doubt]], used: set[str], told: Collection[str]
) -> list[tuple[float, Relative]]:
    """Sightings of a frame that may be of several tracks, each as of one: the likeliest pairs first.

    The share of a sighting is lessened by the odds that it is of another published track (`told`). Unpublished tracks do not count
    here, because a liar could begin many.

    Means over all of them would draw tracks that meet together (Blom and Bloem, IEEE TAC 45(2), 2000, who leave out the less likely
    of two assignments that exchange tracks).
    """
    pairs = sorted((-p, sighting.subject, number) for number, (_, doubt) in enumerate(doubts) for p, sighting in doubt)
    apart, done = [], set[int]()
    for _, subject, number in pairs:
        if subject not in used and number not in done:
            used, done = used | {subject}, done | {number}
            share, doubt = doubts[number]
            rivals = sum(p for p, one in doubt if one.subject != subject and one.subject in told)
            apart.append((share - rivals, next(sighting for _, sighting in doubt if sighting.subject == subject)))
    return apart


def _unnamed(evidence: Evidence) -> list[Relative]:
    """The unnamed sightings of a robot's own, the newest first."""
    unnamed = [
        sighting
        for sighting in evidence.relatives
        if is_class(sighting.subject) and sighting.observer == evidence.robot
    ]
    unnamed = [
        sighting if sighting.mark is not None else replace(sighting, mark=number)
        for number, sighting in enumerate(unnamed)
    ]
    return sorted(unnamed, key=lambda sighting: (sighting.age, sighting.mark or 0))


def _candidates(
    team: TeamState,
    evidence: Evidence,
    frame: Sequence[Relative],
    news: Mapping[str, Evidence],
    motions: Mapping[str, Motion],
) -> list[dict[str, Relative]]:
    """Of each sighting of a frame the subjects that it may be of, with the sighting as one of that subject."""
    observer, ends = evidence.robot, {robot: known.time for robot, known in team.known.items()}
    ends |= {robot: told.time for robot, told in news.items()}
    end = end_of_tick(news.values())
    there = {observer} | {sighting.subject for sighting in evidence.relatives if sighting.age == frame[0].age}
    subjects = sorted({*team.known, *team.seen} - there)
    candidates = []
    for seen in frame:
        is_same = seen.kind != "bearing"  # how far away it is says the sighting, whatever it is of
        sighting = team.limits.sighting(seen, seen.range) if is_same else seen
        possible = near(team, sighting, motions.get(observer)) if observer in team.joint else ()
        of = [
            with_way(team, replace(sighting, subject=one, ahead=ends.get(one, end) - evidence.time))
            for one in subjects
            if could_be(sighting.subject, one) and (one not in team.tracks or one in possible)
        ]
        candidates.append(
            {one.subject: one if is_same else team.limits.sighting(one, team.distance(one)) for one in of}
        )
    return candidates


def _odds(
    team: TeamState,
    observer: str,
    frame: Sequence[Relative],
    candidates: Sequence[Mapping[str, Relative]],
    motions: Mapping[str, Motion],
) -> list[Odds | None]:
    """The odds of each sighting of a frame; None where they are not worked out."""
    if not team.knows(observer):
        return [None] * len(frame)
    moved = {robot: known.motion for robot, known in team.known.items()} | dict(motions)
    return [*team.naming.judge(team.joint, frame, candidates, moved, team.knows, team.tracks, places(team, observer))]


def _of_named_tracks(team: TeamState, unnamed: Unnamed) -> Unnamed:
    """What is told of an unnamed sighting: nothing of tracks that have no name yet."""
    if unnamed.odds is None:
        return unnamed
    odds = {one: share for one, share in unnamed.odds.items() if one not in team.tracks or team.tracks.is_named(one)}
    return replace(unnamed, odds=odds, taken=unnamed.taken if unnamed.taken in odds else None)


def take_in_the_mean(team: TeamState, doubt: Doubt, motions: Mapping[str, Motion]) -> None:
    """Take a sighting of which it is not clear whose it is: the joint is the mean over all that it may be of, or nobody known.

    Mean and covariance are those of the mixture, so that the doubt widens what is believed (the probabilistic data association
    filter, Bar-Shalom and Tse, Automatica 11(5), 1975).
    """
    observer, subjects = doubt[0][1].observer, {relative.subject for _, relative in doubt}
    if observer in team.left_out or not all(team.knows(one) and one in {*motions, *team.seen} for one in subjects):
        return
    for _, relative in doubt:
        team.joint.begin(linearise(team.joint, relative, motions).priors)
    for share, relative in doubt:
        if relative.subject in team.tracks and share >= LIKELY:
            of_object(team, relative, linearise(team.joint, relative, motions).widened(1.0 / share), motions)
    parts = []
    for share, relative in doubt:
        after = team.joint.copy()
        if relative.subject not in team.left_out and not team.contradict(observer, relative.subject):
            factor = linearise(after, relative, motions)
            correct(after, factor, team.bounded(observer, factor, team.moved_by_sighting(relative), share=share))
        parts.append((share, after))
    parts.append((max(0.0, 1.0 - sum(share for share, _ in parts)), team.joint.copy()))
    mean = sum((share * part.mean for share, part in parts), np.zeros_like(team.joint.mean))
    covariance = np.zeros_like(team.joint.covariance)
    for share, part in parts:
        covariance += share * (part.covariance + np.outer(part.mean - mean, part.mean - mean))
    team.joint.mean, team.joint.covariance = mean, 0.5 * (covariance + covariance.T)
    for _, relative in doubt:
        if relative.subject in team.seen:
            team.walks.sighted(relative.subject)
        team.note_errors(relative)
