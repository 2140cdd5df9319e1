"""Messages as bytes and back. Bytes are a message or raise `Refused`, never anything else."""

from contextlib import suppress
from functools import lru_cache
from typing import TypeVar

from pydantic import ValidationError

from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import MODELS
from blackboard.wire.mistakes import first_mistake
from blackboard.wire.raw import pack_map, unpack_map
from blackboard.wire.types import Message

M = TypeVar("M", bound=Message)


def encode(message: Message, *, shortest: bool = False) -> bytes:
    """A message as one msgpack map: the version first, fields in the order of the model, defaults left out.

    `shortest`: floats in the fewest bytes that read back as the same numbers, for a poor link; every reader reads that.
    """
    return pack_map(message.model_dump(exclude_defaults=True, exclude_none=True), shortest=shortest)


def enveloped(key: str, message: Message) -> Envelope:
    """A message on a key, as `encode` writes it."""
    return Envelope.written(key, encode(message), message)


def decode(model: type[M], payload: bytes) -> M:
    """The message in some bytes; raises `Refused` with the first of REASONS that applies.

    Numbers, text and bytes must come as such (an integer may stand for a float); unknown fields are ignored.
    """
    fields = unpack_map(payload)
    try:
        return model.model_validate(fields, strict=True)
    except ValidationError as error:
        place, cure = first_mistake(error, model)
        field = ".".join(str(part) for part in (model.__name__, *place))
        raise Refused("fields", f"{field[:200]}: {cure[:200]}") from None


@lru_cache(maxsize=1)  # in one process an envelope goes from one service to the next
def open_envelope(envelope: Envelope) -> tuple[keys.Topic, dict[str, str], Message]:
    """The message in an envelope of kind PUT, with its topic and the parts of its key: shared, so they must not be changed.

    Refused: "wild-key", what `decode` refuses, and "impostor" where the message names another sender or subject than its key.
    """
    parsed = keys.parse(envelope.key)
    model = MODELS.get(parsed[0].message) if parsed else None
    if parsed is None or model is None:
        raise Refused("wild-key", f"no message belongs on {envelope.key!r:.200}")
    topic, parts = parsed
    message = envelope.message
    if not isinstance(message, model):
        message = decode(model, envelope.payload)
    fields = vars(message)  # asking pydantic for a field that a model lacks takes long
    for name, in_key in {**parts, "level": topic.name}.items():
        in_message = fields.get(name, in_key)
        if in_message != in_key:
            raise Refused("impostor", f"{name} {in_message!r} on the key {envelope.key}")
    return topic, parts, message


def message_in(envelope: Envelope) -> Message | None:
    """The message in an envelope of kind PUT, shared as by `open_envelope`; None where that refuses it."""
    with suppress(Refused):
        return open_envelope(envelope)[2]
    return None
