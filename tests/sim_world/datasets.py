"""A tiny recording in MRCLAM format, and the times of a real one."""

from pathlib import Path

T0 = 1248446200.0  # the start of the window that its page uses

HEAD = "# a recording of nobody\n"


def write(folder: Path, *, until: float = 1020.0) -> None:
    """Two robots from 1000.0 s on: r1 drives along x with 0.1 m/s, r2 stands at (0, 1) and turns with 0.2 rad/s."""
    tables = {
        "Barcodes": ["1 11", "2 12", "6 16", "7 17"],
        "Landmark_Groundtruth": ["6 1.0 2.0 0.001 0.001", "7 -1.0 0.5 0.001 0.001"],
        "Robot1_Measurement": [
            "1000.90 16 2.0 0.1",
            "1001.00 12 1.0 0.2",
            "1001.20 99 1.0 0.2",
            "1001.30 11 1.0 0.2",
            "1001.40 17 3.0 -0.3",
        ],
        "Robot2_Measurement": ["1001.10 11 1.5 0.0", "1002.25 16 1.5 0.5", "1002.45 16 1.4 0.4"],
    }
    count = round((until - 1000.0) * 10)
    times = [1000.0 + k / 10 for k in range(count + 1)]
    tables["Robot1_Odometry"] = [f"{t:.1f} 0.1 0.0" for t in times]
    tables["Robot2_Odometry"] = [f"{t:.1f} 0.0 0.2" for t in times]
    tables["Robot1_Groundtruth"] = [f"{t:.1f} {0.1 * (t - 1000):.3f} 0.0 0.0" for t in times]
    tables["Robot2_Groundtruth"] = [f"{t:.1f} 0.0 1.0 {0.2 * (t - 1000):.3f}" for t in times]
    for name, rows in tables.items():
        (folder / f"{name}.dat").write_text(HEAD + "\n".join(rows) + "\n")
