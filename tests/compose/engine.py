"""A Docker engine as the test of the containers needs it: the base image, the wheels, the image, and a compose project.

Facts are waited for by following `docker events` or a log; nothing here sleeps.
"""

from __future__ import annotations

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
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent.parent
SUITE = "trixie"  # Debian 13, which the official slim image rests on too; it has Python 3.13
STAND_IN = f"cop-blackboard-stand-in:{SUITE}"
LEFT_OUT = ("./var/cache/apt", "./var/lib/apt/lists", "./usr/share/doc/*", "./usr/share/man/*", "./usr/share/locale/*")


def call(*command: str, seconds: float = 60, check: bool = True, **more: Any) -> str:
    """Run a command to its end; its output, and AssertionError with all it said where it failed."""
    done = subprocess.run(
        command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=seconds, check=False, **more
    )
    if check and done.returncode != 0:
        said = f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
        raise AssertionError(f"{' '.join(command)}: exit {done.returncode}\n{said}")
    return str(done.stdout)


def works(*command: str, seconds: float = 60) -> bool:
    try:
        return subprocess.run(command, capture_output=True, timeout=seconds, check=False).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def now() -> str:
    """The engine's time, as its events are stamped."""
    return call("docker", "info", "--format", "{{.SystemTime}}").strip()


def first_line(command: list[str], wanted: Callable[[str], bool], seconds: float, what: str) -> str:
    """The first line of a command's output that is wanted; the command is ended then, or at the deadline."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        deadline = threading.Timer(seconds, process.kill)
        deadline.start()
        try:
            assert process.stdout is not None
            seen = []
            for line in process.stdout:
                if wanted(line):
                    return line
                seen.append(line)
        finally:
            deadline.cancel()
            process.kill()
    raise AssertionError(f"{what}: not within {seconds:g} s; last seen:\n{''.join(seen[-20:])}")


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
    found = re.search(r"^ARG BASE=(\S+)", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert found, "the Dockerfile names no default base"
    official = found[1]
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
    call(
        "tar",
        "--directory",
        str(folder),
        *(f"--exclude={path}" for path in LEFT_OUT),
        "--create",
        "--file",
        archive,
        ".",
    )
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
    for name in ("Dockerfile", ".dockerignore", "docker-compose.yml", "pyproject.toml", "README.md", "LICENSE"):
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

    def __call__(self, *arguments: str, seconds: float = 120, check: bool = True) -> str:
        environment = {**os.environ, **self.environment, **self.changes}
        command = (*self.command, "--project-name", self.name, *arguments)
        return call(*command, seconds=seconds, check=check, cwd=self.folder, env=environment)

    def containers(self, service: str) -> list[str]:
        """The containers of a service, running or not."""
        of = ["--filter", self._label(), "--filter", f"label=com.docker.compose.service={service}"]
        return call("docker", "ps", "--all", "--quiet", "--no-trunc", *of).split()

    def container(self, service: str) -> str:
        (found,) = self.containers(service)
        return found

    def state(self, service: str) -> dict[str, Any]:
        state: dict[str, Any] = json.loads(
            call("docker", "inspect", "--format", "{{json .State}}", self.container(service))
        )
        return state

    def network(self) -> str:
        (found,) = call("docker", "network", "ls", "--quiet", "--filter", self._label()).split()
        return found

    def log(self, service: str) -> str:
        return self("logs", "--no-color", service)

    def wait(self, containers: Iterable[str], event: str, shows: str, since: str, seconds: float) -> None:
        """Wait for an event of every container, counted from `since`; `event` and `shows` as in `docker events`."""
        kind, _, wanted = event.partition("=")
        for container in containers:
            events = ["docker", "events", "--since", since, "--filter", f"container={container}"]
            chosen = [*events, "--filter", f"event={kind}", "--format", shows]
            first_line(chosen, lambda line: line.strip() == wanted, seconds, f"{event} of {container[:12]}")

    def wait_well(self, *services: str, since: str | None = None, seconds: float = 60) -> None:
        """Wait until a health check of each service has ended well, from now on or since then."""
        containers = [container for service in services for container in self.containers(service)]
        self.wait(containers, "exec_die=0", "{{.Actor.Attributes.exitCode}}", since or now(), seconds)

    def wait_unwell(self, service: str, since: str, seconds: float = 60) -> None:
        """Wait until Docker calls a service unhealthy."""
        status = "health_status: unhealthy"
        self.wait(self.containers(service), f"health_status={status}", "{{.Status}}", since, seconds)

    def wait_start(self, service: str, since: str, seconds: float = 60) -> None:
        """Wait until a service's container is started, by whomever."""
        self.wait(self.containers(service), "start=start", "{{.Status}}", since, seconds)

    def wait_exit(self, service: str, seconds: float) -> int:
        return int(call("docker", "wait", self.container(service), seconds=seconds))

    def left_behind(self) -> list[str]:
        return [
            *call("docker", "ps", "--all", "--quiet", "--filter", self._label()).split(),
            *call("docker", "network", "ls", "--quiet", "--filter", self._label()).split(),
            *call("docker", "volume", "ls", "--quiet", "--filter", self._label()).split(),
        ]

    def _label(self) -> str:
        return f"label=com.docker.compose.project={self.name}"
