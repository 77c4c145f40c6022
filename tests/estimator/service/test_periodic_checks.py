"""The conservation law in a service whose accounts are wrong."""

import pytest

from bridge.wire.refusal import Tally
from estimator.device.batch_correction import Cut
from estimator.device.outcome import Outcome
from estimator.device.session import DeviceSession
from estimator.samples.sample_buffer import Samples
from estimator.service.periodic_checks import EVENT
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, info


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
    assert caplog.text.count(" samples were received, but neither published nor dropped") == 1
    ward.send(batches[110:120])
    assert ward.latest().events[EVENT] == 1, "it is told when it is new"
    with monkeypatch.context() as patch:
        patch.setattr(Tally, "add", lambda *_: 0)
        ward.put(b"", bridge="bridge", device=NAME)
        ward.send([*batches[118:120]])  # repeated, and not counted
    ward.latest()
    assert ward.latest().events[EVENT] == 2
    assert ward.service.counts.as_dict()[EVENT] == 2
