"""The checker finds what it is there to find: a history that keeps every promise, and the same with one broken."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import Calibration, CorrectedBatch, Quality, SampleFlag, Status, Verdict
from estimator.once import Miss
from estimator.service.law import EVENT
from estimator.session import DeviceSession
from tests.nemesis.history import Boot, Done, Heard, History
from tests.nemesis.invariants import Floats, broken

BOOT, ID, N = 7, "c-1", 5
WITHIN_S = 5.0


def batch(sequence: int, boot: int = BOOT, quality: Quality = Quality.GOOD) -> CorrectedBatch:
    small, none = np.full(3, 0.001, np.float32), np.zeros(3, np.float32)
    ticks, flags = (sequence + np.arange(N)).astype(np.uint64) * 10_000, np.zeros(N, np.uint32)
    return CorrectedBatch(
        device="d",
        boot=boot,
        sequence=sequence,
        start_time_ns=sequence * 10_000_000,
        tick_period_s=1e-6,
        clock_rate=1.0,
        ticks=ticks,
        rate=np.zeros((N, 3), np.float32),
        flags=flags,
        quality=quality,
        noise_std=small,
        bias_std=small,
        scale_std=small,
        bias=none,
        calibration=ID,
        cross_std=small,
    )


def known() -> Calibration:
    return Calibration(
        device="d",
        boot=BOOT,
        id=ID,
        time_ns=1,
        method="closure",
        verdict=Verdict.ACCEPTED,
        reason="",
        matrix=np.eye(3),
        bias=np.zeros(3),
        parameters=(),
        covariance=np.zeros((0, 0)),
        turns=(),
        noise_std=np.zeros(3),
        model="",
        firmware="",
        gyro_range=0.0,
        rate_hz=0.0,
        temperature_c=20.0,
        who="",
    )


def said() -> Status:
    made = DeviceSession("d").status(7)
    return replace(made, samples_in=10, samples_out=7, dropped={"duplicate": 3})


@pytest.fixture
def history() -> History:
    """One device, three batches, one fault, and 20 s of quiet with samples up to the end."""
    kept = History(calibrations={ID: known()}, statuses={"d": said()}, done=[Done("kill bridge", 1.0, 2.0)], end_s=22.0)
    kept.heard["d", BOOT] = [Heard(0.5, batch(0)), Heard(2.5, batch(N)), Heard(21.9, batch(2 * N))]
    return kept


def right(_: Boot, __: int) -> Floats:
    return np.zeros(3)


def test_what_keeps_every_promise_is_fine(history: History) -> None:
    assert broken(history, right, WITHIN_S) == []


def test_good_by_a_calibration_nobody_published(history: History) -> None:
    history.calibrations.clear()
    [words] = broken(history, right, WITHIN_S)
    assert "nobody has published" in words


@pytest.mark.parametrize("change", [{"boot": BOOT + 1}, {"device": "other"}, {"verdict": Verdict.REPEAT}])
def test_good_by_a_calibration_of_something_else(history: History, change: dict[str, object]) -> None:
    history.calibrations[ID] = replace(known(), **change)  # type: ignore[arg-type]
    [words] = broken(history, right, WITHIN_S)
    assert ID in words


def test_a_sample_twice(history: History) -> None:
    history.heard["d", BOOT].insert(2, Heard(2.6, batch(N - 1)))
    assert any("came after" in words for words in broken(history, right, WITHIN_S))


def test_an_old_boot_that_comes_back(history: History) -> None:
    history.heard["d", BOOT + 1] = [Heard(3.0, batch(0, BOOT + 1, Quality.NONE))]
    [words] = broken(history, right, WITHIN_S)
    assert "goes on" in words
    # Its end, of which nothing was said before, may be said when it is found, as what it is.
    first, second, last = history.heard["d", BOOT]
    late = replace(last.batch, flags=last.batch.flags | np.uint32(SampleFlag.LATE))
    history.heard["d", BOOT] = [first, second, Heard(last.time_s, late)]
    history.heard["d", BOOT + 1].append(Heard(21.9, batch(N, BOOT + 1, Quality.NONE)))
    assert broken(history, right, WITHIN_S) == []


def test_an_epoch_that_is_over(history: History) -> None:
    one, two, three = history.heard["d", BOOT]
    history.heard["d", BOOT] = [
        Heard(two.time_s, replace(one.batch, epoch=8)),
        Heard(two.time_s + 1.0, replace(two.batch, epoch=7)),
        three,
    ]
    [words] = broken(history, right, WITHIN_S)
    assert f"sample {N} of epoch 7 1.000 s after 8" in words
    # What waited meanwhile, and nobody else says, may be given as what it is.
    first, second, last = history.heard["d", BOOT]
    late = replace(second.batch, flags=second.batch.flags | np.uint32(SampleFlag.LATE))
    history.heard["d", BOOT] = [first, Heard(second.time_s, late), last]
    assert broken(history, right, WITHIN_S) == []


def test_a_hole_must_be_told(history: History) -> None:
    del history.heard["d", BOOT][1]
    [words] = broken(history, right, WITHIN_S)
    assert f"{N} samples are missing, 0 were told" in words
    history.misses.append(Miss("d", BOOT, N, N, told=False))
    assert broken(history, right, WITHIN_S) == []


def test_samples_that_are_nowhere(history: History) -> None:
    history.statuses["d"] = replace(said(), samples_in=said().samples_in + 1)
    [words] = broken(history, right, WITHIN_S)
    assert "samples in" in words


def test_the_service_finds_its_own_law_broken(history: History) -> None:
    history.events.add(("d", EVENT))
    assert broken(history, right, WITHIN_S) == [f"d: {EVENT}"]


def test_a_device_that_does_not_come_back(history: History) -> None:
    history.heard["d", BOOT].pop()
    [words] = broken(history, right, WITHIN_S)
    assert "nothing for the last 19.5 s" in words


def test_a_bias_that_is_called_good_and_is_not(history: History) -> None:
    [words] = broken(history, lambda _, __: np.array([0.0, 0.1, 0.0]), WITHIN_S)
    assert "off by 5.7" in words
