"""The types that fields of messages are made of, and the bounds of what a process takes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from blackboard.wire.names import NAME, SUBJECT_KINDS

MAX_OPINIONS = 256  # the longest list in a message: sources of a consensus, sightings of a tick

Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Subject = Annotated[str, Field(pattern=f"^({SUBJECT_KINDS})/{NAME}$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Tick = Annotated[int, Field(ge=0, lt=1 << 53)]
Ancestors = Annotated[dict[Name, Finite], Field(max_length=MAX_OPINIONS)]
Subjects = Annotated[list[Subject], Field(max_length=MAX_OPINIONS)]
#: A tuple may come as a list: msgpack knows no other, and `codec.decode` is strict.
Listed = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Point = Annotated[tuple[Finite, Finite], Listed]


class Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Message(Part):
    version: Literal[1] = 1
