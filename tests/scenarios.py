"""Small teams that several rooms run."""

from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel

from blackboard.config import Scenario
from tests.files import ROOT
from tests.processes import LONG

#: Three robots in two sub-teams; ticks 0 to 4.
SCENARIO = Scenario(
    {
        "team": {"name": "t", "sub_teams": {"a": ["r1", "r2"], "b": ["r3"]}},
        "grid": {"shape": [24, 24]},
        "time": {"tick": 0.5, "seconds": 2.5},
        "world": {"seed": 3},
    }
)

#: The same with a joint belief.
JOINT = SCENARIO.changed("board", fusion="joint")

#: The text of a file of one sub-team of three; ticks 0 to 7.
SMALL_FILE = """
[team.sub_teams]
a = ["r1", "r2", "r3"]
[grid]
shape = [24, 24]
[time]
tick = 0.5
seconds = 4
"""

#: Four robots whose boards learn whom to believe, on a small grid; ticks 0 to 20.
LEARNS = (
    SCENARIO.changed("team", sub_teams={"a": ["r1", "r2", "r3"], "b": ["r4"]})
    .changed("grid", shape=[16, 16])
    .changed("time", seconds=10.0)
    .changed("board", independence="learn", max_age=1.0)
)


def keys_of(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Every key of a section and of the tables in it, as `--set` takes them."""
    for name, field in model.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield from keys_of(inner, f"{prefix}{name}.")
        else:
            yield prefix + name


def patient_demo(folder: Path) -> str:
    """A file of the demo's scenario for a machine of any speed: no wait in lockstep ends before a test's deadline does.

    Waits that time ends are no fault of a run, but change its hash.
    """
    text = (ROOT / "sim_world" / "scenarios" / "demo.toml").read_text(encoding="utf-8")
    for table in ("[board]", "[robot]"):
        assert f"\n{table} " in text
        text = text.replace(f"\n{table} ", f"\n{table}\npatience = {LONG}\n", 1)
    file = folder / "patient.toml"
    file.write_text(text, encoding="utf-8")
    return str(file)
