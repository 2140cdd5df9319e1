"""Reports on replays: scorecards side by side, and whether a replay equals the recording. Pure."""

from typing import Any

from blackboard.judge.samples import GROUPS, LEVELS
from blackboard.process.columns import cell, columns
from blackboard.tape.judge import Match
from blackboard.tape.replay import Replay


def verdict_lines(replayed: Replay, matched: Match) -> list[str]:
    """Whether a replay is the recording, and every reason why it may not be, in sentences."""
    if matched.exact:
        lines = [f"as recorded, to the bit: {matched.same} consensuses"]
    else:
        lines = [
            f"NOT as recorded: {matched.same} consensuses are the same, {matched.different} differ, {matched.only_recorded} "
            f"are only on the tape, {matched.only_replayed} only in the replay; the first: {matched.first or 'none'}"
        ]
        if matched.exact_from is not None:
            lines.append(f"from tick {matched.exact_from} on all are the same")
    if matched.cut_off:
        lines.append(f"the tape breaks off before the last {matched.cut_off} consensuses of its boards")
    if replayed.missing:
        lines.append(f"{replayed.missing} messages that boards were given are not on the tape")
    if replayed.gaps:
        lines.append(f"the journals miss something in {replayed.gaps} places")
    if replayed.late:
        lines.append(
            f"the recorder came after the beginning of {', '.join(replayed.late)}: what they held then is unknown"
        )
    return lines


def side_by_side(cards: dict[str, dict[str, Any]]) -> str:
    """Scorecards as one table, a column for each."""
    rows: list[tuple[str, ...]] = [("", *cards)]
    unit = next(iter(cards.values()))["unit"]
    measures = {f"RMSE {unit}": "rmse", "entropy": "entropy", "log score": "log_score", "in 95 %": "coverage"}
    for group in GROUPS:
        for level in LEVELS:
            scores = [card["scores"][group][level] for card in cards.values()]
            if not any(each["n"] for each in scores):
                continue
            for name, key in measures.items():
                values = [
                    (each[key]["95"] if key == "coverage" else each[key]) if each["n"] else None for each in scores
                ]
                rows.append((f"{group} {level}, {name}", *(cell(value, "{:.3f}") for value in values)))
    rows.append(("samples", *(str(sum(c["scores"][g]["agreed"]["n"] for g in GROUPS)) for c in cards.values())))
    rows.append(("hash of the consensuses", *(card["hash"][:12] for card in cards.values())))
    return "\n".join(columns(rows, numbers=range(1, 1 + len(cards))))
