"""What boards of one sub-team hand on of what they remember: once a second of team time, from the leader to its followers. Pure.

So both go on alike, whichever of them was restarted; and a leader that repeats itself costs little.
"""

import math

from blackboard.board.board import Board
from blackboard.wire.memory import Memory


class Handover:
    """Gives the memory of a board that leads, or takes that of its leader."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.agreed_at: tuple[int, float] | None = None  # tick and team time (s) of the newest tick that is settled
        self._given: int | None = None  # the newest whole second of team time
        self._taken = "", -math.inf  # the board, and the whole second, of the newest Memory that was taken

    def give(self, run: str) -> Memory | None:
        """What is remembered after the first tick of each second; None: nothing is due."""
        if self.agreed_at is None or math.floor(self.agreed_at[1]) == self._given:
            return None
        tick, time = self.agreed_at
        self._given = math.floor(time)
        return Memory(
            board=self.board.name,
            sub_team=self.board.sub_team,
            run=run,
            tick=max(0, tick),
            time=time,
            consensus=self.board.memory("consensus"),
            agreed=self.board.memory("agreed"),
        )

    def take_memory(self, memory: Memory, *, lockstep: bool) -> None:
        """Replace what the board has learned: by one Memory for each second. Refused: "fields".

        In lockstep one of an older tick would undo what was learned since; elsewhere it costs a sample of each pair at most.
        """
        older = self.agreed_at is not None and memory.tick < self.agreed_at[0]
        board, second = self._taken
        repeated = memory.board == board and math.floor(memory.time) <= second
        if not repeated and not (older and lockstep):
            self.board.remember(memory)
            self._taken = memory.board, math.floor(memory.time)
