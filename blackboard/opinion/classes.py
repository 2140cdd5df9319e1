"""What a sighting may name instead of a subject: a class, as `robot/?` or `object/ball?`."""

from __future__ import annotations


def is_class(subject: str) -> bool:
    """Whether something is a class of things, and no thing: `object/ball?` is, `object/ball1` is not."""
    return subject.endswith("?")


def could_be(kind: str, subject: str) -> bool:
    """Whether a subject belongs to a class: `object/ball1` and `object/ball-red` to `object/ball?`, every robot to `robot/?`."""
    return is_class(kind) and not is_class(subject) and subject.startswith(kind[:-1])
