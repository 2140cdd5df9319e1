"""Whom to believe about a robot's place, where some evidence about it contradicts the joint."""

from collections.abc import Mapping

import numpy as np

from blackboard.opinion.chi_squared import DOUBT, GATE, quantile, wilson_hilferty
from blackboard.opinion.gaussian.coalitions import PREDICTION, Choice, about, choose
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.joint import Factor
from blackboard.opinion.gaussian.linearising import linearise_all
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.state import TeamState
from blackboard.opinion.gaussian.vehicle import Motion


def choose_evidence(
    team: TeamState, news: Mapping[str, Evidence], motions: Mapping[str, Motion], entered: set[str]
) -> dict[str, Choice]:
    """For each robot whose place some evidence contradicts: who is believed about it.

    Where a coalition of the evidence wins over the prediction (the robot was carried away, or entered with a lie), its place
    is forgotten.
    """
    choices = {}
    heard = entered | set(motions)
    known = [robot for robot in sorted(heard) if team.knows(robot)]
    evidence = {robot: _pieces(team, robot, news, heard, entered) for robot in known}
    evidence = {robot: pieces for robot, pieces in evidence.items() if len(pieces) > 1}
    made = _factors(team, evidence, motions)
    for robot, pieces in evidence.items():
        factors = {source: made[id(piece)] for source, piece in pieces.items() if id(piece) in made}
        if not any(doubtful for _, doubtful in factors.values()):
            continue
        opinions = about(team.joint, robot, pieces, motions)
        if len(opinions) > 1:
            predicted = team.marginal(robot)
            choice = choose({PREDICTION: predicted, **opinions}, team.rule)
            if choice.outvoted and not _is_refuted(team, [factors[name][0] for name in sorted(choice.members)]):
                continue  # what they say agrees with the prediction once the errors that they share are counted
            choices[robot] = choice
            if choice.outvoted:
                away = [opinions[name].mean - predicted.mean for name in choice.members]
                team.widen(robot, float(np.hypot(*np.mean(away, axis=0))))
                made |= _factors(team, {robot: pieces}, motions)  # of the others nothing has changed
                team.trust.forget(robot)
                team.offsets.forget(robot)
                team.tally.outvoted += 1
    return choices


def _factors(
    team: TeamState, evidence: Mapping[str, Mapping[str, Increment | Relative]], motions: Mapping[str, Motion]
) -> dict[int, tuple[Factor, bool]]:
    """The factors of the evidence about some robots, by its ids, and whether each is doubtful: hardly agrees with what is predicted.

    What says nothing is left out.
    """
    seen = {
        id(piece): piece for pieces in evidence.values() for piece in pieces.values() if isinstance(piece, Relative)
    }
    factors = dict(zip(seen, linearise_all(team.joint, list(seen.values()), motions), strict=True))
    for robot, pieces in evidence.items():
        own = pieces.get(robot)
        if isinstance(own, Increment) and (factor := likelihood(team.joint, robot, own)) is not None:
            factors[id(own)] = factor
    innovations = team.joint.innovations(list(factors.values()))
    doubtful = [innovation.squared > quantile(DOUBT, innovation.freedom) for innovation in innovations]
    return dict(zip(factors, zip(factors.values(), doubtful, strict=True), strict=True))


def _pieces(
    team: TeamState, robot: str, news: Mapping[str, Evidence], heard: set[str], entered: set[str]
) -> dict[str, Increment | Relative]:
    """The evidence about a robot's place, by its source: the robot itself, or the other end of a sighting."""
    pieces: dict[str, Increment | Relative] = {}
    for evidence in news.values():
        for relative in evidence.relatives:
            ends = {relative.observer, relative.subject}
            if relative.observer != evidence.robot or robot not in ends or len(ends) < 2 or ends & team.left_out:
                continue
            (other,) = ends - {robot}
            if other in heard and team.knows(other) and (relative.places or other not in pieces):
                pieces[other] = relative
    own = news[robot].increment
    if own is not None and robot not in entered:
        pieces[robot] = own
    return pieces


def _is_refuted(team: TeamState, factors: list[Factor]) -> bool:
    """Whether some evidence together is beyond the 99.9 % quantile, all that its errors share in the joint considered."""
    innovation = team.joint.innovation(*factors)
    return innovation.squared > wilson_hilferty(GATE, innovation.freedom)
