"""Why a run did not PASS: what its scores suggest as the likely cause, in sentences that name who and what to look at. Pure.

A reason (`Referee.verdict`) says which check failed; a cause says what in the run would explain it. Causes are guesses from
the scores, by the thresholds below; where none of them fits, none is named.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from blackboard.judge.calibration import CONFIDENT

SAME = 0.01  # agreed and solo RMSE that differ by a smaller share are the same
OFF = 2.0  # a robot is off where its RMSE is so many times that of all others together
AWAY = 0.2  # a robot was away where a larger share of its own beliefs is missing
ALONE = 0.1  # a source is alone where others contributed in a smaller share of the ticks

Scores = Mapping[str, Any]  # the scorecard's block "scores"
Honesty = Mapping[str, Mapping[str, Mapping[str, Any]]]  # the scorecard's block "honesty"


def likely_causes(
    scores: Scores,
    honesty: Honesty,
    missing: Mapping[str, Mapping[str, int]],
    company: Mapping[str, float],
    robots: Mapping[str, bool],
    unit: str,
) -> list[str]:
    """Every cause that fits, of robots first.

    `missing` is the scorecard's block; `company` the share of its samples to which more than one robot contributed in what was
    agreed about a subject; `robots` are those that must be heard, and whether each ever took part.
    """
    away = _away(scores, missing)
    return [
        *_never_heard(scores, missing, robots),
        *(
            f"{robot} was not heard in {100 * share:.0f} % of the run: look for what stopped it in its log"
            for robot, share in away.items()
        ),
        *_never_seen(scores, missing),
        *_who_is_off({name: by for name, by in scores["robots"]["by_name"].items() if name not in away}, unit),
        *_no_gain(scores, company, away),
        *_overconfident(honesty),
    ]


def _never_heard(scores: Scores, missing: Mapping[str, Mapping[str, int]], robots: Mapping[str, bool]) -> list[str]:
    """Robots that were never judged: gone, silent, or without a consensus."""
    absent, causes = [], []
    for robot, took_part in robots.items():
        lacking = missing.get(f"robot/{robot}", {})
        if robot in scores["robots"]["by_name"] or not lacking:
            continue
        if not took_part:
            absent.append(robot)
        elif "solo" in lacking:
            causes.append(
                f"{robot} takes part and sends no belief of its own: look at its log, or at `blackboard status`"
            )
        else:
            levels = " and ".join(sorted(lacking))
            causes.append(
                f"{robot} reports, but its board made no {levels} of it: see what was refused (messages.refused)"
            )
    if absent:
        causes.insert(0, f"{_names(absent)} never took part: look for the end of its process in the log above")
    return causes


def _away(scores: Scores, missing: Mapping[str, Mapping[str, int]]) -> dict[str, float]:
    """Robots that were judged, and still not heard in more than AWAY of the run: in which share."""
    shares = {}
    for robot, levels in scores["robots"]["by_name"].items():
        lacking = missing.get(f"robot/{robot}", {}).get("solo", 0)
        if lacking > AWAY * (lacking + levels["solo"]["n"]):
            shares[robot] = lacking / (lacking + levels["solo"]["n"])
    return shares


def _never_seen(scores: Scores, missing: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Objects that were never judged."""
    never = [s for s in missing if s.startswith("object/") and s.split("/", 1)[1] not in scores["objects"]["by_name"]]
    unseen = [subject for subject in never if "solo" in missing[subject]]
    causes = [f"no robot ever saw {_names(unseen)}: too short a run, or out of everybody's view"] if unseen else []
    rest = [subject for subject in never if subject not in unseen]
    return [
        *causes,
        *(f"{subject} was seen, but no board made a consensus of it (messages.refused)" for subject in rest),
    ]


def _who_is_off(by_name: Mapping[str, Any], unit: str) -> list[str]:
    """The robot whose error stands out, alone or in what the team agrees on."""
    for level, why in (
        ("solo", "it lost itself on its own readings: its sensors, or its model of them, are to blame"),
        ("agreed", "what others say of it leads astray: record it (--record run.mcap), and `{why}` names them"),
    ):
        errors = {name: levels[level]["rmse"] for name, levels in by_name.items() if levels[level]["n"]}
        if len(errors) < 2:
            continue
        worst = max(errors, key=lambda name: errors[name])
        others = _together(levels[level] for name, levels in by_name.items() if name != worst)
        if errors[worst] > OFF * others:
            off = f"{worst} is off: {level} rmse {errors[worst]:.3f} {unit}, the other robots' {others:.3f}"
            return [f"{off}; {why.format(why=_why(f'robot/{worst}'))}"]
    return []


def _why(subject: str) -> str:
    """The command that says why a subject is believed to be where it is, of a run that was recorded."""
    return f"blackboard why {subject} run.mcap"


def _no_gain(scores: Scores, company: Mapping[str, float], away: Collection[str]) -> list[str]:
    """Subjects about which the team knows no more than each robot by itself, and whether another robot reported on them.

    Of robots that were away nothing is said.
    """
    alone, useless = list[str](), list[str]()
    for group, prefix in (("robots", "robot/"), ("objects", "object/")):
        for name, levels in scores[group]["by_name"].items():
            solo, agreed = levels["solo"]["rmse"], levels["agreed"]["rmse"]
            if prefix == "robot/" and name in away:
                continue
            if levels["agreed"]["n"] and abs(agreed - solo) <= SAME * solo:
                (alone if company.get(prefix + name, 0.0) < ALONE else useless).append(prefix + name)
    causes = []
    if alone:
        causes.append(
            f"agreed equals solo for {_names(alone)}: nobody else had anything to say of it in more than {100 * ALONE:g} % "
            "of the ticks; robots that see each other, or share what they see, are needed for a gain"
        )
    if useless:
        causes.append(
            f"agreed equals solo for {_names(useless)} although others contributed: what they say weighs next to nothing "
            f"against its own; record the run (--record run.mcap), and `{_why(useless[0])}` shows the weights"
        )
    return causes


def _overconfident(honesty: Honesty) -> list[str]:
    """Whether regions that are too small come from the robots themselves, or from putting beliefs together."""
    causes = []
    for group, levels in honesty.items():
        solo, agreed = (levels.get(level, {}).get("word") for level in ("solo", "agreed"))
        if solo == CONFIDENT:
            causes.append(
                f"{group}: over-confident already alone: their models claim less noise than there is ([robot])"
            )
        elif agreed == CONFIDENT:
            causes.append(
                f"{group}: not over-confident alone, but in what is agreed: errors that sources share were taken as "
                "independent ([board] independence), or a source is wrong"
            )
    return causes


def _together(blocks: Iterable[Mapping[str, Any]]) -> float:
    """The RMSE of several blocks S as one."""
    some = [(block["n"], block["rmse"]) for block in blocks if block["n"]]
    return float((sum(n * rmse**2 for n, rmse in some) / sum(n for n, _ in some)) ** 0.5)


def _names(some: Sequence[str]) -> str:
    return ", ".join(some)
