"""Headings and velocities that were agreed on, against the truth. Pure; running sums."""

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np

from blackboard.judge.instant import Instant
from blackboard.opinion.gaussian.joint import squared_distance
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, wrap
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import LEVELS
from blackboard.wire.gaussians import pose_of, velocity_of

LEAST = 1e-12  # of a variance: who claims to err less than a millionth counts as that


class Motions:
    """Takes the subjects of each instant once; `summary` is the scorecard's block "motion"."""

    def __init__(self) -> None:
        #: what and subject -> how many, sums of squared errors and log densities, and how many regions of LEVELS held the truth
        self._sums: dict[tuple[str, str], Array] = defaultdict(lambda: np.zeros(3 + len(LEVELS)))

    def judge_subject(self, instant: Instant, sub_team: str, subject: str) -> None:
        """Judge what a sub-team agreed on about a subject, as far as the truth is known."""
        agreed = instant.consensus(sub_team, "agreed", subject)
        if agreed is None:
            return
        pose, heading = pose_of(agreed.state), instant.truth.headings.get(subject)
        if pose is not None and heading is not None:
            error = np.array([wrap(float(pose.mean[HEADING]) - heading)])
            self._add("headings", subject, error, pose.covariance[HEADING:, HEADING:])
        velocity, truth = velocity_of(agreed.velocity), instant.truth.velocities.get(subject)
        if velocity is not None and truth is not None:
            self._add("velocities", subject, velocity.mean[AXES] - truth, velocity.covariance[AXES, AXES])

    def _add(self, what: str, subject: str, error: Array, covariance: Array) -> None:
        claimed = covariance + np.eye(len(error)) * LEAST
        squared = squared_distance(error, claimed)
        _, determinant = np.linalg.slogdet(2 * math.pi * claimed)
        nearer = math.erf(math.sqrt(squared / 2)) if len(error) == 1 else -math.expm1(-squared / 2)  # chi-squared
        held = [nearer <= level / 100 for level in LEVELS]
        self._sums[what, subject] += (1.0, float(error @ error), -0.5 * (squared + float(determinant)), *held)

    def summary(self) -> dict[str, dict[str, Any]]:
        """`headings` (radians) and `velocities` (unit / s), each of robots and objects: as far as anything was judged."""
        kinds: dict[str, dict[str, Any]] = {}
        for what, kind in sorted({(what, subject.partition("/")[0]) for what, subject in self._sums}):
            mine = {s: sums for (w, s), sums in sorted(self._sums.items()) if w == what and s.startswith(f"{kind}/")}
            by_name = {subject.partition("/")[2]: _judged([sums]) for subject, sums in mine.items()}
            kinds.setdefault(what, {})[f"{kind}s"] = {**_judged(mine.values()), "by_name": by_name}
        return kinds


def _judged(sums: Iterable[Array]) -> dict[str, Any]:
    """Root mean squared error, mean logarithm of the density (nats), and coverage by level."""
    n, squares, logs, *held = sum(sums, np.zeros(3 + len(LEVELS))).tolist()
    coverage = {str(level): share / n for level, share in zip(LEVELS, held, strict=True)}
    return {"n": round(n), "rmse": math.sqrt(squares / n), "log_score": logs / n, "coverage": coverage}
