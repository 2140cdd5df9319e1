"""Factor graphs in PyFG format: a small one of two robots and an anchor, and one with errors added to it."""

import math
from pathlib import Path

import numpy as np

ANCHOR = (1.0, 2.0)
T0 = 1000.0
STEP = 0.1  # seconds


def write(file: Path, *, seconds: float = 20.0, seed: int = 0) -> None:
    """A drives a circle about (0, 0), B one about (4, 0): odometry ten times a second, ranges five times, a position and a pose."""
    chance, lines = np.random.default_rng(seed), [f"VERTEX_XY L0 {ANCHOR[0]} {ANCHOR[1]}", "SOMETHING_ELSE 1 2"]
    number = round(seconds / STEP) + 1
    poses = {robot: [_pose(robot, k) for k in range(number)] for robot in "AB"}
    for robot, way in poses.items():
        for k, (x, y, heading) in enumerate(way):
            time = T0 + k * STEP
            lines.append(f"VERTEX_SE2 {time:.2f} {robot}{k} {x:.9f} {y:.9f} {heading:.9f}")
            if k:
                dx, dy, turn = _between(way[k - 1], way[k]) + chance.normal(size=3) * [0.003, 0.001, 0.002]
                edge = f"{dx:.9f} {dy:.9f} {turn:.9f} 9e-6 0 0 1e-6 0 4e-6"
                lines.append(f"EDGE_SE2 {time:.2f} {robot}{k - 1} {robot}{k} {edge}")
            if k % 2 == 0:
                away = math.dist((x, y), ANCHOR) + chance.normal() * 0.05
                lines.append(f"EDGE_RANGE {time:.2f} {robot}{k} L0 {away:.9f} 0.0025")
    for k in range(0, number, 2):
        apart = math.dist(poses["A"][k][:2], poses["B"][k][:2]) + chance.normal() * 0.05
        lines.append(f"EDGE_RANGE {T0 + k * STEP:.2f} A{k} B{k} {apart:.9f} 0.0025")
    x, y, turn = _between(poses["A"][4], poses["B"][4])
    lines.append(f"EDGE_SE2 {T0 + 4 * STEP:.2f} A4 B4 {x:.9f} {y:.9f} {turn:.9f} 0.01 0 0 0.01 0 0.01")
    x, y, _ = _between(poses["A"][6], (*ANCHOR, 0.0))
    lines.append(f"EDGE_SE2_XY {T0 + 6 * STEP:.2f} A6 L0 {x:.9f} {y:.9f} 0.01 0 0.01")
    file.write_text("\n".join(lines) + "\n")


def spoilt(
    source: Path, file: Path, seed: int, *, scale: float = 0.02, bias: float = 0.05, outliers: float = 0.05
) -> None:
    """A copy of a file with errors drawn from the seed.

    The way and the turn of each robot, and all ranges, are off by a share with the sigma `scale`; the ranges of each pair by
    a length with the sigma `bias`; and the share `outliers` of them is 0.5 to 3 m too long, as where a radio hears an echo.
    """
    chance, lines = np.random.default_rng(seed), []
    ways: dict[str, list[float]] = {}
    lengths: dict[str, float] = {}
    for line in source.read_text().splitlines():
        words = line.split()
        if words and words[0] == "EDGE_SE2" and words[2][0] == words[3][0]:
            way, turn = ways.setdefault(words[2][0], (1 + chance.normal(size=2) * scale).tolist())
            words[4:7] = [str(float(words[4]) * way), str(float(words[5]) * way), str(float(words[6]) * turn)]
        elif words and words[0] == "EDGE_RANGE":
            off = lengths.setdefault(words[2][0] + words[3][0], float(chance.normal() * bias))
            off += float(chance.uniform(0.5, 3.0)) if chance.random() < outliers else 0.0
            words[4] = str(max(0.0, float(words[4]) + off))
        lines.append(" ".join(words))
    file.write_text("\n".join(lines) + "\n")


def _pose(robot: str, k: int) -> tuple[float, float, float]:
    angle = 0.03 * k + (0.0 if robot == "A" else 1.0)
    centre = 0.0 if robot == "A" else 4.0
    return centre + math.cos(angle), math.sin(angle), angle + math.pi / 2


def _between(one: tuple[float, float, float], other: tuple[float, float, float]) -> np.ndarray:
    """Where a pose stands in the frame of another: x, y, heading."""
    c, s = math.cos(one[2]), math.sin(one[2])
    dx, dy = other[0] - one[0], other[1] - one[1]
    return np.array([c * dx + s * dy, -s * dx + c * dy, other[2] - one[2]])
