"""Messages for people: one line for each, and how often they come on each key. Pure."""

import json
import re
from collections.abc import Iterable
from typing import Any

from blackboard.errors import Refused, UserError
from blackboard.process.columns import columns
from blackboard.process.printable import printable
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind

MAX_KEYS = 4096
SHORT = 40  # characters of a text
#: The key says these.
UNSAID = {"version", "run", "source", "subject", "robot", "process", "sub_team", "board", "level", "kind"}
#: In this order the newest values of a team make sense: what says which run it is goes first, what settles a tick last.
ORDER = ("clock", "truth", "reading", "solo", "report", "consensus", "agreed", "forward", "status")


def key_expression(text: str) -> str:
    """A key expression of Zenoh as a person typed it. UserError: it is none."""
    chunks = text.split("/")
    if not all(re.fullmatch(r"\*\*?|[^*$#?/\s]+", chunk) for chunk in chunks):
        raise UserError(f"{text}: no key expression; write as cop/demo/** or cop/*/a/agreed/object/ball")
    return text


def line(envelope: Envelope, *, short: bool = False) -> str:
    """An envelope as one line: its key, and its message as JSON with the bytes of beliefs counted, or why it is refused.

    `short`: of the message only its numbers and names, without what is in lists and maps.
    """
    key = printable(envelope.key)
    if envelope.kind is not Kind.PUT:
        return f"{key} {envelope.kind.value}"
    try:
        topic, _, message = open_envelope(envelope)
    except Refused as refusal:
        return f"{key} refused: {printable(str(refusal))}"
    fields = message.model_dump(exclude_none=True)
    if short:
        told = [
            f"{name} {_in_short(value)}" for name, value in fields.items() if name not in UNSAID and _is_said(value)
        ]
        return f"{key} {topic.message}: {', '.join([*told, f'{len(envelope.payload)} bytes'])}"
    return f"{key} {topic.message} {json.dumps(_plain(fields))}"


def _is_said(value: Any) -> bool:
    return isinstance(value, int | float) or (isinstance(value, str) and value != "")


def _in_short(value: str | float) -> str:
    return printable(value[:SHORT]) if isinstance(value, str) else f"{value:.6g}"


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return f"<{len(value)} bytes>"
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def in_order(envelopes: Iterable[Envelope]) -> list[Envelope]:
    """The newest values of a team, sorted so that a fold understands them (`ORDER`)."""

    def rank(envelope: Envelope) -> int:
        parsed = keys.parse(envelope.key)
        return ORDER.index(parsed[0].name) if parsed is not None and parsed[0].name in ORDER else len(ORDER)

    return sorted(envelopes, key=lambda envelope: (rank(envelope), envelope.key))


class Rates:
    """How many messages and bytes came on each key; those on more than MAX_KEYS keys count as of `...`."""

    def __init__(self) -> None:
        self.counts: dict[str, tuple[int, int]] = {}

    def count(self, envelope: Envelope) -> None:
        if envelope.kind is Kind.PUT:
            known = envelope.key in self.counts or len(self.counts) < MAX_KEYS
            key = envelope.key if known else "..."
            count, size = self.counts.get(key, (0, 0))
            self.counts[key] = count + 1, size + len(envelope.payload)

    def text(self, seconds: float) -> str:
        """A line for each key, by name, over so many seconds."""
        if not self.counts:
            return f"nothing came in {seconds:.1f} s"
        total = [sum(values) for values in zip(*self.counts.values(), strict=True)]
        rows = [*sorted(self.counts.items()), (f"all {len(self.counts)} keys", (total[0], total[1]))]
        cells = [
            (f"{n / seconds:.2f} Hz", f"{size / seconds / 1000:.2f} kB/s", printable(key)) for key, (n, size) in rows
        ]
        return "\n".join(columns(cells, numbers=(0, 1)))
