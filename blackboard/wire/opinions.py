"""Which opinions a message holds: the one admission of reports and consensuses, for boards and for who checks them. Pure."""

from blackboard.errors import Refused
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus, Report


def check_stamp(time: float, now: float, *, future: float, max_age: float) -> None:
    """Check a stamp at a team time, by how far it may be ahead and how old. All in seconds. Refused: "future", "past"."""
    if time > now + future:
        raise Refused("future", f"stamped {time - now:.1f} s ahead of team time {now:.1f} s")
    if time < now - max_age:
        raise Refused("past", f"stamped {now - time:.1f} s ago, older than {max_age:g} s")


def reported(report: Report, grid: Grid, feedback: str = "guarded") -> tuple[Opinion, ...]:
    """The opinions of a report that count by `[board] feedback`: first-hand, then informed; "paper": the last, "off": the first.

    The report does not decide whose information it is: the first-hand belief is the source's own, and the informed one contains
    that at least. Refused: "grid", "mass".
    """
    own = {report.source: report.time}
    opinions = [Opinion(report.source, unpack(report.belief, grid), own)]
    if report.informed is not None:
        informed = unpack(report.informed.belief, grid)
        opinions.append(Opinion(report.source, informed, {**report.informed.ancestors, **own}))
    return tuple({"paper": opinions[-1:], "off": opinions[:1]}.get(feedback, opinions))


def settled(consensus: Consensus, grid: Grid) -> tuple[Opinion, ...]:
    """The opinions of a sub-team for the exchange: the first-hand part, if there is one beside the whole, then the whole.

    The whole contains the part, so the two are never multiplied. Refused: "grid", "mass".
    """
    part = consensus.firsthand
    ancestors = consensus.ancestors if part is None else {**part.ancestors, **consensus.ancestors}
    whole = Opinion(consensus.sub_team, unpack(consensus.belief, grid), ancestors, whole=part is not None)
    if part is None or not part.ancestors:
        return (whole,)
    return Opinion(consensus.sub_team, unpack(part.belief, grid), part.ancestors), whole
