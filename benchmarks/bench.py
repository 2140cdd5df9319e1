"""Every ratio, as one table: `make bench`, or `python benchmarks/bench.py [--json] [pools wire board robot team start]`.

Each script beside this one answers one question. Absolute times drift on shared machines, so what counts is what was measured in
one run against something else on the same work.
"""

import argparse
import json
import os
import platform
from collections.abc import Callable, Iterator
from pathlib import Path

import board
import pools
import robot
import start
import team
import wire
from ratios import Measured

SCRIPTS: dict[str, Callable[[], Iterator[Measured]]] = {
    "pools": pools.rows,
    "wire": wire.rows,
    "board": board.rows,
    "robot": robot.rows,
    "team": team.rows,
    "start": start.rows,
}


def machine() -> str:
    """The processor, how many cores of it may be used, and the versions."""
    info = Path("/proc/cpuinfo")
    models = (
        [x.split(":", 1)[1].strip() for x in info.read_text().splitlines() if x.startswith("model name")]
        if info.exists()
        else []
    )
    name = models[0] if models else platform.processor() or platform.machine()
    load = os.getloadavg()[0]
    return f"{name}, {os.cpu_count()} cores, load {load:.1f}, {platform.system()}, Python {platform.python_version()}"


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure, and print one table of ratios.")
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, and nothing else there"
    )
    parser.add_argument("scripts", nargs="*", choices=[[], *SCRIPTS], help="which questions [default: all]")
    given = parser.parse_args()
    results: dict[str, list[dict[str, object]]] = {}
    if not given.json:
        print(machine(), flush=True)
    for name in given.scripts or SCRIPTS:
        rows = results.setdefault(name, [])
        for row in SCRIPTS[name]():
            rows.append(row.as_json())
            if not given.json:
                print(row.line(), flush=True)
    if given.json:
        print(json.dumps({"machine": machine(), "rows": results}))


if __name__ == "__main__":
    main()
