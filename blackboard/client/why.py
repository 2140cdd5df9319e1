"""Why the team believes what it believes about a subject, as the boards themselves tell it. Pure."""

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
        levels = [consensus for consensus in (self.agreed, *self.consensus) if consensus is not None]
        lines = [line for consensus in levels for line in _level(consensus)] or [
            f"{self.subject}: no board has a belief about it"
        ]
        return "\n".join([*lines, *(in_words(refusal) for refusal in self.refused)])


def _level(consensus: Consensus) -> list[str]:
    """One belief and its sources, a line for each."""
    head = (
        f"{consensus.subject}: {consensus.level} by {consensus.board} in tick {consensus.tick}, "
        f"entropy {consensus.entropy:.2f} nats, rule {consensus.rule}"
    )
    used = [
        f"  {u.source}: {u.how}, weight {u.weight:.2f}, {u.age:.1f} s old, entropy {u.entropy:.2f}"
        for u in consensus.used
    ]
    left_out = [f"  {out.source}: left out, {quoted(out.reason)}" for out in consensus.left_out]
    dissent = [f"  {d.source}: disagrees by {d.sigmas:.1f} sigmas, counts {d.weight:.2f}" for d in consensus.dissent]
    return [head + (", in conflict" if consensus.conflict else ""), *used, *left_out, *dissent]
