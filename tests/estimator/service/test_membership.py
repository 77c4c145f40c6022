"""Which estimators are alive, and whose each device is."""

from statistics import stdev

from hypothesis import given
from hypothesis import strategies as st

from bridge.wire.messages import Holding, Owned
from estimator.service.membership import HOLD_OFF_S, LEASE_S, Membership, owner

DEVICES = [f"wrist-{n}" for n in range(20)]
NS = 1_700_000_000_000_000_000


def claims(estimator: str, held: dict[str, int], busy: tuple[str, ...] = ()) -> Owned:
    holdings = tuple(Holding(device, epoch, 1, 0, device in busy) for device, epoch in held.items())
    return Owned(estimator, NS, max(held.values(), default=0), 0.0, holdings)


def of(name: str, others: tuple[str, ...]) -> str:
    """A device that belongs to one of several."""
    return next(device for device in DEVICES if owner(device, (name, *others)) == name)


def two() -> tuple[Membership, Membership]:
    """Both know of each other, and their hold-off is over."""
    a, b = Membership("a", ["b"]), Membership("b", ["a"])
    now = HOLD_OFF_S
    for one, other in ((a, b), (b, a)):
        one.said(claims(other.own, {}), now)
        one.look(now)
    return a, b


def test_alone_everything_is_taken_at_once() -> None:
    alone = Membership("a")
    assert all(alone.wants(device, 0.0) for device in DEVICES)


def test_beside_others_nothing_is_taken_before_the_hold_off_is_over() -> None:
    a = Membership("a", ["b"], 10.0)
    device = of("a", ("b",))
    assert not a.wants(device, 10.0 + HOLD_OFF_S / 2)
    assert a.wants(device, 10.0 + HOLD_OFF_S)


def test_each_device_is_wanted_by_exactly_one() -> None:
    a, b = two()
    for device in DEVICES:
        assert a.wants(device, HOLD_OFF_S) is not b.wants(device, HOLD_OFF_S)


def test_one_that_says_nothing_for_a_lease_or_whose_token_dies_is_gone() -> None:
    a, _ = two()
    device = of("b", ("a",))
    now = HOLD_OFF_S + LEASE_S / 2
    assert a.look(now) == ([], [])
    assert a.look(now + LEASE_S) == ([], ["b"])
    assert a.wants(device, now + LEASE_S)
    a, _ = two()
    a.token("b", now, alive=False)
    assert a.look(now) == ([], ["b"])


def test_a_newcomer_is_no_member_before_it_speaks() -> None:
    a = Membership("a")
    a.token("b", 5.0, alive=True)
    assert a.look(5.0) == ([], [])
    a.said(claims("b", {}), 7.0)
    assert a.look(7.0) == (["b"], [])


def test_nobody_is_removed_while_our_own_line_is_down() -> None:
    a, _ = two()
    now = HOLD_OFF_S + 10.0
    a.hold_off(now)
    a.token("b", now, alive=False)
    assert a.look(now) == ([], [])
    a.token("b", now + 0.5, alive=True)
    a.said(claims("b", {}), now + HOLD_OFF_S)
    assert a.look(now + HOLD_OFF_S) == ([], [])


def test_a_claim_under_a_higher_epoch_ends_a_turn_and_one_under_a_lower_does_not() -> None:
    a, b = two()
    device = DEVICES[0]
    first = a.take(device, NS)
    b.hear(first)
    second = b.take(device, NS)
    assert second > first
    assert a.said(claims("b", {device: second}), HOLD_OFF_S) == [device]
    assert b.said(claims("a", {device: first}), HOLD_OFF_S) == []


def test_what_a_living_estimator_has_taken_is_not_taken_back_at_once() -> None:
    a, _ = two()
    device, now = of("a", ("b",)), HOLD_OFF_S
    a.take(device, NS)
    a.lose(device, "b", now)
    assert not a.wants(device, now + HOLD_OFF_S / 2)
    assert a.wants(device, now + HOLD_OFF_S)
    a.take(device, NS)
    a.lose(device, "b", now)
    a.token("b", now, alive=False)
    a.look(now)
    assert a.wants(device, now + 0.1), "the one that took it is gone"


def test_a_device_that_is_being_calibrated_stays_where_it_is() -> None:
    a, _ = two()
    device = of("a", ("b",))
    a.said(claims("b", {device: 5}, busy=(device,)), HOLD_OFF_S)
    assert not a.wants(device, HOLD_OFF_S)
    a.said(claims("b", {device: 5}), HOLD_OFF_S)
    assert a.wants(device, HOLD_OFF_S)


@given(st.lists(st.sampled_from(["a", "b"]), min_size=1, max_size=30))
def test_epochs_rise_whoever_takes(takers: list[str]) -> None:
    a, b = two()
    last, who = 0, ""
    for name in takers:
        one, other = (a, b) if name == "a" else (b, a)
        if name == who:
            continue
        epoch = one.take(DEVICES[0], NS)
        assert epoch > last
        other.said(claims(name, {DEVICES[0]: epoch}), HOLD_OFF_S)
        last, who = epoch, name


def test_of_two_that_took_a_device_under_one_epoch_exactly_one_gives_it_up_and_takes_it_under_another_later() -> None:
    # The last bits of their epochs are alike.
    one, other = Membership("e770", now=0.0), Membership("e3000", now=0.0)
    epoch = one.take("wrist", NS)
    assert other.take("wrist", NS) == epoch
    assert one.said(claims("e3000", other.held), 1.0) == []
    assert other.said(claims("e770", one.held), 1.0) == ["wrist"]
    other.lose("wrist", "e770", 1.0)
    assert other.take("wrist", NS) > epoch


def test_who_owns_a_device_is_the_same_in_every_version_and_shares_are_as_uneven_as_chance() -> None:
    assert [owner(f"d{number}", ("e1", "e2", "e3")) for number in range(8)] == [
        *("e1", "e2", "e3", "e2", "e1", "e3", "e3", "e2"),
    ]
    wards = [[owner(f"w{ward}-bed-{n:03d}", ("a", "b", "c")) for n in range(300)] for ward in range(100)]
    shares = [ward.count(name) for ward in wards for name in "abc"]
    assert 7.0 < stdev(shares) < 9.5  # a multinomial's is 8.2
