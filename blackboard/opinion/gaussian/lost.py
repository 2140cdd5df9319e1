"""How likely each robot is not where the team believes it to be. Pure.

A robot is placed or lost (a hidden Markov model of two states): it gets lost once in `SOUND` seconds in the mean, and is found after
`ASTRAY`. Evidence about a placed robot is as far from what is expected as chi-squared says. About a lost one it is so by the
share `AGREES`, because what led it astray agrees with itself, else `WIDE` times as far. A sighting has two ends: the other one may be
the one that is lost. Errors are alike for seconds. So evidence counts by the time since the last of the same kind and ends, at most a
second, and by `COUNTED` of that.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from blackboard.opinion.gaussian.evidence import Verdict

# Seconds; these numbers are the likeliest of some on 12 runs of `blackboard lab --lost`, seeds 1 and 2.
SOUND, ASTRAY = (200.0, 10.0)
WIDE = 1.5
#: What a robot gained, its compass too, what it says of where it is, and sightings.
AGREES = {"increment": 0.9, "compass": 0.9, "own": 0.4, "relative": 0.6}
COUNTED = 0.3
SPACING = 1.0  # seconds
ELSEWHERE = 0.6  # the probability that an object is not where it is believed to be
#: Of the robots that are surely led astray this share is elsewhere (the others err in their heading, or too little to be lost); half
#: of it is told at `HALF`. Of the same runs.
ELSEWHERE_AT_MOST, HALF, STEEP = 0.55, 0.14, 2.5
LEAST = 1e-3  # of a probability, and the most is 1 - LEAST: nothing here is surer
MAX_PAIRS = 4096

Pair = tuple[str, str, str]  # who says it, about whom, and the kind of evidence


@dataclass
class Lost:
    """Mutable. Robots are named as `robot/r1`; `on_verdicts` once for each settled tick."""

    _probabilities: dict[str, float] = field(default_factory=dict)
    _heard: dict[Pair, float] = field(default_factory=dict)  # team time of the newest evidence, seconds
    _time: float | None = None

    def probability(self, robot: str) -> float:
        """That a robot is not where it is believed to be."""
        share = math.pow(self._astray(robot) / HALF, STEEP)
        return ELSEWHERE_AT_MOST * share / (1 + share)

    def _astray(self, robot: str) -> float:
        """That something led a robot astray; what is expected of any where nothing is known of it."""
        return self._probabilities.get(robot, ASTRAY / (SOUND + ASTRAY))

    def on_verdicts(
        self, time: float, robots: Iterable[str], verdicts: Iterable[Verdict], own: Mapping[str, float]
    ) -> None:
        """Take what a joint that knows some robots found of evidence at a team time (s).

        `own` is the squared distance of where a robot says that it is from where the joint has it.
        """
        dt = 0.0 if self._time is None else max(0.0, time - self._time)
        self._time, astray = time, {robot: self._astray(robot) for robot in robots}
        usual, stays = ASTRAY / (SOUND + ASTRAY), math.exp(-dt * (1 / SOUND + 1 / ASTRAY))
        odds = {robot: _logit(usual + (share - usual) * stays) for robot, share in astray.items()}
        pieces = [
            (verdict.source, verdict.subject, str(verdict.kind), verdict.squared, verdict.freedom)
            for verdict in verdicts
            if verdict.kind != "echo"
        ]
        pieces += [(robot, robot, "own", squared, 2) for robot, squared in own.items()]
        for source, subject, kind, squared, freedom in pieces:
            weight = COUNTED * self._weight((source, subject, kind), time)
            share = _of_the_lost(squared, freedom, AGREES[kind])
            for end, other in {(source, subject), (subject, source)}:
                if end in odds:
                    doubt = astray.get(other, ELSEWHERE) if other != end else 0.0
                    odds[end] += weight * (share - math.log((1 - doubt) + doubt * math.exp(share)))
        self._probabilities = {robot: min(1 - LEAST, max(LEAST, _share(logit))) for robot, logit in odds.items()}
        if len(self._heard) > MAX_PAIRS:
            self._heard = {pair: at for pair, at in self._heard.items() if time - at < SPACING}

    def _weight(self, pair: Pair, time: float) -> float:
        """How much new evidence of two ends says, 0 to 1: those of one tick share it."""
        since = time - self._heard.get(pair, -math.inf)
        self._heard[pair] = time
        return min(1.0, max(0.0, since) / SPACING)


def _of_the_lost(squared: float, freedom: int, agrees: float) -> float:
    """The logarithm of the likelihood of a squared distance of who is lost, by that of who is placed."""
    farther = 0.5 * squared * (1 - 1 / WIDE**2) - freedom * math.log(WIDE)
    return math.log(agrees + (1 - agrees) * math.exp(min(farther, 50.0)))


def _logit(probability: float) -> float:
    kept = min(1 - LEAST, max(LEAST, probability))
    return math.log(kept / (1 - kept))


def _share(odds: float) -> float:
    return 1 / (1 + math.exp(-min(50.0, max(-50.0, odds))))
