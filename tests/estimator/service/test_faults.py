"""Readings that are wrong: not finite, a spike, clipped, stuck. None of them may move the bias."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.bus.contract import Message
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from bridge.wire import codec, keys
from bridge.wire.messages import SampleFlag
from bridge.wire.refusal import Reason, Refusal
from estimator.device.session import DeviceSession
from estimator.service.decode import decode
from tests.estimator.stream import NAME, Stream, calibration, feed

Floats = NDArray[np.float64]
FULL_SCALE = np.radians(2000.0)
RESTED_S, MOVED_S = 10.0, 12.0


@pytest.fixture(scope="module")
def worn() -> Stream:
    """Calibrated, then rest, movement and rest."""
    rng = np.random.default_rng(8)
    moves = [swing(rng, MOVED_S / 3, np.radians(120.0)) for _ in range(3)]
    return calibration(seed=8, after=[Still(RESTED_S), *moves, Still(RESTED_S)])


def at_rest(of: Stream) -> int:
    """A sample in the middle of the first rest after calibration."""
    return of.at(of.time[-1] - 1.5 * RESTED_S - MOVED_S)


def in_motion(of: Stream) -> int:
    return of.at(of.time[-1] - RESTED_S - 0.6 * MOVED_S)


def lived(of: Stream, *, clipped: slice | None = None) -> DeviceSession:
    device = DeviceSession(NAME)
    for batch in of.batches():
        flags = batch.flags.copy()
        if clipped is not None:
            number = batch.sequence + np.arange(len(batch))
            flags[(number >= clipped.start) & (number < clipped.stop)] = SampleFlag.CLIPPED
        feed(device, [replace(batch, flags=flags)])
    assert device.calibration is not None
    return device


def apart_dps(one: DeviceSession, other: DeviceSession) -> float:
    return float(np.degrees(np.abs(one.tracker.bias - other.tracker.bias).max()))


def spoilt(of: Stream, at: slice, gyro: Floats | float) -> Stream:
    """The same stream with other readings in some of its samples."""
    readings = of.gyro.copy()
    readings[at] = gyro
    return replace(of, gyro=readings)


# ---- not finite ---------------------------------------------------------------------------------------------------

MANY = 100_000
BURSTS = 20


def infested(of: Stream, rng: np.random.Generator) -> tuple[Stream, NDArray[np.bool_]]:
    """A stream with many more samples that are not finite, alone, in pairs and in long runs; and which are good."""
    n = len(of)
    more = rng.integers(0, 3, n)
    more[-1] = 0
    long = rng.choice(n - 1, BURSTS, replace=False)
    more[long] = 0
    more[long] = np.diff(np.linspace(0, MANY - more.sum(), BURSTS + 1).astype(int))
    source = np.repeat(np.arange(n), 1 + more)
    first = np.cumsum(1 + more) - 1 - more
    good = np.zeros(len(source), bool)
    good[first] = True
    after = np.arange(len(source)) - first[source]
    between = np.diff(of.ticks, append=of.ticks[-1] + 1)[source]
    bad = of.only(source)
    ticks = (bad.ticks + (after * between) // (1 + more[source])).astype(np.int64)
    readings = np.hstack([bad.gyro, bad.accel])
    where = np.flatnonzero(~good)
    assert len(where) == MANY
    readings[where, rng.integers(0, 6, MANY)] = rng.choice([np.nan, np.inf, -np.inf], MANY)
    readings[where[::3], 0] = np.nan
    return replace(bad, ticks=ticks, gyro=readings[:, :3], accel=readings[:, 3:]), good


def test_readings_that_are_not_finite_are_refused_at_the_door(worn: Stream) -> None:
    stream, good = infested(worn, np.random.default_rng(0))
    edges = sorted({*(np.flatnonzero(np.diff(good)) + 1).tolist(), *range(1, len(stream), 200)})
    batches = stream.batches(edges)
    key = keys.build("w", "raw", bridge="b", device=NAME)
    decoded = decode([Message(key, codec.encode_samples(batch)) for batch in batches])
    taken = [one for one in decoded if not isinstance(one, Refusal)]
    assert [one.sequence for one in taken] == [one.sequence for one in batches if good[one.sequence]]
    assert sum(one.n for one in taken) == len(worn)
    assert {one.reason for one in decoded if isinstance(one, Refusal)} == {Reason.NON_FINITE}


# ---- spikes -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("sign", "axes"), [(1.0, [1]), (-1.0, [0, 1, 2])])
def test_a_spike_in_motion_is_as_if_it_had_not_been(worn: Stream, sign: float, axes: list[int]) -> None:
    whole = lived(worn)
    for place in (0, 37):
        at = in_motion(worn) + place
        reading = worn.gyro[at].copy()
        reading[axes] = sign * FULL_SCALE
        spiked = lived(spoilt(worn, slice(at, at + 1), reading))
        assert 0 < apart_dps(spiked, whole) < 1e-4
        assert spiked.tracker.events == {"spike": 1}


def test_a_spike_in_a_turn_and_in_a_rest_leaves_a_calibration_as_it_was(worn: Stream) -> None:
    whole = lived(worn).calibration
    at = [worn.at(3.0), int(np.argmax(np.abs(worn.rate[: at_rest(worn)]).max(axis=1)))]
    readings = worn.gyro.copy()
    readings[at] = FULL_SCALE
    spiked = lived(replace(worn, gyro=readings)).calibration
    assert whole is not None
    assert spiked is not None
    np.testing.assert_allclose(np.diag(spiked.matrix), np.diag(whole.matrix), atol=1e-4)
    np.testing.assert_allclose(spiked.bias, whole.bias, atol=np.radians(2e-3))


# ---- clipped and stuck --------------------------------------------------------------------------------------------


def test_a_second_of_saturation_leaves_the_bias_within_its_deviation(worn: Stream) -> None:
    whole, at = lived(worn), in_motion(worn)
    second = slice(at, at + 104)
    limited = np.minimum(worn.gyro[second], np.radians(5.0))
    assert (limited < worn.gyro[second]).any()
    clipped = lived(spoilt(worn, second, limited), clipped=second)
    assert (apart_dps(clipped, whole) < np.degrees(clipped.tracker.std)).all()
    unmarked = lived(spoilt(worn, second, limited))
    assert apart_dps(unmarked, whole) > 3 * apart_dps(clipped, whole) > 0, "the mark is what counts"


def test_an_axis_that_is_stuck_is_no_evidence(worn: Stream) -> None:
    device, at = DeviceSession(NAME), at_rest(worn) // 10 * 10
    stuck = slice(at, at + 5 * 104)
    readings = worn.gyro.copy()
    readings[stuck, 1] = worn.bias[at, 1] + np.radians(0.2)  # near enough to be taken for rest
    broken = replace(worn, gyro=readings)
    feed(device, broken.part(0, at + 104).batches())
    before, std = device.tracker.bias, device.tracker.std
    feed(device, broken.part(at + 104, stuck.stop).batches(first=at + 104))
    np.testing.assert_allclose(device.tracker.bias[1], before[1], atol=std[1])
    assert device.tracker.std[1] > std[1]
    assert device.tracker.evidence_age(broken.time[stuck.stop]) > 3.0
