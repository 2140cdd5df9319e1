"""What Linux says that a process uses."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Gauge:
    """What one process used at one time."""

    at: float  # seconds, of the observer
    name: str
    pid: int  # another one after a restart
    memory: float  # MB that are not shared with files: what it has allocated and touched
    threads: int
    descriptors: int


def read(at: float, name: str, pid: int) -> Gauge | None:
    """The gauges of a process; None where it has ended."""
    folder = Path("/proc") / str(pid)
    try:
        lines = (folder / "status").read_text(encoding="utf-8").splitlines()
        told = {key: value.split() for key, _, value in (line.partition(":") for line in lines)}
        descriptors = sum(1 for _ in (folder / "fd").iterdir())
        return Gauge(at, name, pid, int(told["RssAnon"][0]) / 1024, int(told["Threads"][0]), descriptors)
    except (OSError, KeyError):  # it ends just now; what has ended and is not yet waited for has no memory
        return None
