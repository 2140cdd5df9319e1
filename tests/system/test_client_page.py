"""docs/client.md and docs/robots.md to the letter: their commands run, its Python runs, and what it says that is printed is printed."""

import re
import shlex
from contextlib import ExitStack
from pathlib import Path

import pytest

from blackboard.run.launch import free_port
from examples import draw_beliefs
from tests.files import ROOT
from tests.processes import program

PAGE = (ROOT / "docs" / "client.md").read_text(encoding="utf-8")


def blocks(page: str, language: str = "python") -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", ["client.md", "robots.md"])
def test_every_line_of_the_page_does_what_it_says(name: str, tmp_path: Path) -> None:
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    scenario = tmp_path / "my-team.toml"
    scenario.write_text("".join(blocks(text, "toml")), encoding="utf-8")
    commands = re.findall(r"^    blackboard (.+)$", text, re.MULTILINE)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert [command.split()[0] for command in commands] == ["router", "serve"]
    page = "\n".join(blocks(text)).replace("tcp/127.0.0.1:7447", endpoint)
    with ExitStack() as running:
        for command in commands:
            arguments = shlex.split(
                command.replace("tcp/127.0.0.1:7447", endpoint).replace(scenario.name, str(scenario))
            )
            running.enter_context(program("-m", "blackboard", *arguments)).says("ready")
        client = running.enter_context(program("-c", page))
        assert client.ends() == 0, client.err
    lines = client.out.splitlines()
    for printed in re.findall(r"# prints (.+)$", page, re.MULTILINE):
        assert any(printed in line for line in lines), f"{printed!r} is not printed: {lines}"


def test_the_five_lines_are_five() -> None:
    assert len([line for line in blocks(PAGE)[0].splitlines() if line]) == 5


def test_its_pictures_are_those_that_the_command_draws() -> None:
    folder = ROOT / "docs" / "beliefs"
    shown = {Path(name).stem for name in re.findall(r"\]\(beliefs/(.+?)\)", PAGE)}
    drawn = draw_beliefs.pictures()
    assert shown == set(drawn) == {file.stem for file in folder.iterdir()}
    assert {name: (folder / f"{name}.svg").read_text(encoding="utf-8") for name in drawn} == drawn
