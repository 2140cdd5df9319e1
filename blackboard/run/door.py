"""What all doors share: Zenoh's usual flags, logging, signals and exit codes.

Exit codes: 0 done, 1 the run or its check failed, 2 a user error (one clear line on standard error), 130 interrupted,
141 nobody reads standard output any more (`| head -1`), 143 a board or a robot that did not end in order in time.
"""

import logging
import os
import re
import select
import signal
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, Literal, NoReturn, TextIO, cast, get_args

from cyclopts import App, ArgumentCollection, CycloptsError, Group, Parameter
from cyclopts.exceptions import CoercionError, MissingArgumentError, UnknownCommandError, UnusedCliTokensError

import blackboard
from blackboard.errors import RunFailed, UserError, nearest
from blackboard.net.link import Link, Stopped, start_zenoh_log
from blackboard.net.settings import DEFAULT_ENDPOINT, SECURE_ENDPOINT, LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.process.loop import run
from blackboard.process.service import Service
from blackboard.run import logs
from blackboard.run.gate import keep_door
from blackboard.run.lifeline import follow
from blackboard.run.terminal import Printed
from blackboard.wire.keys import WORLD, parse
from blackboard.wire.names import NAME

log = logging.getLogger(__name__)

#: Exit statuses; a command may return others.
DONE, FAILED, USER_ERROR, INTERRUPTED, NO_READER, STOPPED = (0, 1, 2, 130, 141, 143)
ERROR = "error: "  # before the one line on standard error of what ended a command
PATIENCE = 30.0  # seconds to wait for a router
PROMPT = 1.2  # seconds from a signal to the end of a board or a robot, which keep nothing, whatever they do
PARENT = "BLACKBOARD_PARENT"  # set for a child: the process that it must not outlive


#: What a flag of a type takes, for people.
NUMBERS: dict[object, str] = {int: "a whole number", float: "a number"}
#: In the help after all that is the command's own.
NETWORK = Group("Network (Zenoh's usual flags)", sort_key=1)


@Parameter(name="*", group=NETWORK)
@dataclass(frozen=True)
class ZenohFlags:
    """Zenoh's usual flags."""

    mode: Annotated[Literal["client", "peer", "router"] | None, Parameter(name=["--mode", "-m"])] = None
    "Mode of the Zenoh session [default: client]."
    connect: Annotated[list[str], Parameter(name=["--connect", "-e"], negative="", show_default=False)] = field(
        default_factory=list
    )
    "Endpoint to connect to; may be given again [default: tcp/127.0.0.1:7447]."
    listen: Annotated[list[str], Parameter(name=["--listen", "-l"], negative="", show_default=False)] = field(
        default_factory=list
    )
    "Endpoint to listen on; may be given again."
    config: Annotated[str | None, Parameter(name=["--config", "-c"])] = None
    "A Zenoh configuration file (JSON5 or YAML)."
    multicast_scouting: Annotated[bool | None, Parameter(name="--multicast-scouting")] = None
    "Look for others by multicast; off unless asked for."
    cfg: Annotated[list[str], Parameter(name="--cfg", negative="", show_default=False)] = field(default_factory=list)
    "A Zenoh setting KEY:VALUE, VALUE in JSON5; may be given again."
    keys: str | None = None
    "A directory of certificates (`blackboard keys init`); every connection then shows one."

    def link(self, **changes: object) -> LinkConfig:
        """The link's configuration, with some settings changed."""
        settings: dict[str, object] = {
            "mode": self.mode,
            "connect": tuple(self.connect),
            "listen": tuple(self.listen),
            "file": self.config,
            "multicast": self.multicast_scouting,
            "cfg": tuple(self.cfg),
            "keys": self.keys,
        }
        return LinkConfig(**(settings | changes))  # type: ignore[arg-type]


class Stop(threading.Event):
    """A flag that the first SIGINT or SIGTERM sets; the loop looks at it, so that the process ends in order.

    One that has not ended after `within` seconds (None: it may take its time) ends at once, with the status `STOPPED`.
    """

    def __init__(self, within: float | None = None) -> None:
        super().__init__()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self.set())
        if within is not None:
            told, tell = os.pipe()
            os.set_blocking(tell, False)
            # written to even while no Python runs in the main thread
            signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
            threading.Thread(target=_end, args=(told, within), daemon=True).start()

    def __call__(self) -> bool:
        return self.is_set()


def _end(told: int, within: float) -> None:
    """End this process so many seconds after a signal, of which a pipe informs."""
    os.read(told, 1)
    threading.Event().wait(within)
    os._exit(STOPPED)


def serve(
    service: Service,
    name: str,
    flags: ZenohFlags,
    *,
    linger: float = 0.0,
    within: float | None = None,
    asks: str | None = None,
) -> None:
    """Run a service over a Zenoh session of its own until it is done or a signal comes.

    With the key expression `asks` it is first handed the newest that was published on it before. What is on its way at the end is
    still handed to the service, until nothing came for 0.1 s, for at most `linger` seconds. With `within` the process is gone so
    many seconds after a signal, whatever it does: for those who keep nothing.
    """
    stop, clock = Stop(within), UnixClock()
    config = flags.link(who=_who(service.tokens, name))
    identity = config.identity()
    if identity is not None:
        identity.check_tokens(service.tokens)
    with Link(config, name, patience=PATIENCE, stopped=stop, clock=clock) as link:

        def ready() -> None:
            # asked once it listens, so that nothing is missed between the two
            for envelope in link.get(asks) if asks else ():
                service.receive(envelope, clock.now())
            say("ready", process=name, tokens=list(service.tokens))

        run(service, link, clock, stop, ready)
        end = clock.now() + linger
        while clock.now() < end and (late := link.receive(0.1)):
            for envelope in late:
                service.receive(envelope, clock.now())
        service.record_link_counters(link.counters)


def route(flags: ZenohFlags) -> None:
    """Run a Zenoh router until a signal comes. It is ready as soon as a session can be opened through it."""
    stop, config = Stop(), flags.link(mode="router", who="router")
    listen = flags.listen or flags.config or (SECURE_ENDPOINT if flags.keys else DEFAULT_ENDPOINT)
    ready = partial(say, "ready", process="router", listen=listen)
    if config.keys:
        keep_door(config, stop, ready)
        return
    with Link(config, "router", stopped=stop):
        ready()
        while not stop.wait(3600.0):
            pass


def say(event: str, **fields: object) -> None:
    """Log an event with its fields. Launchers and tests wait for the event `ready` in a process's log."""
    log.info(event, extra={"fields": fields})


def _who(tokens: tuple[str, ...], name: str) -> str:
    """The member whose certificate a process looks for: by the token that it holds, else by its name."""
    for token in tokens:
        topic, parts = parse(token) or (None, {})
        if topic is not None:
            return "world" if topic is WORLD else f"{topic.owner}/{parts[topic.owner]}"
    return name


def check_name(what: str, value: str) -> None:
    """Check that a name can be one chunk of a Zenoh key. UserError: it cannot; `what` names the flag."""
    if not re.fullmatch(NAME, value):
        raise UserError(
            f"{what} {value!r}: use up to 64 letters, digits, '.', '_' and '-', it becomes part of a Zenoh key"
        )


def version() -> str:
    """The version of the package, for `--version`."""
    return blackboard.__version__


def new_app(name: str, about: str = "") -> App:
    """A command line, for all whose commands it takes a fraction is no whole number."""
    return App(name=name, help=about, version=version, config=_refuse_fractions, help_format="plaintext")


def groups(named: Mapping[str, str]) -> dict[str, Group]:
    """Of each command the group in which the help shows it; `named` is the title of each group and its commands, in order."""
    made = {title: Group(title, sort_key=place) for place, title in enumerate(named)}
    return {command: made[title] for title, commands in named.items() for command in commands.split()}


def _refuse_fractions(_: App, __: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Check the flags that are whole numbers, because cyclopts rounds. UserError: one is a fraction."""
    for argument in arguments:
        for token in argument.tokens if _is_whole(argument.hint) else ():
            try:
                whole = "." not in token.value or float(token.value).is_integer()
            except ValueError:  # no number: cyclopts says so
                continue
            if not whole:
                raise UserError(f"{token.keyword or argument.name} {token.value}: give a whole number")


def _is_whole(hint: Any) -> bool:
    """Whether what a flag takes are whole numbers, optional or many."""
    return hint is int or any(_is_whole(one) for one in get_args(hint))


def main(app: App) -> NoReturn:
    """Run a command line and exit: with the integer it returns, or with the status of the error that it meets.

    SIGINT interrupts also where it was ignored at the start, as it is for what a shell script puts into the background. The
    processes started from here on then get the default disposition: a program inherits what is ignored, but no handler.
    """
    status: object = DONE
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        follow_parent()
        _zenoh_log()
        # all that any command prints goes through these
        sys.stdout, sys.stderr = cast(TextIO, Printed(sys.stdout)), cast(TextIO, Printed(sys.stderr))
        logs.set_up(os.environ.get("LOG_LEVEL", "INFO").upper(), as_json=os.environ.get("LOG_FORMAT") == "json")
        status = app(exit_on_error=False, print_error=False, result_action="return_value")
    except (CycloptsError, UserError, RunFailed) as error:
        said = _mistake(error) if isinstance(error, CycloptsError) else str(error)
        print(ERROR + " ".join(said.split()), file=sys.stderr)  # noqa: T201
        status = FAILED if isinstance(error, RunFailed) else USER_ERROR
    except KeyboardInterrupt:
        status = INTERRUPTED
    except Stopped:
        pass
    except BrokenPipeError:
        if _has_reader():
            raise
        status = NO_READER
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        status = NO_READER
    if status == NO_READER:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is flushed at the exit
    sys.exit(status if isinstance(status, int) else DONE)


def _mistake(error: CycloptsError) -> str:
    """What is wrong with a command line, with the names that its help uses, and all that may be given instead."""
    command = " ".join(error.command_chain or ())
    if isinstance(error, MissingArgumentError) and error.argument is not None and not error.keyword:
        argument = error.argument
        if not argument.tokens:
            name = argument.name.lstrip("-").upper() if argument.field_info.is_positional else argument.name
            known = [str(value) for value in get_args(argument.hint) if isinstance(value, str)]
            one_of = f", one of {', '.join(known)}" if known else ""
            return f"{command or 'command'}: {name} is missing{one_of}; --help says what it is"
    if isinstance(error, CoercionError) and error.token is not None and error.target_type in NUMBERS:
        return f"{error.token.keyword or command} {error.token.value}: give {NUMBERS[error.target_type]}"
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"{command or 'command'}: {' '.join(error.unused_tokens)} is too much; it takes {_taken(error.app)} (--help)"
    if isinstance(error, UnknownCommandError) and error.unused_tokens and error.app is not None:
        given, known = error.unused_tokens[0], [name for name in error.app if not name.startswith("-")]
        return f'Unknown command "{given}"; there are {", ".join(known)}{nearest(given, known)}'
    return str(error)


def _taken(command: App | None) -> str:
    """What a command takes: its arguments by the names that its help uses, and flags."""
    arguments = command.assemble_argument_collection() if command is not None and command.default_command else ()
    names = [one.name.lstrip("-").upper() for one in arguments if one.field_info.is_positional and "*" not in one.name]
    return f"{', '.join(names)} and flags" if names else "flags only"


def _has_reader() -> bool:
    """Whether the other end of standard output is still open."""
    looked = select.poll()
    looked.register(sys.stdout.fileno(), 0)
    return not any(event & (select.POLLERR | select.POLLHUP) for _, event in looked.poll(0))


def _zenoh_log() -> None:
    """Turn on Zenoh's own log where RUST_LOG asks for it.

    Zenoh writes it to standard output, which is for data. So descriptor 1 becomes standard error, and `sys.stdout` gets a
    duplicate of the descriptor that it had.
    """
    if "RUST_LOG" in os.environ:
        sys.stdout.flush()
        data = os.dup(1)
        os.dup2(2, 1)
        sys.stdout = os.fdopen(data, "w")
        start_zenoh_log()


def follow_parent() -> None:
    """End with the process whose number BLACKBOARD_PARENT gives; without it, do nothing."""
    parent = os.environ.get(PARENT)
    if parent:
        follow(int(parent))
