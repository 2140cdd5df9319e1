"""How the documentation becomes a site: `make docs`, into build/docs. Pages that are made from the code are made here."""

import importlib
import re
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

project = "cop-blackboard"
release = version = version_of("cop-blackboard")
extensions = ["myst_parser", "sphinx.ext.autodoc"]
html_theme = "furo"
html_title = f"{project} {release}"
html_show_sphinx = False
html_show_copyright = False

myst_heading_anchors = 4  # what links as rules.md#a-joint-belief point to, as on GitHub
myst_enable_extensions = ["colon_fence"]

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"npt.ArrayLike": "ArrayLike", "Array": "Array"}
smartquotes = False  # they would change flags
python_maximum_signature_line_length = 100

COMMANDS = """# Commands

Made from the commands themselves, as `--help` shows them. Exit statuses: 0 done, 1 the run or its check failed, 2 a mistake (one line
that says where, what and the cure), 130 interrupted. Completion in a shell: `source <(blackboard completion bash)`.

"""


#: Modules with a table that decides, and what it is of.
TABLES = {
    "blackboard.board.lead": "Which board of a sub-team leads",
    "blackboard.process.team_clock": "When a Clock is followed",
    "blackboard.process.rounds": "When a phase of a tick is over",
    "blackboard.process.reactions": "What a robot does on news of the team clock",
}


def write_tables(app: Any) -> None:
    """Write docs/tables.md, which is no part of the sources."""
    parts = [
        "# The tables of the machines",
        "Made from the code. `python -m MODULE` prints each. [ticks.md](ticks.md) explains them.",
    ]
    for module, what in TABLES.items():
        text = importlib.import_module(module).text()
        parts += [f"## {what}", f"`{module}`", f"```text\n{text.rstrip()}\n```"]
    write("tables.md", "\n\n".join(parts) + "\n")


def write_commands(app: Any) -> None:
    """Write docs/commands.md, which is no part of the sources."""
    import blackboard.__main__
    import robot_agent.__main__
    import sim_world.__main__

    parts = [COMMANDS]
    for module in (blackboard.__main__, robot_agent.__main__, sim_world.__main__):
        parts.append(module.app.generate_docs(output_format="markdown", heading_level=2))
    text = re.sub(r"^#+ Table of Contents\n.*?(?=^\*\*|^#)", "", "\n\n".join(parts), flags=re.MULTILINE | re.DOTALL)
    write("commands.md", text)


def write(name: str, text: str) -> None:
    """Write a page, unless it is there as it is to be: Sphinx reads what is new."""
    file = Path(__file__).parent / name
    if not file.exists() or file.read_text(encoding="utf-8") != text:
        file.write_text(text, encoding="utf-8")


def as_rst(app: Any, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Turn the docstrings, plain text with names between backticks, into reStructuredText, in place."""
    text, shown = [], False
    for line in lines:
        indented = line.startswith("    ")
        if indented and not shown:
            text += ["::", ""] if not text or not text[-1] else ["", "::", ""]
        shown = indented or (shown and not line)
        parts = line.split("`")
        if not indented and len(parts) % 2:
            parts[::2] = [re.sub(r"([*|\\]|_(?=\W|$))", r"\\\1", part) for part in parts[::2]]
            parts[1::2] = [f"``{part}``" for part in parts[1::2]]
            text.append("".join(parts))
        else:
            text.append(line if indented else re.sub(r"([*|\\`])", r"\\\1", line))
    lines[:] = text


def plain_types(app: Any, what: str, name: str, thing: object, options: object, signature: Any, returns: Any) -> Any:
    """A signature with the plain names of `autodoc_type_aliases`."""
    plain = [part and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", part) for part in (signature, returns)]
    return plain[0], plain[1]


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", write_commands)
    app.connect("builder-inited", write_tables)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", plain_types)
