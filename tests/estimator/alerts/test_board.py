"""Alerts by simulation: a second a round, troubles that come and go as a scenario says."""

from collections.abc import Callable, Collection
from datetime import datetime
from random import Random

import pytest

from estimator.alerts.board import Board, Change
from estimator.alerts.outbox import GATHER_S, Outbox
from estimator.config.alerts import HOLD_S, Alerts
from estimator.device.attention import Kind

S = 10**9
NOON, NIGHT = datetime(2026, 3, 1, 12, 0), datetime(2026, 3, 1, 23, 0)  # noqa: DTZ001 - of the wall clock


def lived(board: Board, troubles: Callable[[int], Collection[str]], seconds: int) -> list[tuple[int, Change]]:
    return [(s, change) for s in range(seconds) for change in board.look(troubles(s), float(s), s * S)]


@pytest.mark.parametrize("kind", list(Kind))
def test_each_alert_is_raised_held_acknowledged_and_cleared(kind: Kind) -> None:
    settings, hold, begin = Alerts(), int(HOLD_S[kind]), 100
    board = Board(settings)
    end = begin + hold + 500
    (at, raised), (cleared_at, cleared) = lived(board, lambda s: {kind} if begin <= s < end else (), end)[0:1] + [
        (s, change) for s in range(end, end + 200) for change in board.look((), float(s), s * S)
    ]
    assert (at, raised.cleared) == (begin + hold, False)
    assert (raised.alert.since_ns, raised.alert.raised_ns) == (begin * S, at * S)
    assert cleared.cleared
    assert cleared_at == end - 1 + settings.clear_s

    board = Board(settings)
    assert lived(board, lambda s: {kind}, hold) == [], "not yet held"
    assert board.acknowledge("", "anna", 1) == []
    lived_on = board.look({kind}, hold, hold * S)
    assert [one.cleared for one in lived_on] == [False]
    assert board.acknowledge("other", "anna", 1) == []
    (seen,) = board.acknowledge(kind, "anna", 7 * S)
    assert (seen.alert.who, seen.alert.acknowledged_ns) == ("anna", 7 * S)
    assert board.standing == (seen.alert,), "it stands until its trouble ends"
    assert board.acknowledge("", "bo", 9 * S) == [], "anna was first"
    again = Board(settings, board.standing, 1000.0)
    assert [one for s in range(1000, 1500) for one in again.look({kind}, float(s), s * S)] == [], (
        "known after a restart"
    )
    assert again.look((), 1600.0, 1600 * S) == [Change(seen.alert, cleared=True)]


def test_a_flapping_device_is_one_alert_and_one_all_clear() -> None:
    chance = Random(1)
    flaps = dict.fromkeys(range(4000), False)
    at = 100
    while at < 3000:  # away for 1 to 20 s, back for 1 to 50 s
        away, back = chance.randint(1, 20), chance.randint(1, 50)
        flaps |= dict.fromkeys(range(at, min(at + away, 3000)), True)
        at += away + back
    changes = lived(Board(Alerts()), lambda s: {"lost"} if flaps[s] else (), 4000)
    assert [change.cleared for _, change in changes] == [False, True]
    assert changes[0][0] <= 100 + 60 + 50
    last = max(s for s, lost in flaps.items() if lost)
    assert changes[1][0] == last + 60


def test_a_short_absence_is_no_alert() -> None:
    assert lived(Board(Alerts()), lambda s: {"lost"} if s % 300 < 50 else (), 3000) == []


def test_any_sequence_alternates_alert_and_all_clear() -> None:
    for seed in range(30):
        chance = Random(seed)
        there, changes = False, list[Change]()
        board = Board(Alerts(hold_s={"lost": 20}, clear_s=10))
        for s in range(3000):
            there ^= chance.random() < chance.choice((0.01, 0.1, 0.5))
            changes += board.look({"lost"} if there else (), float(s), s * S)
        assert [change.cleared for change in changes] == [bool(n % 2) for n in range(len(changes))]
        assert changes


@pytest.mark.parametrize(
    ("hours", "at", "quiet"),
    [("", NIGHT, False), ("22:00-06:00", NIGHT, True), ("22:00-06:00", NOON, False), ("12:00-13:30", NOON, True)],
)
def test_quiet_hours(hours: str, at: datetime, quiet: bool) -> None:
    assert Alerts(quiet_hours=hours).quiet(at) is quiet


def test_quiet_hours_delay_what_stands_and_swallow_what_does_not() -> None:
    def alerts(seconds: Collection[int], of: str) -> list[Change]:
        return [c for _, c in lived(Board(Alerts()), lambda s: {of} if s in seconds else (), 1000)]

    outbox = Outbox(Alerts(quiet_hours="22:00-06:00"))
    raised, cleared = alerts(range(100), "lost")
    outbox.put("stays", None, raised, 0.0)
    outbox.put("short", None, raised, 0.0)
    outbox.put("short", None, cleared, 100.0)
    assert outbox.take(200.0, NIGHT) == []
    assert [(one.subject, one.cleared) for one in outbox.take(300.0, NOON)] == [("stays", False)]
    assert outbox.take(400.0, NOON) == []
    outbox.put("stays", None, cleared, 500.0)
    assert outbox.take(500.0, NOON) == [], "waits for others"
    assert [(one.subject, one.cleared) for one in outbox.take(500.0 + GATHER_S, NOON)] == [("stays", True)]
