"""Why the team believes what it believes about a subject, as the boards themselves tell it. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from blackboard.process.printable import quoted
from blackboard.process.refusals import in_words
from blackboard.wire.messages import Consensus, Refusal


@dataclass(frozen=True)
class Why:
    """The newest belief of the team (`agreed`) and of the robot's sub-teams, and what of the robot was refused. `str` says it."""

    subject: str
    agreed: Consensus | None
    consensus: tuple[Consensus, ...]
    refused: tuple[Refusal, ...]

    def __str__(self) -> str:
        levels = [it for it in (self.agreed, *self.consensus) if it is not None]
        lines = [line for it in levels for line in _level(it)] or [f"{self.subject}: no board has a belief about it"]
        return "\n".join([*lines, *(in_words(it) for it in self.refused)])


def _level(it: Consensus) -> list[str]:
    """One belief and its sources, a line for each."""
    head = f"{it.subject}: {it.level} by {it.board} in tick {it.tick}, entropy {it.entropy:.2f} nats, rule {it.rule}"
    used = [
        f"  {u.source}: {u.how}, weight {u.weight:.2f}, {u.age:.1f} s old, entropy {u.entropy:.2f}" for u in it.used
    ]
    left_out = [f"  {out.source}: left out, {quoted(out.reason)}" for out in it.left_out]
    dissent = [f"  {d.source}: disagrees by {d.sigmas:.1f} sigmas, counts {d.weight:.2f}" for d in it.dissent]
    return [head + (", in conflict" if it.conflict else ""), *used, *left_out, *dissent]
