"""Orientation is published while somebody subscribes, its heading is reset by command, and a takeover goes on with it."""

import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.sim.motion import Piece, Still
from bridge.sim.motion_scripts import swing
from bridge.wire.messages import OrientationBatch, SampleBatch
from estimator.client.stream import Stream
from estimator.device.session import DeviceSession
from estimator.orientation.attitude import Oriented
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, calibration, handle, info


@pytest.fixture
def ward(tmp_path: Path) -> Ward:
    return Ward(tmp_path)


@pytest.fixture(scope="module")
def batches() -> list[SampleBatch]:
    after: list[Piece] = [Still(2.0), swing(np.random.default_rng(3), 2.0, np.radians(90.0)), Still(2.0)]
    return calibration(seed=1, after=after).batches()


def look_round(ward: Ward) -> None:
    """The work of a second."""
    ward.service._every_second(time.monotonic())
    ward.service.work()


def of(stream: Stream[OrientationBatch]) -> list[OrientationBatch]:
    found = stream.drain(0.05)
    while more := stream.drain(0.05):
        found += more
    return found


def test_it_is_made_for_subscribers_only(ward: Ward, batches: list[SampleBatch]) -> None:
    ward.send(batches[:25], info())
    look_round(ward)
    assert ward.service._devices[NAME].session.attitude is None
    with closing(ward.client.orientation(NAME, idle_s=0.05)) as stream:
        look_round(ward)
        ward.send(batches[25:65])
        said = of(stream)
    numbers = [batch.sequence + i for batch in said for i in range(len(batch))]
    assert numbers == list(range(batches[25].sequence, batches[65].sequence))
    assert said[0].zero == "start"
    assert said[0].zero_sequence == said[0].sequence == batches[25].sequence
    assert all(batch.linear_accel is not None for batch in said)
    assert said[-1].ticks[-1] == batches[64].ticks[-1]
    assert 0 < said[-1].tilt_std < np.radians(15)
    for _ in range(20):
        look_round(ward)
    assert ward.service._devices[NAME].session.attitude is None, "nobody has subscribed for a while"


def test_the_heading_is_zero_by_command(ward: Ward, batches: list[SampleBatch]) -> None:
    ward.send(batches[:25], info())
    look_round(ward)
    refused = ward.command(lambda: ward.client.zero_heading(NAME, "anna"))
    assert not refused.accepted
    assert refused.message == (Code.NO_ORIENTATION(device=NAME),)
    with closing(ward.client.orientation(NAME, idle_s=0.05)) as stream:
        look_round(ward)
        half = len(batches) // 2
        ward.send(batches[25:half])
        before = of(stream)[-1]
        assert abs(before.heading[-1]) > 0.01
        reply = ward.command(lambda: ward.client.zero_heading(NAME, "anna"))
        assert reply.accepted
        assert reply.message == (Code.HEADING_IS_ZERO(),)
        ward.send(batches[half : half + 1])
        after = of(stream)[0]
    assert (after.zero, after.zero_sequence) == ("anna", after.sequence - 1)
    assert after.heading_std < before.heading_std
    turned = np.linalg.norm(batches[half].gyro, axis=1).max() * 0.1 + 0.01
    assert abs(after.heading[0]) < turned


def test_a_restored_session_goes_on_bit_for_bit(batches: list[SampleBatch]) -> None:
    whole, before = DeviceSession(NAME), DeviceSession(NAME)
    for session in (whole, before):
        session.orient()
        session.begin_boot(1, float(batches[0].device_time[0]), None)
    half, expected = len(batches) - 45, list[Oriented]()  # calibrated: turns under way would be lost
    for i, batch in enumerate(batches):
        found = handle(whole, batch).oriented
        expected += [one.attitudes for one in found] if i >= half else []
    for batch in batches[:half]:
        handle(before, batch)
    state = before.state()
    assert state is not None
    after = DeviceSession.restored(state, before.calibration, NAME)
    assert after.sequence.next is not None
    again = [batch for batch in batches if batch.sequence + len(batch) > after.sequence.next]
    assert again[0].sequence < batches[half].sequence, "a session learns again from what it had corrected before"
    first = again[0].after(after.sequence.next - again[0].sequence)
    goes_on = [one.attitudes for batch in [first, *again[1:]] for one in handle(after, batch).oriented]
    for column in range(3):
        np.testing.assert_array_equal(
            np.concatenate([one[column] for one in goes_on]), np.concatenate([one[column] for one in expected])
        )
