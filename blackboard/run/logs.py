"""How a process logs: one line per event on standard error, for people or as JSON."""

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class OneLine(logging.Formatter):
    """`08:00:12 info     ready process=r1`, or with `as_json` one JSON object with event, level, timestamp and the fields.

    What an event says besides its text comes by `extra={"fields": {...}}`.
    """

    default_time_format = "%H:%M:%S"
    default_msec_format = ""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__()
        self.as_json = as_json

    def format(self, record: logging.LogRecord) -> str:
        """The line of an event; of an exception the traceback is in `exception`, or follows in lines of its own."""
        level, time = record.levelname.lower(), self.formatTime(record)
        fields: dict[str, object] = getattr(record, "fields", {})
        trace = self.formatException(record.exc_info) if record.exc_info else ""
        if self.as_json:
            said = {"event": record.getMessage(), **fields, "level": level, "timestamp": time}
            return json.dumps(said | ({"exception": trace} if trace else {}), default=str)
        text = " ".join([record.getMessage(), *(f"{name}={value}" for name, value in fields.items())])
        return f"{time} {level:8} {text}" + (f"\n{trace}" if trace else "")


@contextmanager
def quiet() -> Iterator[None]:
    """Without the warnings of services that run in this process: what they refuse is counted, in their scorecard too."""
    logger = logging.getLogger("blackboard")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


def set_up(level: str, *, as_json: bool) -> None:
    """Let all loggers write lines to standard error, from a level on (INFO where it is none)."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(OneLine(as_json=as_json))
    logging.basicConfig(
        level=level if level in logging.getLevelNamesMapping() else "INFO", handlers=[handler], force=True
    )
