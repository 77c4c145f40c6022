"""Protocol recognition: decodes the received bytes by every driver; the driver that decodes the largest share is best.

No I/O.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bridge.drivers.byte_stream import OUTPUT
from bridge.drivers.driver import DriverKind, Event, Identity, Notice, Readings
from bridge.reasons.codes import Sentence
from bridge.toml.loader import options
from bridge.transport.transport import Chunk

_FEWEST = 5  # samples; with fewer, a short checksum may match by chance
_SHARE = 0.5  # of samples and faults together
_PLAUSIBLE = 100.0  # rad/s
_PORT = "scan"


@dataclass(frozen=True, slots=True)
class Candidate:
    """Driver with one set of options, to be tried on the bytes of a port.

    table: the options as in the ward file, without port and baud. chosen: the same options as the driver's options
    object.
    baud: usual baud rate of the driver's devices, bits per second; 0 if the devices have no baud rate.
    """

    kind: DriverKind
    table: dict[str, Any]
    chosen: Any
    baud: int

    def __str__(self) -> str:
        return " ".join([self.kind.name, *(str(value) for key, value in self.table.items() if key != "rate_hz")])


@dataclass(frozen=True, slots=True)
class Guess:
    """Result of decoding a port's bytes by one candidate: number of samples, number of faults, and the device's identity.

    rate_hz: sample rate, from receive times if measurable, else as the device reports; 0 if unknown.
    lacking: why recognised data contain no sample, as the driver reports; None if nothing is lacking.
    """

    candidate: Candidate
    samples: int
    faults: int
    identity: Identity | None
    rate_hz: float
    lacking: Sentence | None = None

    @property
    def share(self) -> float:
        """Share of samples among samples and faults, 0 to 1: how much of the data was decoded."""
        return self.samples / max(1, self.samples + self.faults)

    @property
    def understood(self) -> bool:
        """True if enough was decoded to accept this candidate: at least 5 samples and a share of at least 0.5."""
        return self.samples >= _FEWEST and self.share >= _SHARE


def candidates(kinds: Iterable[DriverKind]) -> list[Candidate]:
    """Return all candidates for unknown bytes: each driver that can decode bytes, once per table of its options."""
    return [
        Candidate(kind, table, None if not table else chosen, getattr(chosen, "baud", 0))
        for kind in kinds
        if kind.decoder is not None
        for table in kind.variants()
        if (chosen := _options(kind, table)) is not None
    ]


def guesses(tried: Iterable[Candidate], chunks: Sequence[Chunk]) -> list[Guess]:
    """Decode the received chunks by every candidate; return the results, best first.

    tried: the candidates. A candidate whose decoder raises an exception is left out.
    """
    made = [guess for candidate in tried if (guess := _try(candidate, chunks)) is not None]
    return sorted(made, key=lambda guess: (guess.understood, round(guess.share, 2), guess.samples), reverse=True)


def _options(kind: DriverKind, table: dict[str, Any]) -> Any:
    try:
        return options({"port": _PORT, **table}, kind.options)
    except ValueError:
        return None  # the driver's options are not those of a byte stream


def _try(candidate: Candidate, chunks: Sequence[Chunk]) -> Guess | None:
    """Result of one candidate; None if its decoder fails, since a faulty foreign driver must not stop the scan."""
    assert candidate.kind.decoder is not None
    events: list[Event] = []
    try:
        decoder = candidate.kind.decoder(candidate.chosen)
        decoder.opened()
        for chunk in chunks:
            events += decoder.feed(chunk.data, chunk.receive_time_ns)
        events += decoder.finish()
        faults = decoder.faults.total()
    except Exception:  # noqa: BLE001
        return None
    readings = [event for event in events if isinstance(event, Readings) and _sane(event)]
    identity = next((event for event in events if isinstance(event, Identity)), None)
    return Guess(
        candidate=candidate,
        samples=sum(len(event.ticks) for event in readings),
        faults=faults + sum(isinstance(event, Readings) for event in events) - len(readings),
        identity=identity,
        rate_hz=_rate_hz(readings) or (identity.rate_hz if identity else 0.0),
        lacking=next((event.said for event in events if isinstance(event, Notice) and event.name == OUTPUT), None),
    )


def _sane(readings: Readings) -> bool:
    with np.errstate(invalid="ignore"):
        return bool((np.abs(readings.gyro) < _PLAUSIBLE).all())


def _rate_hz(readings: Sequence[Readings]) -> float:
    if len(readings) < 2:
        return 0.0
    passed_s = (readings[-1].receive_time_ns - readings[0].receive_time_ns) * 1e-9
    return sum(len(event.ticks) for event in readings[1:]) / passed_s if passed_s > 0.5 else 0.0
