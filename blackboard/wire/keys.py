"""THE topic table: every key expression of a team, once. docs/wire.md shows it as `python -m blackboard.wire.keys` prints it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache


@dataclass(frozen=True)
class Topic:
    """One row: `{name}` stands for one chunk, `{subject}` for two (`robot/r1`)."""

    name: str
    pattern: str
    message: str  # the model's name, or "token"
    flow: str
    says: str

    def key(self, **parts: str) -> str:
        """The key (or, with `*` or `**` among the parts, the key expression) of this topic."""
        return self.pattern.format(**parts)

    def match(self, key: str) -> dict[str, str] | None:
        """The parts of a key of this topic, or None. A key with a wildcard is no key."""
        found = _regex(self.pattern).fullmatch(key)
        return found.groupdict() if found else None


@cache
def _regex(pattern: str) -> re.Pattern[str]:
    chunk = r"[A-Za-z0-9_.-]{1,64}"
    parts = re.split(r"\{(\w+)\}", pattern)
    text = "".join(
        re.escape(part) if i % 2 == 0 else f"(?P<{part}>{chunk + '/' + chunk if part == 'subject' else chunk})"
        for i, part in enumerate(parts)
    )
    return re.compile(text)


CLOCK = Topic("clock", "cop/{team}/world/clock", "Clock", "world -> all", "the tick and the simulated time")
READING = Topic("reading", "cop/{team}/world/reading/{robot}", "Readings", "world -> robot", "sensor data of one tick")
TRUTH = Topic("truth", "cop/{team}/world/truth", "Truth", "world -> referee, viewers", "ground truth, never for robots")
WORLD = Topic("world", "cop/{team}/world/alive", "token", "world -> all", "liveliness token of the world")
SOLO = Topic("solo", "cop/{team}/score/solo/{robot}", "Solo", "robot -> referee", "its beliefs without the team")
REPORT = Topic("report", "cop/{team}/{sub_team}/report/{source}/{subject}", "Report", "robot -> board", "a belief")
CONSENSUS = Topic(
    "consensus", "cop/{team}/{sub_team}/consensus/{subject}", "Consensus", "board -> all", "the sub-team's belief"
)
AGREED = Topic(
    "agreed", "cop/{team}/{sub_team}/agreed/{subject}", "Consensus", "board -> robots", "the belief after the exchange"
)
MEMBER = Topic("member", "cop/{team}/{sub_team}/member/{robot}", "token", "robot -> all", "registration of a robot")
BOARD = Topic("board", "cop/{team}/{sub_team}/board/{board}", "token", "board -> all", "liveliness token of a board")
STATUS = Topic(
    "status", "cop/{team}/{sub_team}/status/{process}", "Status", "all -> operators", "counters, the tick done, ages"
)

TOPICS = (CLOCK, READING, TRUTH, WORLD, SOLO, REPORT, CONSENSUS, AGREED, MEMBER, BOARD, STATUS)


def parse(key: str) -> tuple[Topic, dict[str, str]] | None:
    """The topic of a key and its parts, or None for a key of no topic (or with a wildcard)."""
    for topic in TOPICS:
        parts = topic.match(key)
        if parts is not None:
            return topic, parts
    return None


def table() -> str:
    """The table as Markdown."""
    rows = ["| key | message | flow | what |", "|---|---|---|---|"]
    rows += [f"| `{t.pattern}` | {t.message} | {t.flow} | {t.says} |" for t in TOPICS]
    return "\n".join(rows)


if __name__ == "__main__":
    print(table())
