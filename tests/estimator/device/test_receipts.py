"""A status tells what the bias filter made of each measurement, once: what is right is accepted, what is not is refused."""

from collections import Counter
from dataclasses import replace

import numpy as np

from bridge.reasons.catalogue import in_words
from bridge.sim.motion import Still
from bridge.wire.messages import Receipt
from estimator.device.session import DeviceSession
from tests.estimator.stream import NAME, Stream, calibration, feed


def told(stream: Stream) -> tuple[DeviceSession, list[Receipt]]:
    """The receipts of all statuses, said once a second."""
    device, found = DeviceSession(NAME), list[Receipt]()
    for number, batch in enumerate(stream.batches()):
        feed(device, [batch])
        if number % 10 == 9:
            found += device.status(batch.start_time_ns).receipts
    return device, found


def test_receipts_of_a_rest_and_of_a_bias_that_jumps() -> None:
    calm = calibration(seed=1, after=[Still(40.0)])
    device, good = told(calm)
    assert len(good) > 20
    assert all(one.accepted for one in good)
    assert device.status(1).receipts == ()
    assert 0 < device.status(1).nis < 2
    end_ns = 1_700_000_000 * 10**9 + int(calm.ticks[-1]) * 1000
    assert end_ns - 3 * 10**9 < good[-1].time_ns <= end_ns
    for one in good:
        assert one.test_ratio < 1
        assert np.all(np.abs(one.innovation) < 6 * np.array(one.innovation_std))
        assert in_words(one.kind).startswith("zero-rate update")
    jumped = calm.gyro.copy()
    jumped[calm.at(calm.time[-1] - 20.0) :] += 0.003
    device, bad = told(replace(calm, gyro=jumped))
    refused = [f"{one.kind}: {one.reason}" for one in bad if not one.accepted]
    assert all(one.test_ratio > 1 for one in bad if not one.accepted)
    assert Counter(refused) == device.status(1).events  # counted there, and explained here
    assert "zaru level: outside the gate" in refused
    assert any(one.accepted and one.test_ratio > 1 and one.reason == "jumped" for one in bad)
