"""Driver for a virtual device inside the bridge: the native decoder reads the simulator's bytes, without a port."""

import threading
import time
from typing import TYPE_CHECKING, Literal

from msgspec import Struct

from bridge.drivers.boot_detection import draw_boot
from bridge.drivers.driver import DriverKind, Event
from bridge.drivers.native import NativeDecoder
from bridge.reasons.codes import Code
from bridge.transport import host_time
from bridge.transport.errors import DeviceLost

if TYPE_CHECKING:
    from bridge.sim.virtual_device import VirtualDevice

_TURN_S = 0.02
#: how long the battery of a virtual device lasts, s; each boot begins with a full one
_BATTERY_S = 12 * 3600.0


class SimulatedOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a virtual device. Raises ValueError for an invalid option.

    seed: random seed of the device's sensor errors and motion. speed: multiple of real time.
    rate_hz: output data rate, Hz.
    life: motion after the calibration. `lively`: movements, each followed by a rest of some seconds. `ward`: a patient
    who lies, sleeps, sits, walks, and is turned in bed.
    """

    #: number that decides the device's errors and motion, 0 to 4294967295; equal seeds give equal devices
    seed: int = 0
    #: output data rate, Hz, 1 to 2000
    rate_hz: float = 104.0
    #: multiple of real time, 0.01 to 100; 10 runs ten times as fast
    speed: float = 1.0
    #: motion after the calibration: `lively` moves often, with rests of seconds; `ward` is a patient who lies, sits and walks
    life: Literal["lively", "ward"] = "lively"

    def __post_init__(self) -> None:
        if not 1 <= self.rate_hz <= 2000:
            raise ValueError(f"rate_hz is {self.rate_hz:g}: use 1 to 2000")
        if not 0.01 <= self.speed <= 100:
            raise ValueError(f"speed is {self.speed:g}: use 0.01 to 100")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed is {self.seed}: use 0 to 4294967295")


class SimulatedDriver:
    """Driver of a virtual device, timed by the host's monotonic clock.

    device: the virtual device, created by the first `open`; it keeps running after `close`.
    """

    def __init__(self, options: SimulatedOptions) -> None:
        self.place = f"simulated, seed {options.seed}"
        self.device: VirtualDevice | None = None
        self._options = options
        self._closed = threading.Event()
        self._decoder = NativeDecoder(options.rate_hz)
        self.faults = self._decoder.faults
        self._born_s = 0.0

    def open(self) -> None:
        """Open the virtual device; the first call creates it and switches it on."""
        if self.device is None:
            self.device = _made(self._options)
            self._born_s = time.monotonic()
        self._decoder.opened()
        self._closed.clear()

    def read(self, timeout_s: float) -> list[Event]:
        """Return the events since the last call, after a pause of timeout_s seconds, but at most 20 ms.

        Raises DeviceLost after `close`.
        """
        if self.device is None or self._closed.wait(min(timeout_s, _TURN_S)):
            raise DeviceLost(Code.CLOSED(place=self.place))
        if ask := self._decoder.to_send():
            self.device.receive(ask)
        data = self.device.advance((time.monotonic() - self._born_s) * self._options.speed)
        return self._decoder.feed(data, host_time.now_ns())

    def close(self) -> None:
        """Stop reading; this ends a `read` in another thread. The virtual device keeps its state."""
        self._closed.set()


def _made(options: SimulatedOptions) -> "VirtualDevice":
    # Imported late: other readers of a ward's configuration, such as an estimator, do not need the simulator.
    from bridge.sim.motion_scripts import demo_script  # noqa: PLC0415
    from bridge.sim.virtual_device import DeviceSpec, demo_device  # noqa: PLC0415
    from bridge.sim.ward_script import ward_script  # noqa: PLC0415

    # Boot numbers are random: with those of an earlier run, the bus would take the samples for repeats.
    script = {"lively": demo_script, "ward": ward_script}[options.life]
    spec = DeviceSpec(battery_s=_BATTERY_S)
    return demo_device(
        "simulated", options.seed, rate_hz=options.rate_hz, spec=spec, draw_boot=draw_boot, script=script
    )


KIND = DriverKind(
    name="simulated",
    summary="a virtual device that is calibrated and then worn, for trying things out: seed, rate_hz, speed, life",
    options=SimulatedOptions,
    make=SimulatedDriver,
    state=lambda _: "present",
)
