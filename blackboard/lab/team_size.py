"""What one more robot adds: the belief of a robot, alone and fused with those of 1, 2, ... team-mates. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from blackboard.lab.cases import Case, Run
from blackboard.lab.comparison import fused
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.opinion.rules import Rule
from blackboard.opinion.scores import Score


@dataclass
class TeamSizeScores:
    """Scores of the cooperative belief, one row for each (instant, robot, subject), a column for each size of the team."""

    run: list[int] = field(default_factory=list)
    time: list[float] = field(default_factory=list)  # seconds
    subject: list[str] = field(default_factory=list)
    original: list[float] = field(default_factory=list)  # nats: entropy of what the robot itself believes
    entropies: list[list[float]] = field(default_factory=list)  # nats
    log_scores: list[list[float]] = field(default_factory=list)
    levels: list[list[float]] = field(default_factory=list)  # mass of the cells denser than the true one
    borders: list[list[float]] = field(default_factory=list)  # and of those as dense as it

    def merge(self, other: "TeamSizeScores") -> "TeamSizeScores":
        return TeamSizeScores(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def means(self, values: Array) -> Array:
        """The mean of values (rows, sizes) within each run, shape (runs, sizes)."""
        runs = np.asarray(self.run)
        return np.stack([values[runs == run].mean(axis=0) for run in np.unique(runs)])


def score_sizes(
    runs: Sequence[tuple[int, Run]],
    robots: Sequence[str],
    rules: Mapping[str, Rule],
    sizes: Sequence[int] | None = None,
) -> dict[str, TeamSizeScores]:
    """For each rule: every robot, its own place and the objects it sees, with the n - 1 mates that follow it by name.

    A mate without an opinion on the subject changes nothing, as on a board. `sizes` are the n that are scored [default: all].
    """
    scores = {name: TeamSizeScores() for name in rules}
    for number, run in runs:
        for case in run:
            for name, rule in rules.items():

                def pool(members: frozenset[str], case: Case = case, rule: Rule = rule) -> Belief:
                    return Belief(case.grid, fused(case.of(members), rule).p)

                add_case(scores[name], number, case, robots, sizes or range(1, len(robots) + 1), pool)
    return scores


def add_case(
    scores: TeamSizeScores,
    run: int,
    case: Case,
    robots: Sequence[str],
    sizes: Sequence[int],
    believed: Callable[[frozenset[str]], Belief],
) -> None:
    """The rows of a case, one for each robot that it is about; `believed` says what a team believes, and is asked once for each."""
    known: dict[frozenset[str], Score] = {}
    for robot in concerned(case):
        by_size = Score()
        for size in sizes:
            members = team(robot, robots, size)
            if members not in known:
                known[members] = _scored(believed(members), case)
            by_size = by_size.merge(known[members])
        scores.run.append(run)
        scores.time.append(case.time)
        scores.subject.append(case.subject)
        scores.original += _scored(Belief(case.grid, case.of((robot,)).opinions[0]), case).entropies
        scores.entropies.append(by_size.entropies)
        scores.log_scores.append(by_size.log_scores)
        scores.levels.append(by_size.levels)
        scores.borders.append(by_size.borders)


def concerned(case: Case) -> tuple[str, ...]:
    """The robots that a case is about: itself, or all that see the object."""
    kind, name = case.subject.split("/")
    return tuple(s for s in case.sources if kind == "object" or s == name)


def team(robot: str, robots: Sequence[str], size: int) -> frozenset[str]:
    """A robot and the `size` - 1 that follow it by name, round from the last to the first."""
    first = list(robots).index(robot)
    return frozenset([*robots[first:], *robots[:first]][:size])


def _scored(belief: Belief, case: Case) -> Score:
    score = Score()
    score.add(belief, case.truth)
    return score
