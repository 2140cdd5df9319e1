"""A real robot's sensors for its `robot-agent`, with no world running: put Readings, stamped with Unix time (docs/wire.md)."""

import json
import sys
import threading
import time

import msgpack
import zenoh

team, robot, endpoint = sys.argv[1:]  # such as: demo r1 tcp/127.0.0.1:7447
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
period, run = 0.2, f"since {time.time():.0f}"  # seconds; where `run` is another one than before, the robot begins again
with zenoh.open(config) as session:
    for tick in range(sys.maxsize):
        readings = {"version": 1, "run": run, "robot": robot, "tick": tick, "time": time.time()}
        readings["odometry"] = {"distance": 0.0, "turn": 0.0, "dt": period}  # since the last tick, from the wheels
        readings["sightings"] = [{"subject": "object/ball", "range": 6.0, "bearing": 0.5}]  # from the camera
        if tick % 25 == 0:  # whenever something measures an absolute position: a known start, a beacon
            readings |= {"fix": {"position": [10.0, 20.0], "sigma": 1.0}, "compass": 0.3}
        session.put(f"cop/{team}/world/reading/{robot}", msgpack.packb(readings))
        threading.Event().wait(period)
