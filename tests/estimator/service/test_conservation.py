"""The conservation law, by itself and in a service whose accounts are wrong."""

import pytest

from bridge.wire.refusal import Tally
from estimator.device.batch_correction import Cut
from estimator.device.outcome import Outcome
from estimator.device.session import DeviceSession
from estimator.samples.sample_buffer import Samples
from estimator.service.conservation import EVENT, Conservation, SampleAccount, combined
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, info

GOOD = SampleAccount(came=100, out=90, dropped=10, said=90)


def test_it_holds() -> None:
    law = Conservation()
    assert law.check({"a": GOOD, "b": GOOD}, decoded=200, turned_away=0) == {}
    assert law.total == SampleAccount(came=200, out=180, dropped=20, said=180)
    assert law.check({}, 200, 0) == {}, "of devices that are forgotten, too"
    assert law.check({"c": GOOD}, 300, 0) == {}


@pytest.mark.parametrize(
    ("account", "words"),
    [
        (SampleAccount(100, 90, 9, 90), "1 samples came and are neither out nor dropped"),
        (SampleAccount(100, 90, 11, 90), "-1 samples came"),
        (SampleAccount(100, 90, 10, 80), "10 samples count as out and were not published"),
        (SampleAccount(100, 90, 9, 91), "-1 samples count as out"),
    ],
)
def test_what_breaks_it_is_told_when_it_is_new(account: SampleAccount, words: str) -> None:
    law = Conservation()
    (said,) = law.check({"a": account}, 100, 0).values()
    assert words in said
    assert law.check({"a": account}, 100, 0) == {}
    worse = combined([account, SampleAccount(came=9, out=4, said=4)])
    assert list(law.check({"a": worse}, 109, 0)) == ["a"]
    assert law.violations == {"a": 2}


def test_a_service_in_which_samples_vanish_says_so(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    batches = once.batches()
    ward.send(batches[:100], info(1))
    assert EVENT not in ward.latest().events
    handle = DeviceSession.take

    def forgetful(self: DeviceSession, samples: Samples, cuts: list[Cut]) -> Outcome | None:
        return handle(self, samples, [])

    with monkeypatch.context() as patch:
        patch.setattr(DeviceSession, "take", forgetful)
        ward.send(batches[100:110])
    ward.latest()
    status = ward.latest()
    assert status.events[EVENT] == 1
    assert caplog.text.count(" samples count as out and were not published") == 1
    ward.send(batches[110:120])
    assert ward.latest().events[EVENT] == 1, "it is told when it is new"
    with monkeypatch.context() as patch:
        patch.setattr(Tally, "add", lambda *_: 0)
        ward.put(b"", bridge="bridge", device=NAME)
        ward.send([*batches[118:120]])  # repeated, and not counted
    ward.latest()
    assert ward.latest().events[EVENT] == 2
    assert ward.service.counts.as_dict()[EVENT] == 2
