"""What a command prints: nothing but printable characters and line breaks reaches its standard output and error."""

from collections.abc import Iterable
from typing import Any, TextIO

from blackboard.process.printable import printable


class Printed:
    """A text stream in place of another, which gets the same with everything else as escapes (`printable`).

    JSON stays the same JSON: in its texts an escape means the character.
    """

    def __init__(self, beneath: TextIO) -> None:
        #: where `rich` finds the stream itself, for progress bars and help, which are no texts from outside
        self.rich_proxied_file = beneath

    def write(self, text: str) -> int:
        """Write a text; the number of its characters."""
        self.rich_proxied_file.write("\n".join(map(printable, text.split("\n"))))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def beneath(stream: Any) -> TextIO:
    """The stream to which control sequences of our own go."""
    inner: TextIO = getattr(stream, "rich_proxied_file", stream)
    return inner


def in_lines(value: Any) -> Any:
    """Maps, lists and texts with all texts printable in one line: a line break in them is an escape, too."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {in_lines(key): in_lines(one) for key, one in value.items()}
    return [in_lines(one) for one in value] if isinstance(value, list | tuple) else value
