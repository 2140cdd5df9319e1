"""One line per event, for people or as JSON, with what the event says besides its text."""

import json
import logging
import re
import sys

from blackboard.run.logs import OneLine


def event(**extra: object) -> logging.LogRecord:
    record = logging.LogRecord("blackboard", logging.INFO, __file__, 1, "%d of %d", (1, 2), None)
    record.__dict__ |= extra
    return record


def test_a_line_for_people_has_time_level_text_and_fields() -> None:
    said = OneLine(as_json=False).format(event(fields={"process": "r1", "tokens": ["a"]}))
    assert re.fullmatch(r"\d\d:\d\d:\d\d info     1 of 2 process=r1 tokens=\['a'\]", said)


def test_a_line_of_json_has_the_same() -> None:
    said = json.loads(OneLine(as_json=True).format(event(fields={"process": "r1", "at": {1}})))
    assert said.pop("timestamp").count(":") == 2
    assert said == {"event": "1 of 2", "level": "info", "process": "r1", "at": "{1}"}


def test_an_exception_is_told_whole() -> None:
    try:
        raise ValueError("no such\ncell")
    except ValueError:
        record = event(exc_info=sys.exc_info())
    assert "ValueError: no such\ncell" in OneLine(as_json=False).format(record)
    line = OneLine(as_json=True).format(record)
    assert "\n" not in line
    assert "ValueError: no such\ncell" in json.loads(line)["exception"]
