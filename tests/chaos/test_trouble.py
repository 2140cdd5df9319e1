"""What a line does to a stream: delays, losses as TCP shows them, and never another order."""

import numpy as np
import pytest

from blackboard.chaos.trouble import LONGEST, RETRANSMISSION, OneDirection, Trouble


def late(trouble: Trouble, n: int = 2000, size: int = 100) -> list[float]:
    """How late each of `n` pieces comes that are sent 10 s apart."""
    line = OneDirection(np.random.default_rng(1))
    return [line.arrives(10.0 * i, size, trouble) - 10.0 * i for i in range(n)]


def test_without_trouble_nothing_is_late() -> None:
    assert late(Trouble()) == [0.0] * 2000


def test_a_delay_is_even_around_its_middle() -> None:
    delays = late(Trouble(delay=0.5, jitter=0.1))
    assert min(delays) >= 0.4 - 1e-9
    assert max(delays) <= 0.6 + 1e-9
    assert np.mean(delays) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(("segments", "share"), [(1, 0.2), (3, 1 - 0.8**3)])
def test_a_lost_segment_costs_the_time_until_it_is_sent_again(segments: int, share: float) -> None:
    delays = late(Trouble(loss=0.2), size=1448 * segments)
    kept = [seconds for seconds in delays if seconds > 1e-6]
    assert len(kept) / len(delays) == pytest.approx(share, abs=0.03)
    assert min(kept) == pytest.approx(RETRANSMISSION)
    assert max(kept) <= LONGEST + 1e-9


def test_what_is_behind_a_lost_segment_waits_for_it() -> None:
    line, trouble = OneDirection(np.random.default_rng(3)), Trouble(loss=0.3, jitter=0.05, delay=0.05)
    arrivals = [line.arrives(0.01 * i, 100, trouble) for i in range(500)]
    assert arrivals == sorted(arrivals)


def test_a_line_that_loses_everything_goes_on() -> None:
    assert max(late(Trouble(loss=1.0), n=10)) == pytest.approx(LONGEST)
