"""The network bench says which promise was broken, and how far."""

from typing import Any

from tests.bench.network.guarded import Heard
from tests.bench.network.judge import Verdict, disputed_until, judged


def given(*spans: tuple[int, int], epoch: int = 1, good: bool = True) -> list[dict[str, Any]]:
    """Batches of one boot from the first number to before the last, a second apart."""
    common = {"device": "d", "boot": 1, "epoch": epoch, "good": good, "old": 0, "late": 0}
    return [common | {"at": float(at), "first": first, "n": last - first} for at, (first, last) in enumerate(spans)]


def verdict(*spans: tuple[int, int], good: bool = True) -> Verdict:
    return judged(Heard(batches=given(*spans, good=good)), 0.0)


def test_what_came_once_and_in_order_breaks_nothing() -> None:
    found = verdict((0, 10), (10, 20))
    assert (found.broken, found.kept) == ("", True)


def test_what_is_lost_is_not_said_to_be_given_twice() -> None:
    found = verdict((0, 10), (1056, 1066))
    assert (found.broken, found.kept) == ("1,046 lost", False)


def test_what_is_given_twice_is_said_to_be() -> None:
    assert verdict((0, 10), (0, 10), (10, 20)).broken == "10 given twice, 10 GOOD twice"
    assert verdict((0, 10), (10, 20), (0, 10), good=False).broken == "20 given twice, 1 out of order"


def test_a_loss_that_is_told_counts_though_nothing_of_the_device_came_before() -> None:
    heard = Heard(batches=given((0, 10)), misses=[{"at": 5.0, "n": 3}])
    assert judged(heard, 1.0).broken == "3 lost"


def test_a_device_without_an_owner_is_disputed_until_it_has_one_or_until_now() -> None:
    def said(at: float, *held: str) -> dict[str, Any]:
        return {"at": at, "estimator": "e1", "held": dict.fromkeys(held, 1)}

    nobody_since = [said(1.0, "d"), said(5.0)]
    taken = Heard(owned=[*nobody_since, said(7.0, "d"), said(8.0, "d")])
    assert disputed_until([taken], ["d"], since_s=4.0, now_s=9.0) == 7.0
    assert disputed_until([taken, Heard(owned=nobody_since)], ["d"], since_s=4.0, now_s=9.0) == 9.0
