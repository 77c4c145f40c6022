"""What the end-to-end tests share: devices with known truth, and waiting for what a subscriber sees."""

import time
from collections.abc import Callable
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from bridge.sim.calibration_session import Session
from bridge.sim.imu_errors import DEMO_SPEC
from bridge.sim.motion_scripts import demo_script
from bridge.sim.sample_source import SimulatedSource
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice
from bridge.wire.messages import CorrectedBatch, Quality
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from estimator.service import history
from estimator.service.history import History
from estimator.service.store_reader import StoreReader
from tests.sim.recorded_source import RecordedSource

_SIMULATED = """
[[bridge.devices]]
id = "{id}"
driver = "simulated"
seed = {seed}
speed = {speed}
life = "{life}"
"""
WAITING = DeviceSpec(wait_for_host=True)


def recorded(
    name: str,
    gyro: NDArray[np.float64],
    accel: NDArray[np.float64] | None,
    rate_hz: float,
    temperature_c: NDArray[np.float64] | None = None,
) -> VirtualDevice:
    """A device that plays a recording from the moment it is first asked who it is."""
    return VirtualDevice(name, RecordedSource(gyro, accel, temperature_c, rate_hz=rate_hz), seed=1, spec=WAITING)


def simulated_session(name: str, session: Session) -> VirtualDevice:
    """A device that plays one simulated calibration session."""
    return recorded(name, session.gyro, session.accel, session.rate_hz, session.temperature_c)


def living(name: str, seed: int) -> VirtualDevice:
    """A device that is calibrated at every boot and then worn for ever."""
    return VirtualDevice(name, SimulatedSource(demo_script, DEMO_SPEC, 104.0), seed, WAITING)


def add_simulated(ward: Ward, names: list[str], speed: float, life: str = "lively") -> None:
    """Have the ward's bridge simulate these devices, too; before it is started."""
    devices = "".join(_SIMULATED.format(id=name, seed=seed, speed=speed, life=life) for seed, name in enumerate(names))
    text = ward.config.read_text(encoding="utf-8")
    ward.config.write_text(text.replace("[estimator]", devices + "[estimator]"), encoding="utf-8")


def wait(what: str, until: Callable[[], bool], watcher: Watcher, ward: Ward, timeout_s: float = 90.0) -> float:
    """Poll until something is so; the seconds it took. Fails with the logs when it does not come."""
    begin = time.monotonic()
    while not until():
        if time.monotonic() - begin > timeout_s:
            logs = "\n".join(f"--- {name}\n{ward.log(name)[-1500:]}" for name in ("router", "bridge", "estimator"))
            statuses = "\n".join(map(str, watcher.statuses.values()))
            raise AssertionError(f"{what} did not come in {timeout_s:.0f} s\n{statuses}\n{logs}")
        watcher.poll()
        time.sleep(0.02)
    return time.monotonic() - begin


def until(program: str, true: Callable[[], bool], ward: Ward, timeout_s: float = 90.0) -> None:
    """Poll until something is so of a program of the ward; fails with its log."""
    deadline = time.monotonic() + timeout_s
    while not true():
        ward.check()
        assert time.monotonic() < deadline, ward.log(program)
        time.sleep(0.1)


def kept(ward: Ward, device: str) -> History:
    """What the store has of a device now."""
    with closing(StoreReader.reading(ward.folder / "truerate.sqlite3")) as store:
        return history.read(store, device)


def subscribers(ward: Ward, n: int = 3) -> list[Subscriber]:
    """Subscribers that keep all they receive."""
    return [Subscriber(ward.endpoint, WARD, keep=True) for _ in range(n)]


def good_calibrations(batches: list[CorrectedBatch]) -> list[str]:
    """The calibrations under which GOOD samples were published, in order of first use."""
    return list(dict.fromkeys(b.calibration for b in batches if b.quality is Quality.GOOD))


def numbers(batches: list[CorrectedBatch]) -> NDArray[np.int64]:
    """The sequence number of every sample, as received."""
    return np.concatenate([np.arange(b.sequence, b.sequence + len(b)) for b in batches])
