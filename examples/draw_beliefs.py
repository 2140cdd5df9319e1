"""Draw the pictures of docs/client.md, one for each way to make a belief: `python examples/draw_beliefs.py docs/beliefs`."""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from blackboard import Belief, Grid

GRID = Grid((48, 32), 0.25, unit="m")
SCALE, WIDE = 30, 12.0  # pixels a metre, metres
FILLS = {0.95: "#d6e4f5", 0.9: "#a9c7e8", 0.5: "#5b8fc9"}  # share of the mass -> colour of its region


def picture(
    belief: Belief, dots: Sequence[Sequence[float]] | np.ndarray = (), robot: Sequence[float] | None = None
) -> str:
    """The 50, 90 and 95 % regions as SVG, with points and a robot (x, y, heading); y points up."""
    grid = belief.grid
    high = grid.shape[1] * grid.cell
    paths = [
        f'<path fill="{fill}" d="{"".join(outline(ring, high) for ring in belief.polygons(share))}"/>'
        for share, fill in FILLS.items()
    ]
    points = [f'<circle cx="{x * SCALE:.0f}" cy="{(high - y) * SCALE:.0f}" r="1.5"/>' for x, y in dots]
    if robot is not None:
        x, y, heading = robot
        tip = x + 0.8 * math.cos(heading), y + 0.8 * math.sin(heading)
        points.append(f'<circle cx="{x * SCALE:g}" cy="{(high - y) * SCALE:g}" r="6" fill="#c0392b"/>')
        points.append(f'<path stroke="#c0392b" stroke-width="3" d="{outline([(x, y), tip], high)[:-1]}"/>')
    size = f'viewBox="0 0 {WIDE * SCALE:g} {high * SCALE:g}" width="{WIDE * SCALE:g}"'
    frame = '<rect width="100%" height="100%" fill="white" stroke="#888"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{frame}{"".join(paths + points)}</svg>\n'


def outline(ring: Sequence[Sequence[float]] | np.ndarray, high: float) -> str:
    return "M" + "L".join(f"{x * SCALE:.0f} {(high - y) * SCALE:.0f}" for x, y in ring) + "Z"


def pictures() -> dict[str, str]:
    """The name of each picture, and the picture."""
    chance = np.random.default_rng(1)
    turn = np.array([[2.0, 1.2], [1.2, 1.0]])
    xy = np.concatenate([chance.normal((3.5, 5), 0.7, (150, 2)), chance.normal((8, 3), 0.4, (80, 2))])
    sighting = {"distance": 6.0, "distance_sigma": 0.3}
    rooms = np.full(GRID.shape, -1)
    rooms[6:22, 6:26], rooms[22:30, 14:18], rooms[30:42, 6:26] = 0, 0, 0
    rooms[12:16, 12:16] = 100
    gaussian = Belief.from_gaussian(GRID, (6, 4), turn)
    return {
        "gaussian": picture(gaussian, [(6, 4)]),
        "mixture": picture(Belief.from_mixture(GRID, [(3, 5), (8.5, 3)], [0.4 * turn, 0.5 * np.eye(2)], [1, 2])),
        "particles": picture(Belief.from_particles(GRID, xy, bandwidth=0.3), xy),
        "sighting": picture(
            Belief.from_range_bearing(GRID, (2, 2), 0.2, **sighting, bearing=0.3, bearing_sigma=0.15), robot=(2, 2, 0.2)
        ),
        "range": picture(Belief.from_range_bearing(GRID, (2, 2), 0.2, **sighting), robot=(2, 2, 0.2)),
        "occupancy": picture(Belief.from_occupancy(GRID, rooms, unknown=100, free=True)),
        "resampled": picture(gaussian.resampled(Grid((12, 8), 1.0, unit="m"))),
    }


if __name__ == "__main__":
    for name, svg in pictures().items():
        (Path(sys.argv[1]) / f"{name}.svg").write_text(svg, encoding="utf-8")
