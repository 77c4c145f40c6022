"""Driver interface: a driver converts a device's data to events, over any transport.

A driver opens its device, reads it and closes it. `bridge.ingest.intake` handles clocks and gaps. Drivers do not use
the message bus.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentence
from bridge.wire.messages import BootCause, DeviceCalibration
from bridge.wire.refusal import Tally


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a device: boot number, model, sample rate, full-scale range. Sent at each boot; may be repeated.

    boot: number that identifies the boot (the time from one power-up or restart to the next). boot_cause: how the boot
    was detected. rate_hz: nominal sample rate, Hz. gyro_range: full-scale range in rad/s, 0 if unknown. tick_period_s:
    seconds per tick. tick_bits, sequence_bits: widths of the device's tick counter and sequence number in bits, for
    unwrapping. has_accel, has_temperature: True if the device sends accelerations, temperatures.
    has_clock: False for a device without a clock. Its ticks then count samples, rate_hz is only nominal, and
    `bridge.ingest` derives the sample times from receive times.
    """

    boot: int
    boot_cause: BootCause
    model: str
    firmware: str
    rate_hz: float
    gyro_range: float
    tick_period_s: float
    has_accel: bool
    has_temperature: bool
    tick_bits: int = 32
    sequence_bits: int = 32
    has_clock: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Readings: n consecutive samples as the device sent them, not yet validated. Vectors are in the sensor frame.

    boot: boot number. gyro (n, 3): rad/s. accel (n, 3): m/s², or None. temperature_c (n,): °C, or None.
    ticks (n,): device time in ticks of Identity.tick_period_s. sequence: sequence number of the first sample. Both are
    as sent and wrap at the widths in Identity.
    clipped (n,): True for samples that the device itself reports as beyond its range; None if there are none.
    receive_time_ns: ns since the Unix epoch by `host_time.now_ns`, which does not jump when the host's clock is set.
    """

    boot: int
    sequence: int
    receive_time_ns: int
    ticks: NDArray[np.unsignedinteger]
    gyro: NDArray[np.floating]
    accel: NDArray[np.floating] | None
    temperature_c: NDArray[np.floating] | None
    clipped: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True)
class Battery:
    """State of a device's battery. percent: charge, 0 to 100 %. charging: True if the battery is being charged."""

    percent: float
    charging: bool = False


@dataclass(frozen=True, slots=True)
class Notice:
    """Message about a device for the user: text that the device sent, or a setting that disturbs the measurement.

    name: key of the notice. said: the message. A later notice replaces an earlier one of the same name; said=None
    withdraws the earlier one.
    """

    name: str
    said: Sentence | None


Event = Identity | Readings | Battery | Notice | DeviceCalibration


class Driver(Protocol):
    """Interface of a driver, which opens, reads and closes one device.

    faults: counts of frames and samples that could not be used, by label, since the driver was created.
    place: location of the device for the user: a port or a file.
    """

    faults: Tally
    place: str

    def open(self) -> None:
        """Open the device. Raises DeviceUnavailable if it cannot be opened now; the caller may try again."""

    def read(self, timeout_s: float) -> list[Event]:
        """Return the events (identities, readings and others) that arrived, [] if none.

        timeout_s: longest wait for the first event, s.
        Called from one thread only. Raises DeviceLost if the device is gone.
        """

    def close(self) -> None:
        """Close the device; never raises, and may be repeated. A call from another thread ends a `read`."""


@dataclass(frozen=True, slots=True)
class DriverKind:
    """Kind of driver, by its name in the configuration: how to create a driver, and which options it has.

    summary: one line for the user.
    options: type of the settings besides `id` and `driver`; `make` and `state` take an instance.
    make: creates the driver. state: returns in a few words whether the device can be opened now, without opening it.
    decoder: creates the protocol's decoder, from options or, if there are none, from None. If `decoder` itself is None,
    `bridge scan` does not use this kind to identify unknown bytes.
    variants: option tables, without port and baud, to try on unknown bytes of protocols that need options to be
    decoded.
    """

    name: str
    summary: str
    options: type[msgspec.Struct]
    make: Callable[[Any], Driver]
    state: Callable[[Any], str]
    decoder: Callable[[Any], Any] | None = None
    variants: Callable[[], Sequence[dict[str, Any]]] = lambda: ({},)
