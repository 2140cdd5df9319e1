"""Messages of which a test says only what it cares about, and the envelopes in which they travel."""

from collections.abc import Iterable
from typing import Any

from blackboard.opinion.belief import Belief
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.keys import Topic
from blackboard.wire.messages import Consensus, PackedBelief
from blackboard.wire.types import Message

_TOPICS = {topic.message: topic for topic in keys.TOPICS}


def consensus(belief: Belief | PackedBelief, subject: str = "object/ball", **fields: Any) -> Consensus:
    """What board `a` of sub-team `a` agreed on in tick 0, but for these fields."""
    plain = {
        "board": "a",
        "sub_team": "a",
        "level": "agreed",
        "subject": subject,
        "tick": 0,
        "time": 0.0,
        "belief": pack(belief) if isinstance(belief, Belief) else belief,
        "ancestors": {},
        "used": [],
        "entropy": 1.0,
        "conflict": False,
        "rule": "coalition",
    }
    return Consensus.model_validate({**plain, **fields})


def put(message: Message, *, team: str = "t", sub_team: str = "a") -> Envelope:
    """A message on its own key, the parts of which are fields of the message where it has them."""
    topic = _TOPICS[type(message).__name__]
    if isinstance(message, Consensus):
        topic = keys.CONSENSUS if message.level == "consensus" else keys.AGREED
    named = {name: value for name, value in message if isinstance(value, str)}
    return Envelope(topic.key(**{"team": team, "sub_team": sub_team, **named}), encode(message))


def token(topic: Topic, name: str = "", *, team: str = "t", sub_team: str = "a", kind: Kind = Kind.ALIVE) -> Envelope:
    """That the token of a world, or of the robot or board of this name, is there, or is gone."""
    return Envelope(topic.key(team=team, sub_team=sub_team, robot=name, board=name), kind=kind)


def world(kind: Kind = Kind.ALIVE) -> Envelope:
    """That the token of the world is there, or is gone."""
    return token(keys.WORLD, kind=kind)


def opened(envelopes: Iterable[Envelope]) -> list[Message]:
    """The messages in envelopes."""
    return [open_envelope(envelope)[2] for envelope in envelopes]


def kinds(messages: Iterable[Message]) -> list[str]:
    """The names of their types."""
    return [type(message).__name__ for message in messages]
