"""A board that is killed and started again, with no other one: the team goes on as it was."""

import numpy as np
import pytest

from blackboard.board.service import board_of
from examples.field.world import Truth, World
from tests.field.play import CHI, SETTLED, Field, new_scenario

pytestmark = pytest.mark.long
KILLED, BACK, END = 15.0, 15.6, 20.0  # seconds
SEED = 114
#: Wheels by which alone a robot soon no longer knows where it is.
WHEELS = Truth(turn=0.1, along=0.15)


class Restarted(Field):
    """Its board is killed after `KILLED` seconds, and a new one comes at `BACK`; or, if it `stays`, it runs on."""

    def __init__(self, seed: int, stays: bool = False) -> None:
        chosen = new_scenario(WHEELS)
        super().__init__(World(seed, WHEELS), chosen, sigmas=False, phases={"r2": 0.03, "r3": 0.06})
        begin, dying = self.now + 1.0, self.board
        self._due = []
        if not stays:
            self.board = board_of(chosen, "a", "board-a")
            self._due = [(begin + KILLED, lambda: self.leave(dying)), (begin + BACK, lambda: self.join(self.board))]

    def run_to(self, end: float) -> None:
        while self._due and self._due[0][0] <= end:
            at, happens = self._due.pop(0)
            super().run_to(at)
            happens()
        super().run_to(end)


def test_what_the_team_knew_is_known_to_a_lone_board_that_starts_again() -> None:
    """Before, robots entered by their wheels, off by a metre, and the first sightings made them sure of wrong places.

    The same team whose board runs on is the measure. One filter with all readings also knows how noisy the wheels are.
    """
    squared, distances = list[float](), list[float]()
    scores, undisturbed = Restarted(SEED).play(END)["team"], Restarted(SEED, stays=True).play(END)["team"]
    first = round((BACK + 0.4 - SETTLED) / WHEELS.dt)
    for robot in ("r1", "r2", "r3"):
        squared.append(np.mean(scores[robot].squared[first:]) / np.mean(undisturbed[robot].squared[first:]))
        distances += scores[robot].distances[first:]
    assert np.sqrt(np.mean(squared)) <= 1.25
    assert np.mean(np.array(distances) <= CHI[0.95]) >= 0.85
