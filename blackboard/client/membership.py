"""A robot's place in a team, for a program of one's own, whatever it says there: the door between a thread and the network."""

import asyncio
import atexit
import logging
import re
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from blackboard.client.agreed import Agreed, TeamNews
from blackboard.client.arguments import Call, check_kinds, shown
from blackboard.client.ask import ask
from blackboard.client.desk import AgreedStream, Desk
from blackboard.client.why import Why
from blackboard.config import BoardSection, Scenario, load
from blackboard.errors import Refused, UserError
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.opinion.grid import Grid
from blackboard.process.clock import UnixClock
from blackboard.process.loop import run
from blackboard.process.service import Service
from blackboard.process.team_clock import TeamClock
from blackboard.wire import keys as topics
from blackboard.wire.codec import message_in
from blackboard.wire.messages import Consensus, Refusal
from blackboard.wire.names import NAME, SUBJECT_KINDS

log = logging.getLogger(__name__)

MAX_REFUSALS = 256  # that are kept


class Speaker(Service, Protocol):
    """The service that sends for a robot."""

    @property
    def clock(self) -> TeamClock:
        """The team's clock as the robot has it."""


class Membership:
    """A robot's place in its team, as a context manager; `with` or `async with` connects, registers and leaves.

    What it says is made by the service of a subclass (`_made`). Everything may be called in any thread, also in a callback.
    UserError: no router answers, or it is not known which team is meant.
    """

    def __init__(
        self,
        robot: str,
        scenario: str | Path | Scenario | None = None,
        *,
        endpoint: str | Sequence[str] = (),
        team: str | None = None,
        sub_team: str | Sequence[str] | None = None,
        grid: Grid | None = None,
        keys: str | None = None,
        strict: bool = False,
        patience: float = 10.0,
    ) -> None:
        """Join as `robot`; team, sub-team and grid are those of the scenario (a file, or the name of one that comes with the package).

        Without a scenario they come from a board that answers at the endpoint [default: tcp/127.0.0.1:7447], if there is one
        team and sub-team. Or they come from the robot's certificate in `keys` (a directory of `blackboard keys`). With `strict`
        the next call raises what a board refused before; otherwise that is logged, once for each board and reason. `patience`
        is in seconds.
        """
        made = type(self).__name__
        check_kinds(made, scenario=scenario, grid=grid, keys=keys, endpoint=endpoint, sub_team=sub_team)
        check_kinds(made, robot=robot, team="" if team is None else team, patience=patience)
        self.robot = robot
        self._scenario = scenario if scenario is None or isinstance(scenario, Scenario) else load(scenario)
        known = self._scenario
        self._endpoints = (endpoint,) if isinstance(endpoint, str) else tuple(endpoint)
        self._keys, self._strict, self._patience = keys, strict, patience
        chosen = known.team.of(robot) if known is not None else []
        given = (sub_team,) if isinstance(sub_team, str) else tuple(sub_team or chosen)
        self.name = team or (known.team.name if known is not None else "")
        self.sub_teams = given
        self._grid = grid or (known.grid if known is not None else None)
        named = [
            ("robot", robot),
            *(("team", name) for name in [self.name] if name),
            *(("sub_team", name) for name in given),
        ]
        for what, value in named:
            if not re.fullmatch(NAME, value):
                raise UserError(f"{made}({what}={shown(value)}): use up to 64 letters, digits, '.', '_' and '-'")
        strange = [name for name in given if known is not None and not team and name not in known.team.sub_teams]
        if strange and known is not None:
            raise UserError(f"{made}(sub_team={shown(strange[0])}): the scenario has {', '.join(known.team.sub_teams)}")
        #: Of the team's boards, as far as they are known.
        self._settings = BoardSection() if known is None else known.board
        #: `[board] fusion` is "joint"; without a scenario a board says it.
        self._joint = known is None or known.board.fusion == "joint"
        self._clock = UnixClock()
        self._callbacks: list[Callable[[Agreed], object]] = []
        self._streams: list[AgreedStream] = []
        self._newest: dict[str, Agreed] = {}
        self._arrived = threading.Condition()
        self._refusals: deque[Refusal] = deque(maxlen=MAX_REFUSALS)
        self._untold: Refusal | None = None  # the newest that a strict call has not raised
        self._joined: Desk | None = None
        self._link: Link | None = None
        self._thread: threading.Thread | None = None

    def _made(self, grid: Grid, news: TeamNews) -> Speaker:
        """The service that speaks for the robot on a grid, and hands on the team's news."""
        raise NotImplementedError

    # --- joining and leaving --------------------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        if self._link is not None:
            raise RuntimeError(f"{self.robot} has joined its team already")
        config = LinkConfig(connect=self._endpoints, keys=self._keys, who=f"robot/{self.robot}", called=True)
        identity = config.identity()
        if identity is not None:
            self.name = self.name or identity.member.team
            self.sub_teams = self.sub_teams or tuple(identity.member.sub_teams)
        link = Link(config, self.robot, patience=self._patience, clock=self._clock)
        try:
            is_told = bool(self.name and self.sub_teams and self._grid)
            if not is_told:
                self._ask(link)
            assert self._grid is not None, "a board said it"
            self._service = self._made(self._grid, TeamNews(self._grid, self._hear_agreed, self._hear_refused))
            if identity is not None:
                identity.check_tokens(self._service.tokens)
        except BaseException:
            link.close()
            raise
        self._link, self._joined = link, Desk(self._service)
        self._warning = threading.Timer(self._patience, self._warn_without_boards)
        self._warning.daemon = True
        self._desk.poke = link.poke
        self._thread = threading.Thread(target=self._run, name=f"team of {self.robot}", daemon=True)
        self._thread.start()
        atexit.register(self.close)  # a thread that the interpreter ends within Zenoh aborts the process
        if is_told and identity is None:  # else a board or a certificate said the names
            self._warning.start()
        self._desk.call(lambda now: (None, []))  # tokens are held and topics subscribed to from here on
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return await asyncio.to_thread(self.__enter__)

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self.close)

    def close(self) -> None:
        """Leave the team: no process waits for this robot any more. A second time changes nothing."""
        if self._link is None or self._thread is None:
            return
        self._warning.cancel()
        self._desk.stop.set()
        self._link.poke()
        atexit.unregister(self.close)
        if threading.current_thread() is not self._thread:
            self._thread.join()
            if self._warning.is_alive():
                self._warning.join()
            self._link.close()
            self._link = None

    def _run(self) -> None:
        assert self._link is not None
        try:
            run(self._desk, self._link, self._clock)
        finally:
            self._desk.stop.set()
            for stream in list(self._streams):
                stream.close()
            with self._arrived:
                self._arrived.notify_all()

    # --- the team's grid and time ----------------------------------------------------------------------------------------

    @property
    def grid(self) -> Grid:
        """The team's grid, on which every belief must be."""
        if self._grid is None:
            raise RuntimeError("the team's grid is known once the team is joined: `with Team(...) as team:`")
        return self._grid

    @property
    def time(self) -> float:
        """Team time in seconds: the world's where a world gives the clock, else Unix time."""
        return self._desk.call(lambda now: (self._service.clock.time(now), []))

    # --- listening --------------------------------------------------------------------------------------------------------

    def on_agreed(self, callback: Callable[[Agreed], object]) -> Callable[[Agreed], object]:
        """Call something with every belief that the team agrees on, in the team's own thread: be quick. Also a decorator."""
        if not callable(callback):
            raise ValueError(f"on_agreed(callback={shown(callback)}): give a function of one argument")
        self._callbacks.append(callback)
        return callback

    @property
    def agreed(self) -> dict[str, Agreed]:
        """The newest belief about each subject."""
        with self._arrived:
            return dict(self._newest)

    def newest(self, subject: str, timeout: float | None = None) -> Agreed:
        """The newest belief about a subject, waiting up to `timeout` seconds for the first [default: for ever]. Or TimeoutError."""
        _check_subject("newest", subject)
        with self._arrived:
            self._arrived.wait_for(lambda: subject in self._newest or self._desk.done, timeout)
            if subject not in self._newest:
                raise TimeoutError(f"{subject}: the team has not agreed on anything about it; `why` may say more")
            return self._newest[subject]

    def __iter__(self) -> Iterator[Agreed]:
        """Beliefs as the team agrees on them, of each subject the newest, until the team is closed."""
        stream = self._listen()
        try:
            while (agreed := stream.take(None)) is not None:
                yield agreed
        finally:
            self._streams.remove(stream)

    async def __aiter__(self) -> AsyncIterator[Agreed]:
        """The same in asyncio."""
        stream, came, loop = self._listen(), asyncio.Event(), asyncio.get_running_loop()
        stream.listener = lambda: _tell(loop, came)
        try:
            while not stream.ended:
                came.clear()
                while (agreed := stream.take()) is not None:
                    yield agreed
                if not stream.ended:
                    await came.wait()
        finally:
            self._streams.remove(stream)

    async def next(self, subject: str) -> Agreed:
        """The next belief about a subject that the team agrees on. TimeoutError: the team was closed."""
        _check_subject("next", subject)
        async for agreed in self:
            if agreed.subject == subject:
                return agreed
        raise TimeoutError(f"{subject}: the team was closed")

    @property
    def refused(self) -> list[Refusal]:
        """What boards have refused of this robot, the newest last."""
        return list(self._refusals)

    def why(self, subject: str) -> Why:
        """Why the team believes what it believes about a subject: who was used how, who was left out; print it.

        Asks the boards, which takes at most 2 seconds.
        """
        _check_subject("why", subject)
        if self._desk.done or self._link is None:
            raise RuntimeError("the team is closed")
        levels: dict[str, list[Consensus]] = {"agreed": [], "consensus": []}
        for topic in (topics.AGREED, topics.CONSENSUS):
            for sub_team in self.sub_teams:
                for envelope in self._link.get(topic.key(team=self.name, sub_team=sub_team, subject=subject)):
                    message = message_in(envelope)
                    if isinstance(message, Consensus):
                        levels[message.level].append(message)
        agreed = max(levels["agreed"], key=lambda consensus: consensus.time, default=None)
        refused = tuple(refusal for refusal in self._refusals if refusal.subject == subject)[-1:]
        return Why(subject, agreed, tuple(levels["consensus"]), refused)

    # --- inside -----------------------------------------------------------------------------------------------------------

    @property
    def _desk(self) -> Desk:
        """RuntimeError: no team was joined yet."""
        if self._joined is None:
            raise RuntimeError(f"{self.robot} has not joined its team: `with {type(self).__name__}(...) as ...:`")
        return self._joined

    def _listen(self) -> AgreedStream:
        stream, desk = AgreedStream(), self._desk
        self._streams.append(stream)
        if desk.done:
            stream.close()
        return stream

    def _hear_agreed(self, agreed: Agreed) -> None:
        with self._arrived:
            self._newest[agreed.subject] = agreed
            self._arrived.notify_all()
        try:
            for callback in list(self._callbacks):
                callback(agreed)
        finally:  # who iterates gets it also where a callback raises
            for stream in list(self._streams):
                stream.put(agreed)

    def _hear_refused(self, refusal: Refusal) -> None:
        self._refusals.append(refusal)
        self._untold = refusal

    def _raise_refused(self) -> None:
        """Refused: with `strict`, what a board refused since the last call."""
        untold, self._untold = self._untold, None
        if self._strict and untold is not None:
            raise Refused(untold.reason, f"{untold.board} refused {untold.subject or 'a status'}: {untold.text}")

    def _warn_without_boards(self) -> None:
        """Log it where no board of the named team and sub-teams answers: a name may be misspelt, or boards may start later."""
        if self._link is None or self._desk.done:
            return
        try:
            ask(self._link.get, self._clock.now, self.robot, self.name, self.sub_teams, 0.0)
        except UserError as error:
            log.warning("%s", error)

    def _ask(self, link: Link) -> None:
        """Learn from the boards which team, sub-team and grid are meant. UserError: none answers, or there are several."""
        board = ask(link.get, self._clock.now, self.robot, self.name, self.sub_teams, self._patience)
        self.name, self.sub_teams, self._grid = (
            board.team,
            self.sub_teams or (board.sub_team,),
            self._grid or board.grid,
        )
        self._joint = board.fusion == "joint"


def _check_subject(method: str, subject: object) -> None:
    """ValueError: the name is that of no subject, so there will never be a belief about it."""
    if not isinstance(subject, str) or not re.fullmatch(f"({SUBJECT_KINDS})/{NAME}", subject):
        raise Call(method).wrong("subject", subject, "give robot/NAME, object/NAME, landmark/NAME, or person/NAME")


def _tell(loop: asyncio.AbstractEventLoop, came: asyncio.Event) -> None:
    if not loop.is_closed():
        loop.call_soon_threadsafe(came.set)
