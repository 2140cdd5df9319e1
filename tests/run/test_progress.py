"""Progress where standard error is no terminal."""

import pytest

from blackboard.run.progress import progress


def test_elsewhere_than_on_a_terminal_there_is_nothing_or_a_line_for_the_first_and_each_tenth(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress("quiet", lines=False) as show:
        assert show is None
    with progress("tune") as show:
        assert show is not None
        for done in range(1, 25):
            show(done, 24)
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 11
    assert err.startswith("tune: 1 of 24 (")
    assert err.endswith("tune: 24 of 24 (0.0 min left)\n")
