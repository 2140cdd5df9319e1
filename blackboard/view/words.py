"""What `blackboard.view.why.explain` found, in plain sentences with numbers. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from blackboard.view.why import JOINT

Table = dict[str, Any]


def sentences(it: Table) -> list[str]:
    """The sentences, in groups that an empty one parts: the subject, then each level."""
    unit = it["unit"]
    found = [f"{it['subject']} in tick {it['tick']} ({it['time']:.1f} s of team time)."]
    if it["truth"] is None:
        found.append("Nobody says what is true.")
    for level in it["levels"]:
        found += ["", *_belief(level, it, unit)]
        if level["level"] == "agreed":
            found += [f"{name} agreed last in tick {tick}." for name, tick in it["agreed_before"].items()]
        found += _joint(level) if level["rule"] == JOINT else _pooled(level, unit)
        found += [f"{out['source']} was left out: {out['reason']}." for out in level["left_out"]]
        found += [_dissent(one) for one in level["dissent"]] + _camps(level["camps"])
        found += _ages(level) + [_learned(one) for one in level["learned"] if one["samples"] > 0]
    return found


def _belief(level: Table, it: Table, unit: str) -> list[str]:
    who = f"Sub-team {level['sub_team']}"
    if level["level"] == "agreed":
        same = "the same" if it["same"] else "not quite the same; this is what the first one has"
        who = f"Agreed by {_and(it['agreed_by'])}" + (f" ({same})" if len(it["agreed_by"]) > 1 else "")
    if level["mean"] is None:
        return [f"{who}: a belief that cannot be read."]
    old = "" if level["tick"] == it["tick"] else f" It is of tick {level['tick']}."
    where = (
        f"{who}: at {_place(level['mean'])} {unit}, sigma {level['sigma']:.2f}; the 95 % region has {level['area']:.3g} {unit}^2, "
        f"the entropy is {level['entropy']:.2f} nats.{old}"
    )
    truth = level["truth"]
    if truth is None:
        return [where]
    inside = "inside" if truth["inside"] else "outside"
    said = (
        f"The truth is {truth['error']:.2f} {unit} away, at {_place(it['truth'])}: {inside} the 95 % region "
        f"({100 * truth['denser']:.0f} % of the mass is denser there), log score {truth['log_score']:.2f} nats."
    )
    return [where, said]


def _joint(level: Table) -> list[str]:
    used = [source["source"] for source in level["sources"]]
    found = ["It is a marginal of the joint Gaussian of the whole team, so no single opinion has a weight in it."]
    if used:
        each = ", ".join(f"{source['source']} {source['entropy']:.2f}" for source in level["sources"])
        found.append(
            f"This tick's evidence about it came from {_and(used)}. Entropy of what each says, in nats: {each}."
        )
    else:
        found.append("No evidence about it came in this tick: it was predicted.")
    if level["components"]:
        found.append("Evidence contradicted the prediction. " + _coalitions(level["components"]))
    return found


def _pooled(level: Table, unit: str) -> list[str]:
    table = ", ".join(f"{name} {_short(value)}" for name, value in sorted(level["parameters"].items()))
    count = len({source["source"] for source in level["sources"]})
    found = [
        f"Pooled from {count} {_plural('source', count)} by the rule {level['rule']}"
        + (f" ({table})." if table else ".")
    ]
    if level["outcome"] != "pooled":
        found.append(f"A veto left the rule no cell, so another rule was taken ({level['outcome']}).")
    if len(level["components"]) > 1:
        found.append(_coalitions(level["components"]))
    if level["conflict"]:
        found.append("There is a conflict: somebody is surer alone than all together, or contradicts them.")
    found += [_said(source) for source in level["sources"]]
    for name, change in level["without"].items():
        if not change:
            found.append(f"Without {name} there would be no belief at all.")
            continue
        nats = "infinitely far" if change["nats"] is None else f"{change['nats']:.3f} nats"
        found.append(
            f"Without {name} the belief would be {nats} away (Kullback-Leibler) and its mean would move {change['shift']:.2f} {unit}."
        )
    if level["recomputed"] is None:
        found.append("What would be without a source cannot be said: not everything that was pooled was seen here.")
    elif level["recomputed"] > 0.01:
        found.append(
            f"Computed again here it is {level['recomputed']:.3f} nats from what the board published, so take these as rough."
        )
    return found


def _said(source: Table) -> str:
    power = f", taken to the power {source['power']:.2f}" if source["power"] < 0.995 else ""
    what = f"entropy {source['entropy']:.2f} nats, {source['age']:.1f} s old{power}"
    if source["how"] == "independent":
        return f"{source['source']}, first-hand: weight {source['weight']:.2f}, {what}."
    others = [name for name in source["contains"] if name != source["source"]]
    twice = f" It contains information of {_and(others)} that was counted already, so it" if others else " It"
    part = f"was averaged in and not multiplied, with a share of {source['weight']:.2f}"
    if source["weight"] < 0.005:
        part = "added nothing"
    return f"{source['source']}, informed: {what}.{twice} {part}."


def _coalitions(shares: Sequence[float]) -> str:
    n = len(shares)
    parts = [f"{q} of {n}: {100 * share:.0f} %" for q, share in enumerate(shares, 1) if share >= 0.005]
    return f"Coalitions of so many hold so much of the choice: {', '.join(reversed(parts))}."


def _ages(level: Table) -> list[str]:
    old = {name: age for name, age in level["ancestors"].items() if age > 0.05}
    if not level["ancestors"]:
        return []
    oldest = max(level["ancestors"], key=lambda name: level["ancestors"][name])
    rest = f"; the oldest of it, of {oldest}, is {level['ancestors'][oldest]:.1f} s old" if old else ""
    return [f"In all it rests on information of {_and(sorted(level['ancestors']))}{rest}."]


def _learned(one: Table) -> str:
    echo = f", and is an echo of {one['echo']}" if one["echo"] else ""
    return (
        f"Learned of {one['source']}: its errors have {one['variance']:.2f} times the variance that it claims, "
        f"correlation {one['correlation']:.2f}{echo} (from {one['samples']:.0f} comparisons)."
    )


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


def _plural(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"


def _place(point: Sequence[float]) -> str:
    return f"({', '.join(f'{x:.2f}' for x in point)})"


def _short(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:g}"
