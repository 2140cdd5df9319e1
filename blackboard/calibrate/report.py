"""What `blackboard calibrate` prints: numbers with intervals, tables to paste into a scenario, and how well they predict."""

import math
from collections.abc import Mapping
from typing import Any

from blackboard.calibrate.found import LONG, NUMBERS, FoundSensors, FoundTeam, Number
from blackboard.calibrate.landmarks import Misplaced
from blackboard.process.columns import columns

LASTING = 0.02  # of a scale: what it may wander by later, at least
AXES = {"along": "unit", "across": "unit", "turn": "rad"}
#: Units of what is said of the noise.
NOISE = {
    **{
        f"{when}, {name}": f"{of}/sqrt(s)"
        for when in ("moving", f"over {LONG:g} s", "standing")
        for name, of in AXES.items()
    },
    "noise, range floor": "unit",
    "noise, range share": "share",
    "noise, bearing": "rad",
}


def report(calibration: FoundTeam, world: Mapping[str, Any]) -> dict[str, Any]:
    """All that was found, as JSON: each number with half of its 95 % interval, null where the drive does not determine it.

    `world` is what the scenario's [world] has to say for the tables of its robots to hold.
    """
    return {
        "robots": {name: _robot(sensors) for name, sensors in calibration.robots.items()},
        "landmarks": [{**vars(landmark), "off": round(landmark.off, 3)} for landmark in calibration.landmarks],
        "nats": {name: round(value, 4) for name, value in calibration.nats.items()},
        "scenario": {
            **({"world": dict(world)} if world else {}),
            "robots": {name: _tables(sensors) for name, sensors in calibration.robots.items()},
        },
    }


def _robot(sensors: FoundSensors) -> dict[str, Any]:
    numbers = {
        name: None if number.value is None else {"value": round(number.value, 5), "within": round(number.within, 5)}
        for name, number in sensors.numbers.items()
    }
    ranges = [
        {"from": low, "to": None if math.isinf(high) else high, "sightings": count, "rms": round(rms, 4)}
        for low, high, count, rms in sensors.ranges
    ]
    rest = {
        "ranges": ranges,
        "lasting": sensors.lasting,
        "misread": round(sensors.misread, 5),
        "sightings": sensors.sightings,
    }
    return {"numbers": numbers, **rest}


def _tables(sensors: FoundSensors) -> dict[str, dict[str, Any]]:
    """The tables of a robot's section in a scenario; what was not found is left out."""
    odometry = {
        "distance_scale": sensors.numbers["way, straight"],
        "curve_distance_scale": sensors.numbers["way, arc"],
        "turn_scale": sensors.numbers["turn, spin"],
        "curve_turn_scale": sensors.numbers["turn, arc"],
        "drift": sensors.numbers["drift"],
        "lag": sensors.numbers["lag"],
        **{
            name: _larger(sensors.numbers[f"moving, {name}"], sensors.numbers[f"over {LONG:g} s, {name}"])
            for name in AXES
        },
    }
    vision = {
        "range_scale": sensors.numbers["range scale"],
        "range_bias": sensors.numbers["range bias"],
        "bearing_bias": sensors.numbers["bearing bias"],
        "range_floor": sensors.numbers["noise, range floor"],
        "range_share": sensors.numbers["noise, range share"],
        "bearing": sensors.numbers["noise, bearing"],
    }
    tables: dict[str, dict[str, Any]] = {}
    for section, numbers in (("odometry", odometry), ("vision", vision)):
        told = {key: round(number.value, 4) for key, number in numbers.items() if number.value is not None}
        if section == "odometry" and told:
            standing, moving = sensors.numbers["standing, turn"].value, sensors.numbers["moving, turn"].value
            if standing is not None and moving:
                told["standing"] = round(min(1.0, standing / moving), 4)
            told = {"measured": True, **told}
            told["distance_lasting"] = _lasting(sensors.numbers["way, straight"], sensors.numbers["way, arc"])
            told["turn_lasting"] = _lasting(sensors.numbers["turn, spin"], sensors.numbers["turn, arc"])
        if told:
            tables[section] = told
    return tables


def _larger(*numbers: Number) -> Number:
    """The noise over a second, or that over long spans: a robot that sees nothing for long must not claim more than it knows."""
    return max(numbers, key=lambda number: number.value or 0.0)


def _lasting(*numbers: Number) -> float:
    """How far scales that were found may be off later."""
    return round(min(0.5, max([LASTING, *(number.within / 2 for number in numbers if number.value is not None)])), 4)


def text(report: Mapping[str, Any], unit: str) -> str:
    robots = report["robots"]
    rows = [["", *robots, ""]]
    for name, of in {**{name: of for name, (of, _) in NUMBERS.items()}, **NOISE}.items():
        cells = [_cell(robot["numbers"].get(name)) for robot in robots.values()]
        rows.append([name, *cells, of.replace("unit", unit)])
    for name in ("range", "bearing"):
        cells = [_seconds(robot["lasting"].get(name)) for robot in robots.values()]
        rows.append([f"errors last, {name}", *cells, "s"])
    rows.append(["misread", *(f"{100 * robot['misread']:.2f}" for robot in robots.values()), "%"])
    rows.append(["sightings", *(str(robot["sightings"]) for robot in robots.values()), ""])
    lines = [*columns(rows), "", *columns(_ranges(robots, unit)), ""]
    lines += [
        _landmark(Misplaced(**{k: v for k, v in landmark.items() if k != "off"}), unit)
        for landmark in report["landmarks"]
    ]
    lines += [""] if report["landmarks"] else ["Every landmark is where the map has it, as far as it was seen.", ""]
    lines.append("The half that was not fitted, nats for each reading (more is better):")
    lines += columns([[f"  {name}", f"{value:.3f}"] for name, value in report["nats"].items()])
    return "\n".join([*lines, "", *_pasted(report["scenario"])])


def _cell(number: Mapping[str, float] | None) -> str:
    return "-" if number is None else f"{number['value']:.3f} +-{number['within']:.3f}"


def _seconds(value: float | None) -> str:
    return "-" if value is None else "< 1" if not value else f"{value:g}"


def _ranges(robots: Mapping[str, Any], unit: str) -> list[list[str]]:
    """The RMS errors of ranges by distance, with the sightings that they rest on."""
    rows = [[f"RMS error of ranges ({unit})", *robots]]
    bins = {(part["from"], part["to"]) for robot in robots.values() for part in robot["ranges"]}
    for low, high in sorted(bins, key=lambda limits: limits[0]):
        row = [f"{low:g} and more" if high is None else f"{low:g} to {high:g}"]
        for robot in robots.values():
            own = [part for part in robot["ranges"] if part["from"] == low]
            row.append(f"{own[0]['rms']:.3f} ({own[0]['sightings']})" if own else "-")
        rows.append(row)
    return rows


def _landmark(misplaced: Misplaced, unit: str) -> str:
    where = f"({misplaced.seen[0]:.2f}, {misplaced.seen[1]:.2f}) +-{2 * misplaced.sigma:.2f} {unit}"
    if misplaced.exchanged:
        both = f"{misplaced.landmark} and {misplaced.exchanged} carry each other's names"
        return f"{both}: {misplaced.landmark} is seen at {where} ({misplaced.sightings} times)"
    return (
        f"{misplaced.landmark} is not where the map has it, ({misplaced.map[0]:.2f}, {misplaced.map[1]:.2f}): it is seen at {where}, "
        f"{misplaced.off:.2f} {unit} off ({misplaced.sightings} times)"
    )


def _pasted(scenario: Mapping[str, Any]) -> list[str]:
    lines = ["# Found by blackboard calibrate: for the team's scenario."]
    named = {
        f"robots.{robot}.{name}": table for robot, own in scenario["robots"].items() for name, table in own.items()
    }
    for name, table in {"world": scenario.get("world", {}), **named}.items():
        if table:
            lines += [f"[{name}]", *(f"{key} = {str(value).lower()}" for key, value in table.items())]
    return lines
