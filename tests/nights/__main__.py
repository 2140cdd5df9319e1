"""`make nights COUNT=10000 SEED=1`: live through nights on all cores, and tell of each that breaks what is promised.

A failure is one line with its seed, the commit and what broke first; then the night is made as small as it can be and written down
(`tests.nights.gift`). The exit status is 1 where something broke.
"""

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # each process has one core; before NumPy is loaded
    os.environ.setdefault(name, "1")

from tests.nights import gift  # noqa: E402
from tests.nights.run import Outcome, coverage, known, moved, quietly, uncalibrated  # noqa: E402

EVERY = 10.0  # seconds between two lines of progress


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.nights", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="nights")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first night")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no night after this time")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("build/nights"), help="where failures are written")
    parser.add_argument("--no-shrink", action="store_true", help="say only which nights fail")
    parser.add_argument("--first-failure", action="store_true", help="end with the first night that fails")
    args = parser.parse_args()
    began, done, failed, sums, seconds = time.monotonic(), 0, 0, Counter[str](), 0.0
    shown = began
    numbers = range(args.first, args.first + args.count)
    for outcome in _outcomes(args.seed, numbers, args.workers):
        done, sums, seconds = done + 1, sums + outcome.sums, seconds + outcome.seconds
        if outcome.broken is not None:
            failed += 1
            print(f"night {outcome.night.name} of {gift.commit()}: {outcome.broken}", flush=True)
            if not args.no_shrink:
                print(gift.wrapped(outcome.night, args.out), flush=True)
            if args.first_failure:
                return 1
        if time.monotonic() - began > 60 * args.minutes:
            break
        if time.monotonic() - shown > EVERY:
            shown = time.monotonic()
            left = min((shown - began) / done * (args.count - done), 60 * args.minutes + began - shown)
            print(
                f"{done} of {args.count} nights, {failed} failed, {left / 60:.0f} min left", file=sys.stderr, flush=True
            )
    doubts = uncalibrated(sums)
    for doubt in doubts:
        print(doubt)
    took = time.monotonic() - began
    print(
        f"{done} nights of seed {args.seed}: {failed} failed; {took:.0f} s, {seconds / max(1, done):.2f} s of a core for each"
    )
    for share, held in coverage(sums).items():
        print(f"the {float(share):.0%} regions of {sums['coverage n']} agreed beliefs hold the truth in {held:.1%}")
    print(f"one liar moves the honest {moved(sums):.2f} times as far off, in {sums['lied n']} agreed beliefs")
    print(
        f"joints know robots with {known(sums):.2f} times the variance of their own filters, over {sums['known n']} of them"
    )
    return 1 if failed or doubts else 0


def _outcomes(seed: int, numbers: range, workers: int) -> Iterator[Outcome]:
    """Nights as they end."""
    jobs = [(seed, number) for number in numbers]
    if workers == 1:
        yield from map(quietly, jobs)
        return
    with get_context("spawn").Pool(workers, maxtasksperchild=200) as pool:
        yield from pool.imap_unordered(quietly, jobs)


if __name__ == "__main__":
    sys.exit(main())
