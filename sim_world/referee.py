"""The referee: beliefs compared with the truth at each tick. Pure.

A sample is one robot, one subject (its own place, or an object), one instant and one of the robot's sub-teams, for
which all three beliefs exist: what the robot believed alone (`solo`), its sub-team's `consensus`, and what was `agreed`
after the exchange. So the three are judged on the same samples; where one is missing it is counted under its level.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

from blackboard.errors import Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score, region_area
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import PackedBelief
from sim_world.instant import Instant
from sim_world.scenario import CheckSection
from sim_world.series import AREA_OF, Sample

LEVELS = ("solo", "consensus", "agreed")
GROUPS = {"robots": "robot/", "objects": "object/"}

#: What was found in a tick about (subject, belief): its score of one entry, or None if it could not be unpacked.
Known = dict[tuple[str, PackedBelief], tuple[Score, Belief] | None]


@dataclass(frozen=True)
class Judgement:
    """What the referee found at the end of a run."""

    passed: bool
    reasons: list[str]  # every check that failed, or all checks where none did
    scores: dict[str, Any]  # the scorecard's block "scores"
    missing: dict[str, dict[str, int]]  # subject -> level -> samples that were not judged, because a belief was missing
    hash: str
    unit: str  # of the errors in `scores`
    refused: dict[str, int]  # reason -> beliefs that could not be unpacked


class Referee:
    """Takes each instant once, in order; its `judgement` at the end has scores, hash and verdict."""

    def __init__(
        self,
        grid: Grid,
        check: CheckSection,
        robots: Sequence[str],
        record: Callable[[Sample], None] | None = None,
    ) -> None:
        """`robots` are those of the scenario: each must have been heard for a PASS. `record` is given every sample that counts."""
        self.grid, self.check, self.robots, self._record = grid, check, tuple(robots), record
        self.refused: Counter[str] = Counter()
        self._hash = hashlib.sha256()
        self._scores: dict[str, dict[str, Score]] = {}  # subject -> level -> score
        self._missing: dict[str, Counter[str]] = {}  # subject -> level -> samples
        self._landmark_at: dict[str, float] = {}  # robot -> team time of the newest tick in which it saw a landmark

    @property
    def hash(self) -> str:
        """sha256 over the payloads of all consensuses, sorted by tick, sub-team, level, subject."""
        return self._hash.hexdigest()

    def hear(self, instant: Instant, judged: bool) -> None:
        """Take a tick that is over: into the hash, and into the scores where it is `judged`."""
        for name in sorted(instant.consensuses):
            payload, _ = instant.consensuses[name]
            self._hash.update(payload)
        self._landmark_at |= dict.fromkeys(instant.landmark_seen, instant.truth.time)
        if not judged:
            return
        known: Known = {}
        objects = [subject for subject in instant.truth.positions if subject.startswith("object/")]
        present = {robot for robots in instant.teams.values() for robot in robots}
        for robot in sorted(set(self.robots) - present):
            self._miss(f"robot/{robot}", "solo")
        for sub_team, robots in instant.teams.items():
            for robot in robots:
                for subject in (f"robot/{robot}", *objects):
                    if subject in instant.truth.positions:
                        self._sample(instant, robot, sub_team, subject, known)

    def _sample(
        self,
        instant: Instant,
        robot: str,
        sub_team: str,
        subject: str,
        known: Known,
    ) -> None:
        scored = {}
        for level in LEVELS:
            packed = instant.belief(level, robot, sub_team, subject)
            found = None
            if packed is not None:
                if (subject, packed) not in known:
                    known[subject, packed] = self._score(packed, instant.truth.positions[subject])
                found = known[subject, packed]
            if found is None:
                self._miss(subject, level)
            else:
                scored[level] = found
        if len(scored) == len(LEVELS):
            for level, (score, belief) in scored.items():
                _extend(self._scores.setdefault(subject, {}).setdefault(level, Score()), score)
                if self._record is not None:
                    self._record(self._describe(instant, robot, sub_team, subject, level, score, belief))

    def _score(self, packed: PackedBelief, truth: Sequence[float]) -> tuple[Score, Belief] | None:
        score = Score()
        try:
            belief = unpack(packed, self.grid)
        except Refused as refusal:
            self.refused[refusal.reason] += 1
            return None
        score.add(belief, truth)
        return score, belief

    def _describe(
        self, instant: Instant, robot: str, sub_team: str, subject: str, level: str, score: Score, belief: Belief
    ) -> Sample:
        """A sample at one level, as a row of the series; `score` has one entry."""
        (truth_x, truth_y), (mean_x, mean_y) = instant.truth.positions[subject], belief.mean().tolist()
        return Sample(
            tick=instant.truth.tick,
            time=instant.truth.time,
            robot=robot,
            sub_team=sub_team,
            subject=subject,
            level=level,
            truth_x=truth_x,
            truth_y=truth_y,
            mean_x=mean_x,
            mean_y=mean_y,
            log_score=score.log_scores[0],
            region=score.levels[0],
            area=region_area(belief, AREA_OF),
            landmark_age=instant.truth.time - self._landmark_at.get(robot, -math.inf),
        )

    def _miss(self, subject: str, level: str) -> None:
        self._missing.setdefault(subject, Counter())[level] += 1

    # --- the judgement ------------------------------------------------------------------------------------------------

    def judgement(self) -> Judgement:
        """All that was found until now."""
        scores = self.scores()
        passed, reasons = self.verdict(scores)
        return Judgement(
            passed, reasons, scores, self.missing(), self.hash, self.grid.unit, dict(sorted(self.refused.items()))
        )

    def scores(self) -> dict[str, Any]:
        """The scorecard's block "scores": for robots and objects, each level, together and by name."""
        found = {}
        for group, prefix in GROUPS.items():
            named = {s.removeprefix(prefix): by for s, by in sorted(self._scores.items()) if s.startswith(prefix)}
            together = {level: reduce(Score.merge, (by[level] for by in named.values()), Score()) for level in LEVELS}
            found[group] = {
                **{level: score.summary() for level, score in together.items()},
                "by_name": {name: {level: by[level].summary() for level in LEVELS} for name, by in named.items()},
            }
        return found

    def missing(self) -> dict[str, dict[str, int]]:
        """Samples that were not judged because a belief was missing: subject -> level -> how many."""
        return {subject: dict(sorted(counts.items())) for subject, counts in sorted(self._missing.items())}

    def verdict(self, scores: dict[str, Any]) -> tuple[bool, list[str]]:
        """Whether `scores` PASS, and every check that failed, or all of them where none did."""
        checks = [(f"robot/{robot}" in self._scores, f"{robot} was never judged") for robot in self.robots]
        objects = [subject for subject in {**self._scores, **self._missing} if subject.startswith("object/")]
        checks.append((not objects or scores["objects"]["solo"]["n"] > 0, "no object was ever judged"))
        failed = [text for passed, text in checks if not passed]
        compared = [check for group in GROUPS for check in self._checks(group, scores[group])]
        failed += [text for passed, text in compared if not passed]
        return not failed, failed or [text for _, text in compared]

    def _checks(self, group: str, scores: dict[str, Any]) -> list[tuple[bool, str]]:
        """[world.check] on a group's scores: whether each check passed, and what it compared."""
        solo, agreed, check = scores["solo"], scores["agreed"], self.check
        if not agreed["n"]:
            return []
        found = []
        limit = check.robots if group == "robots" else check.objects
        for name, unit, most in (("rmse", self.grid.unit, limit), ("entropy", "nats", check.entropy)):
            text = f"{group}: agreed {name} {agreed[name]:.3f} {unit}, solo {solo[name]:.3f}, asked {most:g} of it"
            found.append((agreed[name] <= most * solo[name], text))
        share = agreed["coverage"]["95"]
        text = f"{group}: agreed 95 % regions hold the truth in {100 * share:.1f} %, asked {100 * check.coverage:g} %"
        return [*found, (share >= check.coverage, text)]


def _extend(score: Score, one: Score) -> None:
    score.errors += one.errors
    score.entropies += one.entropies
    score.log_scores += one.log_scores
    score.levels += one.levels
