"""The fast lane says what the session's own way says, to the bit and in the same order, whatever comes."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.bus.contract import Message
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import SampleBatch
from estimator.block import Stretch
from estimator.config import Estimator
from estimator.service import overload
from estimator.service.ahead import Ahead
from estimator.service.device import Device
from estimator.service.shell import Service
from estimator.service.store import Store
from estimator.session import DeviceSession
from tests.estimator.memory_ward import Ward
from tests.estimator.served import Kept
from tests.estimator.stream import Stream, calibration

WARD = "w"
DEVICES = ("one", "two", "three")


def key(device: str, bridge: str = "b") -> str:
    return keys.build(WARD, "raw", bridge=bridge, device=device)


@pytest.fixture(scope="module")
def lives() -> dict[str, list[SampleBatch]]:
    """Three devices, each calibrated and then worn, in batches of ten."""
    return {
        device: [replace(batch, device=device) for batch in calibration(seed=seed).batches()]
        for seed, device in enumerate(DEVICES)
    }


class Fed:
    """A subscription with these messages in rounds."""

    missed, overflowed, waiting, waited_s, caught_up, closed = 0, 0, 0, 0.0, True, False

    def __init__(self, rounds: list[list[Message]]) -> None:
        self._rounds: Iterator[list[Message]] = iter(rounds)

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        return next(self._rounds, [])

    def close(self) -> None:
        pass


def served(folder: Path, rounds: list[list[Message]]) -> tuple[dict[str, list[bytes]], list[dict[str, int]], int]:
    """What was published under each key, in order; the counts of each device; how many batches went the fast way."""
    bus = Kept()
    store = Store(folder / "store.sqlite3")
    settings, now_ns = Estimator(id="e", store=str(folder / "s")), 1_700_000_000_000_000_000
    service = Service(WARD, settings, bus, MemoryBus(MemoryBroker()), store, lambda: now_ns)
    service._raw = Fed(rounds)  # type: ignore[assignment]
    fast = Counter[str]()
    keep = DeviceSession.keep

    def counted(self: DeviceSession, stretch: Stretch, taken: NDArray[np.float64], received_ns: int) -> None:
        fast["kept"] += round(len(taken) / 10)
        keep(self, stretch, taken, received_ns)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DeviceSession, "keep", counted)
        now = [1000.0]
        patch.setattr("estimator.service.shell.time.monotonic", lambda: now[0])
        for messages in rounds:
            now[0] += 0.1 * len(messages) / len(DEVICES)  # as they come at 104 Hz
            service.step(0.0)
        while service.step(0.0):  # a device that may be done with its calibration waits for the others
            pass
        service._intake.give_up()
    said: dict[str, list[bytes]] = {}
    for where, payload in bus.said:
        said.setdefault(where, []).append(payload)
    counts = []
    for device in service._devices.values():
        status = device.status(1)
        counts.append({**status.dropped, **status.events, "in": status.samples_in, "out": status.samples_out})
    store.close()
    return said, counts, fast["kept"]


def both(folder: Path, rounds: list[list[Message]]) -> int:
    """Hold the two ways against each other; how many batches went the fast one."""
    folders = [folder / "fast", folder / "slow"]
    for each in folders:
        each.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(overload, "BUSY", np.inf)  # how fast this machine is makes no difference
        fast = served(folders[0], rounds)
        patch.setattr(DeviceSession, "plain", lambda *_: False)
        slow = served(folders[1], rounds)
    assert slow[2] == 0
    assert fast[0].keys() == slow[0].keys()
    for where, payloads in slow[0].items():
        assert fast[0][where] == payloads
    assert fast[1] == slow[1]
    return fast[2]


def together(lives: dict[str, list[SampleBatch]]) -> list[Message]:
    """All devices side by side, as a bridge sends them."""
    n = min(map(len, lives.values()))
    return [Message(key(device), codec.encode_samples(lives[device][i])) for i in range(n) for device in DEVICES]


def rounds_of(messages: list[Message], seed: int, longest: int = 60) -> list[list[Message]]:
    rng, rounds, at = np.random.default_rng(seed), [], 0
    while at < len(messages):
        n = int(rng.integers(1, longest))
        rounds.append(messages[at : at + n])
        at += n
    return rounds


def test_a_calibrated_ward_is_corrected_alike(tmp_path: Path, lives: dict[str, list[SampleBatch]]) -> None:
    messages = together(lives)
    assert both(tmp_path, rounds_of(messages, 1)) > 0.7 * len(messages)


def test_what_goes_on_is_corrected_ahead_of_its_session_and_alike(
    tmp_path: Path, lives: dict[str, list[SampleBatch]], monkeypatch: pytest.MonkeyPatch
) -> None:
    messages, held, release = together(lives), [0], Ahead.release

    def counted(self: Ahead) -> tuple[bytes, ...]:
        held[0] += len(self.held)
        return release(self)

    monkeypatch.setattr(Ahead, "release", counted)
    assert both(tmp_path, rounds_of(messages, 4, 4)) > 0.7 * len(messages)
    assert 0.6 * len(messages) < held[0] <= len(messages)


@pytest.mark.parametrize("longest", [4, 12])
def test_whatever_comes_is_treated_alike(tmp_path: Path, lives: dict[str, list[SampleBatch]], longest: int) -> None:
    rng = np.random.default_rng(5)
    messages: list[Message] = []
    for message in together(lives):
        odd = rng.random()
        batch = codec.decode_samples(message.key, message.payload)
        payloads = {
            0: [message.payload, message.payload],
            1: [],
            2: [message.payload[:-7]],
            3: [codec.encode_samples(replace(batch, flags=np.full(len(batch), 2, np.uint32)))],
            4: [codec.encode_samples(replace(batch, boot=batch.boot + 1)), message.payload],
            5: [codec.encode_samples(replace(batch, device="other"))],
            6: [codec.encode_samples(replace(batch, ticks=batch.ticks[::-1].copy()))],
            7: [codec.encode_samples(replace(batch, gyro=np.where(batch.gyro > -9, np.nan, 0).astype(np.float32)))],
            8: [codec.encode_samples(replace(batch, accel=None))],
            9: [codec.encode_samples(replace(batch, tick_period_s=2e-6)), message.payload],
            10: [codec.encode_samples(replace(batch, sequence=batch.sequence + 10**15))],
        }[int(rng.integers(11))] if odd < 0.1 else [message.payload]  # fmt: skip
        messages += [Message(message.key, payload) for payload in payloads]
        if odd > 0.99:
            messages.append(Message(key(batch.device, "other"), message.payload))
    assert both(tmp_path, rounds_of(messages, 2, longest)) > 100


@pytest.mark.parametrize("samples", [1, 10], ids=["within", "between"])
def test_a_leap_of_the_devices_clock_is_treated_alike(
    tmp_path: Path, lives: dict[str, list[SampleBatch]], samples: int
) -> None:
    def leapt(batch: SampleBatch) -> SampleBatch:
        far = np.arange(len(batch)) >= len(batch) - samples
        return replace(batch, ticks=batch.ticks + far.astype(np.uint64) * np.uint64(10**12))

    batches = [leapt(batch) if i == 150 else batch for i, batch in enumerate(lives["one"])]
    rounds = [[Message(key("one"), codec.encode_samples(batch))] for batch in batches]
    assert both(tmp_path, rounds) > 200
    counts = served(tmp_path, rounds)[1][0]
    assert (counts["refused leap"], counts["range"]) == (1, len(batches[150]))


@pytest.mark.parametrize("longest", [2, 60])
@pytest.mark.parametrize("most", [2000.0, 900.0])
def test_large_rates_are_clipped_alike(
    tmp_path: Path, lives: dict[str, list[SampleBatch]], monkeypatch: pytest.MonkeyPatch, most: float, longest: int
) -> None:
    for where in ("together", "published"):
        monkeypatch.setattr(f"estimator.service.{where}.MAX_CORRECTED", most)
    large = [
        Message(key("one"), codec.encode_samples(replace(b, gyro=np.full_like(b.gyro, 999.0)) if i % 7 == 0 else b))
        for i, b in enumerate(lives["one"])
    ]
    assert both(tmp_path, rounds_of(large, 3, longest)) > 200


def test_what_changes_is_said_after_the_samples_that_led_to_it(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    ahead, say = list[int](), Device.say_status

    def noted(device: Device, time_ns: int) -> None:
        ahead.append(device.session.sequence.samples_out - device.told)
        say(device, time_ns)

    monkeypatch.setattr(Device, "say_status", noted)
    batches = once.batches()
    for start in range(0, len(batches), 30):
        ward.send(batches[start : start + 30])
    assert len(ahead) > 3
    assert max(ahead) == 10, "the batch in which a block ends may be corrected anew from there on"
