"""Texts from outside on a terminal: what could move its cursor, forge a line or turn the order of letters is shown as an escape."""

import re

SHOWN = 200  # characters of a text from outside in a line of the log
_PERHAPS_NOT = re.compile(r"[^ -~]")  # all but printable ASCII


def printable(text: str) -> str:
    r"""A text with every character that is not printable as `\n` or `\u001b`: controls, formats (bidi), separators of lines."""
    return _PERHAPS_NOT.sub(lambda match: _escaped(match[0]), text)


def quoted(text: str) -> str:
    """A text from outside as a part of one line: printable, and cut after `SHOWN` characters."""
    return printable(text[:SHOWN]) + ("..." if len(text) > SHOWN else "")


def _escaped(character: str) -> str:
    if character.isprintable():
        return character
    code = ord(character)
    return "\\n" if character == "\n" else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
