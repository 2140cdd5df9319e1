"""What a team agrees on, told to another one: over real boards on a bus, without a network or a clock."""

import logging
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import pytest

from blackboard.board.service import BoardService
from blackboard.client.agreed import FORGOTTEN, Agreed, TeamNews
from blackboard.client.agreed import MAX_SUBJECTS as REMEMBERED
from blackboard.client.member import Member
from blackboard.client.share import MAX_SUBJECTS, Share
from blackboard.config import BoardSection
from blackboard.net.scheduler import Scheduler
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire import keys
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock, Report, Status
from blackboard.wire.names import VIA
from tests.wire.envelopes import consensus, put, token

GRID = Grid((20, 20))
BALL = "object/ball"
STEP = 0.1  # seconds
DRIFT = 0.5
SETTINGS = BoardSection(fusion="opinions", period=0.5, drift=DRIFT)


class Teams(Scheduler):
    """Teams of a board and one robot each, on one bus, that share what `pairs` say; robots are named r1 everywhere."""

    def __init__(self, *teams: str, pairs: Iterable[tuple[str, str]], **options: object) -> None:
        super().__init__()
        self.agreed: dict[tuple[str, str], Agreed] = {}
        self.said: list[tuple[float, str, Report]] = []  # by those who share: when, and to which team
        self.bus.spies.append(self._spy)
        self.robots = {team: self._robot(team) for team in teams}
        boards = [
            BoardService(team=team, sub_team="a", board="board-a", grid=GRID, settings=SETTINGS) for team in teams
        ]
        self.shares = {(source, to): self._share(source, to, dict(options)) for source, to in pairs}
        for service in (*self.robots.values(), *boards, *self.shares.values()):
            self.join(service)

    def _robot(self, team: str) -> Member:
        def hear(agreed: Agreed) -> None:
            self.agreed[team, agreed.subject] = agreed

        return Member(team=team, sub_teams=("a",), robot="r1", grid=GRID, settings=SETTINGS, news=TeamNews(GRID, hear))

    @staticmethod
    def _share(source: str, to: str, options: dict[str, object]) -> Share:
        settings = SETTINGS.model_copy(update={"max_age": options.pop("max_age", SETTINGS.max_age)})
        return Share(source, to, sub_team="a", grid=GRID, settings=settings, **options)  # type: ignore[arg-type]

    def _spy(self, envelope: Envelope) -> None:
        if f"/report/{VIA}" in envelope.key:
            self.said.append((self.now, envelope.key.split("/")[1], decode(Report, envelope.payload)))

    def run(self, seconds: float, sees: Sequence[tuple[str, str, Belief]] = ()) -> None:
        """Let time pass, while robots of teams report beliefs on subjects."""
        for _ in range(round(seconds / STEP)):
            for team, subject, belief in sees:
                robot = self.robots[team]
                self.send(robot, robot.report(subject, belief, self.now))
            self.run_for(STEP)

    def of(self, team: str, subject: str = BALL) -> Belief:
        return self.agreed[team, subject].belief

    def fresh(self, team: str, subject: str = BALL) -> bool:
        """Whether a team still agrees on something about a subject."""
        newest = self.agreed.get((team, subject))
        return newest is not None and self.now - newest.time < 1.5


SEEN = gaussian(GRID, (6.5, 8.5), 1.5)
BOTH_WAYS = [("north", "all"), ("all", "north"), ("south", "all"), ("all", "south")]


def test_what_one_team_sees_all_of_a_tree_believe_and_no_more() -> None:
    teams = Teams("north", "south", "all", pairs=BOTH_WAYS, every=0.5)
    teams.run(20.0, [("north", BALL, SEEN)])
    for team in ("all", "south"):
        assert math.dist(teams.of(team).mean(), (6.5, 8.5)) < 0.2
        # older by a settlement or two
        assert entropy(SEEN.p) - 0.02 < entropy(teams.of(team).p) < entropy(SEEN.p) + 0.8
    assert entropy(teams.of("north").p) == pytest.approx(entropy(SEEN.p), abs=0.05)
    assert set(teams.agreed["south", BALL].story.ancestors) == {f"{VIA}all", "north..r1"}


def test_nobody_is_told_what_rests_on_its_own_robots_alone() -> None:
    teams = Teams("north", "all", pairs=[("north", "all"), ("all", "north")])
    teams.run(5.0, [("north", BALL, SEEN)])
    assert {to for _, to, _ in teams.said} == {"all"}
    assert teams.shares["all", "north"].tells.intake.counters["not_shared"] > 0


def test_nobody_is_told_again_what_came_from_it() -> None:
    """The root has it from the first team, so the second one, which has it from the root, need not say it."""
    teams = Teams("north", "south", "all", pairs=BOTH_WAYS, every=0.5)
    teams.run(10.0, [("north", BALL, SEEN)])
    assert {(to, report.source) for _, to, report in teams.said} == {("all", f"{VIA}north"), ("south", f"{VIA}all")}


def test_two_teams_that_see_the_same_do_not_become_surer_in_a_circle() -> None:
    """Each tells the other again and again; Chernoff's rule adds nothing that was there before."""
    teams = Teams("north", "south", pairs=[("north", "south"), ("south", "north")], every=0.2)
    teams.run(4.0, [("north", BALL, SEEN), ("south", BALL, SEEN)])
    early = entropy(teams.of("north").p)
    teams.run(40.0, [("north", BALL, SEEN), ("south", BALL, SEEN)])
    assert entropy(teams.of("north").p) == pytest.approx(early, abs=0.02)
    assert entropy(teams.of("north").p) > entropy(SEEN.p) - 0.02


def test_what_nobody_sees_any_more_ends_in_all_teams() -> None:
    teams = Teams("north", "south", "all", pairs=BOTH_WAYS, every=0.5, max_age=3.0)
    teams.run(5.0, [("north", BALL, SEEN)])
    assert teams.fresh("south")
    assert teams.fresh("all")
    teams.robots["north"].withdraw(BALL, teams.now)
    teams.run(40.0)
    assert not any(teams.fresh(team) for team in ("north", "south", "all"))


def test_two_views_meet_at_the_root_and_come_back_sharper() -> None:
    """One team measures along one axis, the other along the other one: together they know both."""
    along, across = gaussian(GRID, (6.5, 8.5), (0.7, 4.0)), gaussian(GRID, (6.5, 8.5), (4.0, 0.7))
    teams = Teams("north", "south", "all", pairs=BOTH_WAYS, every=0.5)
    teams.run(10.0, [("north", BALL, along), ("south", BALL, across)])
    for team in ("north", "south", "all"):
        assert entropy(teams.of(team).p) < entropy(along.p) - 0.3


def test_robots_keep_the_name_of_their_team_and_never_come_home() -> None:
    teams = Teams("north", "south", "all", pairs=BOTH_WAYS, subjects=["robot/*"])
    teams.run(6.0, [("north", "robot/r1", SEEN), ("south", BALL, SEEN)])
    subjects = {(to, report.subject) for _, to, report in teams.said}
    assert subjects == {("all", "robot/north..r1"), ("south", "robot/north..r1")}
    assert math.dist(teams.of("south", "robot/north..r1").mean(), (6.5, 8.5)) < 0.2
    assert ("all", BALL) not in teams.agreed


def test_one_report_in_a_period_and_the_newest_one() -> None:
    teams = Teams("north", "all", pairs=[("north", "all")], every=2.0)
    teams.run(10.0, [("north", BALL, SEEN)])
    times = [at for at, _, _ in teams.said]
    assert 4 <= len(times) <= 6
    assert all(later - earlier > 1.9 for earlier, later in pairwise(times))
    # each is stamped with the time of the settlement that it tells, which is every half second
    assert all(0.0 <= at - report.time <= 0.6 for at, _, report in teams.said)
    assert all(report.time % 0.5 == pytest.approx(0.0, abs=0.11) for _, _, report in teams.said)


def test_another_grid_is_refused_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    teams = Teams("north", pairs=[])
    share = Share("north", "all", sub_team="a", grid=Grid((10, 10)), settings=SETTINGS)
    teams.join(share)
    with caplog.at_level(logging.WARNING):
        teams.run(3.0, [("north", BALL, SEEN)])
    assert share.hears.intake.refused["grid"] > 2
    assert sum("the team's is (10, 10)" in line for line in caplog.messages) == 1


def test_it_holds_a_token_in_the_team_that_it_tells_and_none_in_the_other() -> None:
    teams = Teams("north", "all", pairs=[("north", "all")])
    share = teams.shares["north", "all"]
    assert share.tokens == (keys.MEMBER.key(team="all", sub_team="a", robot=f"{VIA}north"),)
    sent: list[str] = []
    teams.bus.spies.append(lambda envelope: sent.append(envelope.key))
    teams.run(3.0, [("north", BALL, SEEN)])
    assert not [key for key in sent if key.startswith("cop/north/") and VIA in key]
    status = teams.link(share).newest[keys.STATUS.key(team="all", sub_team="a", process=f"{VIA}north")]
    decoded = decode(Status, status)
    assert decoded.subjects == [BALL]
    assert decoded.counters["shared"] > 0


def agreed(subject: str, time: float, team: str = "north", tick: int = 1, **until: float) -> Envelope:
    """What the board of a team says at a time, by its own clock: what its robots gathered until when."""
    said = consensus(SEEN, subject, board="board-a", tick=tick, time=time, ancestors=until)
    return put(said, team=team)


def reports(out: Iterable[Envelope]) -> list[Report]:
    return [decode(Report, envelope.payload) for envelope in out if keys.REPORT.match(envelope.key)]


def ancestors(report: Report) -> dict[str, float]:
    assert report.informed is not None
    return report.informed.ancestors


def new_share(source: str = "north", to: str = "all", **options: object) -> tuple[Share, float]:
    """A share among two teams whose boards it knows, and the Unix time."""
    teams = Teams(source, to, pairs=[(source, to)], **options)
    teams.run(STEP)
    return teams.shares[source, to], teams.now


def test_no_more_objects_are_told_than_a_board_keeps_and_those_that_are_gone_make_room() -> None:
    share, now = new_share(max_age=2.0)
    subjects = [f"object/{n}" for n in range(MAX_SUBJECTS + 20)]
    subjects_told = [report.subject for s in subjects for report in reports(share.receive(agreed(s, now, r1=now), now))]
    assert subjects_told == subjects[:MAX_SUBJECTS]
    share.check()
    share.wake(now + 6.0)
    assert [
        report.subject for report in reports(share.receive(agreed("object/new", now + 6.0, r1=now + 6.0), now + 6.0))
    ] == ["object/new"]


def test_a_team_in_simulated_time_is_told_by_its_own_clock_how_old_it_is() -> None:
    """Stamps of one team mean nothing in the other one; how long ago they were does."""
    share, now = new_share()
    clock = Clock(run="one", tick=14, time=7.0, mode="lockstep", robots={"a": ["r1"]})
    for envelope in (token(keys.WORLD, team="all"), put(clock, team="all")):
        share.receive(envelope, now)
    assert len(reports(share.receive(agreed(BALL, 2.0, r1=2.0), now))) == 1
    assert share.receive(agreed(BALL, 3.0, r1=2.75), now + 0.75) == []  # a report in a second
    (report,) = reports(share.wake(now + 1.0))
    assert report.time == pytest.approx(6.75)
    assert ancestors(report) == {"north..r1": pytest.approx(6.5)}


def test_in_another_run_of_the_team_that_is_told_it_is_told_again() -> None:
    """What that team knew before, and until when, means nothing any more."""
    teams = Teams("north", "all", pairs=[("north", "all")], every=0.5)
    teams.run(4.0, [("north", BALL, SEEN)])
    clock = Clock(run="one", tick=1, time=0.5, mode="realtime", robots={})
    link = teams.bus.connect()
    link.token(keys.WORLD.key(team="all"))
    link.send(put(clock, team="all"))
    before = len(teams.said)
    teams.run(3.0, [("north", BALL, SEEN)])
    since = teams.said[before:]
    assert len(since) >= 4
    assert all(report.time < 10.0 for _, _, report in since[-3:])


@pytest.mark.parametrize("wrong", [-30.0, 30.0, -1e6])
def test_the_clock_of_the_team_that_is_heard_may_be_wrong(wrong: float) -> None:
    share, now = new_share(every=0.2)
    (report,) = reports(share.receive(agreed(BALL, now + wrong, r1=now + wrong - 0.5), now))
    assert report.time == pytest.approx(now)
    assert ancestors(report) == {"north..r1": pytest.approx(now - 0.5)}


@pytest.mark.parametrize("name", ["husky.1", "r.r.r", "n" * 50])
def test_robots_with_dots_and_long_names_stay_those_of_their_team(name: str) -> None:
    share, now = new_share("site.north", "site", subjects=["robot/*", "object/*"])
    (report,) = reports(share.receive(agreed(f"robot/{name}", now, "site.north", r1=now), now))
    assert report.subject == f"robot/site.north..{name}"


def test_a_robot_whose_name_becomes_too_long_is_not_shared_and_no_name_ends_a_report() -> None:
    share, now = new_share(subjects=["robot/*", "object/*"])
    assert share.receive(agreed("robot/" + "n" * 62, now, r1=now), now) == []
    (report,) = reports(share.receive(agreed(BALL, now, **{"all..": now, "n" * 64: now, "r1": now}), now))
    assert set(ancestors(report)) == {"north..r1"}


def test_one_forged_message_far_in_the_future_ends_nothing_for_long() -> None:
    teams = Teams("north", "all", pairs=[("north", "all")], every=0.5)
    teams.run(2.0, [("north", BALL, SEEN)])
    forged = teams.agreed["north", BALL].story.model_copy(update={"tick": 2**53 - 1, "time": 1e12})
    teams.bus.connect().send(put(forged, team="north"))
    teams.run(FORGOTTEN + 2.0, [("north", BALL, SEEN)])
    before = len(teams.said)
    teams.run(3.0, [("north", BALL, SEEN)])
    assert len(teams.said) - before >= 4


def test_what_is_remembered_of_a_flood_is_bounded() -> None:
    share, now = new_share()
    for n in range(REMEMBERED + 50):
        share.receive(agreed(f"object/x{n}", now, r1=now), now)
    share.check()


def test_a_worlds_referee_hears_nothing_of_it() -> None:
    """It has no place, so its uniform beliefs would only spoil the scores of the robots."""
    share, now = new_share()
    share.receive(token(keys.WORLD, team="all"), now)
    clock = Clock(run="one", tick=3, time=1.0, mode="lockstep", robots={"a": ["r1"]})
    again = put(clock, team="all")  # the world asks a second time
    out = [one for said in (again, agreed(BALL, now, r1=now), again) for one in share.receive(said, now)]
    assert len(reports(out)) == 2
    assert not [envelope.key for envelope in out if keys.SOLO.match(envelope.key)]
