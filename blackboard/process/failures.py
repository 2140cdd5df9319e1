"""Exceptions that a process survives, whatever message or tick met them: counted, and logged once per source and kind."""

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from blackboard.process.printable import quoted

log = logging.getLogger(__name__)

MAX_LOGGED = 1000  # sources and kinds of exceptions that are remembered as logged


class Failures:
    """Counts in `counters` under "failed". The traceback is logged at debug level, because an attacker may cause many."""

    def __init__(self, counters: Counter[str] | None = None) -> None:
        self.counters: Counter[str] = Counter() if counters is None else counters
        self._logged: set[tuple[str, str]] = set()

    @contextmanager
    def survive(self, source: str, *passing: type[Exception]) -> Iterator[None]:
        """Go on after the block if it raises an Exception that is not `passing`; `source` names what was handled: a key, a phase."""
        try:
            yield
        except passing:
            raise
        except Exception as error:
            self.counters["failed"] += 1
            named = quoted(source), type(error).__name__
            if named not in self._logged and len(self._logged) < MAX_LOGGED:
                self._logged.add(named)
                log.error(
                    "%s: %s: %s; going on without it, and not logged again for this source", *named, quoted(str(error))
                )
                log.debug("the traceback of it", exc_info=True)
