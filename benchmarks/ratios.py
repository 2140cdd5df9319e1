"""What the scripts here have in common: one measured ratio with what was asked beside it, and the times it is made of."""

import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
if str(ROOT) not in sys.path:  # so that each script runs on its own
    sys.path.insert(0, str(ROOT))


@dataclass(frozen=True)
class Measured:
    """One answer: `value` in `unit` ("x" is a ratio of two measurements of one run), and the most (or the least) that was asked."""

    question: str
    value: float
    unit: str = "x"
    most: float | None = None
    least: float | None = None

    def met(self) -> bool | None:
        """Whether it is what was asked; None where nothing was."""
        if self.most is None and self.least is None:
            return None
        return (self.most is None or self.value <= self.most) and (self.least is None or self.value >= self.least)

    def line(self) -> str:
        asked = "" if self.most is None else f"at most {self.most:g}"
        asked = asked if self.least is None else f"at least {self.least:g}"
        verdict = {True: "met", False: "MISSED", None: ""}[self.met()]
        return f"{self.question:<92} {self.value:10.3g} {self.unit:<5} {asked:<15} {verdict}".rstrip()

    def as_json(self) -> dict[str, Any]:
        return {**asdict(self), "met": self.met()}


def milliseconds(*calls: Callable[[], object], least: float = 0.01, rounds: int = 15) -> list[float]:
    """Processor milliseconds of each call, the best of rounds in which all of them take turns, `least` seconds each time."""
    number = []
    for call in calls:
        call()
        begin = time.process_time()
        call()
        number.append(max(1, int(least / max(time.process_time() - begin, 1e-6))))
    best = [float("inf")] * len(calls)
    for _ in range(rounds):
        for i, call in enumerate(calls):
            begin = time.process_time()
            for _ in range(number[i]):
                call()
            best[i] = min(best[i], (time.process_time() - begin) / number[i])
    return [1e3 * seconds for seconds in best]


def show(rows: Iterable[Measured]) -> None:
    for row in rows:
        print(row.line(), flush=True)
