"""What one estimator says of a device is enough for another to go on with it."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Quality, SampleBatch, State
from estimator.device.session_knobs import SessionKnobs
from estimator.service.checkpoints import Checkpoints, checkpoint_of
from estimator.service.device import Device
from tests.estimator.served import Kept
from tests.estimator.stream import NAME, calibration, feed, info

NOW_NS = 1_700_000_000_000_000_000


def calibrated() -> tuple[Device, list[SampleBatch]]:
    """A device that was calibrated and rests, and the batches of its rest that were not handled yet."""
    device = Device(Kept(), "w", NAME, SessionKnobs(), 2.0, 0.0, epoch=7)
    batches = calibration(seed=1, after=[Still(8.0)]).batches()
    device.session.info = info()
    feed(device.session, batches[:-40])
    assert device.session.life.state is State.TRACKING
    return device, batches[-40:]


def over_the_wire(checkpoint: Checkpoint) -> Checkpoint:
    key = keys.build("w", "checkpoint", device=NAME)
    return codec.decode_checkpoint(key, codec.encode_checkpoint(checkpoint))


def test_another_goes_on_where_the_first_was() -> None:
    device, rest = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    known = over_the_wire(said)
    there = Device(Kept(), "w", NAME, SessionKnobs(), 2.0, 0.0, epoch=8)
    there.take_over(known)
    going_on = there.session.sequence.next
    assert going_on is not None
    batches = calibration(seed=1, after=[Still(8.0)]).batches()
    after = [batch for batch in batches if batch.sequence + len(batch) > going_on]
    theirs = feed(there.session, after).corrected
    mine = feed(device.session, rest).corrected
    n = sum(map(len, mine))
    assert {batch.quality for batch in theirs} == {Quality.GOOD}
    np.testing.assert_array_equal(
        np.concatenate([batch.rate for batch in theirs])[-n:], np.concatenate([batch.rate for batch in mine])
    )


def test_a_checkpoint_with_a_damaged_state_changes_nothing() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    there = Device(Kept(), "w", NAME, SessionKnobs(), 2.0, 0.0, epoch=8)
    for state in (b"", b"rubbish", said.state[:-20]):
        with pytest.raises(ValueError, match="state"):
            there.take_over(replace(said, state=state))
        assert there.session.boot is None


def test_a_later_turn_is_not_undone_by_an_earlier_one_that_speaks_later() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Checkpoints(10)
    for one in (replace(said, epoch=9, bridge="b9"), replace(said, epoch=8, bridge="b8", time_ns=NOW_NS + 10**12)):
        replicas.note(one)
    assert [known.bridge for known in replicas if known.device == NAME] == ["b9"]


def test_a_calibration_said_late_is_not_of_a_boot_whose_number_came_again() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Checkpoints(10)
    replicas.note(replace(said, epoch=9, calibration=None, boot_repeated=True))
    replicas.note(replace(said, epoch=8))
    assert replicas.repeated(NAME, 1)
    assert replicas.calibration(NAME, 1) is None
    replicas.note(replace(said, epoch=9, boot_repeated=False))
    assert not replicas.repeated(NAME, 1)


def test_a_calibration_of_another_boot_is_a_prior_under_its_key_and_no_more() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Checkpoints(10)
    replicas.note(said)
    assert replicas.calibration(NAME, 2) is None
    assert replicas.prior(info(1)) is None
    assert replicas.prior(info(2)) is said.calibration
    assert replicas.prior(info(2, firmware="2.0")) is None
