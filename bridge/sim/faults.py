"""Faults to inject, one at a time: in the bytes between device and host, and in the samples inside the device.

`injected` counts how often a fault struck. Each is used by one device only.
"""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from bridge.sim.quaternion import Array
from bridge.sim.source import Samples


class ByteFault(ABC):
    """Damages bytes on their way to the host; strikes with a probability, drawn from the seed."""

    def __init__(self, probability: float, seed: int = 0) -> None:
        self.injected = 0
        self.probability = probability
        self.rng = np.random.default_rng(seed)

    @abstractmethod
    def __call__(self, data: bytes) -> bytes:
        """What arrives of a chunk."""


class BitErrors(ByteFault):
    """Flips bits; the probability is per bit."""

    def __call__(self, data: bytes) -> bytes:
        """See ByteFault."""
        flips = self.rng.random((len(data), 8)) < self.probability
        self.injected += int(flips.sum())
        return bytes(np.frombuffer(data, np.uint8) ^ np.packbits(flips, axis=1)[:, 0])


class DroppedBytes(ByteFault):
    """Loses bytes; the probability is per byte."""

    def __call__(self, data: bytes) -> bytes:
        """See ByteFault."""
        kept = self.rng.random(len(data)) >= self.probability
        self.injected += len(data) - int(kept.sum())
        return np.frombuffer(data, np.uint8)[kept].tobytes()


class DuplicatedChunk(ByteFault):
    """Sends a whole chunk twice; the probability is per chunk."""

    def __call__(self, data: bytes) -> bytes:
        """See ByteFault."""
        if not data or self.rng.random() >= self.probability:
            return data
        self.injected += 1
        return data + data


class Garbage(ByteFault):
    """Puts up to 64 random bytes after a frame; the probability is per frame."""

    def __call__(self, data: bytes) -> bytes:
        """See ByteFault."""
        *frames, rest = data.split(b"\0")
        return b"".join(whole + b"\0" + self._noise() for whole in frames) + rest

    def _noise(self) -> bytes:
        if self.rng.random() >= self.probability:
            return b""
        self.injected += 1
        return self.rng.bytes(int(self.rng.integers(1, 65)))


class Dribble:
    """Hands on at most so many bytes a turn; the rest comes later, in order. injected: turns that held some back."""

    def __init__(self, at_most: int) -> None:
        self.injected = 0
        self._at_most = at_most
        self._held = b""

    def __call__(self, data: bytes) -> bytes:
        """What arrives this turn."""
        data = self._held + data
        self._held = data[self._at_most :]
        self.injected += bool(self._held)
        return data[: self._at_most]


class HeldUp:
    """A link that is dead while `dead` is set and then delivers all at once, as TCP does. injected: bytes held up."""

    def __init__(self) -> None:
        self.injected = 0
        self.dead = False
        self._held = b""

    def __call__(self, data: bytes) -> bytes:
        """What arrives."""
        if self.dead:
            self._held += data
            self.injected += len(data)
            return b""
        held, self._held = self._held, b""
        return held + data


class AxisFault(ABC):
    """Spoils one axis of the gyro in n samples from sequence number `first` on."""

    def __init__(self, first: int, n: int = 1, axis: int = 0) -> None:
        self.injected = 0
        self.first, self.n, self.axis = first, n, axis

    def __call__(self, sequence: int, samples: Samples) -> Samples:
        """The samples as the device sends them, the first of them numbered `sequence`."""
        gyro = samples.gyro.copy()
        begin, end = (max(0, edge - sequence) for edge in (self.first, self.first + self.n))
        struck = gyro[begin:end, self.axis]
        if len(struck):
            self.injected += len(struck)
            struck[:] = self.spoilt(struck)
        return replace(samples, gyro=gyro)

    @abstractmethod
    def spoilt(self, readings: Array) -> Array | float:
        """What is read in place of these readings (n,), n ≥ 1."""


class NotANumber(AxisFault):
    """The axis reads NaN."""

    def spoilt(self, readings: Array) -> float:  # noqa: ARG002
        """See AxisFault."""
        return float("nan")


class Spike(AxisFault):
    """The axis reads size_dps too much."""

    size_dps = 250.0

    def spoilt(self, readings: Array) -> Array:
        """See AxisFault."""
        return np.asarray(readings + np.radians(self.size_dps))


class StuckAxis(AxisFault):
    """The axis repeats its first reading."""

    _value: float | None = None

    def spoilt(self, readings: Array) -> float:
        """See AxisFault."""
        if self._value is None:
            self._value = float(readings[0])
        return self._value


class Stuck:
    """The whole sensor repeats its first sample, in n samples from sequence number `first` on."""

    def __init__(self, first: int, n: int) -> None:
        self.injected = 0
        self._first, self._n = first, n
        self._sample: Samples | None = None

    def __call__(self, sequence: int, samples: Samples) -> Samples:
        """The samples as the device sends them, the first of them numbered `sequence`."""
        begin, end = (min(max(0, edge - sequence), len(samples)) for edge in (self._first, self._first + self._n))
        if begin == end:
            return samples
        frozen = self._sample = self._sample or samples[begin : begin + 1]
        gyro, accel = samples.gyro.copy(), samples.accel.copy()
        gyro[begin:end], accel[begin:end] = frozen.gyro, frozen.accel
        self.injected += end - begin
        return replace(samples, gyro=gyro, accel=accel)


class TemperatureLeap:
    """The thermometer reads leap_k too much, in n samples from sequence number `first` on."""

    def __init__(self, first: int, n: int = 1, leap_k: float = -60.0) -> None:
        self.injected = 0
        self._first, self._n, self._leap_k = first, n, leap_k

    def __call__(self, sequence: int, samples: Samples) -> Samples:
        """The samples as the device sends them, the first of them numbered `sequence`."""
        number = sequence + np.arange(len(samples))
        struck = (number >= self._first) & (number < self._first + self._n)
        self.injected += int(struck.sum())
        return replace(samples, temperature_c=samples.temperature_c + self._leap_k * struck)


class Clipped:
    """Limits every axis to ± limit_dps, as a range set too small does."""

    def __init__(self, limit_dps: float) -> None:
        self.injected = 0
        self._limit = float(np.radians(limit_dps))

    def __call__(self, sequence: int, samples: Samples) -> Samples:  # noqa: ARG002
        """The samples as the device sends them."""
        self.injected += int((np.abs(samples.gyro) > self._limit).any(axis=1).sum())
        return replace(samples, gyro=np.clip(samples.gyro, -self._limit, self._limit))
