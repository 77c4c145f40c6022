"""What one estimator says of a device is enough for another to go on with it."""

from dataclasses import replace

from bridge.sim.motion import Still
from bridge.wire.messages import SampleBatch, State
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
    assert (known := replicas.of(NAME)) is not None
    assert known.boot_repeated
    assert known.calibration is None


def test_a_calibration_of_another_boot_is_a_prior_under_its_key_and_no_more() -> None:
    device, _ = calibrated()
    said = checkpoint_of(device, NOW_NS)
    assert said is not None
    replicas = Checkpoints(10)
    replicas.note(said)
    assert replicas.prior(info(1)) is None
    assert replicas.prior(info(2)) is said.calibration
    assert replicas.prior(info(2, firmware="2.0")) is None
