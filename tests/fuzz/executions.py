"""One execution: some bytes, fed to a decoder that lives on; whatever comes out must be a whole event."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from bridge.diagnose.protocol_guess import Candidate, candidates
from bridge.drivers import registry
from bridge.drivers.driver import Battery, Identity, Notice, Readings
from tests.fuzz.seeds import SEEDS

_LIFE = 2000  # executions of one decoder
_MAX_TEXT = 10_000


class Target:
    """A decoder as `bridge scan` makes it; a new one now and then."""

    def __init__(self, name: str) -> None:
        self.name = name
        [self._candidate] = [candidate for candidate in _candidates() if str(candidate) == name]
        self.seeds = SEEDS[name]
        self.executions = 0
        self.events = 0
        self.faults = 0
        self.decoder: Any = None

    def feed(self, data: bytes) -> None:
        """Execute once; raises AssertionError where an event is none, and whatever the decoder raises."""
        if self.executions % _LIFE == 0:
            self.faults += 0 if self.decoder is None else self.decoder.faults.total()
            make = self._candidate.kind.decoder
            assert make is not None
            self.decoder = make(self._candidate.chosen)
        elif self.executions % 97 == 0:
            self.decoder.opened()
        self.executions += 1
        for event in self.decoder.feed(data, self.executions * 10_000_000):
            self.events += 1
            _check(event)
        assert len(self.decoder.to_send()) <= _MAX_TEXT


def names() -> list[str]:
    """Every driver that has a decoder, and of text every profile."""
    return sorted(map(str, _candidates()))


def _candidates() -> list[Candidate]:
    return candidates(registry.kinds().values())


def inputs(seeds: list[bytes], rng: np.random.Generator, n: int) -> Iterator[bytes]:
    """n inputs: messages whole, cut, doubled, with bits flipped, bytes lost, put in or replaced; and plain noise."""
    draws = rng.integers(0, 2**32, (n, 6), dtype=np.uint64).tolist()
    for kind, which, where, length, value, other in draws:
        data = bytearray(seeds[which % len(seeds)])
        at = where % max(1, len(data))
        match kind % 8:
            case 0:
                pass
            case 1:
                data = data[:at]
            case 2:
                data[at:] = seeds[other % len(seeds)][length % 64 :]
            case 3:
                data[at] ^= 1 << (value % 8)
            case 4:
                del data[at : at + length % 8]
            case 5:
                data[at:at] = value.to_bytes(8, "little")[: length % 8]
            case 6:
                data[at : at + 4] = (value * 0x01010101 % 2**32).to_bytes(4, "little")
            case _:
                data = bytearray(rng.bytes(length % 80))
        yield bytes(data)


def _check(event: object) -> None:
    match event:
        case Identity():
            assert 0 < event.boot < 2**64
            assert event.rate_hz > 0
            assert event.tick_period_s > 0
            assert len(event.model) + len(event.firmware) <= _MAX_TEXT
        case Readings():
            n = len(event.ticks)
            assert n > 0
            assert event.gyro.shape == (n, 3)
            assert event.accel is None or event.accel.shape == (n, 3)
            assert event.temperature_c is None or event.temperature_c.shape == (n,)
        case Battery():
            assert 0 <= event.percent <= 100
        case Notice():
            assert event.name
            assert event.said is None or max(map(len, event.said.params.values()), default=0) <= _MAX_TEXT
        case _:
            raise AssertionError(f"no event: {event!r}")
