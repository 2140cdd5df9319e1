"""Where the project, its pages and tapes are, and recordings beside it."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GOLDEN = ROOT / "tests" / "tape" / "golden.mcap"
DATASET7 = ROOT.parent / "shared" / "mrclam" / "dataset7"
needs_dataset7 = pytest.mark.skipif(
    not DATASET7.is_dir(), reason="needs the MRCLAM recording in ../shared/mrclam/dataset7"
)


def page(name: str) -> str:
    """The text of a page of the documentation, by the name of its file."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")
