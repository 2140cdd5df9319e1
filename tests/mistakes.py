"""What a person is told of a mistake."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from blackboard.errors import UserError


@contextmanager
def one_line(says: str) -> Iterator[pytest.ExceptionInfo[UserError]]:
    """Around what a person did wrong: it raises UserError with a single line, in which a pattern is found."""
    with pytest.raises(UserError, match=says) as raised:
        yield raised
    assert "\n" not in str(raised.value)
