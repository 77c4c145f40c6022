"""A device that is taken over, or given away: nothing is lost by it, and a bad checkpoint of it harms nobody."""

import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Holding, Owned, SampleBatch
from estimator.device.session_knobs import SessionKnobs
from estimator.service.checkpoints import checkpoint_of
from estimator.service.device import Device
from estimator.service.device_loss import SILENT
from estimator.service.membership import BEYOND
from estimator.service.quota import ROUND
from tests.estimator.memory_ward import WARD, Ward
from tests.estimator.served import Kept
from tests.estimator.stream import NAME, calibration, feed, info
from tests.memory_bus import MemoryBus

#: the places of the length of a block and of the correction that is applied, in a state
LENGTH_S, APPLIED = 7, 10


@pytest.fixture
def ward(tmp_path: Path) -> Ward:
    return Ward(tmp_path)


@pytest.fixture(scope="module")
def batches() -> list[SampleBatch]:
    return calibration(seed=1, after=[Still(8.0)]).batches()


@pytest.fixture(scope="module")
def checkpoint(batches: list[SampleBatch]) -> Checkpoint:
    """Of a calibrated device, but for its last 40 batches."""
    return said_of(batches[:-40])


def said_of(batches: list[SampleBatch]) -> Checkpoint:
    device = Device(Kept(), WARD, NAME, SessionKnobs(), 2.0, 0.0, epoch=7)
    device.session.info = info()
    feed(device.session, batches)
    said = checkpoint_of(device, 1_700_000_000_000_000_000)
    assert said is not None
    return said


def say(ward: Ward, checkpoint: Checkpoint) -> None:
    key = keys.build(WARD, "checkpoint", device=checkpoint.device)
    MemoryBus(ward.broker).publisher(key, cache=1).put(codec.encode_checkpoint(checkpoint))


def claim(ward: Ward, held: dict[str, int]) -> None:
    """Another estimator says that it holds devices."""
    holdings = tuple(Holding(device, epoch, 1, 0) for device, epoch in held.items())
    owned = Owned("other", 0, max(held.values()), 0.0, holdings)
    MemoryBus(ward.broker).publisher(keys.build(WARD, "owned", estimator="other")).put(codec.encode_owned(owned))


def samples(batches: list[SampleBatch]) -> list[int]:
    return [number for batch in batches for number in range(batch.sequence, batch.sequence + len(batch))]


def got(ward: Ward) -> list[int]:
    return [number for batch in ward.subscriber for number in range(batch.sequence, batch.sequence + len(batch))]


# ---- checkpoints that are none ------------------------------------------------------------------------------------------


def first_array(raw: Any, shape: list[int]) -> list[Any]:
    """The first packed array of this shape in a state."""
    if isinstance(raw, list) and len(raw) == 3 and isinstance(raw[2], bytes) and raw[1] == shape:
        return raw
    for one in raw.values() if isinstance(raw, dict) else raw if isinstance(raw, list) else ():
        if found := first_array(one, shape):
            return found
    return []


def huge_matrix(raw: list[Any]) -> None:
    first_array(raw, [3])[:] = ["s", [2**18, 1], b""]


def matrix_of_one_dimension(raw: list[Any]) -> None:
    first_array(raw, [3])[:] = ["s", [3], bytes(48)]


def no_block(raw: list[Any]) -> None:
    raw[LENGTH_S] = 0.0


def endless_block(raw: list[Any]) -> None:
    raw[LENGTH_S] = 1e300


def correction_of_two_axes(raw: list[Any]) -> None:
    first_array(raw[APPLIED], [3, 3])[:] = ["d", [2, 2], np.eye(2).tobytes()]


@pytest.mark.parametrize(
    "damage", [huge_matrix, matrix_of_one_dimension, no_block, endless_block, correction_of_two_axes]
)
def test_a_damaged_checkpoint_is_counted_and_its_device_begins_with_its_samples(
    ward: Ward, checkpoint: Checkpoint, batches: list[SampleBatch], damage: Callable[[list[Any]], None]
) -> None:
    raw = msgspec.msgpack.decode(zlib.decompress(checkpoint.state))
    damage(raw)
    say(ward, replace(checkpoint, state=zlib.compress(msgspec.msgpack.encode(raw))))
    ward.send(batches[-40:])
    assert got(ward) == samples(batches[-40:])
    assert ward.service._count_all()["checkpoint messages refused, damaged"] == 1


def test_a_state_that_is_good_without_a_calibration_of_its_boot_is_damaged(
    ward: Ward, checkpoint: Checkpoint, batches: list[SampleBatch]
) -> None:
    assert checkpoint.calibration is not None
    of_before = replace(checkpoint.calibration, boot=checkpoint.boot + 1)
    say(ward, replace(checkpoint, calibration=of_before))
    ward.send(batches[-40:])
    assert ward.service._count_all()["checkpoint messages refused, damaged"] == 1


def test_a_checkpoint_of_an_epoch_that_nobody_can_go_above_displaces_no_other(
    ward: Ward, checkpoint: Checkpoint
) -> None:
    say(ward, replace(checkpoint, epoch=BEYOND, bridge="wrong"))
    say(ward, replace(checkpoint, bridge="right"))
    ward.service.step(0.0)
    assert [known.bridge for known in ward.service._cluster.replicas] == ["right"]
    assert ward.service._count_all()["checkpoint messages refused, epoch"] == 1


def test_alone_a_device_of_which_only_a_checkpoint_is_known_is_silent(ward: Ward, checkpoint: Checkpoint) -> None:
    say(ward, checkpoint)
    ward.settle()
    assert ward.service._devices[NAME].session.life.reason == SILENT


# ---- samples around it --------------------------------------------------------------------------------------------------


def test_the_end_of_the_boot_before_does_not_displace_one_that_had_just_begun(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    say(ward, said_of(batches[:2]))
    before = [
        replace(batch, boot=99, sequence=batch.sequence + 5000, receive_time_ns=batch.receive_time_ns - 10**10)
        for batch in batches[:5]
    ]
    ward.send([*before, *batches[:20]])
    assert got(ward) == samples(batches[:20])


def test_alone_what_comes_right_after_an_outage_of_the_router_is_not_lost(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    ward.broker.stop()
    ward.service._every_second(time.monotonic())
    ward.broker.start()
    ward.send(batches[:25])
    assert got(ward) == samples(batches[:25])


def test_messages_that_wait_are_not_handled_once_their_device_is_given_away(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    bridge = MemoryBus(ward.broker)
    ward.service._entrance.newcomers = None  # all of them are admitted at once
    for n in range(ROUND + 2):
        name = f"wrist-{n}"
        key = keys.build(WARD, "raw", bridge="bridge", device=name)
        bridge.publisher(key).put(codec.encode_samples(replace(batches[0], device=name)))
    ward.service.step(0.0)
    membership = ward.service._cluster.membership
    waiting = set(membership.held) - set(ward.service._devices)
    assert len(waiting) == 2
    ward.service._every_second(time.monotonic())
    assert waiting <= set(membership.held), "they are ours while their messages wait"
    claim(ward, dict.fromkeys(waiting, membership.highest + 10**6))
    ward.service.step(0.0)
    ward.settle()
    assert not waiting & set(membership.held)
    assert not waiting & set(ward.service._devices)
