"""The referee: beliefs compared with the truth at each tick. Pure.

A sample is one robot, one subject (its own place, or an object) and one instant. Three beliefs must exist: what the robot
believed alone (`solo`), its sub-team's `consensus`, and what was `agreed` after the exchange. So the three are judged on the
same samples; where one is missing it is counted under its level. A robot in several sub-teams is judged once, in the first by
name, through which its evidence counts in the exchange. Robots that a [[fault]] is about are the group `faulty`, and what they
believe about objects is not judged.

[world.check] compares errors without the first seconds of a robot that comes back after it was gone. How far off it is until its next
fix or sighting is chance. Its errors against what it claims are judged in those seconds, too.
"""

import hashlib
import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from blackboard.config.world import CheckSection
from blackboard.errors import Refused
from blackboard.judge.attendance import Attendance
from blackboard.judge.calibration import Calibration, claimed_error, word
from blackboard.judge.causes import likely_causes
from blackboard.judge.forecasts import OUTSIDE, Forecasts
from blackboard.judge.instant import Instant
from blackboard.judge.motions import Motions
from blackboard.judge.samples import GROUPS, LEVELS, Keep, Sampler
from blackboard.judge.tally import Tally
from blackboard.judge.unnamed import UnnamedJudge
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import PackedBelief

FAULTY = "faulty"  # the group of the robots that a [[fault]] is about, where there are any

#: What was found in a tick about (subject, belief): its score of one entry, the belief, the error it claims; None: not unpacked.
Known = dict[tuple[str, PackedBelief], tuple[Score, Belief, float] | None]


Scores = dict[str, dict[str, Tally]]  # subject -> level -> scores


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
    honesty: dict[str, dict[str, Any]] = field(default_factory=dict)  # the scorecard's block "honesty"
    motion: dict[str, dict[str, Any]] = field(default_factory=dict)  # the scorecard's block "motion"
    lost: dict[str, Any] = field(default_factory=dict)  # the scorecard's block "lost"
    tracks: dict[str, Any] = field(default_factory=dict)  # the scorecard's block "tracks"
    identities: dict[str, Any] = field(default_factory=dict)  # the scorecard's block "identities"
    causes: list[str] = field(default_factory=list)  # what would explain a FAIL; empty where none fits, and of a PASS


class Referee:
    """Takes each instant once, in order; its `judgement` at the end has scores, hash and verdict."""

    def __init__(
        self,
        grid: Grid,
        check: CheckSection,
        robots: Sequence[str],
        record: Keep | None = None,
        *,
        faulty: Collection[str] = (),
        unnamed: Collection[str] = (),
    ) -> None:
        """`robots` are those of the scenario: each must have been heard for a PASS, but for those that are `faulty`.

        What is of a kind that is `unnamed` is judged by its tracks, and so are robots of no team.
        `record` is given every sample that counts.
        """
        self.grid, self.check, self.robots, self._record = grid, check, tuple(robots), record
        self.faulty = frozenset(faulty)
        self.refused: Counter[str] = Counter()
        self._hash = hashlib.sha256()
        self._scores: Scores = {}
        self._returned: Scores = {}  # of robots that came back and are not settled yet; not in `_scores`
        self._attendance = Attendance()
        self._took_part: set[str] = set()  # robots
        self._company: Counter[str] = Counter()  # subject -> samples whose agreed belief rests on several robots
        self._calibrations: dict[tuple[str, str], Calibration] = {}  # subject and level
        self._motions = Motions()
        self._lost = Forecasts()
        self._unnamed = UnnamedJudge(grid, check.track, unnamed)
        self._sampler = Sampler()

    @property
    def hash(self) -> str:
        """sha256 over the payloads of all consensuses, sorted by tick, sub-team, level, subject."""
        return self._hash.hexdigest()

    def judge_instant(self, instant: Instant, judged: bool) -> None:
        """Take a tick that is over: into the hash, and into the scores where it is `judged`."""
        for name in sorted(instant.consensuses):
            payload, _ = instant.consensuses[name]
            self._hash.update(payload)
        self._sampler.begin_tick(instant.truth, instant.landmark_seen)
        self._attendance.note_heard(instant.solos.keys(), instant.truth.time)
        if not judged:
            return
        known: Known = {}
        objects = [s for s in instant.truth.positions if s.startswith("object/") and not self._unnamed.is_unnamed(s)]
        sub_team_of = {robot: name for name in sorted(instant.teams, reverse=True) for robot in instant.teams[name]}
        self._took_part |= sub_team_of.keys()
        for robot in sorted(set(self.robots) - sub_team_of.keys()):
            self._attendance.note_missing(f"robot/{robot}", instant.truth.time, ["solo"])
        for robot in sorted(sub_team_of):
            for subject in (f"robot/{robot}", *([] if robot in self.faulty else objects)):
                if subject in instant.truth.positions:
                    self._sample(instant, robot, sub_team_of[robot], subject, known)
        self._judge_motions(instant, sub_team_of)
        self._unnamed.judge_instant(instant, {*self.robots, *sub_team_of})

    def _judge_motions(self, instant: Instant, sub_team_of: Mapping[str, str]) -> None:
        """Each robot's by its sub-team, but for those that are faulty, and each object's by the first sub-team."""
        for subject in instant.truth.positions:
            kind, _, name = subject.partition("/")
            if kind == "object" and instant.teams:
                self._motions.judge_subject(instant, min(instant.teams), subject)
            elif name in sub_team_of and name not in self.faulty:
                self._motions.judge_subject(instant, sub_team_of[name], subject)

    def _sample(self, instant: Instant, robot: str, sub_team: str, subject: str, known: Known) -> None:
        scored = {}
        for level in LEVELS:
            packed = instant.belief(level, robot, sub_team, subject)
            judged = None
            if packed is not None:
                if (subject, packed) not in known:
                    known[subject, packed] = self._score(packed, instant.truth.positions[subject])
                judged = known[subject, packed]
            if judged is not None:
                scored[level] = judged
        self._attendance.note_missing(subject, instant.truth.time, [level for level in LEVELS if level not in scored])
        if len(scored) == len(LEVELS):
            self._company[subject] += len(instant.sources("agreed", robot, sub_team, subject)) > 1
            lost = self._judge_lost(instant, sub_team, subject, scored["agreed"][0])
            scores = self._scores if self._attendance.is_settled(robot, instant.truth.time) else self._returned
            for level, (score, belief, claimed) in scored.items():
                scores.setdefault(subject, {}).setdefault(level, Tally()).add(score)
                calibration = self._calibrations.setdefault((subject, level), Calibration())
                calibration.add(instant.truth.time, score, claimed)
                if self._record is not None:
                    about = {"sub_team": sub_team, "level": level, "lost": lost if level == "agreed" else math.nan}
                    sources = len(instant.sources(level, robot, sub_team, subject))
                    self._record(self._sampler.sample(belief, score, robot, subject, sources=sources, **about))

    def _judge_lost(self, instant: Instant, sub_team: str, subject: str, score: Score) -> float:
        """The agreed probability that a robot is lost, NaN where there is none; it is counted with whether the robot was lost."""
        agreed = instant.consensus(sub_team, "agreed", subject)
        if agreed is None or agreed.lost is None:
            return math.nan
        self._lost.add(agreed.lost, score.levels[0] > OUTSIDE)
        return agreed.lost

    def _score(self, packed: PackedBelief, truth: Sequence[float]) -> tuple[Score, Belief, float] | None:
        score = Score()
        try:
            belief = unpack(packed, self.grid)
        except Refused as refusal:
            self.refused[refusal.reason] += 1
            return None
        score.add(belief, truth)
        return score, belief, claimed_error(belief)

    def judgement(self) -> Judgement:
        """All that was found until now."""
        scores = self.scores()
        passed, reasons = self.verdict()
        honesty, missing, unit = self.honesty(), self.missing(), self.grid.unit
        company = {subject: count / self._attendance.judged[subject] for subject, count in self._company.items()}
        robots = {robot: robot in self._took_part for robot in self.robots if robot not in self.faulty}
        causes = [] if passed else likely_causes(scores, honesty, missing, company, robots, unit)
        refused = dict(sorted(self.refused.items()))
        unnamed = self._unnamed.tracks(), self._unnamed.identities()
        blocks = (honesty, self._motions.summary(), self._lost.summary(), *unnamed)
        return Judgement(passed, reasons, scores, missing, self.hash, unit, refused, *blocks, causes)

    def scores(self) -> dict[str, Any]:
        """The scorecard's block "scores": for robots and objects, each level, together and by name; `faulty` where there are any."""
        return self._grouped(_joined(self._scores, self._returned))

    def _grouped(self, among: Scores) -> dict[str, Any]:
        scores = {}
        for group in (*GROUPS, *([FAULTY] if self.faulty else [])):
            named = {s.split("/", 1)[1]: among[s] for s in self._subjects(group, among)}
            together = {level: Tally.merged(by[level] for by in named.values()) for level in LEVELS}
            scores[group] = {
                **{level: score.summary() for level, score in together.items()},
                "by_name": {name: {level: by[level].summary() for level in LEVELS} for name, by in named.items()},
            }
        return scores

    def honesty(self) -> dict[str, dict[str, Any]]:
        """The scorecard's block "honesty": for each group and level one word, and each coverage with its 95 % interval."""
        honesty: dict[str, dict[str, Any]] = {}
        for group in GROUPS:
            for level in LEVELS:
                subjects = self._subjects(group, self._scores)
                coverage = Calibration.merged(self._calibrations[subject, level] for subject in subjects).coverage()
                spans = {str(at): {"share": c.value, "low": c.low, "high": c.high} for at, c in coverage.items()}
                honesty.setdefault(group, {})[level] = {"word": word(coverage), "coverage": spans}
        return honesty

    def _subjects(self, group: str, among: Iterable[str]) -> list[str]:
        mine = [subject for subject in among if subject.startswith(GROUPS.get(group, "robot/"))]
        if group == "objects":
            return sorted(mine)
        return sorted(s for s in mine if (s.removeprefix("robot/") in self.faulty) == (group == FAULTY))

    def missing(self) -> dict[str, dict[str, int]]:
        """Samples that were not judged because a belief was missing: subject -> level -> how many."""
        return {subject: dict(sorted(counts.items())) for subject, counts in sorted(self._attendance.missing.items())}

    def verdict(self) -> tuple[bool, list[str]]:
        """Whether all that was found until now is a PASS, and every check that failed, or all of them where none did."""
        scores = self._grouped(self._scores)
        checks = [(f"robot/{r}" in self._scores, f"{r} was never judged") for r in self.robots if r not in self.faulty]
        objects = [subject for subject in {**self._scores, **self._attendance.missing} if subject.startswith("object/")]
        checks.append((not objects or scores["objects"]["solo"]["n"] > 0, "no object was ever judged"))
        failed = [text for passed, text in checks if not passed]
        lacking = self._attendance.lacking
        expected = [*self._subjects("robots", lacking), *self._subjects("objects", lacking)]
        failed += self._attendance.reasons(expected, self.check.missing)
        compared = [check for group in GROUPS for check in self._checks(group, scores[group])]
        failed += [text for passed, text in compared if not passed]
        return not failed, failed or [text for _, text in compared]

    def _checks(self, group: str, scores: dict[str, Any]) -> list[tuple[bool, str]]:
        """[world.check] on a group's scores: whether each check passed, and what it compared."""
        solo, agreed, check = scores["solo"], scores["agreed"], self.check
        if not agreed["n"]:
            return []
        checks = []
        limit = check.robots if group == "robots" else check.objects
        for name, unit, most in (("rmse", self.grid.unit, limit), ("entropy", "nats", check.entropy)):
            text = f"{group}: agreed {name} {agreed[name]:.3f} {unit}, solo {solo[name]:.3f}, asked {most:g} of it"
            checks.append((agreed[name] <= most * solo[name], text))
        share = agreed["coverage"]["95"]
        text = f"{group}: agreed 95 % regions hold the truth in {100 * share:.1f} %, asked {100 * check.coverage:g} %"
        return [*checks, (share >= check.coverage, text), *self._honesty(group, solo)]

    def _honesty(self, group: str, solo: Mapping[str, Any]) -> list[tuple[bool, str]]:
        """Whether a group's beliefs are as good as they claim: the errors of robots alone, and the regions of what was agreed."""
        checks, check, unit = list[tuple[bool, str]](), self.check, self.grid.unit
        subjects = self._subjects(group, self._scores)
        if group == "robots":
            whole = Calibration.merged(self._calibrations[subject, "solo"] for subject in subjects)
            named = {"robots": whole, **{subject: self._calibrations[subject, "solo"] for subject in subjects}}
            for name, calibration in named.items():
                error, claimed = calibration.rmse()
                far = calibration.is_far_above_its_claim(check.claim)
                text = f"{name}: solo rmse {error:.3f} {unit}, its beliefs claim {claimed:.3f}, asked {check.claim:g} of it"
                if far or name == "robots":
                    checks.append((not far, text))
            if check.solo is not None:
                checks.append(
                    (solo["rmse"] <= check.solo, f"robots: solo rmse {solo['rmse']:.3f} {unit}, at most {check.solo:g}")
                )
        agreed = Calibration.merged(self._calibrations[subject, "agreed"] for subject in subjects)
        for level, share in agreed.coverage().items():
            least, most = level / 100 - check.calibration, level / 100 + check.calibration
            off = share.is_above(most) or share.is_below(least)
            low, high = (f"{100 * end:.0f}" for end in (share.low, share.high) if end is not None)
            text = (
                f"{group}: agreed {level} % regions hold the truth in {100 * share.value:.1f} %, whose interval of "
                f"{low} to {high} {'misses' if off else 'reaches'} the "
                f"{100 * max(0.0, least):g} to {100 * min(1.0, most):g} asked"
            )
            checks.append((not off, text))
        return checks


def _joined(first: Scores, second: Scores) -> Scores:
    """The scores of both. What only one has is shared, and not copied."""
    joined = {**second, **first}
    for subject in first.keys() & second.keys():
        joined[subject] = {level: Tally.merged((first[subject][level], second[subject][level])) for level in LEVELS}
    return joined
