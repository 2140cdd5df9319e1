"""A Docker engine as the test of the containers needs it: the base image, the wheels, the image, and a compose project.

Facts are waited for by following `docker events` or a log; nothing here sleeps.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import DEVNULL, PIPE, STDOUT, CompletedProcess, Popen, TimeoutExpired
from typing import Any

import pytest

from tests.files import ROOT

SUITE = "trixie"  # Debian 13, which the official slim image rests on too; it has Python 3.13
STAND_IN = f"cop-blackboard-stand-in:{SUITE}"
LEFT_OUT = ("./var/cache/apt", "./var/lib/apt/lists", "./usr/share/doc/*", "./usr/share/man/*", "./usr/share/locale/*")


def run(
    *command: str, seconds: float = 60, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        command, capture_output=True, text=True, stdin=DEVNULL, check=False, timeout=seconds, cwd=cwd, env=env
    )


def succeed(done: CompletedProcess[str]) -> str:
    """The output of a command; AssertionError with all that it said where it failed."""
    if done.returncode != 0:
        said = f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
        raise AssertionError(f"{' '.join(done.args)}: exit {done.returncode}\n{said}")
    return done.stdout


def call(*command: str, seconds: float = 60) -> str:
    """The output of a command that must succeed."""
    return succeed(run(*command, seconds=seconds))


def works(*command: str, seconds: float = 60) -> bool:
    """Whether a command is there and succeeds."""
    try:
        return run(*command, seconds=seconds).returncode == 0
    except (OSError, TimeoutExpired):
        return False


def now() -> str:
    """The engine's time, as its events are stamped."""
    return call("docker", "info", "--format", "{{.SystemTime}}").strip()


def first_line(command: list[str], wanted: Callable[[str], bool], seconds: float, what: str) -> str:
    """The first line of a command's output that is wanted; the command is ended then, or at the deadline."""
    lines = []
    with Popen(command, stdout=PIPE, stderr=STDOUT, text=True) as process:
        deadline = threading.Timer(seconds, process.kill)
        deadline.start()
        try:
            for line in process.stdout or ():
                if wanted(line):
                    return line
                lines.append(line)
        finally:
            deadline.cancel()
            process.kill()
    raise AssertionError(f"{what}: not within {seconds:g} s; last seen:\n{''.join(lines[-20:])}")


# --- what an image is built from -------------------------------------------------------------------------------------


def compose_command() -> list[str]:
    """Compose of either generation; skips the test with its reason where an engine or compose is missing."""
    if not works("docker", "info"):
        pytest.skip("no Docker engine answers here (docker info)")
    for command in (["docker", "compose"], ["docker-compose"]):
        if works(*command, "version"):
            return command
    pytest.skip("neither docker compose nor docker-compose is installed")


def base_image(work: Path) -> str:
    """The official base image; where no registry answers, a stand-in by Debian's debootstrap, kept under its tag."""
    match = re.search(r"^ARG BASE=(\S+)", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert match, "the Dockerfile names no default base"
    official = match[1]
    if works("docker", "image", "inspect", official) or works("docker", "pull", official, seconds=120):
        return official
    if not works("docker", "image", "inspect", STAND_IN):
        _make_stand_in(work / "base")
    return STAND_IN


def _make_stand_in(folder: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("no base image can be pulled, and debootstrap for a stand-in needs root")
    if shutil.which("debootstrap") is None:
        works("apt-get", "update", seconds=120)
        if not works("apt-get", "install", "--yes", "debootstrap", seconds=120):
            pytest.skip("no base image can be pulled, and debootstrap for a stand-in cannot be installed")
    call("debootstrap", "--variant=minbase", "--include=python3-venv", SUITE, str(folder), seconds=300)
    archive = str(folder.with_suffix(".tar"))
    left_out = [f"--exclude={path}" for path in LEFT_OUT]
    call("tar", "--create", "--file", archive, "--directory", str(folder), *left_out, ".")
    call("docker", "import", archive, STAND_IN)
    shutil.rmtree(folder)


def download_wheels(base: str, folder: Path) -> None:
    """What the image installs, for the Python of its base, as `make wheels` does it."""
    version = "import sys; print('%d.%d' % sys.version_info[:2])"
    python = call("docker", "run", "--rm", base, "python3", "-c", version).strip()
    settings = [f"IMAGE_PYTHON={python}", f"WHEELS={folder}", f"VENV={sys.prefix}"]
    call("make", "--directory", str(ROOT), "wheels", *settings, seconds=180)


def copy_sources(folder: Path) -> None:
    """What a fresh clone has of what the image is built from, and the compose file."""
    for name in ("blackboard", "robot_agent", "sim_world"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in (
        "Dockerfile",
        ".dockerignore",
        "docker-compose.yml",
        "secure.yml",
        "pyproject.toml",
        "README.md",
        "LICENSE",
    ):
        shutil.copy2(ROOT / name, folder)


def build_offline(base: str, folder: Path, image: str) -> None:
    """Build with no network at all: what is not in the base or the wheel folder is missing."""
    given = ["--network", "none", "--build-arg", f"BASE={base}", "--force-rm", "--tag", image]
    call("docker", "build", *given, str(folder), seconds=400)


def remove_image(image: str) -> None:
    works("docker", "image", "rm", "--force", image)
    works("docker", "image", "prune", "--force", "--filter", "label=cop-blackboard.stage=build")


# --- a project -------------------------------------------------------------------------------------------------------


@dataclass
class Project:
    """A compose project under a name of its own."""

    command: list[str]
    folder: Path
    name: str
    environment: Mapping[str, str]
    changes: dict[str, str] = field(default_factory=dict)  # of the environment, for one test

    def run(self, *arguments: str, seconds: float = 120) -> CompletedProcess[str]:
        """Run compose on this project."""
        environment = {**os.environ, **self.environment, **self.changes}
        command = (*self.command, "--project-name", self.name, *arguments)
        return run(*command, seconds=seconds, cwd=self.folder, env=environment)

    def __call__(self, *arguments: str, seconds: float = 120) -> str:
        """The output of compose on this project, which must succeed."""
        return succeed(self.run(*arguments, seconds=seconds))

    def down(self) -> None:
        """Stop and remove everything, whatever state it is in."""
        self.run("down", "--volumes", "--remove-orphans")

    def containers(self, service: str) -> list[str]:
        """The containers of a service, running or not."""
        of = ["--filter", self._label(), "--filter", f"label=com.docker.compose.service={service}"]
        return call("docker", "ps", "--all", "--quiet", "--no-trunc", *of).split()

    def container(self, service: str) -> str:
        (container,) = self.containers(service)
        return container

    def state(self, service: str) -> dict[str, Any]:
        shown = call("docker", "inspect", "--format", "{{json .State}}", self.container(service))
        state: dict[str, Any] = json.loads(shown)
        return state

    def network(self) -> str:
        (network,) = call("docker", "network", "ls", "--quiet", "--filter", self._label()).split()
        return network

    def log(self, service: str) -> str:
        return self("logs", "--no-color", service)

    def wait(self, containers: Iterable[str], event: str, shows: str, since: str, seconds: float) -> None:
        """Wait for an event of every container, counted from `since`; `event` and `shows` as in `docker events`."""
        kind, _, wanted = event.partition("=")
        for container in containers:
            events = ["docker", "events", "--since", since, "--filter", f"container={container}"]
            chosen = [*events, "--filter", f"event={kind}", "--format", shows]
            first_line(chosen, lambda line: line.strip() == wanted, seconds, f"{event} of {container[:12]}")

    def wait_well(self, *services: str, since: str | None = None, seconds: float = 120) -> None:
        """Wait until a health check of each service has ended well, from now on or since then."""
        containers = [container for service in services for container in self.containers(service)]
        self.wait(containers, "exec_die=0", "{{.Actor.Attributes.exitCode}}", since or now(), seconds)

    def wait_unwell(self, service: str, since: str) -> None:
        """Wait until Docker calls a service unhealthy."""
        status = "health_status: unhealthy"
        self.wait(self.containers(service), f"health_status={status}", "{{.Status}}", since, 120)

    def wait_start(self, service: str, since: str) -> None:
        """Wait until a service's container is started, by whomever."""
        self.wait(self.containers(service), "start=start", "{{.Status}}", since, 120)

    def report(self) -> str:
        """What everybody said last, and how the health checks went: for the reader of a failed test."""
        containers = call("docker", "ps", "--all", "--quiet", "--filter", self._label()).split()
        tries = "{{with .State.Health}}{{range .Log}}; {{.ExitCode}} {{.Output}}{{end}}{{end}}"
        health = "{{.Name}} {{.State.Status}}" + tries
        checks = call("docker", "inspect", "--format", health, *containers) if containers else ""
        return checks + self.run("logs", "--no-color", "--tail", "30").stdout

    def left_behind(self) -> list[str]:
        """Containers, networks, volumes and images of this project that are still there."""
        kinds = (["ps", "--all"], ["network", "ls"], ["volume", "ls"])
        names = [call("docker", *kind, "--quiet", "--filter", self._label()) for kind in kinds]
        names.append(call("docker", "image", "ls", "--quiet", self.environment["IMAGE"]))
        return "".join(names).split()

    def _label(self) -> str:
        return f"label=com.docker.compose.project={self.name}"
