"""What `blackboard.view.why.explain` found, in plain sentences: the answer, then who, then the numbers. Pure.

What did not change anything is left out; the JSON has it.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from blackboard.opinion.gaussian.coalitions import PREDICTION, named
from blackboard.opinion.gaussian.distrust import DISTRUSTED
from blackboard.opinion.gaussian.priors import found_in
from blackboard.state.alarms import LIKELY_LOST
from blackboard.view.why import JOINT, away

Table = dict[str, Any]

LITTLE = 0.01  # nats, and sigmas by which the mean moves: a source without which less would change changed nothing
NOTEWORTHY = 0.2  # by which a variance or a correlation is off before it is mentioned


def sentences(told: Table) -> list[str]:
    """The sentences, in groups that an empty one parts: the answer, who, the numbers, and then each sub-team's own belief."""
    first, *others = told["levels"]
    lines = [_answer(first, told)]
    if first["truth"] is not None:
        lines.append(_truth(first, told["unit"]))
    lines += _motion(first, told["unit"])
    lines += ["", _agreement(told), *_who(first, told), "", *_numbers(first, told)]
    for level in others:
        if None in (level["mean"], first["mean"]) or not _is_same(level, first):
            lines += ["", f"Sub-team {level['sub_team']} by itself: {_place(level, told['unit'])}.", *_who(level, told)]
            lines += _numbers(level, told)
        elif first["rule"] != JOINT:
            lines += ["", f"Sub-team {level['sub_team']} believes the same by itself.", *_who(level, told)]
    return lines


def _answer(level: Table, told: Table) -> str:
    """The question answered in one sentence: where, how surely, and by whom."""
    if level["mean"] is None:
        return f"What is believed about {told['subject']} cannot be read."
    ignored = [named(out["source"]) for out in level["left_out"]]
    but = f"; {_and(ignored)} {'was' if len(ignored) == 1 else 'were'} ignored" if ignored else ""
    but += f"; {away(told['absent'])}" if told["absent"] is not None else ""
    return f"{told['subject']} is believed to be {_place(level, told['unit'])}, because {_because(level)}{but}."


def _because(level: Table) -> str:
    names = list(dict.fromkeys(source["source"] for source in level["sources"]))
    if level["rule"] == JOINT:
        if not names:
            return "no robot said anything new about it in this tick: it is predicted from before"
        return f"{_and(names)} said so in this tick, and the team before"
    if len(names) == 1:
        told = sorted(level["ancestors"])
        return f"{_and(told) if told else names[0]} said so, and nobody else did"
    if not names:
        return "its board says so, and not who said it"
    weights = {name: _importance(level, name) for name in names}
    main = max(names, key=lambda name: weights[name])
    rest = [_whom(level, name) for name in names if name != main and not _is_idle(level["without"].get(name))]
    less = f", and what {_and(rest)} said counted less" if rest else ", and what the others said changed nothing"
    return f"{_whom(level, main)} said so{less}"


def _whom(level: Table, source: str) -> str:
    """A source of a belief, in a sentence: sub-teams agree with each other, and robots report."""
    return f"sub-team {source}" if level["level"] == "agreed" and level["rule"] != JOINT else source


def _importance(level: Table, name: str) -> float:
    """What would change without a source; where that is not known, its weight."""
    change = level["without"].get(name)
    if change:
        return math.inf if change["nats"] is None else float(change["nats"])
    return sum(float(source["weight"]) for source in level["sources"] if source["source"] == name)


def _is_idle(change: Table | None) -> bool:
    """Whether nothing would change without a source, as far as that is known."""
    nats = change["nats"] if change else None
    return isinstance(nats, float) and nats < LITTLE


def _is_same(level: Table, first: Table) -> bool:
    near = math.dist(level["mean"], first["mean"]) < LITTLE * max(first["sigma"], 1e-9)
    return near and bool(abs(level["entropy"] - first["entropy"]) < LITTLE)


def _place(level: Table, unit: str) -> str:
    if level["mean"] is None:
        return "a belief that cannot be read"
    return f"at {_point(level['mean'])} {unit}, give or take {level['sigma']:.2f}"


def _truth(level: Table, unit: str) -> str:
    truth = level["truth"]
    return (
        f"The truth is {truth['error']:.2f} {unit} away, {'inside' if truth['inside'] else 'outside'} the 95 % region."
    )


def _motion(level: Table, unit: str) -> list[str]:
    """Where it heads, and how fast it moves, as far as that is known."""
    told = []
    if level["heading"] is not None:
        told.append(
            f"heads {math.degrees(level['heading']):.0f} degrees, give or take {math.degrees(level['heading_sigma']):.2f}"
        )
    if level["velocity"] is not None:
        speed, sigma = math.hypot(*level["velocity"][:2]), max(level["velocity_sigma"][:2])
        told.append(f"moves at {speed:.2f} {unit}/s, give or take {sigma:.2f}")
    lost = level["lost"]
    lines = [f"It {', and '.join(told)}."] if told else []
    if level["parameters"].get(DISTRUSTED) == 1.0:
        lines.append("Its mates saw it elsewhere than its odometry led, which is not believed until it fits again.")
    if found := [f"{name} {value:.3g}" for name, value in found_in(level["parameters"]).items()]:
        lines.append(f"Its sensors err by more than it was told: {_and(found)}; `blackboard calibrate` measures them.")
    return lines + (
        [f"With {100 * lost:.0f} % it is lost, and not there."] if lost is not None and lost >= LIKELY_LOST else []
    )


def _agreement(told: Table) -> str:
    level = told["levels"][0]
    if level["level"] != "agreed":
        return f"Sub-team {level['sub_team']} believes it; nothing is agreed on yet."
    shown = f", not quite the same: the numbers here are those of {told['agreed_by'][0]}" if told["agreed_by"] else ""
    same = "" if told["same"] or len(told["agreed_by"]) < 2 else shown
    before = "".join(f"; {name} agreed last in tick {tick}" for name, tick in told["agreed_before"].items())
    return f"Agreed by {_and(told['agreed_by'])}{same}{before}."


def _who(level: Table, told: Table) -> list[str]:
    """Who is behind a belief, who was ignored, and what is known against whom."""
    lines = _joint(level) if level["rule"] == JOINT else _pooled(level, told["unit"])
    lines += [f"{_whose(out['source'])} was ignored: {out['reason']}." for out in level["left_out"]]
    lines += [_dissent(one) for one in level["dissent"]] + _camps(level["camps"])
    return lines + [line for one in level["learned"] if (line := _learned(one))]


def _whose(source: str) -> str:
    return "The prediction" if source == PREDICTION else f"What {source} said"


def _joint(level: Table) -> list[str]:
    lines = []
    if level["sources"]:
        each = ", ".join(
            f"{source['source']} (entropy {source['entropy']:.2f} nats by itself)" for source in level["sources"]
        )
        lines.append(f"New in this tick is what they said: {each}.")
    if level["existence"] is not None:
        lines.append(
            f"It is a track of something without a name, which is there with {100 * level['existence']:.1f} %."
        )
    lines += _unnamed(level["unnamed"])
    if len(level["components"]) > 1:
        lines.append(_coalitions(level["components"]))
    return lines


def _unnamed(sightings: Sequence[Table]) -> list[str]:
    """Whose sightings without a name clearly are this, and with which odds others may be."""
    clear = dict.fromkeys(one["source"] for one in sightings if one["taken"])
    lines = [f"{_and(list(clear))} saw it without a name, and it clearly is this."] if clear else []
    for one in sightings:
        if not one["taken"] and one["probability"] >= LITTLE:
            share = 100 * one["probability"]
            lines.append(
                f"Something that {one['source']} saw is this with {share:.0f} %; that is not clear, and it counts by that share."
            )
    return lines


def _pooled(level: Table, unit: str) -> list[str]:
    lines = []
    if level["outcome"] != "pooled":
        lines.append(f"A veto left the rule no cell, so another rule was taken ({level['outcome']}).")
    if len(level["components"]) > 1:
        lines.append(_coalitions(level["components"]))
    if level["conflict"]:
        lines.append("There is a conflict: somebody is surer alone than all together, or contradicts them.")
    many = len({source["source"] for source in level["sources"]}) > 1
    if many or not level["without"]:
        lines += [_said(source) for source in level["sources"] if source["weight"] >= LITTLE]
    return lines + _without(level["without"], unit) + _recomputed(level["recomputed"])


def _without(changes: Mapping[str, Table], unit: str) -> list[str]:
    """What would be believed without each source; empty is what was not computed."""
    idle = [name for name, change in changes.items() if change and _is_idle(change)]
    lines = []
    for name, change in changes.items():
        if change and name not in idle:
            nats = "infinitely far" if change["nats"] is None else f"{change['nats']:.3f} nats"
            lines.append(f"Without {name} it would be {change['shift']:.2f} {unit} from there ({nats} away).")
    return [*lines, f"{_and(idle)} changed nothing."] if idle else lines


def _recomputed(nats: float | None) -> list[str]:
    """How far what was computed again is from what the board published, where it is; None: nothing was."""
    if nats is None:
        return ["What would be without a source cannot be said: not everything that was pooled was seen here."]
    if nats > LITTLE:
        return [f"Computed again here it is {nats:.3f} nats from what the board published, so take these as rough."]
    return []


def _said(source: Table) -> str:
    power = f", taken to the power {source['power']:.2f}" if source["power"] < 0.995 else ""
    what = f"entropy {source['entropy']:.2f} nats, {source['age']:.1f} s old{power}"
    if source["how"] == "independent":
        return f"{source['source']}, first-hand: weight {source['weight']:.2f}, {what}."
    others = [name for name in source["contains"] if name != source["source"]]
    twice = f" It holds what {_and(others)} said and was counted already, so it" if others else " It"
    return f"{source['source']}, informed: {what}.{twice} was averaged in, not multiplied, with {100 * source['weight']:.0f} %."


def _coalitions(shares: Sequence[float]) -> str:
    """By how many sources each share of a belief stands: `shares` of one, two, ... all."""
    n = len(shares)
    parts = list[str]()
    for q, share in sorted(enumerate(shares, 1), reverse=True):
        if share >= 0.005:
            who = ("both sources" if n == 2 else f"all {n} sources") if q == n else f"{q} of {n}"
            right = f"that {who} {'is' if q == 1 and n > 1 else 'are'} right"
            parts.append(f"{100 * share:.0f} % {'of this belief assumes ' if not parts else ''}{right}")
    return f"{', '.join(parts)}."


def _numbers(level: Table, told: Table) -> list[str]:
    """Tick, region, entropy, score, rule; whose information it is."""
    old = "" if level["tick"] == told["tick"] else f", of tick {level['tick']}"
    parts = [f"tick {told['tick']} ({told['time']:.1f} s of team time){old}"]
    if level["area"] is not None:
        parts.append(f"95 % region {_short(level['area'])} {told['unit']}^2")
    parts.append(f"entropy {level['entropy']:.2f} nats")
    if level["truth"] is not None:
        parts.append(f"log score {level['truth']['log_score']:.2f} nats")
    table = ", ".join(f"{name} {_short(value)}" for name, value in sorted(level["parameters"].items()))
    rule = "one joint belief of the whole team, without weights" if level["rule"] == JOINT else f"rule {level['rule']}"
    parts.append(rule + (f" ({table})" if table else ""))
    return [f"Numbers: {'; '.join(parts)}.", *_ages(level)]


def _ages(level: Table) -> list[str]:
    if not level["ancestors"]:
        return []
    oldest = max(level["ancestors"], key=lambda name: level["ancestors"][name])
    age = level["ancestors"][oldest]
    rest = f"; the oldest of it, of {oldest}, is {age:.1f} s old" if age > 0.05 else ""
    return [f"In all it rests on what {_and(sorted(level['ancestors']))} said{rest}."]


def _learned(one: Table) -> str:
    """What was learned of a source, empty where that is next to nothing."""
    times, samples = math.sqrt(max(0.0, one["variance"])), f" (from {one['samples']:.0f} comparisons)"
    if one["samples"] <= 0:
        return ""
    if one["echo"]:
        return f"{one['source']} is an echo of {one['echo']}{samples}."
    told = []
    if abs(one["variance"] - 1.0) > NOTEWORTHY:
        told.append(f"are {times:.1f} times what it claims")
    if one["correlation"] > NOTEWORTHY:
        told.append(f"go with those of others by {100 * one['correlation']:.0f} %")
    return f"The errors of {one['source']} {' and '.join(told)}{samples}." if told else ""


def _dissent(one: Table) -> str:
    return (
        f"{one['source']} keeps disagreeing with the others, for {one['for']:.0f} s now, by {one['sigmas']:.1f} sigmas: "
        f"it counts by {100 * one['weight']:.0f} %."
    )


def _camps(camps: Sequence[Table]) -> list[str]:
    if not camps:
        return []
    each = "; ".join(f"{_and(camp['sources'])} with {100 * camp['weight']:.0f} % of the weight" for camp in camps)
    return [f"Camps of one size contradict each other, and nobody can tell which is right: {each}."]


def _and(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names) or "nobody"


def _point(point: Sequence[float]) -> str:
    return f"({', '.join(f'{x:.2f}' for x in point)})"


def _short(value: str | float) -> str:
    """A value as it is read best: three digits, and no powers of ten where it is large."""
    return value if isinstance(value, str) else f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.3g}"
