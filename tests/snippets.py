"""The blocks of code in the documentation, fenced or indented, so that tests can run them and none is forgotten."""

import re
import tomllib
from dataclasses import dataclass
from functools import cache

from tests.files import ROOT

#: A fenced block, or lines that are indented by four spaces below an empty line.
BLOCK = re.compile(
    r"^```(?P<word>[^\n]*)\n(?P<fenced>.*?)^```$|(?<=\n\n)(?P<indented> {4} *\S[^\n]*\n(?:(?: {4}[^\n]*)?\n)*)",
    re.M | re.S,
)
MADE = ("commands.md", "tables.md")  # pages that `make docs` makes
PROMPT = re.compile(r"^(?:[a-z][\w-]*\$ +)?")  # `base$ blackboard router`: on which host
WORDS = [
    "blackboard", "blackboard-rerun", "robot-agent", "sim-world", "make", "docker", "pip", "python", "git",
    "export", "ros2", "rviz2",
]  # fmt: skip


@dataclass(frozen=True)
class Block:
    """A code block of a Markdown page. `language` is the word after its opening fence; that of an indented block is guessed."""

    page: str  # the file's name
    line: int  # of its first line
    language: str
    text: str  # without the indentation

    @property
    def first(self) -> str:
        """Its first line."""
        return self.text.splitlines()[0]

    @property
    def commands(self) -> tuple[str, ...]:
        """The command lines of a shell block, as they are typed: without prompts and comments, continued lines joined."""
        lines = re.sub(r" *\\\n +", " ", self.text).splitlines()
        return tuple(re.split(r"\s+# ", PROMPT.sub("", line))[0].strip() for line in lines if line.strip())


@cache
def pages() -> dict[str, str]:
    """The text of every page that is written by hand, by the file's name; a note is `notes/NAME.md`."""
    site = ROOT / "docs"
    files = {file.name: file for file in (ROOT / "README.md", ROOT / "CONTRIBUTING.md")}
    files |= {str(file.relative_to(site)): file for file in sorted(site.glob("**/*.md")) if file.name not in MADE}
    return {name: file.read_text(encoding="utf-8") for name, file in files.items()}


@cache
def blocks(page: str) -> tuple[Block, ...]:
    """The blocks of a page in their order."""
    text, of_page = pages()[page], []
    for match in BLOCK.finditer(text):
        inside = match["fenced"] if match["indented"] is None else re.sub(r"^ {4}", "", match["indented"], flags=re.M)
        line = text.count("\n", 0, match.start()) + (1 if match["indented"] else 2)
        of_page.append(Block(page, line, _language(match["word"], inside), inside.rstrip() + "\n"))
    return tuple(of_page)


def block(page: str, first: str) -> Block:
    """The one block of a page whose first line begins so."""
    (only,) = (each for each in blocks(page) if each.first.startswith(first))
    return only


def _language(word: str | None, text: str) -> str:
    if word:
        return word
    command = PROMPT.sub("", text.splitlines()[0]).split()[0].removeprefix(".venv/bin/")
    if command in WORDS:
        return "shell"
    try:
        return "toml" if tomllib.loads(text) else "text"
    except tomllib.TOMLDecodeError:
        return "python" if re.match(r"(from \w+ )?import ", text) else "text"
