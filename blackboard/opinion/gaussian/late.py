"""Late sightings of objects: each is compared with where the object was when the sighting was taken.

An object's motion is independent of all else. So what `Walks` has moved it since its last sighting can be taken back exactly; it is
then moved on to the time of the sighting, and after that to now. A sighting that is older than the last one that was taken, out of
sequence (Bar-Shalom, IEEE TAES 38(3), 2002), counts with the noise of what the object may have moved between both.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.state import TeamState


def with_way(team: TeamState, relative: Relative, since: float | None = None) -> Relative:
    """The sighting, with how far its object has gone since it was taken, or in the last `since` seconds."""
    seconds = min(relative.late if since is None else since, team.objects.kept)
    if seconds <= 0 or relative.subject in team.known or relative.subject not in team.joint:
        return relative
    way, strayed = team.walks.went(relative.subject, team.objects.drift_of(relative.subject), seconds)
    return replace(relative, gone=(float(way[0]), float(way[1])), strayed=strayed)


@contextmanager
def as_it_was(team: TeamState, relative: Relative) -> Iterator[Relative]:
    """Move an object to where it was when it was seen, and back to now after the block.

    Yields the sighting. If it is older than the last one that was taken, it has the way of the object between both.
    """
    subject, late = relative.subject, min(relative.late, team.objects.kept)
    if late <= 0 or subject in team.known:
        yield relative
        return
    lag = late
    if subject in team.joint:
        seconds, way = team.walks.rewind(subject)
        team.shift(subject, Moments(-way.mean, -way.covariance))
        team.influence.go(subject, -way.mean)
        lag = min(late, seconds)
        team.pass_object(subject, seconds - lag)
        relative = with_way(team, replace(relative, gone=(0.0, 0.0), strayed=0.0), late - lag)
    yield relative
    if subject in team.joint:
        team.pass_object(subject, lag)
