"""Promises of a ward, seen from its bus alone: raw messages in, corrected rates and statuses out."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.recording import Recording
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch, SampleFlag, Status
from estimator.config.device_settings import knobs_of
from estimator.config.schema import Estimator
from estimator.noise.device_model import GENERIC, load_model
from estimator.offline.recordings import correct
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.estimator.stream import NAME, Stream, calibration
from tests.memory_bus import MemoryBroker, MemoryBus

WARD, NOW_NS = "w", 1_700_000_000_000_000_000
#: of a batch of a device, or any bytes under its key
Sent = tuple[str, bytes]


@cache
def life() -> Stream:
    """A device that is calibrated, moved and put down."""
    rng = np.random.default_rng(3)
    return calibration(seed=3, after=[swing(rng, 2.0, np.radians(90.0)), Still(6.0)], rate_hz=52.0)


def sent(batches: Iterable[SampleBatch], device: str = NAME) -> list[Sent]:
    return [(device, codec.encode_samples(replace(batch, device=device))) for batch in batches]


@dataclass(frozen=True, slots=True)
class Heard:
    """What a subscriber hears of a ward: corrected batches in the order in which they came, and each device's last status."""

    corrected: list[CorrectedBatch]
    statuses: dict[str, Status]

    def numbers(self, device: str = NAME) -> list[tuple[int, int]]:
        """Boot and number of each sample."""
        return [(b.boot, b.sequence + i) for b in self.corrected if b.device == device for i in range(len(b))]

    def columns(self, device: str = NAME) -> dict[str, bytes]:
        """All that is published of each sample, but for where messages were cut."""
        batches = [batch for batch in self.corrected if batch.device == device]
        of_each = ("noise_std", "bias_std", "scale_std", "cross_std", "bias", "flicker_std", "quality", "calibration")
        found = {
            name: np.concatenate([getattr(b, name) for b in batches])
            for name in ("rate", "ticks", "flags", "sample_time_ns")
        }
        for name in of_each:
            found[name] = np.concatenate([np.tile(getattr(b, name), (len(b), 1)) for b in batches])
        return {name: column.tobytes() for name, column in found.items()}


def ward(rounds: Sequence[Sequence[Sent]]) -> Heard:
    """What is heard when these are sent, a round at a time."""
    broker, store = MemoryBroker(), Store(":memory:")
    with MemoryBus(broker) as bus, MemoryBus(broker) as outside:
        service = Service(WARD, Estimator(id="e"), bus, store, lambda: NOW_NS)
        corrected = outside.subscribe(keys.pattern(WARD, "corrected"), capacity=1 << 20)
        status = outside.subscribe(keys.pattern(WARD, "status"), capacity=1 << 20)
        publishers = {
            device: outside.publisher(keys.build(WARD, "raw", bridge="b", device=device))
            for device in dict.fromkeys(device for messages in rounds for device, _ in messages)
        }
        for messages in rounds:
            for device, payload in messages:
                publishers[device].put(payload)
            service.step(0.0)
        while service.step(0.0):
            pass
        # What is missing was waited for, and every device has said how it is.
        clock, passed_s = time.monotonic, [0.0]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(time, "monotonic", lambda: clock() + passed_s[0])
            for now_s in range(1, 41):
                passed_s[0] = now_s / 20
                service.step(0.0)
        found = [codec.decode_corrected(*message) for message in corrected.drain(1 << 20, 0.0)]
        said = [codec.decode_status(*message) for message in status.drain(1 << 20, 0.0)]
    store.close()
    return Heard(found, {one.device: one for one in said})


def in_rounds(messages: list[Sent], seed: int, longest: int) -> list[list[Sent]]:
    rng, rounds, at = np.random.default_rng(seed), list[list[Sent]](), 0
    while at < len(messages):
        n = int(rng.integers(1, longest + 1))
        rounds.append(messages[at : at + n])
        at += n
    return rounds


@cache
def one_by_one() -> Heard:
    return ward([[message] for message in sent(life().batches())])


@settings(max_examples=8, deadline=None)
@given(st.lists(st.integers(1, 1500), max_size=60, unique=True), st.integers(0, 9), st.sampled_from([1, 7, 200]))
def test_any_batching_in_any_rounds_is_published_to_the_same_bit(edges: list[int], seed: int, longest: int) -> None:
    of = life()
    cuts = sorted({edge for edge in edges if edge < len(of)} | set(range(60, len(of), 60)))
    heard = ward(in_rounds(sent(of.batches(cuts)), seed, longest))
    assert heard.numbers() == one_by_one().numbers() == [(1, number) for number in range(len(of))]
    expected = one_by_one().columns()
    for name, column in heard.columns().items():
        assert column == expected[name], name
    assert heard.corrected[-1].quality is Quality.GOOD


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32))
def test_whatever_comes_each_sample_is_out_once_and_in_order_or_counted(seed: int) -> None:
    """Lost, repeated, late, torn and marked messages, and a device that was switched on again."""
    rng = np.random.default_rng(seed)
    of = life().part(0, 600)
    messages = list[Sent]()
    for batch in [b for boot in (1, 2) for b in of.batches(boot=boot)]:
        (whole,) = sent([batch])
        flags = np.full(len(batch), int(rng.choice([1, 2, 4, 16])), np.uint32)
        messages += {
            0: [],
            1: [whole, whole],
            2: [(NAME, whole[1][:-5])],
            3: sent([replace(batch, flags=flags)]),
            4: sent([replace(batch, accel=None)]),
        }.get(int(rng.integers(40)), [whole])
    for at in rng.integers(1, len(messages), 10).tolist():
        messages.insert(at + 2, messages.pop(at))
    heard = ward(in_rounds(messages, seed, 30))
    status, numbers = heard.statuses[NAME], heard.numbers()
    assert status.samples_in == status.samples_out + sum(status.dropped.values())
    assert len(numbers) == len(set(numbers)) == status.samples_out
    assert numbers == sorted(numbers)


@settings(max_examples=4, deadline=None)
@given(st.integers(20, 1400))
def test_after_a_reboot_no_sample_is_good_without_a_calibration_of_that_boot(cut: int) -> None:
    of = life()
    end = of.at(of.time[-1] - 1.0)
    heard = ward(in_rounds(sent([*of.part(0, end).batches(), *of.part(0, cut).batches(boot=2)]), cut, 50))
    before, after = ([b for b in heard.corrected if b.boot == boot] for boot in (1, 2))
    assert before[-1].quality is Quality.GOOD
    assert sum(map(len, after)) == cut
    assert Quality.GOOD not in {batch.quality for batch in after}


def test_whatever_one_device_sends_no_bit_of_anothers_changes() -> None:
    rng, messages = np.random.default_rng(5), list[Sent]()
    for batch in life().batches():
        (whole,) = sent([batch], "wild")
        wild = {
            0: [("wild", rng.bytes(200))],
            1: sent([replace(batch, gyro=np.full_like(batch.gyro, 999.0))], "wild"),
            2: sent([replace(batch, sequence=batch.sequence + 10**12)], "wild"),
            3: sent([replace(batch, ticks=batch.ticks + np.uint64(10**13))], "wild"),
            4: sent([replace(batch, boot=int(rng.integers(2, 9)))], "wild"),
            5: [whole] * 5,
            6: sent([replace(batch, gyro=np.full_like(batch.gyro, np.nan))], "wild"),
        }.get(int(rng.integers(10)), [whole])
        messages += [*wild, *sent([batch])]
    heard = ward(in_rounds(messages, 1, 40))
    assert heard.numbers() == one_by_one().numbers()
    assert heard.columns() == one_by_one().columns()


def test_a_recording_is_corrected_as_it_was_published_live() -> None:
    of = life()
    heard = [batch for batch in one_by_one().corrected if batch.device == NAME]
    recording = Recording(of.time, of.gyro, of.accel, of.temperature_c, of.rate_hz, NAME)
    found = correct(recording, knobs=knobs_of(load_model(GENERIC)))
    np.testing.assert_array_equal(found.rate, np.concatenate([batch.rate for batch in heard]))
    np.testing.assert_array_equal(found.quality, np.concatenate([np.full(len(b), int(b.quality)) for b in heard]))
    assert not any((batch.flags & np.uint32(SampleFlag.CLIPPED)).any() for batch in heard)
