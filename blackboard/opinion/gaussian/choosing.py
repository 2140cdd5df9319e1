"""Whom to believe about a robot's place, where some evidence about it contradicts the joint."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from blackboard.opinion.chi_squared import DOUBT, GATE, quantile, wilson_hilferty
from blackboard.opinion.gaussian.coalitions import PREDICTION, Choice, about, choose
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.joint import Factor
from blackboard.opinion.gaussian.relation import Relative, linearise
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.vehicle import Motion


def choose_evidence(
    team: TeamState, news: Mapping[str, Evidence], motions: Mapping[str, Motion], entered: set[str]
) -> dict[str, Choice]:
    """For each robot whose place some evidence contradicts: who is believed about it.

    Where a coalition of the evidence wins over the prediction (the robot was carried away, or entered with a lie), its place
    is forgotten.
    """
    found = {}
    heard = entered | set(motions)
    made: dict[int, tuple[Factor, bool] | None] = {}  # by the id of a piece of evidence, of the joint as it is
    for robot in sorted(heard):
        pieces = _pieces(team, robot, news, heard, entered) if team.knows(robot) else {}
        if len(pieces) < 2:
            continue
        factors = _factors(team, robot, pieces, motions, made)
        if not any(doubtful for _, doubtful in factors.values()):
            continue
        said = {source: about(team.joint, robot, piece, motions) for source, piece in pieces.items()}
        opinions = {source: place for source, place in said.items() if place is not None}
        if len(opinions) > 1:
            predicted = team.marginal(robot)
            choice = choose({PREDICTION: predicted, **opinions}, team.rule)
            if choice.outvoted and not _is_refuted(team, [factors[name][0] for name in sorted(choice.members)]):
                continue  # what they say agrees with the prediction once the errors that they share are counted
            found[robot] = choice
            if choice.outvoted:
                away = [opinions[name].mean - predicted.mean for name in choice.members]
                team.widen(robot, float(np.hypot(*np.mean(away, axis=0))))
                made.clear()
                team.trust.forget(robot)
                team.offsets.forget(robot)
                team.tally.outvoted += 1
    return found


def _factors(
    team: TeamState,
    robot: str,
    pieces: Mapping[str, Increment | Relative],
    motions: Mapping[str, Motion],
    made: dict[int, tuple[Factor, bool] | None],
) -> dict[str, tuple[Factor, bool]]:
    """The factors of pieces of evidence, by source, and whether each is doubtful; without those that say nothing.

    What is made already is taken from there.
    """
    for piece in pieces.values():
        if id(piece) in made:
            continue
        if isinstance(piece, Relative):
            factor: Factor | None = linearise(team.joint, piece, motions)
        else:
            factor = likelihood(team.joint, robot, piece)
        made[id(piece)] = None if factor is None else (factor, _is_doubtful(team, factor))
    found = {source: made[id(piece)] for source, piece in pieces.items()}
    return {source: one for source, one in found.items() if one is not None}


def _pieces(
    team: TeamState, robot: str, news: Mapping[str, Evidence], heard: set[str], entered: set[str]
) -> dict[str, Increment | Relative]:
    """The evidence about a robot's place, by its source: the robot itself, or the other end of a sighting."""
    found: dict[str, Increment | Relative] = {}
    for evidence in news.values():
        for relative in evidence.relatives:
            ends = {relative.observer, relative.subject}
            if relative.observer != evidence.robot or robot not in ends or len(ends) < 2 or ends & team.left_out:
                continue
            (other,) = ends - {robot}
            if other in heard and team.knows(other) and (relative.places or other not in found):
                found[other] = relative
    own = news[robot].increment
    if own is not None and robot not in entered:
        found[robot] = own
    return found


def _is_doubtful(team: TeamState, factor: Factor) -> bool:
    """Whether a piece of evidence hardly agrees with what is predicted."""
    found = team.joint.innovation(factor)
    return found.squared > quantile(DOUBT, found.freedom)


def _is_refuted(team: TeamState, factors: list[Factor]) -> bool:
    """Whether some evidence together is beyond the 99.9 % quantile, all that its errors share in the joint considered."""
    found = team.joint.innovation(*factors)
    return found.squared > wilson_hilferty(GATE, found.freedom)
