"""`blackboard share` between real teams, as docs/fleets.md says: what one sees the others believe, by the root of a tree."""

import json
import re
from collections.abc import Callable
from contextlib import ExitStack

import pytest

from blackboard.client import Team
from blackboard.net.link import Link
from blackboard.opinion.belief import gaussian
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.messages import Consensus
from tests.commands import call
from tests.mistakes import one_line
from tests.processes import program, wait_until
from tests.snippets import block

BALL = "object/ball"


def test_an_object_that_one_team_sees_is_known_in_the_others(endpoint: str, connect: Callable[[str], Link]) -> None:
    link = connect("watcher")
    agreed = keys.AGREED.key(team="south", sub_team="a", subject=BALL)
    commands = [command.split()[1:] for command in block("fleets.md", "blackboard serve --team all").commands]
    there = ("-e", endpoint)
    with ExitStack() as stack:
        for team in ("north", "south"):
            board = ("serve", "--team", team, "--sub-team", "a", *there)
            stack.enter_context(program("-m", "blackboard", *board)).says("ready")
        for command in commands:
            words = [word.replace("tcp/base:7447", endpoint) for word in command]
            stack.enter_context(program("-m", "blackboard", *words)).says("ready")
        with Team("r1", endpoint=endpoint, team="north", sub_team="a") as north:
            belief = gaussian(north.grid, (20.0, 30.0), 2.0)

            def known_in_the_south() -> bool:
                north.report(BALL, belief)
                consensuses = [decode(Consensus, envelope.payload) for envelope in link.get(agreed)]
                return any("north..r1" in consensus.ancestors for consensus in consensuses)

            wait_until(known_in_the_south, "the south knows of the ball")
        question = ("why", BALL, "--team", "south", "--json", "-e", endpoint)
        with program("-m", "blackboard", *question) as why:
            assert why.ends() == 0, why.err
            assert "north..r1" in json.dumps(json.loads(why.out))


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("a", "a"), "a a: give two teams"),
        (("a/b", "c"), "SOURCE 'a/b': use up to 64 letters"),
        (("a", "c", "--subject", "ball"), "--subject ball: write object/NAME, 'object/*', robot/NAME or 'robot/*'"),
        (("a", "c", "--every", "0"), "--every 0: give seconds above 0 and below [board] max_age, which is 10"),
        (("a", "c", "--keys", "certificates"), "--keys: a certificate is for one team"),
        (("a", "demo", "--scenario", "demo"), "demo: there are a, b; say --sub-team"),
        (("a" * 60, "c"), "at most 59 letters"),
    ],
)
def test_mistakes_are_one_line(command: tuple[str, ...], said: str, endpoint: str) -> None:
    with one_line(re.escape(said)):
        call("share", *command, "-e", endpoint)
