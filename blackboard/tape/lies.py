"""What if a robot lied about where it is: its reports, moved. Pure."""

from collections.abc import Callable, Mapping, Sequence

from blackboard.errors import Refused, UserError
from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.falsified import displaced
from blackboard.wire.messages import Report


def parse_lies(given: Sequence[str], robots: Sequence[str]) -> dict[str, float]:
    """ROBOT=DISTANCE, the distance in the grid's unit. UserError: another form, or no such robot."""
    lies = {}
    for one in given:
        robot, equals, distance = one.partition("=")
        try:
            lies[robot] = float(distance)
        except ValueError:
            equals = ""
        if not equals or abs(lies[robot]) > 1e6 or lies[robot] != lies[robot]:
            raise UserError(f"--lie {one}: say ROBOT=DISTANCE in the grid's unit, as r2=6")
        if robot not in robots:
            raise UserError(f"--lie {one}: no such robot; on the tape are {', '.join(robots)}")
    return lies


def lying(lies: Mapping[str, float]) -> Callable[[Envelope], Envelope]:
    """A change of envelopes: what these robots report is displaced along x by so much (unit), other envelopes stay as they are.

    So a lie of a tape is that of a [[fault]]. A report that cannot be read stays as it is, too.
    """

    def change(envelope: Envelope) -> Envelope:
        parts = keys.REPORT.match(envelope.key)
        distance = lies.get(parts["source"], 0.0) if parts is not None else 0.0
        if envelope.kind is not Kind.PUT or not distance:
            return envelope
        try:
            report = decode(Report, envelope.payload)
            return Envelope(envelope.key, encode(displaced(report, (distance, 0.0))))
        except Refused:
            return envelope

    return change
