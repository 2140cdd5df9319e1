"""Errors, divided by whose fault they are.

A fault of this program is a plain exception with a sentence. It ends the process at the start; a service that runs counts and logs
it, and goes on without what met it (`blackboard.process.failures`). Bytes from another process that cannot be used
raise `Refused`, which a service counts under its reason and drops; evidence that breaks a joint raises `Degenerate`. A person's
mistake raises `UserError`, which a door prints as one line before it exits with status 2. A run that breaks off raises `RunFailed`,
which a door prints the same way before it exits with status 1.
"""

import difflib
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

PACKAGE = "cop-blackboard"  # as it is installed


class OpinionError(ValueError):
    """An opinion that is no probability vector; the text names the opinion, the cell and the value."""


class VetoError(OpinionError):
    """No cell is left that opinions hold possible together, and the rule has no answer for that."""


class RuleError(OpinionError):
    """A rule of an unknown name, or a parameter that a rule does not have or cannot take: which key, and the cure.

    The text is "key value: cure", or "key: cure" where no value is to blame.
    """

    def __init__(self, key: str, cure: str, value: object = None) -> None:
        super().__init__(f"{key}: {cure}" if value is None else f"{key} {value}: {cure}")
        self.key, self.cure, self.value = key, cure, value


class UnknownKeyError(RuleError):
    """A parameter that a rule does not have."""


class Refused(ValueError):
    """A message that a process will not take; `reason` is a key of `blackboard.wire.messages.REASONS`."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(f"{reason}: {text}")
        self.reason = reason


class Degenerate(Exception):
    """Evidence after which a joint belief is no Gaussian that can be kept; `robot` gave it, and is empty where that is not known."""

    def __init__(self, robot: str, text: str) -> None:
        super().__init__(text)
        self.robot = robot


class UserError(Exception):
    """A person's mistake, in one line: where, what, and the cure. Doors exit with status 2 on it."""


class RunFailed(Exception):
    """A run that ended without a scorecard, and why, in one line. Doors exit with status 1 on it."""


def nearest(given: object, known: Iterable[str]) -> str:
    """`; did you mean NAME?` for the known name nearest to a text; empty where none is near."""
    found = difflib.get_close_matches(given, list(known), 1) if isinstance(given, str) else []
    return f"; did you mean {found[0]}?" if found else ""


def plain(error: Exception) -> str:
    """What an error says, without the number and the file that the system adds."""
    return str(getattr(error, "strerror", None) or error)


@contextmanager
def extra(name: str, what: str) -> Iterator[None]:
    """Around imports of what an extra of the package installs. UserError: it is not there; says what needs it, and the cure.

    The cure works in a clone, and where a wheel was installed: the package itself is on no registry, what the extra needs is.
    """
    try:
        yield
    except ModuleNotFoundError:
        clone = Path(__file__).parent.parent
        is_clone = (clone / "pyproject.toml").exists()
        packages = f"-e '{clone}[{name}]'" if is_clone else " ".join(f"'{one}'" for one in _needed(name))
        cure = f"{sys.executable} -m pip install {packages}"
        raise UserError(f"{what} needs the extra `{name}`: {cure}") from None


def _needed(extra_name: str) -> list[str]:
    """What an extra of the installed package needs, as pip takes it; an extra that it takes in is in its place."""
    needed = list[str]()
    try:
        requirements = metadata.requires(PACKAGE) or []
    except metadata.PackageNotFoundError:  # the source alone is here
        return [f"{PACKAGE}[{extra_name}]"]
    for line in requirements:
        requirement, _, marker = line.partition(";")
        if marker.strip().replace('"', "'") == f"extra == '{extra_name}'":
            inner = re.fullmatch(rf"{PACKAGE}\[(.+)\]", requirement.strip())
            needed += [requirement.strip()] if inner is None else _needed(inner[1])
    return needed


@contextmanager
def writing(file: object) -> Iterator[None]:
    """Around what writes a file, named in the error. UserError: it cannot be written."""
    try:
        yield
    except OSError as error:
        raise UserError(f"{file}: cannot be written ({error.strerror or error}); choose another place") from error
