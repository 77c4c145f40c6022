"""The network bench says which promise was broken, and how far."""

from typing import Any

import pytest

from tests.bench.network.guarded import Heard
from tests.bench.network.judge import disputed_until, judged


def given(*spans: tuple[int, int], good: bool = True) -> list[dict[str, Any]]:
    """Batches of one boot from the first number to before the last, a second apart."""
    common = {"device": "d", "boot": 1, "epoch": 1, "good": good, "old": 0}
    return [common | {"at": float(at), "first": first, "n": last - first} for at, (first, last) in enumerate(spans)]


@pytest.mark.parametrize(
    ("heard", "since_s", "broken"),
    [
        (Heard(given((0, 10), (10, 20))), 0.0, ""),
        (Heard(given((0, 10), (1056, 1066))), 0.0, "1,046 lost"),
        (Heard(given((0, 10), (0, 10), (10, 20))), 0.0, "10 given twice, 10 GOOD twice"),
        (Heard(given((0, 10), (10, 20), (0, 10), good=False)), 0.0, "20 given twice, 1 out of order"),
        (Heard(given((0, 10)), [{"at": 5.0, "n": 3}]), 1.0, "3 lost"),
    ],
)
def test_what_was_broken_is_said(heard: Heard, since_s: float, broken: str) -> None:
    assert judged(heard, since_s).broken == broken


def test_a_device_without_an_owner_is_disputed_until_it_has_one_or_until_now() -> None:
    def said(at: float, *held: str) -> dict[str, Any]:
        return {"at": at, "estimator": "e1", "held": dict.fromkeys(held, 1)}

    nobody_since = [said(1.0, "d"), said(5.0)]
    taken = Heard(owned=[*nobody_since, said(7.0, "d"), said(8.0, "d")])
    assert disputed_until([taken], ["d"], since_s=4.0, now_s=9.0) == 7.0
    assert disputed_until([taken, Heard(owned=nobody_since)], ["d"], since_s=4.0, now_s=9.0) == 9.0
