"""When a link has lost its router, and when it is connected to one again. Pure; `now` is Unix time in seconds."""

#: Seconds from one line about a loss to the next, so that a router that comes and goes leaves few lines in a log.
PAUSE = 10.0


class Outage:
    """The routers that a session is connected to, as Zenoh reports them. An outage lasts until `look` has reported its end."""

    def __init__(self) -> None:
        self._routers: set[str] = set()
        self._lost_at: float | None = None  # of an outage whose end is not logged yet
        self._back_at: float | None = None  # its end
        self._told = False  # that the router is lost
        self._quiet_until = 0.0

    def hear_router(self, router: str, now: float, *, here: bool) -> None:
        """A connection to a router was opened or closed."""
        lost = bool(self._routers) and not here
        (self._routers.add if here else self._routers.discard)(router)
        if self._routers:
            self._back_at = now
        elif lost:
            self._lost_at = now if self._lost_at is None else self._lost_at
            self._back_at = None

    def look(self, now: float) -> list[float | None]:
        """What is new: None where the router is lost, the seconds that it was away where it is back."""
        outages: list[float | None] = []
        if self._lost_at is not None and not self._told and not now < self._quiet_until <= now + PAUSE:
            self._told, self._quiet_until = True, now + PAUSE
            outages.append(None)
        if self._lost_at is not None and self._told and self._back_at is not None:
            outages.append(self._back_at - self._lost_at)
            self._lost_at, self._told = None, False
        return outages
