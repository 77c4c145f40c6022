"""A device that tells no time: its rate is measured, a silence is told from a gap, and its time never jumps."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.drivers.driver import Identity, Readings
from bridge.ingest.intake import Intake
from bridge.reasons.codes import Code, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, SampleBatch, SampleFlag

NOW = 1_700_000_000 * 10**9
KEY = keys.build("w", "raw", bridge="b", device="d")
ARRIVALS = Path(__file__).parents[3] / "shared/data/sunsided_mpu6050/unmoved-x-pointing-forward.npz"
Floats = NDArray[np.float64]


def hello(told_hz: float) -> Identity:
    return Identity(
        7, BootCause.PORT_OPENED, "m", "f", told_hz, 4.0, 1 / told_hz, False, False, 64, 64, has_clock=False
    )  # fmt: skip


class Host:
    """A device of real rate_hz behind an intake that was told another; `published` is what came of it."""

    def __init__(self, told_hz: float, real_hz: float, seed: int = 1) -> None:
        self.intake = Intake("d", "b", "text", "/dev/x")
        self.intake.take(hello(told_hz))
        self.real_hz = real_hz
        self.published: list[SampleBatch] = []
        self._rng = np.random.default_rng(seed)
        self._number = 0  # of the next sample, as it can be counted
        self.made = 0  # samples the device has made

    def receive(self, n: int, at_s: float) -> None:
        gyro = self._rng.normal(size=(n, 3))
        ticks = np.arange(self._number, self._number + n, dtype=np.uint64)
        readings = Readings(7, self._number, NOW + round(at_s * 1e9), ticks, gyro, None, None)
        self._number += n
        for batch in self.intake.take(readings):
            codec.decode_samples(KEY, codec.encode_samples(batch))
            self.published.append(batch)
        assert self.intake.samples_in == self.intake.samples + self.intake.dropped.total()

    def live(self, seconds: float, *, lost: bool = False, held_s: float = 0.0) -> None:
        """Packets of five samples, a few ms late; `lost` on the way, or all held up at first for held_s."""
        ends = self.made / self.real_hz + seconds
        open_s = self.made / self.real_hz + held_s
        while (self.made + 5) / self.real_hz <= ends:
            self.made += 5
            if not lost:
                at_s = max(open_s, self.made / self.real_hz)
                self.receive(5, at_s + float(self._rng.exponential(0.002)))

    @property
    def time_s(self) -> Floats:
        return np.concatenate([batch.device_time for batch in self.published])

    @property
    def host_s(self) -> Floats:
        of = [batch.ticks - batch.ticks[0] for batch in self.published]
        since = [
            ticks * batch.tick_period_s * batch.clock_rate for ticks, batch in zip(of, self.published, strict=True)
        ]
        return np.concatenate([(b.start_time_ns - NOW) * 1e-9 + s for b, s in zip(self.published, since, strict=True)])

    @property
    def sequence(self) -> NDArray[np.int64]:
        return np.concatenate([batch.sequence + np.arange(len(batch)) for batch in self.published])

    def notices(self) -> Sentences:
        return self.intake.info(NOW, {}).notices

    def events(self) -> dict[str, int]:
        return self.intake.info(NOW, {}).events


@pytest.mark.parametrize(("told_hz", "real_hz"), [(100.0, 98.3), (102.4, 204.8), (200.0, 104.0)])
def test_device_time_follows_the_rate_that_is_measured(told_hz: float, real_hz: float) -> None:
    host = Host(told_hz, real_hz)
    host.live(40)
    steps = np.diff(host.time_s)
    assert steps[0] == pytest.approx(1 / told_hz, rel=1e-3)
    assert steps[-1000:].mean() == pytest.approx(1 / real_hz, rel=5e-4)
    assert (steps > 0).all()
    assert {batch.tick_period_s for batch in host.published} == {1e-6}
    assert len(host.time_s) == host.made
    true_s = np.arange(1, host.made + 1) / real_hz
    assert np.abs(host.host_s - true_s)[-1000:].max() < 5e-3


def test_what_is_measured_and_how_well_is_said_from_the_first_second() -> None:
    host = Host(100.0, 98.3)
    host.live(1)
    assert host.notices() == (Code.RATE_PRESUMED(rate_hz="100"),)
    host.live(30)
    [measured] = host.notices()
    assert (measured.code, measured.params["rate_hz"]) == (Code.RATE_MEASURED, "98.3")
    assert float(measured.params["percent"]) < 0.1
    assert host.events() == {}


@pytest.mark.parametrize("gap_s", [0.1, 30.0])
def test_a_silence_that_nothing_makes_up_for_is_a_gap(gap_s: float) -> None:
    host = Host(100.0, 101.0)
    host.live(20)
    before, last = host.made, len(host.time_s)
    host.live(gap_s, lost=True)
    missing = host.made - before
    host.live(10)
    assert host.events()["missing_samples"] == pytest.approx(missing, abs=2 + 2e-3 * missing)
    assert host.events()["gaps"] == 1
    jump = host.sequence[last] - host.sequence[last - 1] - 1
    assert jump == host.events()["missing_samples"]
    assert host.time_s[last] - host.time_s[last - 1] == pytest.approx(gap_s + 1 / 101, abs=0.03 + 2e-3 * gap_s)
    (flagged,) = [batch for batch in host.published if batch.flags[0] & SampleFlag.AFTER_GAP]
    assert flagged.sequence == host.sequence[last]
    assert host.intake.release() == []


@pytest.mark.parametrize("held_s", [0.5, 20.0])
def test_a_silence_that_a_burst_makes_up_for_is_none(held_s: float) -> None:
    host = Host(100.0, 100.0)
    host.live(20)
    host.live(held_s + 10, held_s=held_s)
    assert np.diff(host.sequence).max() == 1
    assert "gaps" not in host.events()
    assert len(host.time_s) == host.made
    late = np.concatenate([batch.flags & SampleFlag.LATE != 0 for batch in host.published])
    assert late.sum() == pytest.approx(max(0, held_s - 1) * 100, abs=2)
    assert host.events().get("late", 0) == late.sum()


@pytest.mark.data
@pytest.mark.parametrize("told_hz", [104.0])
def test_arrivals_in_bursts_tell_the_rate_to_a_thousandth(told_hz: float) -> None:
    if not ARRIVALS.exists():
        pytest.skip(f"{ARRIVALS} is not here")
    arrival_s = np.load(ARRIVALS)["arrival_s"]
    host = Host(told_hz, 100.0)
    for i, at_s in enumerate(arrival_s.tolist()):
        host.receive(1, at_s)
        if i == 2000:
            assert host.intake.info(NOW, {}).measured_rate_hz == pytest.approx(100.0, rel=1e-3)
    assert host.intake.info(NOW, {}).measured_rate_hz == pytest.approx(100.0, rel=1e-3)
    steps = np.diff(host.time_s)
    assert steps[2000:].mean() == pytest.approx(0.01, rel=1e-3)
    assert np.diff(host.sequence).max() == 1
    assert len(host.time_s) == len(arrival_s)
