"""Texts that move a terminal's cursor, forge lines or turn the order of letters, in every place of a message that takes any text."""

import sys
import unicodedata
from typing import Any

import msgpack

from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MODELS

#: Every character that is a control, a format, a separator of lines or paragraphs; but those that UTF-8 cannot write.
HARMFUL = "".join(c for c in map(chr, range(sys.maxunicode + 1)) if unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp"))
#: The most that the shortest free text of a message takes, of each of them in some piece.
PIECES = [HARMFUL[at : at + 60] for at in range(0, len(HARMFUL), 60)]


class Poison:
    """Puts a text in the place of every text in a message that may be anything."""

    def __init__(self, text: str) -> None:
        self.text = text
        self._takes: dict[tuple[str, tuple[str, ...]], bool] = {}  # message type and place -> whether it takes the text

    def envelope(self, envelope: Envelope) -> Envelope:
        """An envelope with the text in it; one that cannot be read, or is no message, as it is."""
        parsed = keys.parse(envelope.key)
        if envelope.kind is not Kind.PUT or parsed is None or parsed[0].message not in MODELS:
            return envelope
        fields = msgpack.unpackb(envelope.payload)
        self._fill(parsed[0].message, fields, fields, ())
        return Envelope(envelope.key, msgpack.packb(fields))

    def _fill(self, model: str, whole: dict[str, Any], part: Any, place: tuple[str, ...]) -> None:
        for at, value in list(part.items()) if isinstance(part, dict) else list(enumerate(part)):
            here = (*place, at if isinstance(part, dict) else "*")
            if isinstance(value, str):
                part[at] = self.text
                if not self._is_taken(model, whole, here):
                    part[at] = value
            elif isinstance(value, dict | list) and "belief" not in here and "grid" not in here:
                self._fill(model, whole, value, here)
            if isinstance(part, dict) and place and self.text not in part:
                part[self.text] = part.pop(at)
                if not self._is_taken(model, whole, (*place, "key")):
                    part[at] = part.pop(self.text)

    def _is_taken(self, model: str, whole: dict[str, Any], place: tuple[str, ...]) -> bool:
        known = self._takes.get((model, place))
        if known is None:
            try:
                decode(MODELS[model], msgpack.packb(whole))
                known = True
            except Refused:
                known = False
            self._takes[model, place] = known
        return known
