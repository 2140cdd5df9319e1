"""Errors by whose fault they are.

Ours crash with a sentence (plain exceptions). A peer's bytes raise `Refused`, which a service counts under its reason and drops.
A person's mistake raises `Mistake`, which a door prints as one line before it exits with status 2.
"""

from __future__ import annotations


class OpinionError(ValueError):
    """An opinion that is no probability vector; the text names the opinion, the cell and the value."""


class Refused(ValueError):
    """A message that a process will not take; `reason` is a key of `blackboard.wire.messages.REASONS`."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(f"{reason}: {text}")
        self.reason = reason


class Mistake(Exception):
    """A person's mistake, in one line: where, what, and the cure. Doors exit with status 2 on it."""
