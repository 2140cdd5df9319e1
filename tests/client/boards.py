"""Real boards at a router, in threads of this process; stopped however the test ends."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from blackboard.board.service import BoardService
from blackboard.config import BoardSection
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.opinion.grid import Grid
from blackboard.process.clock import UnixClock
from blackboard.process.loop import run


@contextmanager
def serving(
    endpoint: str, grid: Grid, sub_team: str = "a", keys: str | None = None, **settings: object
) -> Iterator[None]:
    """A board of a sub-team, with some settings of [board], is there."""
    name = f"board-{sub_team}"
    stop = threading.Event()
    config = LinkConfig(connect=(endpoint,), keys=keys, who=f"board/{name}")
    chosen = BoardSection.model_validate({"period": 0.1, **settings})
    board = BoardService(team="t", sub_team=sub_team, board=name, grid=grid, settings=chosen)
    with Link(config, name) as link:
        thread = threading.Thread(target=run, args=(board, link, UnixClock(), stop.is_set))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
