"""What a failure leaves: the smallest night that still fails, as a tape for `blackboard why` and `view`, and as a test of a few lines."""

import subprocess
from pathlib import Path

from tests.nights.night import Night
from tests.nights.run import lived, recorded
from tests.nights.shrink import shrunk

TEST = '''"""Night {name} of {commit}: {broken}."""

from tests.nights.faults import *
from tests.nights.night import Night, Team
from tests.nights.run import live


def test_night_{number}() -> None:
    night = {night!r}
    assert live(night) is None
'''


def commit() -> str:
    """The commit of the sources, short; with a plus where they were changed since."""
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty=+"],
            capture_output=True,
            text=True,
            check=True,
            cwd=Path(__file__).parent,
        )
    except (OSError, subprocess.CalledProcessError):
        return "no commit"
    return described.stdout.strip()


def wrapped(night: Night, folder: Path) -> str:
    """Shrink a night that fails, write its tape and its test into a folder, and say what they are."""
    smallest = shrunk(night, lambda tried: "" if (broken := lived(tried).broken) is None else broken.oracle)
    broken = lived(smallest).broken
    folder.mkdir(parents=True, exist_ok=True)
    number = night.name.replace("/", "_")
    tape, test = folder / f"night_{number}.mcap", folder / f"test_night_{number}.py"
    tape.write_bytes(recorded(smallest))
    test.write_text(TEST.format(name=night.name, commit=commit(), broken=broken, number=number, night=smallest))
    return f"  smallest: {broken}\n  {smallest}\n  {tape}, {test}"
