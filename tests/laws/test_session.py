"""Laws of a device's session, for any batching and any damage."""

from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from bridge.wire.messages import CorrectedBatch, Quality
from estimator.device.session import DeviceSession
from tests.estimator.stream import NAME, Stream, calibration, feed
from tests.sentences import free


@cache
def life() -> Stream:
    rng = np.random.default_rng(3)
    return calibration(seed=3, after=[swing(rng, 2.0, np.radians(90.0)), Still(2.5)], rate_hz=52.0)


def columns(corrected: list[CorrectedBatch]) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]]:
    """All that is published, sample by sample."""
    spread = {
        name: np.concatenate([np.tile(getattr(b, name), (len(b), 1)) for b in corrected])
        for name in ("noise_std", "bias_std", "scale_std", "bias", "quality")
    }
    return spread | {
        "rate": np.concatenate([b.rate for b in corrected]),
        "ticks": np.concatenate([b.ticks for b in corrected]),
        "number": np.concatenate([b.sequence + np.arange(len(b)) for b in corrected]),
        "calibration": np.concatenate([[b.calibration] * len(b) for b in corrected]),
    }


@cache
def whole() -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]]:
    return columns(feed(DeviceSession(NAME), life().batches()).corrected)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 1500), max_size=60, unique=True))
def test_any_batching_corrects_alike_to_the_last_bit(edges: list[int]) -> None:
    of = life()
    # At most a second or so in a batch, as the wire has it.
    steps = [edge for edge in edges if edge < len(of)] + list(range(0, len(of), 60))
    found = columns(feed(DeviceSession(NAME), of.batches(sorted(set(steps) - {0}))).corrected)
    for name, expected in whole().items():
        np.testing.assert_array_equal(found[name], expected, err_msg=name)


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_what_comes_in_goes_out_or_is_counted(data: st.DataObject) -> None:
    """Batches lost, repeated, late, of an old boot, of a new one, in any order."""
    of = life()
    batches = [b for boot in (1, 2, 3) for b in of.part(0, 300).batches(boot=boot)]
    order = data.draw(st.lists(st.integers(0, len(batches) - 1), min_size=1, max_size=120))
    device = DeviceSession(NAME)
    out: list[tuple[int, int]] = []
    for index in order:
        for b in feed(device, [batches[index]]).corrected:
            out += [(b.boot, b.sequence + i) for i in range(len(b))]
            assert b.quality is not Quality.GOOD
    status = device.status(1)
    assert status.samples_in == sum(len(batches[i]) for i in order)
    assert status.samples_in == status.samples_out + sum(status.dropped.values())
    assert len(out) == len(set(out)) == status.samples_out
    boots = [boot for boot, _ in out]
    assert [b for i, b in enumerate(boots) if i == 0 or b != boots[i - 1]] == list(dict.fromkeys(boots))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 5000), st.integers(1, 400))
def test_after_a_reboot_at_any_moment_no_sample_is_good(cut: int, n: int) -> None:
    of = life()
    device = DeviceSession(NAME)
    feed(device, of.part(0, cut % len(of) + 1).batches())
    after = feed(device, replace(of).part(0, n).batches(boot=2)).corrected
    assert sum(map(len, after)) == min(n, len(of))
    assert all(b.quality in (Quality.NONE, Quality.BIAS_ONLY) for b in after)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.sampled_from(["recalibrate", "cancel", "silence"]), max_size=8), st.integers(0, 2**32))
def test_people_may_ask_for_anything_at_any_time(asked: list[str], seed: int) -> None:
    of = life()
    device = DeviceSession(NAME)
    moments = set(np.random.default_rng(seed).integers(0, len(of) // 10, len(asked)).tolist())
    queue = list(asked)
    for i, batch in enumerate(of.batches()):
        feed(device, [batch])
        if i in moments and queue:
            ask = queue.pop()
            before = device.calibration
            if ask == "silence":
                device.silence(free("no samples"))
            elif ask == "recalibrate":
                device.recalibrate("nurse", "")
            else:
                device.cancel("nurse")
            assert device.calibration is before
            assert device.status(1).reason
    status = device.status(1)
    assert status.samples_in == status.samples_out == len(of)
