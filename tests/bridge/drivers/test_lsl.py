"""The LSL driver, on streams that pylsl sends on loopback: units, labels, boots by uid, loss and return, time, refusals."""

import os
import time
from collections.abc import Sequence

import numpy as np
import pylsl
import pytest

from bridge.drivers.driver import Event, Identity, Notice, Readings
from bridge.drivers.lsl import LslDriver, LslOptions
from bridge.drivers.lsl_channels import NoChannels, NoUnit, find
from bridge.reasons.codes import Code
from bridge.transport import host_time
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from tests import lsl as on_this_machine

assert on_this_machine.CONFIG.is_file()
#: streams are seen by every process of the machine: ours have names of their own
OWN = f"-{os.getpid()}"
PATIENCE_S = 60.0
NOT_UNITS = ("", "", "", "")
GYRO, ALL = ("GX", "GY", "GZ"), ("gyro_x", "gyro_y", "gyro_z", "temperature", "acc_x", "acc_y", "acc_z")


def described(labels: Sequence[str], units: Sequence[str], kind: str, source: str = "s") -> pylsl.StreamInfo:
    """A stream's metadata."""
    info = pylsl.StreamInfo("sensor", kind, len(labels), 100.0, "float32", source)
    info.set_channel_labels(list(labels))
    if any(units):
        info.set_channel_units(list(units))
    return info


class Sender:
    """A program that sends a stream of 100 Hz."""

    def __init__(self, source: str, labels: Sequence[str], units: Sequence[str], *, kind: str = "IMU") -> None:
        info = described(labels, units, kind, source + OWN)
        acquisition = info.desc().append_child("acquisition")
        acquisition.append_child_value("manufacturer", "Maker")
        acquisition.append_child_value("model", "M1")
        self._outlet: pylsl.StreamOutlet | None = pylsl.StreamOutlet(info)
        self.stamps = np.empty(0)

    def send(self, row: Sequence[float], numbers: Sequence[int], ago_s: float = 0.0, *, jitter_s: float = 0.0) -> None:
        """Send samples of these numbers, the last of them taken ago_s seconds ago, each with the values of `row`."""
        assert self._outlet is not None
        assert self._outlet.wait_for_consumers(PATIENCE_S)
        self.stamps = pylsl.local_clock() - ago_s + (np.array(numbers) - numbers[-1]) / 100.0
        if jitter_s:  # they come in bursts
            self.stamps = np.floor(self.stamps / jitter_s) * jitter_s + np.array(numbers) * 1e-5
        self._outlet.push_chunk(np.tile(np.array(row, np.float32), (len(numbers), 1)), self.stamps.tolist())

    def close(self) -> None:
        self._outlet = None


def opened(source: str, **given: object) -> LslDriver:
    return find_again(LslDriver(LslOptions(source_id=source + OWN, **given)))  # type: ignore[arg-type]


def find_again(driver: LslDriver) -> LslDriver:
    """Open a driver whose stream is there: LSL may need more than one look on a busy machine."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            driver.open()
        except DeviceUnavailable as unavailable:
            if unavailable.reason[0].code not in (Code.LSL_NOT_HEARD, Code.NO_ANSWER) or time.monotonic() > deadline:
                raise
        else:
            return driver


def read(driver: LslDriver, samples: int) -> list[Event]:
    """The events of so many samples."""
    found: list[Event] = []
    deadline = time.monotonic() + PATIENCE_S
    while sum(len(event.ticks) for event in found if isinstance(event, Readings)) < samples:
        assert time.monotonic() < deadline, found
        found += driver.read(0.2)
    return found


def parts(events: list[Event]) -> tuple[list[Identity], list[Readings]]:
    return [e for e in events if isinstance(e, Identity)], [e for e in events if isinstance(e, Readings)]


def test_labels_and_units_make_readings_in_si() -> None:
    sender = Sender("all", ALL, ["deg/s"] * 3 + ["celsius"] + ["g"] * 3)
    driver = opened("all")
    row = (180.0, 0.0, -90.0, 36.5, 0.0, 0.0, 1.0)
    sender.send(row, range(60), ago_s=0.8)
    (who,), came = parts(read(driver, 60))
    assert (who.model, who.rate_hz, who.has_accel, who.has_temperature, who.has_clock) == (
        "Maker M1",
        100.0,
        True,
        True,
        True,
    )
    assert came[0].gyro[0] == pytest.approx([np.pi, 0.0, -np.pi / 2])
    assert came[0].accel is not None
    assert came[0].accel[0] == pytest.approx([0.0, 0.0, 9.80665])
    assert came[0].temperature_c is not None
    assert came[0].temperature_c[0] == pytest.approx(36.5)
    ticks = np.concatenate([one.ticks for one in came]).astype(np.int64)
    assert np.diff(ticks) == pytest.approx(10_000, abs=1)
    assert came[-1].receive_time_ns < host_time.now_ns()

    def wrong_s(ago_s: float) -> float:
        sender.send(row, [0], ago_s)
        sample_s = sender.stamps[-1] + on_this_machine.ahead_s()  # LSL's time on the host's clock
        return float(abs(parts(read(driver, 1))[1][-1].receive_time_ns * 1e-9 - sample_s))

    # A sample has the time when it was taken, though it comes later; a machine that pauses may hide that of one.
    assert any(wrong_s(ago_s) < 0.002 for ago_s in (0.6, 0.5, 0.4, 0.3, 0.2))
    driver.close()


def test_missing_stamps_are_missing_samples() -> None:
    sender = Sender("holes", GYRO, ["rad/s"] * 3)
    driver = opened("holes")
    sender.send((1.0, 2.0, 3.0), [*range(50), *range(53, 60)])
    came = parts(read(driver, 57))[1]  # LSL may hand the first of them over before the others
    numbers = [one.sequence + index for one in came for index in range(len(one.ticks))]
    assert numbers == [*range(50), *range(53, 60)]
    driver.close()


def test_another_outlet_is_another_boot_and_the_same_one_is_not() -> None:
    sender = Sender("boots", GYRO, ["rad/s"] * 3)
    driver = opened("boots")
    sender.send((1.0, 2.0, 3.0), range(60))
    (first,), _ = parts(read(driver, 60))
    driver.close()
    find_again(driver)
    sender.send((1.0, 2.0, 3.0), range(60, 90))
    again, came = parts(read(driver, 30))
    assert (again, came[0].boot) == ([], first.boot)
    sender.close()
    with pytest.raises(DeviceLost, match=f"source_id boots{OWN} is lost"):
        read(driver, 1)
    driver.close()
    with pytest.raises(DeviceUnavailable, match="is not heard"):
        driver.open()
    sender = Sender("boots", GYRO, ["rad/s"] * 3)
    find_again(driver)
    sender.send((1.0, 2.0, 3.0), range(60))
    (second,), came = parts(read(driver, 60))
    assert second.boot == came[0].boot != first.boot
    assert came[0].sequence == 0
    driver.close()


def test_uneven_stamps_are_noticed_and_may_be_counted_instead() -> None:
    sender = Sender("bursts", GYRO, ["rad/s"] * 3)
    driver = opened("bursts")
    sender.send((1.0, 2.0, 3.0), range(600), jitter_s=0.08)
    deadline = time.monotonic() + PATIENCE_S
    while Notice("stamps", Code.LSL_UNEVEN()) not in driver.read(0.1):
        assert time.monotonic() < deadline
    driver.close()
    driver = opened("bursts", time="count")
    sender.send((1.0, 2.0, 3.0), range(600, 700), jitter_s=0.08)
    (who,), came = parts(read(driver, 100))
    assert not who.has_clock
    assert np.concatenate([one.ticks for one in came]).tolist() == list(range(100))
    driver.close()


@pytest.mark.parametrize(
    ("labels", "units", "given", "told"),
    [
        (
            GYRO,
            NOT_UNITS,
            {},
            "states no known unit of GX, GY, GZ (it states: –). Give the unit with the option `gyro_unit`",
        ),
        (
            ("EEG1", "EEG2", "EEG3"),
            ["uV"] * 3,
            {},
            "has no channels gyro of axes x, y and z. It has: EEG1, EEG2, EEG3.",
        ),
        (("a", "b", "c"), ["rad/s"] * 3, {"gyro": ("a", "b", "d")}, "has no channels d of axes"),
    ],
)
def test_a_stream_that_does_not_say_enough(
    labels: Sequence[str], units: Sequence[str], given: dict[str, object], told: str
) -> None:
    sender = Sender("bad", labels, units)
    with pytest.raises(DeviceUnavailable) as refused:
        opened("bad", **given)
    assert told in str(refused.value)
    sender.close()


def test_eeg_is_no_imu_and_volts_are_no_rate() -> None:
    with pytest.raises(NoChannels, match="gyro"):
        find(described(("EEG1", "EEG2", "EEG3"), ["uV"] * 3, "EEG"), (), (), "", "")
    with pytest.raises(NoUnit):
        find(described(GYRO, ["volt"] * 3, "IMU"), (), (), "", "")


@pytest.mark.parametrize(
    ("labels", "units", "kind", "given"),
    [
        (GYRO, NOT_UNITS, "IMU", {"gyro_unit": "dps"}),
        (("a", "b", "c"), ["°/s"] * 3, "IMU", {"gyro": ("a", "b", "c")}),
        (("X", "Y", "Z"), ["degrees per second"] * 3, "Gyroscope", {}),
        (("X", "Y", "Z"), ["°/s"] * 3, "IMU", {}),
    ],
)
def test_what_is_missing_may_be_given(
    labels: Sequence[str], units: Sequence[str], kind: str, given: dict[str, object]
) -> None:
    options = LslOptions(name="n", **given)  # type: ignore[arg-type]
    found = find(described(labels, units, kind), options.gyro, options.accel, options.gyro_unit, options.accel_unit)
    assert found.gyro.vector(np.array([180.0, 0.0, 90.0])) == pytest.approx((np.pi, 0.0, np.pi / 2))
    assert found.accel is None


def test_several_streams_ask_for_a_choice() -> None:
    senders = [Sender(source, GYRO, ["rad/s"] * 3, kind=f"Twin{OWN}") for source in ("one", "two")]
    driver = LslDriver(LslOptions(type=f"Twin{OWN}"))
    with pytest.raises(DeviceUnavailable, match=rf"several streams match: sensor \(one{OWN}\), sensor \(two{OWN}\)"):
        all(find_again(driver) for _ in range(60))  # one look may hear only one of them
    assert senders


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "name, type and source_id are empty"),
        ({"name": "it's"}, "choose the stream by another property"),
        ({"name": "a", "gyro": ("x",)}, "gyro has 1 labels"),
        ({"name": "a", "gyro_unit": "volt"}, "gyro_unit is 'volt': use one of rad/s"),
    ],
)
def test_wrong_options(given: dict[str, object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        LslOptions(**given)  # type: ignore[arg-type]
