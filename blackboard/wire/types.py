"""The types that fields of messages are made of, and the bounds of what a process takes."""

from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from blackboard.wire.names import CLASS, NAME, SIGHTED, SUBJECT_KINDS
from blackboard.wire.raw import MAX_ITEMS

MAX_OPINIONS = 256  # the longest list in a message: sources of a consensus, sightings of a tick

LARGEST = 1e12  # of any number: sums, squares and their inverses stay finite when they are multiplied
LEAST = 1e-6  # of a number that must be positive, such as a standard deviation
MAX_NAME = 200  # characters of a text for people, or of a name of a counter or a setting

Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Subject = Annotated[str, Field(pattern=f"^({SUBJECT_KINDS})/{NAME}$")]
Class = Annotated[str, Field(pattern=f"^({CLASS})$")]
Sighted = Annotated[str, Field(pattern=f"^({SIGHTED})$")]
InView = Annotated[str, Field(pattern=rf"^({SIGHTED}|landmark/\?)$")]  # by a robot, which has a map; a board has none
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=LEAST, le=LARGEST, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=MAX_NAME)]
Confidence = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=0, lt=1 << 63)]
Tick = Annotated[int, Field(ge=0, lt=1 << 53)]
Ancestors = Annotated[dict[Name, Finite], Field(max_length=MAX_OPINIONS)]
Counts = Annotated[dict[Text, Count], Field(max_length=MAX_OPINIONS)]
Settings = Annotated[dict[Text, Text | Finite], Field(max_length=MAX_ITEMS)]
Names = Annotated[list[Name], Field(max_length=MAX_OPINIONS)]
Subjects = Annotated[list[Subject], Field(max_length=MAX_OPINIONS)]
#: A tuple may come as a list: msgpack knows no other, and `codec.decode` is strict.
Listed = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
#: The same of all rows of a list, in one call.
ListedRows = BeforeValidator(
    lambda rows: [tuple(row) if isinstance(row, list) else row for row in rows] if isinstance(rows, list) else rows
)
Point = Annotated[tuple[Finite, Finite], Listed]


def capped(ancestors: Mapping[str, float], first: Callable[[], Collection[str]]) -> dict[str, float]:
    """The ancestors, at most as many as a message may name: those in `first` are kept before the others, then by name."""
    if len(ancestors) <= MAX_OPINIONS:
        return dict(ancestors)
    known = first()
    kept = sorted(ancestors, key=lambda name: (name not in known, name))[:MAX_OPINIONS]
    return {name: ancestors[name] for name in sorted(kept)}


class Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, defer_build=True)  # most processes use few of the messages


class Message(Part):
    version: Literal[1] = 1
    """always sent; another number, or none, is refused whatever else the message holds"""
