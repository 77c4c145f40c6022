"""The checker finds what it is there to find: a history that keeps every promise, and the same with one broken."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.sample_source import TrueSamples
from bridge.wire.messages import Calibration, CorrectedBatch, Quality, Status, Verdict
from estimator.client import Miss
from estimator.device.session import DeviceSession
from estimator.service.periodic_checks import EVENT
from tests.nemesis.history import Boot, Done, Heard, History, Sent
from tests.nemesis.invariants import broken

BOOT, ID, N = 7, "c-1", 5
WITHIN_S = 5.0
#: when the first three batches are heard, and then one twice a second
TIMES = (0.5, 2.5, *np.arange(3.0, 22.0, 0.5))


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
        reason=(),
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
    """One device, one fault that may cost no samples, and 20 s of quiet with samples up to the end."""
    kept = History(calibrations={ID: known()}, statuses={"d": said()}, done=[Done("kill router", 1.0, 2.0)], end_s=22.0)
    kept.heard["d", BOOT] = [Heard(at_s, batch(N * number)) for number, at_s in enumerate(TIMES)]
    kept.said = list(kept.heard["d", BOOT])
    kept.sent["d", BOOT] = [Sent(at_s - 0.1, N * number) for number, at_s in enumerate(TIMES, 1)]
    return kept


def true(first: int, last: int, bias: float = 0.0, rate: float = 0.0) -> TrueSamples:
    n = last + 1 - first
    return TrueSamples(np.full((n, 3), rate), np.zeros((n, 4)), np.full((n, 3), bias))


def right(_: Boot, first: int, last: int) -> TrueSamples:
    return true(first, last)


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


def test_an_estimator_goes_back_to_an_old_boot(history: History) -> None:
    history.said.insert(2, Heard(2.6, batch(0, BOOT + 1)))
    [words] = broken(history, right, WITHIN_S)
    assert "was over in epoch 0" in words


def test_an_estimator_says_a_sample_twice(history: History) -> None:
    history.said.insert(2, Heard(2.6, batch(N + 1)))
    [words] = broken(history, right, WITHIN_S)
    assert f"sample {N + 1} is said again" in words
    # Another may: who had it before him, or has it from now on.
    history.said[2] = Heard(2.6, replace(batch(N + 1), epoch=-1))
    assert broken(history, right, WITHIN_S) == []


def test_an_epoch_that_is_over(history: History) -> None:
    heard = history.heard["d", BOOT]
    for number, (at_s, old) in enumerate(heard):
        heard[number] = Heard(at_s, replace(old, epoch=7 if number < 8 or number == 12 else 8))
    history.said = list(heard)
    assert broken(history, right, WITHIN_S) == [], "nobody else has said it"
    history.said.insert(12, Heard(heard[12].time_s - 1.0, replace(heard[12].batch, epoch=8)))
    [words] = broken(history, right, WITHIN_S)
    assert f"sample {12 * N} of epoch 7 is given, of which epoch 8 had said some" in words


def test_a_hole_must_be_told_and_have_a_cause(history: History) -> None:
    del history.heard["d", BOOT][1]
    lost, untold = broken(history, right, WITHIN_S)
    assert f"{N} samples from {N} on are lost" in lost
    assert f"{N} samples are missing, 0 were told" in untold
    history.misses.append(Miss("d", BOOT, N, N, told=False))
    assert len(broken(history, right, WITHIN_S)) == 1
    history.done.append(Done("garble the line of d", 2.0, 3.0, costs="d"))
    assert broken(history, right, WITHIN_S) == []


@pytest.mark.parametrize("done", [Done("garble e", 2.0, 3.0, costs="e"), Done("kill bridge", 7.0, 8.0, costs="")])
def test_a_fault_of_another_or_at_another_time_is_no_cause(history: History, done: Done) -> None:
    del history.heard["d", BOOT][1]
    history.misses.append(Miss("d", BOOT, N, N, told=False))
    history.done.append(done)
    [words] = broken(history, right, WITHIN_S)
    assert "are lost" in words


def test_what_was_held_up_by_one_fault_is_lost_by_the_next(history: History) -> None:
    del history.heard["d", BOOT][1]
    history.misses.append(Miss("d", BOOT, N, N, told=False))
    history.done += [Done("hold the line of bridge", 2.0, 6.0), Done("kill bridge", 5.9, 6.1, costs="")]
    assert broken(history, right, WITHIN_S) == []


def test_a_begin_an_end_or_a_whole_boot_that_is_lost(history: History) -> None:
    del history.heard["d", BOOT][0]
    history.sent["d", BOOT].append(Sent(21.9, N * len(TIMES) + 3))
    history.sent["d", BOOT + 1] = [Sent(22.0, 9)]
    words = broken(history, right, WITHIN_S)
    assert [word.split(" samples")[0].rpartition(" ")[2] for word in words] == [str(N), "3", "9"]


def test_a_sample_that_was_never_sent(history: History) -> None:
    history.sent["d", BOOT][-1] = Sent(21.9, N * len(TIMES) - 1)
    [words] = broken(history, right, WITHIN_S)
    assert f"sample {N * len(TIMES) - 1} of {N * len(TIMES) - 1} that were sent" in words
    history.sent.clear()
    [words] = broken(history, right, WITHIN_S)
    assert "of 0 that were sent" in words


def test_a_message_that_is_not_understood(history: History) -> None:
    history.refused["wire"] = 2
    assert broken(history, right, WITHIN_S) == ["2 messages were refused: wire"]


def test_samples_that_are_nowhere(history: History) -> None:
    history.statuses["d"] = replace(said(), samples_in=said().samples_in + 1)
    [words] = broken(history, right, WITHIN_S)
    assert "samples in" in words


def test_the_service_finds_its_own_law_broken(history: History) -> None:
    history.events.add(("d", EVENT))
    assert broken(history, right, WITHIN_S) == [f"d: {EVENT}"]


def test_a_device_that_comes_back_too_late_or_not_at_all(history: History) -> None:
    whole = list(history.heard["d", BOOT])
    for gone in ([h for h in whole if h.time_s < 10.0], [h for h in whole if not 3.0 < h.time_s < 10.0]):
        history.heard["d", BOOT] = gone
        assert any("nothing that is not late for" in words for words in broken(history, right, WITHIN_S))
    history.heard["d", BOOT] = whole
    history.sent["d", BOOT] = [Sent(min(at_s, 3.0), n) for at_s, n in history.sent["d", BOOT]]  # all else is heard late
    [words] = broken(history, right, WITHIN_S)
    assert "nothing that is not late for" in words


def test_between_two_faults_it_is_heard_again_too(history: History) -> None:
    history.done.append(Done("kill router", 15.0, 16.0))
    history.heard["d", BOOT] = [h for h in history.heard["d", BOOT] if not 3.0 < h.time_s < 15.0]
    assert any("nothing that is not late for 8.0 s" in words for words in broken(history, right, WITHIN_S))


def test_good_and_then_no_more(history: History) -> None:
    at_s, last = history.heard["d", BOOT][-1]
    history.heard["d", BOOT][-1] = Heard(at_s, replace(last, quality=Quality.BIAS_ONLY))
    [words] = broken(history, right, WITHIN_S)
    assert "is BIAS_ONLY, 19.5 s after what was done before" in words
    history.heard["d", BOOT] = [Heard(s, replace(b, quality=Quality.NONE)) for s, b in history.heard["d", BOOT]]
    assert broken(history, right, WITHIN_S) == [], "it was never GOOD"


def test_a_bias_or_a_rate_that_is_called_good_and_is_not(history: History) -> None:
    [words] = broken(history, lambda _, first, last: true(first, last, bias=0.1), WITHIN_S)
    assert "its bias is off by 5.7" in words
    [words] = broken(history, lambda _, first, last: true(first, last, rate=0.1), WITHIN_S)
    assert "its rate is off by 5.7" in words
