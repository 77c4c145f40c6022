"""The compiled loop against its witness in plain NumPy, over streams of everything that may happen to one."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.kernels.stillness import TOLD
from estimator.samples.sample_buffer import ACCEL, CELSIUS, GYRO, Floats
from estimator.stillness import detector
from estimator.stillness.detector import Stillness, Window
from tests.estimator.stillness.reference import ReferenceStillness

Flags = NDArray[np.bool_]
Columns = tuple[Floats, Floats, Floats, Flags]


def some_time(rng: np.random.Generator) -> Floats:
    """At up to three rates; with jitter, samples that were lost, and silences as long as a gap or nearly."""
    step = np.concatenate([np.full(rng.integers(200, 900), 1 / hz) for hz in rng.choice([8, 26, 52, 104, 416], 3)])
    step *= 1 + 0.05 * rng.uniform(-1, 1, len(step))
    step[rng.random(len(step)) < 0.005] *= 3
    silent = rng.random(len(step)) < 0.006
    step[silent] += rng.choice([0.1, 0.24, 0.26, 3.0], silent.sum())
    return np.asarray(rng.uniform(0, 1e4) + np.cumsum(step))


def some_gyro(rng: np.random.Generator, time: Floats) -> Floats:
    """Rests at some bias; turns, even, by fits and starts, or slow; movements; louder noise. Of a coarse gyro now and then."""
    step = np.diff(time, prepend=time[0] - 0.02)[:, None]
    noise = rng.choice([5e-4, 2e-3, 6e-3]) * np.sqrt(0.02 / step) * rng.normal(size=(len(time), 3))
    gyro = rng.normal(0, 0.1, 3) + noise
    for _ in range(rng.integers(2, 12)):
        begin = int(rng.integers(0, len(time)))
        part = slice(begin, begin + int(rng.integers(10, 600)))
        after, axes = time[part, None] - time[begin], rng.normal(size=3)
        match rng.integers(0, 5):
            case 0:
                gyro[part] += axes * np.sin(rng.uniform(1, 20) * after)
            case 1:
                gyro[part] += rng.choice([0.03, 0.1]) * axes
            case 2:
                gyro[part] += rng.choice([0.03, 0.1]) * axes * (after % 2.0 < 1.3)
            case 3:
                gyro[part] += 0.01 * axes * after
            case _:
                gyro[part] += rng.uniform(3, 9) * noise[part]
    return np.asarray(np.round(gyro, 3) if rng.random() < 0.3 else gyro)


def spiked(rng: np.random.Generator, time: Floats, gyro: Floats) -> Flags:
    """Put spikes into gyro: alone, side by side, just far enough and not quite, behind gaps, and steps; what was clipped."""
    clipped = rng.random(len(gyro)) < 0.002
    silent = np.flatnonzero(np.diff(time) > detector.GAP_S) + 1
    places = [*rng.integers(0, len(gyro), rng.integers(0, 60)), *silent[rng.random(len(silent)) < 0.5]]
    for i in places:
        size = detector.SPIKE_FAR * rng.choice([-1, 1]) * rng.choice([0.9, 1.01, 1.5, 3.0, 10.0])
        gyro[i : i + rng.choice([1, 2, 40], p=[0.8, 0.1, 0.1]), rng.random(3) < 0.5] += size
        clipped[i] |= rng.random() < 0.5
    return clipped


def some_accel(rng: np.random.Generator, n: int) -> Floats:
    """Gravity and pushes; absent now and then, also in one axis, or infinite."""
    accel = np.array([0.0, 3.0, 9.0]) + 0.02 * rng.normal(size=(n, 3))
    for _ in range(rng.integers(0, 6)):
        begin, axis = int(rng.integers(0, n)), rng.integers(0, 3)
        part = slice(begin, begin + int(rng.integers(1, 100)))
        match rng.integers(0, 4):
            case 0:
                accel[part] += rng.normal(0, 0.5, (len(accel[part]), 3))
            case 1:
                accel[part] = np.nan
            case 2:
                accel[part, axis] = np.nan
            case _:
                accel[begin, axis] = np.inf
    return accel


def some_stream(rng: np.random.Generator) -> Columns:
    time = some_time(rng)
    gyro = some_gyro(rng, time)
    return time, gyro, some_accel(rng, len(time)), spiked(rng, time, gyro)


#: a window, with the noise as it was known when it closed, and whether it was
Judged = tuple[Window, Floats, bool]


def parts_of(
    columns: Columns, edges: list[int], *, aided: bool
) -> Iterator[tuple[Floats, Floats, Floats | None, Flags]]:
    time, gyro, accel, clipped = columns
    for part in (slice(a, b) for a, b in pairwise([0, *edges, len(time)])):
        yield time[part], gyro[part], accel[part] if aided else None, clipped[part]


def fed(columns: Columns, edges: list[int], *, aided: bool) -> list[Judged]:
    stillness, found = Stillness(), list[Judged]()
    for part in parts_of(columns, edges, aided=aided):
        known, windows = stillness.noise_known, stillness.feed(*part)
        found += [
            (window, windows.noise_std(i), known or bool(windows.found[: i + 1, TOLD].any()))
            for i, window in enumerate(windows)
        ]
        assert not found or (stillness.noise_std == found[-1][1]).all()
    return found


def witnessed(columns: Columns, edges: list[int], *, aided: bool) -> list[Judged]:
    witness = ReferenceStillness()
    return [
        (window, witness.noise_std, witness.noise_known)
        for part in parts_of(columns, edges, aided=aided)
        for window in witness.feed(*part)
    ]


@pytest.mark.parametrize("seed", range(100, 116))
def test_it_agrees_with_its_witness(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detector, "NEW_REFERENCE_S", 4.0)  # there are new rests within a stream of a minute
    rng = np.random.default_rng(seed)
    columns, aided = some_stream(rng), rng.random() < 0.8
    edges = [sorted(rng.integers(0, len(columns[0]), n).tolist()) for n in rng.choice([0, 20, 100, 1000], 2)]
    with np.errstate(invalid="ignore"):  # of an infinite reading
        witness = witnessed(columns, edges[0], aided=aided)
    found = fed(columns, edges[1], aided=aided)
    assert len(witness) > 30
    for (ours, noise, known), (its, its_noise, its_known) in zip(found, witness, strict=True):
        assert plain(ours) == plain(its)
        assert known == its_known
        np.testing.assert_allclose(noise, its_noise, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(ours.rows[:, :CELSIUS], its.rows)
        for sensor, readings in enumerate(
            (its.rows[:, GYRO], its.rows[:, ACCEL]) if its.aided else (its.rows[:, GYRO],)
        ):
            finite = readings[np.isfinite(readings)]
            for part in (slice(3 * sensor, 3 * sensor + 3), slice(6 + 3 * sensor, 9 + 3 * sensor)):
                np.testing.assert_allclose(
                    ours.summed[part], its.summed[part], rtol=1e-12, atol=1e-12 * np.abs(finite).max(initial=0.0)
                )


def plain(window: Window) -> tuple[float, ...]:
    """All of it that is no array."""
    return window.start, window.end, window.start_time, window.end_time, window.spikes, window.still, window.aided
