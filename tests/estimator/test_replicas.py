"""What one estimator says of a device is enough for another to go on with it."""

from dataclasses import replace

import numpy as np

from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Quality, SampleBatch, State
from estimator.service.device import Device
from estimator.service.replicas import Replicas, checkpoint_of
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs
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
    replicas = Replicas(10)
    replicas.note(over_the_wire(said))
    remembered = replicas.recall(NAME, 1, NOW_NS + 1_000_000_000)
    assert remembered is not None
    assert remembered.bias is not None
    kept = device.session.checkpoint()
    assert kept is not None
    assert remembered.bias.lag_k == kept.lag_k != 0
    other = DeviceSession(NAME)
    other.info = info()
    there = feed(other, rest, remembered).corrected
    here = feed(device.session, rest).corrected
    assert {batch.quality for batch in there} == {Quality.GOOD}
    assert {batch.calibration for batch in there} == {
        device.session.calibration.id if device.session.calibration else ""
    }
    mine, theirs = (np.concatenate([b.rate for b in corrected]) for corrected in (here, there))
    np.testing.assert_allclose(theirs, mine, atol=float(here[-1].bias_std.max()))


def test_nothing_is_said_of_a_device_without_a_boot() -> None:
    assert checkpoint_of(Device(Kept(), "w", NAME, SessionKnobs(), 2.0, 0.0), NOW_NS) is None


def test_a_later_turn_is_not_undone_by_an_earlier_one_that_speaks_later() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Replicas(10)
    for one in (replace(said, epoch=9, bridge="b9"), replace(said, epoch=8, bridge="b8", time_ns=NOW_NS + 10**12)):
        replicas.note(one)
    assert replicas.bridge(NAME) == "b9"


def test_a_calibration_said_late_is_not_of_a_boot_whose_number_came_again() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Replicas(10)
    replicas.note(replace(said, epoch=9, calibration=None, boot_repeated=True))
    replicas.note(replace(said, epoch=8))
    assert replicas.repeated(NAME, 1)
    remembered = replicas.recall(NAME, 1, NOW_NS)
    assert remembered is not None
    assert remembered.calibration is None
    replicas.note(replace(said, epoch=9, boot_repeated=False))
    assert not replicas.repeated(NAME, 1)


def test_a_calibration_said_late_is_not_forgotten_for_a_later_turn_without_one() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Replicas(10)
    replicas.note(replace(said, epoch=9, calibration=None, turned=(0, 2)))
    remembered = replicas.recall(NAME, 1, NOW_NS)
    assert remembered is not None
    assert (remembered.calibration, remembered.turned) == (None, (0, 2))
    replicas.note(replace(said, epoch=8))
    remembered = replicas.recall(NAME, 1, NOW_NS)
    assert remembered is not None
    assert remembered.calibration is said.calibration


def test_a_calibration_said_late_ends_a_doubt_of_who_had_not_heard_of_it() -> None:
    """Turns by a scale of another boot may well seem to contradict gravity."""
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Replicas(10)
    replicas.note(replace(said, epoch=9, bridge="b9", calibration=None, doubted=True, x=said.x + 0.1, asked_by="nurse"))
    replicas.note(replace(said, epoch=8, bridge="b8"))
    remembered = replicas.recall(NAME, 1, NOW_NS)
    assert remembered is not None
    assert (remembered.doubted, remembered.calibration, remembered.bias) == (False, said.calibration, None)
    assert remembered.asked == ("nurse", "")
    assert replicas.bridge(NAME) == "b9"


def test_a_calibration_said_late_comes_with_its_bias_where_none_was_known() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas, nothing = Replicas(10), np.zeros(0)
    replicas.note(replace(said, epoch=9, calibration=None, x=nothing, covariance=nothing.reshape(0, 0)))
    replicas.note(replace(said, epoch=8))
    remembered = replicas.recall(NAME, 1, NOW_NS)
    assert remembered is not None
    assert remembered.bias is not None
    np.testing.assert_array_equal(remembered.bias.x, said.x)
    assert remembered.bias.time == said.device_time_s


def test_a_calibration_of_another_boot_is_a_prior_under_its_key_and_no_more() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Replicas(10)
    replicas.note(said)
    assert replicas.recall(NAME, 2, NOW_NS) is None
    assert replicas.prior(info(1)) is None
    assert replicas.prior(info(2)) is said.calibration
    assert replicas.prior(info(2, firmware="2.0")) is None


def test_devices_are_bounded() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Replicas(2)
    for name in "abc":
        replicas.note(replace(said, device=name))
    assert [replicas.bridge(name) for name in "abc"] == ["", said.bridge, said.bridge]
    nothing = Replicas(0)
    nothing.note(said)
    assert nothing.recall(NAME, 1, NOW_NS) is None


def test_where_the_clock_of_who_has_a_device_was_set_back_what_it_says_then_counts() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    assert said.calibration is not None
    again = replace(said.calibration, id="calibrated-again")
    replicas = Replicas(10)
    replicas.note(said)
    replicas.note(replace(said, time_ns=NOW_NS - 3600 * 10**9, calibration=again))
    remembered = replicas.recall(NAME, 1, NOW_NS)
    assert remembered is not None
    assert remembered.calibration is again
