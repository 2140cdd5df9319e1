"""What one more robot adds: the belief of a robot, alone and fused with those of 1, 2, ... team-mates. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    """Scores of the cooperative belief, one row for each (instant, robot, subject), a column for each size 1..N of the team."""

    run: list[int] = field(default_factory=list)
    time: list[float] = field(default_factory=list)  # seconds
    subject: list[str] = field(default_factory=list)
    original: list[float] = field(default_factory=list)  # nats: entropy of what the robot itself believes
    entropies: list[list[float]] = field(default_factory=list)  # nats
    log_scores: list[list[float]] = field(default_factory=list)
    levels: list[list[float]] = field(default_factory=list)  # mass of the cells denser than the true one

    def merge(self, other: TeamSizeScores) -> TeamSizeScores:
        return TeamSizeScores(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def means(self, values: Array) -> Array:
        """The mean of values (rows, sizes) within each run, shape (runs, sizes)."""
        runs = np.asarray(self.run)
        return np.stack([values[runs == run].mean(axis=0) for run in np.unique(runs)])


def score_sizes(
    runs: Sequence[tuple[int, Run]], robots: Sequence[str], rules: Mapping[str, Rule]
) -> dict[str, TeamSizeScores]:
    """For each rule: every robot, its own place and the objects it sees, with the n - 1 mates that follow it by name.

    A mate without an opinion on the subject changes nothing, as on a board.
    """
    found = {name: TeamSizeScores() for name in rules}
    for number, run in runs:
        for case in run:
            for robot in _concerned(case):
                for name, rule in rules.items():
                    _row(found[name], number, case, _teams(robot, robots), rule)
    return found


def _concerned(case: Case) -> tuple[str, ...]:
    """The robots that a case is about: itself, or all that see the object."""
    kind, name = case.subject.split("/")
    return tuple(s for s in case.sources if kind == "object" or s == name)


def _teams(robot: str, robots: Sequence[str]) -> list[list[str]]:
    """The teams of 1, 2, ... robots that begin with this one."""
    first = list(robots).index(robot)
    order = [*robots[first:], *robots[:first]]
    return [order[: n + 1] for n in range(len(order))]


def _row(scores: TeamSizeScores, run: int, case: Case, teams: Sequence[Sequence[str]], rule: Rule) -> None:
    by_size, known = Score(), dict[tuple[str, ...], Score]()
    for team in teams:
        part = case.of(team)
        if part.sources not in known:
            one = Score()
            one.add(Belief(case.grid, fused(part, rule).p), case.truth)
            known[part.sources] = one
        by_size = by_size.merge(known[part.sources])
    own = Score()
    own.add(Belief(case.grid, case.of(teams[0]).opinions[0]), case.truth)
    scores.run.append(run)
    scores.time.append(case.time)
    scores.subject.append(case.subject)
    scores.original += own.entropies
    scores.entropies.append(by_size.entropies)
    scores.log_scores.append(by_size.log_scores)
    scores.levels.append(by_size.levels)
