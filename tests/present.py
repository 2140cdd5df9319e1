"""What a test needs to be there before it looks into it."""

from typing import TypeVar

T = TypeVar("T")


def present(value: T | None) -> T:
    """The value. AssertionError: it is None."""
    assert value is not None
    return value
