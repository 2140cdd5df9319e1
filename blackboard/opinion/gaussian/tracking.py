"""Tracks of unnamed things in the joint: which a sighting may be of, what a frame says of all of them, how they begin and end."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from blackboard.opinion.chi_squared import DOUBT, GATE, quantile
from blackboard.opinion.classes import kind_of, stem
from blackboard.opinion.gaussian.absent import Absent, bounded, found_again
from blackboard.opinion.gaussian.assignment import CLEAR, posterior
from blackboard.opinion.gaussian.joint import squared_distance
from blackboard.opinion.gaussian.naming import Odds
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.rolling import Rolling
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.tracks import KEPT, LIKELY
from blackboard.opinion.gaussian.vehicle import AXES, BEARING, HEADING, Motion, moved_in, wrap
from blackboard.opinion.gaussian.views import TINY, Place
from blackboard.opinion.grid import Array


def near(team: TeamState, seen: Relative, motion: Motion | None) -> set[str]:
    """The tracks that may be within the gate of a sighting: all but those that clearly are too far away, which costs much less to see.

    The trace of a covariance is no less than any variance in it; and what an observer errs, tracks that it saw err with it.
    """
    blocks = [block for block in team.tracks if block in team.joint]
    if not seen.places or not blocks:
        return set(blocks)
    observer = team.joint.moments(seen.observer)
    back, turned = moved_in(observer.mean, motion, seen.age)
    angle = float(observer.mean[HEADING] - turned - observer.mean[BEARING]) + seen.bearing
    place = observer.mean[AXES] - back + seen.range * np.array([math.cos(angle), math.sin(angle)])
    variances = observer.covariance.diagonal()
    fresh = seen.range_variance + max((variance for _, variance in seen.profile), default=0.0)
    fresh += sum(bias.sigma**2 for bias in seen.biases) + sum(np.abs(seen.spread))
    spread = (
        variances[AXES].sum() + fresh + seen.range**2 * (variances[[HEADING, BEARING]].sum() + seen.bearing_variance)
    )
    first = np.array([team.joint.blocks[block].start for block in blocks])
    apart = team.joint.mean[first[:, np.newaxis] + np.arange(2)] - place
    diagonal = team.joint.variances
    within = np.square(apart).sum(axis=1) <= quantile(GATE, 2) * (spread + diagonal[first] + diagonal[first + 1])
    return {block for block, close in zip(blocks, within.tolist(), strict=True) if close}


def watch(
    team: TeamState,
    observer: str,
    time: float,
    frame: Sequence[Relative],
    odds: Sequence[Odds | None],
    *,
    whole: bool = True,
) -> None:
    """Hold what an observer sees in a frame of a tick that ended at a team time (s), with what that may be of, for and against tracks.

    A track of a class of which it has no frame now is left as it is. A frame that is not `whole` speaks against none.
    """
    if observer in team.left_out or not team.knows(observer) or any(its is None for its in odds):
        return
    for sighting in frame:
        if sighting.places:
            team.tracks.look(observer, sighting.subject, sighting.range, sighting.bearing)
    shown: dict[str, float] = {}
    for its in odds:
        for block, share in its.subjects.items() if its else ():
            if block in team.tracks:
                shown[block] = min(1.0, shown.get(block, 0.0) + share)
                if shown[block] >= LIKELY:
                    team.seen[block] = 0.0
    looked = team.tracks.on_frame(observer, {sighting.subject for sighting in frame}, time)
    where = places(team, observer)
    told = {block: where[block] for block in where if block in shown or (whole and team.tracks.kind(block) in looked)}
    team.tracks.judge(observer, told, shown)


def places(team: TeamState, observer: str) -> dict[str, Place]:
    """Where the tracks are, as an observer would see them."""
    blocks, places = [block for block in team.tracks if block in team.joint], dict[str, Place]()
    if blocks:
        state = team.joint.moments(observer)
        camera = float(state.mean[HEADING] - state.mean[BEARING])
        for block in blocks:
            its = team.joint.moments(block)
            dx, dy = (its.mean - state.mean[AXES]).tolist()
            variance = float(np.trace(its.covariance) + np.trace(state.covariance[AXES, AXES])) / 2
            places[block] = math.hypot(dx, dy), wrap(math.atan2(dy, dx) - camera), math.sqrt(max(0.0, variance))
    return places


def begin(
    team: TeamState, frame: Sequence[Relative], odds: Sequence[Odds | None], newer: Collection[str]
) -> dict[str, Relative]:
    """Begin a track for each sighting of a frame that most likely shows nobody known: block -> that sighting, named after the track.

    No track begins for a class in `newer`: a newer frame of the tick shows something of it. Nor for what the frame shows twice.
    """
    begun: dict[str, Relative] = {}
    for sighting, its in zip(frame, odds, strict=True):
        strange = its is not None and its.is_new and kind_of(sighting.subject) != "landmark"
        new = strange and sighting.subject not in newer
        if new and sighting.places and sighting.observer not in team.left_out:
            area = min(team.naming.area, team.tracks.area(sighting.observer, sighting.subject))
            others = [one for block, one in begun.items() if team.tracks.kind(block) == sighting.subject]
            if team.naming.is_second(sighting, [area * _overlap(sighting, one) for one in others]):
                continue
            block = team.tracks.begin(sighting.observer, sighting.subject)
            if block is None:
                team.tally.tracks["unnamed_left_out"] += 1
            else:
                begun[block] = team.limits.sighting(replace(sighting, subject=block), sighting.range)
    return begun


def _overlap(one: Relative, other: Relative) -> float:
    """The density (1 / unit^2) at which an observer sees both as it does, if they are of one thing."""
    one, other = one.without_profile(), other.without_profile()
    away, aside = one.range - other.range, wrap(one.bearing - other.bearing)
    along, across = one.range_variance + other.range_variance, one.bearing_variance + other.bearing_variance
    if along <= 0.0 or across <= 0.0:
        return 0.0
    squared = away**2 / along + aside**2 / across
    return math.exp(-squared / 2) / (2 * math.pi * math.sqrt(along * across) * max(TINY, one.range))


def _is_anywhere(team: TeamState, block: str) -> bool:
    """Whether a track is nowhere in particular: its 99 % region is larger than the map."""
    region = math.pi * quantile(DOUBT, 2) * math.sqrt(max(0.0, float(np.linalg.det(team.marginal(block).covariance))))
    return region > team.naming.area


def pass_absent(team: TeamState, dt: float) -> None:
    """Let `dt` seconds pass for tracks that may be found again; after `KEPT` seconds unseen they are forgotten."""
    passed = {name: one.passed(dt) for name, one in team.absent.items()}
    team.absent = bounded({name: one for name, one in passed.items() if one.unseen <= KEPT}, team.left_out)


def _note(team: TeamState) -> None:
    """Mark tracks whose place is no longer known as lost, and keep the motion of the published ones that were just seen."""
    for block in team.tracks:
        was_told = team.tracks.is_told(block)
        team.tracks.lose(block, math.sqrt(team.marginal(block).covariance.trace() / 2))
        if was_told and not team.tracks.is_told(block) and block in team.absent:
            team.absent[block] = replace(team.absent[block], lost=True)
        if team.tracks.is_told(block) and team.seen[block] == 0.0:
            kind, rolling = _going(team, block)
            team.absent[block] = Absent(kind, rolling.moments(), rolling.fastest, team.tracks.observers(block))


def _going(team: TeamState, block: str) -> tuple[str, Rolling]:
    """A track's class and its motion."""
    kind = team.tracks.kind(block)
    return kind, team.walks.rolling(block, team.marginal(block), team.objects.drift_of(block), kind)


def _found_again(team: TeamState, new: Sequence[str], taken: Collection[str]) -> dict[str, str]:
    """New track -> name of the thing out of sight that it is of; names in `taken` are not given.

    It may have a track yet, which goes straight on where the thing turned.
    """
    absent = {name: one for name, one in team.absent.items() if name not in taken}
    began = {block: (*_going(team, block), team.tracks.age(block)) for block in new if absent}
    return found_again(began, absent, team.naming.area)


def end_tick(team: TeamState) -> None:
    """Drop the tracks that are over, and name those that are sure."""
    gone = {block for block in team.tracks if block not in team.joint or _is_anywhere(team, block)}
    for block in sorted(gone.union(team.tracks.ended())):
        if block not in gone and block in team.absent and not team.absent[block].lost:  # observers saw nothing there
            del team.absent[block]
        _drop(team, block)
    _note(team)
    new, same = team.tracks.to_be_named(), _called(team)
    again = _found_again(team, [block for block in new if block not in same], set(same.values()))
    for name in sorted(again.values()):
        if name in team.tracks:
            _drop(team, name)
    same |= again
    for block in new:
        name = same.get(block) or team.tracks.new_name(block, lambda name: _was_given(team, name), team.called)
        _call(team, block, name)
        team.tally.tracks["tracks_born"] += 1
    for block in sorted(same.keys() - set(new)):
        _call(team, block, same[block])


def _drop(team: TeamState, block: str) -> None:
    team.tally.tracks["tracks_died"] += team.tracks.is_named(block)
    team.tracks.drop(block)
    team.forget_object(block)


def _was_given(team: TeamState, name: str) -> bool:
    return name in team.called or name in team.absent or _is_used(team, name)


def _is_used(team: TeamState, name: str) -> bool:
    return any(name in kept for kept in (team.joint, team.known, team.rings))


def _call(team: TeamState, block: str, name: str) -> None:
    team.tracks.call(block, name)
    team.rename(block, name)
    team.absent.pop(block, None)  # under the name that it had here before


def _called(team: TeamState) -> dict[str, str]:
    """What a board that began earlier calls the tracks that are sure here: where it is clear which is which, by their places.

    A name that is in use here, or over for good, is of something else.
    """
    new = team.tracks.to_be_named()
    blocks = [block for block in team.tracks if block in new or team.tracks.is_named(block)] if team.called else []
    names = sorted(
        name
        for name in team.called
        if not _is_used(team, name) and (name in team.absent or not team.tracks.is_over(name))
    )
    weights = np.zeros((len(blocks), len(names)))
    for row, block in enumerate(blocks):
        mine = team.marginal(block)
        for column, name in enumerate(names):
            if name.startswith(stem(team.tracks.kind(block))):
                its = team.called[name]
                weights[row, column] = (
                    _density(mine.mean - its.mean, mine.covariance + its.covariance) * team.naming.area
                )
    return {blocks[row]: names[column] for row, column in np.argwhere(posterior(weights) >= CLEAR)}


def _density(apart: Array, covariance: Array) -> float:
    """That of a normal distribution, 1 / unit^2; 0 beyond the gate."""
    squared = squared_distance(apart, covariance)
    if squared > quantile(GATE, 2):
        return 0.0
    return math.exp(-squared / 2) / (2 * math.pi * math.sqrt(max(TINY, float(np.linalg.det(covariance)))))
