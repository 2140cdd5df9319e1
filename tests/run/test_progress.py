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


def test_the_first_of_very_many_does_not_tell_how_long_all_take(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("replay") as show:
        assert show is not None
        show(1, 47290)
        show(4729, 47290)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "replay: 1 of 47290"
    assert second.endswith(" min left)")
