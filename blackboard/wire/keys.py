"""The topic table: every key expression of a team, once. docs/messages.md shows it."""

import re
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal

from blackboard.wire.names import NAME, SUBJECT_KINDS

#: The world's process has the referee. Operators look on, recorders among them.
Role = Literal["world", "robot", "board", "operator"]
Period = Literal["every tick", "once a second", "while it runs"]
Priority = Literal["interactive-high", "data", "data-low"]  # Zenoh's names, the most urgent first

LONGEST = 512  # characters of a key: more than any topic can have

EVERYBODY: tuple[Role, ...] = ("world", "robot", "board", "operator")


@dataclass(frozen=True)
class Topic:
    """One row: `{name}` stands for one chunk, `{subject}` for two (`robot/r1`)."""

    name: str
    pattern: str
    message: str  # the model's name, or "token" for a liveliness token
    writers: tuple[Role, ...]  # who may put on the key, or hold the token
    owner: str  # the part of the key that names the writer, or its sub-team; "" where there is one writer in a team
    readers: tuple[Role, ...]
    period: Period  # how often it is sent at least
    content: str  # what it is, in a few words
    priority: Priority = "data"  # where a network is too slow for all: which message goes first

    def key(self, **parts: str) -> str:
        """The key (or, with `*` or `**` among the parts, the key expression) of this topic."""
        return self.pattern.format(**parts)

    def match(self, key: str) -> dict[str, str] | None:
        """The parts of a key of this topic, or None. A key with a wildcard is no key."""
        match = _regex(self.pattern).fullmatch(key)
        return match.groupdict() if match else None


@cache
def _regex(pattern: str) -> re.Pattern[str]:
    parts = re.split(r"\{(\w+)\}", pattern)
    text = "".join(
        re.escape(part) if i % 2 == 0 else f"(?P<{part}>{f'(?:{SUBJECT_KINDS})/{NAME}' if part == 'subject' else NAME})"
        for i, part in enumerate(parts)
    )
    return re.compile(text)


#                     key, message, writers, owner, readers, period, what, priority
CLOCK = Topic(
    "clock", "cop/{team}/world/clock", "Clock",
    ("world",), "", EVERYBODY, "every tick", "the tick and the simulated time", "interactive-high",
)  # fmt: skip
READING = Topic(
    "reading", "cop/{team}/world/reading/{robot}", "Readings",
    ("world", "robot"), "robot", ("robot", "operator"), "every tick", "sensor data of one tick; of a real robot by its own drivers",
)  # fmt: skip
TRUTH = Topic(
    "truth", "cop/{team}/world/truth", "Truth",
    ("world",), "", ("world", "operator"), "every tick", "ground truth, never for robots", "data-low",
)  # fmt: skip
WORLD = Topic(
    "world", "cop/{team}/world/alive", "token",
    ("world",), "", EVERYBODY, "while it runs", "liveliness token of the world",
)  # fmt: skip
SOLO = Topic(
    "solo", "cop/{team}/score/solo/{robot}", "Solo",
    ("robot",), "robot", ("world", "operator"), "every tick", "its beliefs without the team", "data-low",
)  # fmt: skip
REPORT = Topic(
    "report", "cop/{team}/{sub_team}/report/{source}/{subject}", "Report",
    ("robot",), "source", ("board", "operator"), "every tick", "a belief",
)  # fmt: skip
CONSENSUS = Topic(
    "consensus", "cop/{team}/{sub_team}/consensus/{subject}", "Consensus",
    ("board",), "sub_team", EVERYBODY, "every tick", "the sub-team's belief",
)  # fmt: skip
AGREED = Topic(
    "agreed", "cop/{team}/{sub_team}/agreed/{subject}", "Consensus",
    ("board",), "sub_team", EVERYBODY, "every tick", "the belief after the exchange",
)  # fmt: skip
FORWARD = Topic(
    "forward", "cop/{team}/{sub_team}/forward/{board}", "Forward",
    ("board",), "board", ("board", "operator"), "every tick", "its robots' evidence, for a joint",
)  # fmt: skip
JOURNAL = Topic(
    "journal", "cop/{team}/{sub_team}/journal/{board}", "Journal",
    ("board",), "board", ("operator",), "every tick", "what the board was given, in its order and when, for a replay",
)  # fmt: skip
MEMORY = Topic(
    "memory", "cop/{team}/{sub_team}/memory/{board}", "Memory",
    ("board",), "board", ("board", "operator"), "once a second", "what a board that learns remembers, for those that follow it",
)  # fmt: skip
MEMBER = Topic(
    "member", "cop/{team}/{sub_team}/member/{robot}", "token",
    ("robot",), "robot", EVERYBODY, "while it runs", "registration of a robot",
)  # fmt: skip
BOARD = Topic(
    "board", "cop/{team}/{sub_team}/board/{board}", "token",
    ("board",), "board", EVERYBODY, "while it runs", "liveliness token of a board",
)  # fmt: skip
REFUSED = Topic(
    "refused", "cop/{team}/{sub_team}/refused/{robot}", "Refusal",
    ("board",), "sub_team", ("robot", "operator"), "once a second", "what a board refused of a robot, while it does",
)  # fmt: skip
STATUS = Topic(
    "status", "cop/{team}/{sub_team}/status/{process}", "Status",
    ("robot", "board"), "process", EVERYBODY, "once a second", "counters, the tick done, ages", "interactive-high",
)  # fmt: skip
DISK = Topic(
    "disk", "cop/{team}/tape/disk/{recorder}", "Disk",
    ("operator",), "recorder", ("operator",), "once a second", "a recorder's disk, while it takes nothing",
)  # fmt: skip

#: All of the above, in their order.
TOPICS = tuple(topic for topic in list(globals().values()) if isinstance(topic, Topic))

#: Where in a key the part stands that no other topic has.
_WORD_AT = 3
_BY_WORD = {topic.pattern.split("/")[_WORD_AT]: topic for topic in TOPICS}


def parse(key: str) -> tuple[Topic, dict[str, str]] | None:
    """The topic of a key and its parts, or None for a key of no topic (or with a wildcard)."""
    chunks = key.split("/", _WORD_AT + 1)
    topic = _BY_WORD.get(chunks[_WORD_AT]) if len(chunks) > _WORD_AT else None
    parts = None if topic is None else topic.match(key)
    return None if topic is None or parts is None else (topic, parts)


@lru_cache(1 << 12)
def writer(key: str) -> str | None:
    """Whom a key names as its writer, as one of the `identities` of a token; None for a key of no topic.

    Readings have an identity of their own that no token gives, because a robot's drivers write them and hold none.
    """
    parsed = parse(key) if len(key) <= LONGEST else None
    if parsed is None:
        return None
    topic, parts = parsed
    if topic.owner == "":
        return f"{parts['team']}/world"
    if topic is READING:
        return f"{parts['team']}/reading/{parts['robot']}"
    named = "" if topic.owner == "sub_team" else parts[topic.owner]
    return f"{parts['team']}/{parts.get('sub_team', '')}/{named}"


def identities(token: str) -> tuple[str, ...]:
    """The identities that the holder of a token may write under: its own in its sub-team, and one without what a key may not name."""
    topic, parts = parse(token) or (None, {}) if len(token) <= LONGEST else (None, {})
    if topic is WORLD:
        return (f"{parts['team']}/world",)
    if topic is MEMBER:
        return f"{parts['team']}/{parts['sub_team']}/{parts['robot']}", f"{parts['team']}//{parts['robot']}"
    if topic is BOARD:
        return f"{parts['team']}/{parts['sub_team']}/{parts['board']}", f"{parts['team']}/{parts['sub_team']}/"
    return ()


@lru_cache(1 << 12)
def written_by(token: str) -> tuple[str, ...]:
    """The key expressions of all that the holder of a token writes under its own name; readings are those of a robot's drivers."""
    topic, parts = parse(token) or (None, {}) if len(token) <= LONGEST else (None, {})
    if topic is None or topic.message != "token":
        return ()
    (role,), named = topic.writers, parts.get(topic.owner, "")
    mine = (
        one
        for one in TOPICS
        if role in one.writers and one.message != "token" and (one.owner == "") == (role == "world")
    )
    names = parts | dict.fromkeys(("source", "process"), named) | {"subject": "**"}
    return tuple(one.key(**{"robot": "*", **names}) for one in mine)


def table() -> str:
    rows = ["| key | message | who writes | named by | who reads | how often | priority | what |"]
    rows.append("|---" * 8 + "|")
    for t in TOPICS:
        owner = f"`{{{t.owner}}}`" if t.owner else "-"
        priority = "-" if t.message == "token" else t.priority
        cells = (
            f"`{t.pattern}`",
            t.message,
            _roles(t.writers),
            owner,
            _roles(t.readers),
            t.period,
            priority,
            t.content,
        )
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _roles(roles: tuple[Role, ...]) -> str:
    return "all" if roles == EVERYBODY else ", ".join(roles)
