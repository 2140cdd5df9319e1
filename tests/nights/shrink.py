"""From a night that breaks an oracle to the smallest one that still does: fewer faults, shorter ones, a smaller team. Pure but for the nights."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from tests.nights.faults import Fault
from tests.nights.night import FIRST, Night

TRIES = 60  # nights that are tried at most

#: Lives through a night: the name of the oracle that it breaks, or "".
Live = Callable[[Night], str]


def shrunk(night: Night, live: Live, tries: int = TRIES) -> Night:
    """The smallest night found that breaks the same oracle."""
    oracle, left = live(night), tries
    if not oracle:
        raise ValueError(f"night {night.name} breaks nothing")
    changed = True
    while changed:
        changed = False
        for smaller in candidates(night):
            if left <= 0:
                return night
            left -= 1
            if live(smaller) == oracle:
                night, changed = smaller, True
                break
    return night


def candidates(night: Night) -> Iterator[Night]:
    """Nights that are smaller in one way, the greatest step first."""
    if len(night.faults) > 3:
        half = len(night.faults) // 2
        yield replace(night, faults=night.faults[:half])
        yield replace(night, faults=night.faults[half:])
    for fault in night.faults:
        yield night.without(fault)
    yield from _teams(night)
    for fault in night.faults:
        for shorter in _shorter(fault):
            yield replace(night, faults=tuple(shorter if other is fault else other for other in night.faults))


def _teams(night: Night) -> Iterator[Night]:
    """The night of a smaller or simpler team, if no fault concerns a process that is left out."""
    team = night.team
    smaller = [replace(team, guest=False)] if team.guest else []
    smaller += [replace(team, budget=None, rate=None)] if team.is_poor else []
    smaller += [replace(team, boards=1)] if team.boards > 1 else []
    for sub_team in team.sub_teams if len(team.sub_teams) > 1 else ():
        smaller.append(replace(team, sub_teams={s: members for s, members in team.sub_teams.items() if s != sub_team}))
    for robot in team.robots if len(team.robots) > 2 else ():
        left = {s: tuple(member for member in robots if member != robot) for s, robots in team.sub_teams.items()}
        smaller += [replace(team, sub_teams=left)] if all(left.values()) else []
    known = set(team.processes)
    for simpler in smaller:
        gone = known - set(simpler.processes)
        if len(simpler.robots) > 1 and not any(f"'{name}'" in repr(night.faults) for name in gone):
            yield replace(night, team=simpler)


def _shorter(fault: Fault) -> Iterator[Fault]:
    length = fault.end - fault.begin
    if length > 0.1:
        yield replace(fault, end=round(fault.begin + length / 2, 2))
        yield replace(fault, begin=round(fault.end - length / 2, 2))
    elif fault.begin > FIRST:
        yield replace(fault, begin=FIRST, end=round(FIRST + length, 2))
