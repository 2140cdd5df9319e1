"""A robot written from docs/wire.md alone: it stands still, reports itself and a ball, and prints what its team agrees on."""

import argparse
import json
import signal
import sys
import threading
import time
import zlib

import msgpack
import numpy as np
import zenoh


def pack(p: np.ndarray, grid: object, step: float = 0.05) -> dict[str, object]:
    b = np.rint(255 + np.log(np.maximum(p / p.max(), 1e-9)) / step).clip(0, 255).astype(np.uint8)  # 0: in the rest
    data = zlib.compress(np.diff(b.ravel(), prepend=np.uint8(0)).tobytes())
    return {"grid": grid, "lo": [0, 0], "box": p.shape, "step": step, "rest": float(p[b == 0].sum()), "data": data}


def show(sample: zenoh.Sample) -> None:
    agreed = msgpack.unpackb(bytes(sample.payload))
    grid, lo, box, data = (agreed["belief"][name] for name in ("grid", "lo", "box", "data"))
    levels = np.frombuffer(zlib.decompress(data), np.uint8).cumsum(dtype=np.uint8)
    cell = np.add(lo, np.unravel_index(levels.argmax(), box)) + 0.5  # the centre of the likeliest
    print(agreed["tick"], agreed["subject"], *np.add(grid["origin"], cell * grid["cell"]).round(3), flush=True)


def main(args: argparse.Namespace) -> None:
    me, grid, home, world = args.id, args.grid, f"cop/{args.team}/{args.sub_team}", f"cop/{args.team}/world/clock"
    away = (np.indices(grid["shape"]).T + 0.5) * grid["cell"] + grid["origin"] - args.at  # of each cell from here
    masses = {f"robot/{me}": np.exp(-(away**2).sum(-1).T / 2), "object/ball": np.exp(-((away - 5) ** 2).sum(-1).T / 8)}
    beliefs = {subject: pack(mass / mass.sum(), grid) for subject, mass in masses.items()}
    messages = {f"{home}/report/{me}/{s}": {"source": me, "subject": s, "belief": b} for s, b in beliefs.items()}
    messages[f"cop/{args.team}/score/solo/{me}"] = {"robot": me, "beliefs": beliefs}
    messages[f"{home}/status/{me}"] = {"process": me, "kind": "robot", "phase": "reported", "subjects": list(beliefs)}
    clock, ticked, end = {}, threading.Semaphore(0), time.monotonic() + args.seconds
    config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [args.connect]}}))
    with zenoh.open(config) as session, session.liveliness().declare_token(f"{home}/member/{me}"):
        session.declare_subscriber(f"{home}/agreed/**", show)
        session.declare_subscriber(world, lambda s: (clock.update(msgpack.unpackb(bytes(s.payload))), ticked.release()))  # type: ignore[func-returns-value]
        while time.monotonic() < end:
            if ticked.acquire(timeout=0.2) or not clock:  # at each Clock, whoever sends it; first by Unix time
                now = {"tick": int(time.time() * 5), "time": time.time()} | clock
                for key, message in messages.items():
                    session.put(key, msgpack.packb({"version": 1, "tick": now["tick"], "time": now["time"], **message}))


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit())
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-e", "--connect", default="tcp/127.0.0.1:7447")
    for name in ("--team", "--sub-team", "--id"):
        parser.add_argument(name, required=True)
    parser.add_argument("--at", nargs=2, type=float, default=[10.0, 10.0])
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--grid", type=json.loads, default='{"shape": [50, 50], "cell": 1.0, "origin": [0.0, 0.0]}')
    main(parser.parse_args())
