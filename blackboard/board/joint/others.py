"""What a board knows of the other boards that keep a joint: what they have passed on, and what they call their tracks. Pure."""

from collections import deque
from contextlib import suppress

from blackboard.errors import Refused
from blackboard.opinion.gaussian.joint import Moments
from blackboard.wire.evidence import Forward
from blackboard.wire.gaussians import unpack_track

TICKS = 8  # of another board that are remembered as heard; a stale one may arrive after the newest

Board = tuple[str, str]  # its sub-team and its name


class OtherBoards:
    """Mutable: the other boards that keep a joint."""

    def __init__(self) -> None:
        self._forwarders: set[Board] = set()
        self._heard: dict[Board, deque[int]] = {}  # the last ticks that they forwarded
        self._tracks: dict[Board, Forward] = {}  # what they said of their tracks last

    def expect(self, board: Board, joint: bool) -> None:
        """Whether a board keeps a joint too, as its status says; if not, it forwards nothing."""
        (self._forwarders.add if joint else self._forwarders.discard)(board)

    def hear_forward(self, forward: Forward) -> None:
        """Note that a board has passed on the evidence of a tick, and its tracks."""
        self._heard.setdefault((forward.sub_team, forward.board), deque(maxlen=TICKS)).append(forward.tick)
        self.hear_tracks(forward)

    def has_heard(self, board: Board, tick: int) -> bool:
        """Whether a board has passed on the evidence of a tick, or is not expected to."""
        return board not in self._forwarders or tick in self._heard.get(board, ())

    def hear_tracks(self, forward: Forward) -> None:
        """Take what another board calls its tracks, and where they are."""
        board = forward.sub_team, forward.board
        if board not in self._tracks or self._tracks[board].time <= forward.time:
            self._tracks[board] = forward.model_copy(update={"evidence": []})

    def tracks(self, oldest: float, began: float) -> dict[str, Moments]:
        """Where the board that keeps its joint for longest, and since before `began`, has tracks, by name.

        What was said before `oldest` does not count. Both are team times in seconds.
        """
        self._tracks = {board: message for board, message in self._tracks.items() if message.time >= oldest}
        elders = [
            (message.since, board)
            for board, message in self._tracks.items()
            if message.since is not None and message.since < began
        ]
        if not elders:
            return {}
        with suppress(Refused):
            return {track.name: unpack_track(track) for track in self._tracks[min(elders)[1]].tracks}
        return {}
