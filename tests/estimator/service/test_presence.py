"""What liveliness tokens mean, and what not: settled by boot, a hint only."""

from itertools import permutations

import pytest

from bridge.reasons.codes import Code
from bridge.wire import keys
from bridge.wire.refusal import Tally
from estimator.service.presence import SETTLED_S, Presence

BRIDGE = keys.build("w", "alive/bridge", bridge="b")
OLD, NEW = (keys.build("w", "alive/device", device="wrist", boot=keys.boot_id(boot)) for boot in (1, 2))


def told(*changes: tuple[str, bool], now: float = 0.0) -> Presence:
    presence = Presence(Tally())
    for change in changes:
        presence.change(*change)
    presence.note(now)
    return presence


def gone(presence: Presence, boot: int, now: float = SETTLED_S) -> bool:
    return presence.gone("wrist", boot, "b", now)


def test_a_boot_whose_token_was_taken_back_by_a_bridge_that_lives_is_gone() -> None:
    presence = told((BRIDGE, True), (OLD, True), (OLD, False))
    assert not gone(presence, 1, SETTLED_S - 0.1), "not before it is settled"
    assert gone(presence, 1)
    assert presence.why("wrist", 1, "b") == (Code.DEVICE_UNHEARD(bridge="b"),)


@pytest.mark.parametrize("order", set(permutations([(OLD, True), (OLD, False), (NEW, True)])))
def test_no_order_of_an_old_boots_tokens_says_anything_of_the_new_one(order: tuple[tuple[str, bool], ...]) -> None:
    presence = told((BRIDGE, True), *order)
    assert not gone(presence, 2, 100.0)
    assert not presence.why("wrist", 2, "b")


def test_a_bridge_that_dies_with_its_devices_says_nothing_of_them() -> None:
    presence = told((BRIDGE, True), (OLD, True), (OLD, False), (BRIDGE, False))
    assert not gone(presence, 1, 100.0)
    assert presence.why("wrist", 1, "b") == (Code.BRIDGE_GONE(bridge="b"),)


def test_without_a_router_nothing_is_known() -> None:
    presence = told((BRIDGE, True), (OLD, True), (OLD, False))
    presence.forget()
    presence.note(1.0)
    assert not gone(presence, 1, 100.0)
    assert presence.why("wrist", 1, "b") == (Code.BRIDGE_NOT_BACK(bridge="b"),)
    presence.change(BRIDGE, True)
    presence.note(2.0)
    assert not presence.why("wrist", 1, "b")
