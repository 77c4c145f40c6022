# ruff: noqa: E501 - a fault a line
"""Faults of clocks and rows are mended and said, each by its name, or refused with the way out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bridge.recording import Reading, load
from tests.bridge.recording.text.session import BIAS_DPS, Floats, refusal, right, table, turns

TIME, GYRO, ACCEL = turns()
HEADER = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"


def written(path: Path, time: Floats, header: str = HEADER, form: str = "%.6f", gyro: Floats = GYRO) -> Path:
    times = [form % one for one in time]
    rows = [f"{one},{row}" for one, row in zip(times, table([gyro, ACCEL[: len(gyro)]]), strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def arrivals(wait_s: float, hz: float = 50.0) -> Floats:
    """Times at which samples arrive that are sent every wait_s."""
    jitter = np.random.default_rng(1).uniform(0, 2e-4, len(TIME))
    return 1.7e9 + np.maximum.accumulate(np.ceil(TIME / wait_s + 1e-9) * wait_s + jitter)


def stalls() -> Floats:
    """Times of arrival at a host that is busy for 0.3 s now and then."""
    time = TIME + np.random.default_rng(2).uniform(0, 2e-3, len(TIME))
    for start in (1.0, 4.5, 8.0, 12.3, 15.0, 19.0):
        late = (time > start) & (time < start + 0.3)
        time[late] = start + 0.3 + np.arange(late.sum()) * 1e-4
    return np.maximum.accumulate(time)


MENDED = {
    "bunches": (arrivals(0.06), "arrival times, in bursts"),
    "long bunches": (arrivals(0.2), "arrival times, in bursts"),
    "stalls": (stalls(), ""),
    "one decimal": (np.floor(TIME * 10 + 1e-9) / 10, "the clock is coarse"),
    "whole seconds": (np.floor(TIME + 1e-9), "the clock is coarse"),
    "one bad": (np.where(np.arange(len(TIME)) == 400, 9999.0, TIME), "1 bad time, outside the neighbouring times"),
    "a few bad": (np.where(np.isin(np.arange(len(TIME)), [300, 301, 777]), 0.0, TIME), "3 bad times"),
    "the first is bad": (np.where(np.arange(len(TIME)) == 0, 5e5, TIME), "1 bad time"),
    "one missing": (np.where(np.arange(len(TIME)) == 400, np.nan, TIME), "1 time missing, interpolated"),
}  # fmt: skip


@pytest.mark.parametrize("fault", MENDED)
def test_a_clocks_fault_is_mended_and_said(tmp_path: Path, fault: str) -> None:
    time, said = MENDED[fault]
    assert said in right(written(tmp_path / "a.csv", time))


def test_a_counter_that_wraps_is_unwrapped(tmp_path: Path) -> None:
    for bits, tick_s, header in ((32, 1e-6, "t_us"), (16, 1e-3, "t_ms")):
        counts = np.mod(np.rint(TIME / tick_s) + (1 << bits) - 5 / tick_s % (1 << bits), 1 << bits)
        path = written(tmp_path / "a.csv", counts, HEADER.replace("t_s", header), "%.0f")
        assert "the counter wrapped" in right(path)


def test_rows_out_of_order_are_sorted(tmp_path: Path) -> None:
    order = np.arange(len(TIME))
    for at in (100, 340, 600):
        order[[at, at + 1]] = order[[at + 1, at]]
    order[450:453] = [452, 450, 451]
    lines = written(tmp_path / "a.csv", TIME).read_text().split("\n")
    (tmp_path / "b.csv").write_text("\n".join([lines[0], *(lines[1 + at] for at in order)]))
    assert "4 rows out of order" in right(tmp_path / "b.csv")


def test_rows_that_came_twice_are_dropped(tmp_path: Path) -> None:
    lines = written(tmp_path / "a.csv", TIME).read_text().strip().split("\n")
    twice = [line for at, line in enumerate(lines) for _ in range(1 + (at > 0 and at % 40 == 0))]
    again = [*lines[:500], *lines[480:]]
    for name, rows in (("twice", twice), ("again", again)):
        with_times, without = tmp_path / f"{name}.csv", tmp_path / f"{name}_without.csv"
        with_times.write_text("\n".join(rows))
        without.write_text("\n".join(row.split(",", 1)[1] for row in rows))
        assert "including the time" in right(with_times)
        assert "equal to an earlier row in all values" in right(without, Reading(rate_hz=50.0))
        # The advice that used to lead to a wrong scale: times with repeats in them, and a rate beside them.
        right(with_times, Reading(rate_hz=50.0))


def test_equal_readings_of_a_coarse_sensor_are_no_repeats(tmp_path: Path) -> None:
    coarse = np.rint(GYRO * 16.4)
    path = tmp_path / "counts.csv"
    path.write_text("\n".join(["gx,gy,gz", *table([coarse], ",", "%.0f")]))
    recording = load(path, reading=Reading(rate_hz=50.0, gyro_sensitivity=16.4))
    assert len(recording) == len(GYRO)


def test_a_reboot_splits_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", np.concatenate([TIME[:400], TIME[: len(TIME) - 400]]))
    said = refusal(path)
    assert "the rebooted device" in said
    assert "choose one with --boot: 1 (400 samples), 2" in said
    assert "--rate-hz" not in said
    assert len(load(path, boot=1)) == 400
    assert len(load(path, boot=2)) == len(TIME) - 400
    assert "the rebooted device" in refusal(path, Reading(rate_hz=50.0))
    for boot in (0, 3):
        assert f"the rebooted device has no boot {boot}" in refusal(path, Reading(boot=boot))


def test_times_that_lost_their_digits_ask_for_the_rate(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", 1.73234e9 + TIME, form="%.5e")
    assert "the times are rounded" in refusal(path)
    assert "the times are replaced by the given rate" in right(path, Reading(rate_hz=50.0))


def test_times_of_arrival_with_samples_missing_are_refused(tmp_path: Path) -> None:
    time = arrivals(0.06)
    kept = np.ones(len(time), bool)
    kept[500:560] = False
    rows = written(tmp_path / "a.csv", time).read_text().split("\n")
    (tmp_path / "b.csv").write_text(
        "\n".join([rows[0], *(row for row, keep in zip(rows[1:], kept, strict=False) if keep)])
    )
    assert "arrival times, and samples are missing" in refusal(tmp_path / "b.csv")


def test_times_that_go_back_again_and_again_are_refused(tmp_path: Path) -> None:
    said = refusal(written(tmp_path / "a.csv", np.random.default_rng(0).uniform(0, 100, len(TIME))))
    assert "below the previous time" in said
    assert "--rate-hz" not in said


def test_gaps_of_a_device_that_lost_samples_stay(tmp_path: Path) -> None:
    kept = np.ones(len(TIME), bool)
    kept[50:80] = kept[200:210] = False
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEADER, *table([TIME[kept], GYRO[kept], ACCEL[kept]])]))
    recording = load(path)
    assert np.allclose(recording.time_s, TIME[kept])
    assert recording.sequence[-1] == len(TIME) - 1
    assert np.allclose(load(path, rate_hz=50.0).time_s, TIME[kept])


def test_a_packet_counter_shows_what_is_missing(tmp_path: Path) -> None:
    kept = np.ones(len(TIME), bool)
    kept[100:130] = False
    counter = np.mod(np.arange(len(TIME)) + 65_000, 65_536)[kept].astype(float)
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["PacketCounter,gx_dps,gy_dps,gz_dps", *table([counter, GYRO[kept]])]))
    recording = load(path, rate_hz=50.0)
    assert np.allclose(recording.time_s, TIME[kept])
    assert "30 samples missing, by the counter" in recording.notes


ROWS: dict[str, Callable[[list[str]], list[str]]] = {
    "cut last line": lambda rows: [*rows[:-1], rows[-1][:20]],
    "header again": lambda rows: [*rows[:400], rows[0], *rows[400:]],
    "NUL tail": lambda rows: [*rows, "\0" * 3000],
    "comments": lambda rows: ["# device: mine", "# rate: 50 Hz", *rows[:99], "# a mark", *rows[99:]],
    "sep=": lambda rows: ["sep=,", *rows],
    "comma at the end": lambda rows: [f"{row}," for row in rows],
    "comma at the end of the samples": lambda rows: [rows[0], *(f"{row}," for row in rows[1:])],
    "no accelerometer in two of three": lambda rows: [rows[0], *(",".join([*row.split(",")[:4], "", "", ""]) if at % 3 else row for at, row in enumerate(rows[1:]))],
    "a few NaN": lambda rows: [rows[0], *(",".join([row.split(",")[0], "nan", *row.split(",")[2:]]) if at % 300 == 299 else row for at, row in enumerate(rows[1:]))],
    "blank lines": lambda rows: [row for line in rows for row in (line, "")],
    "torn lines": lambda rows: [*rows[:300], rows[300][:25], *rows[301:450], rows[450] + rows[451], *rows[452:]],
}  # fmt: skip


@pytest.mark.parametrize("fault", ROWS)
def test_rows_that_are_no_samples_are_left_out(tmp_path: Path, fault: str) -> None:
    rows = written(tmp_path / "a.csv", TIME).read_text().strip().split("\n")
    path = tmp_path / "b.csv"
    path.write_text("\n".join(ROWS[fault](rows)))
    said = right(path)
    assert "left out" in said or fault in {
        "NUL tail",
        "sep=",
        "comma at the end",
        "comma at the end of the samples",
        "blank lines",
        "no accelerometer in two of three",
    }
    accel = load(path).accel
    assert accel is not None


PLAUSIBLE = {
    "m/s² called g": (1.0, 9.80665, "--accel-unit m/s2", Reading(accel_unit="m/s2")),
    "mg called g": (1.0, 1000.0, "--accel-unit mg", Reading(accel_unit="mg")),
    "counts called g": (1.0, 2048.0, "--accel-sensitivity", Reading(accel_sensitivity=2048.0)),
}


@pytest.mark.parametrize("case", PLAUSIBLE)
def test_an_accelerometer_in_another_unit_is_left_out_and_the_advice_is_right(tmp_path: Path, case: str) -> None:
    _, factor, advice, reading = PLAUSIBLE[case]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEADER, *table([TIME, GYRO, ACCEL * factor])]))
    assert advice in right(path)
    assert load(path).accel is None
    right(path, reading)
    assert load(path, reading=reading).accel is not None


def test_rates_in_another_unit_are_doubted_both_ways(tmp_path: Path) -> None:
    rest = np.radians(np.random.default_rng(3).normal(BIAS_DPS, 0.04, (2000, 3)))
    for factor, name, advice in ((1.0, "dps", "--gyro-unit rad/s"), (np.degrees(1), "rad_s", "--gyro-unit deg/s")):
        path = tmp_path / f"{name}.csv"
        header = f"t_s,gx_{name},gy_{name},gz_{name}"
        path.write_text("\n".join([header, *table([np.arange(2000) / 50, rest * factor], form="%.9f")]))
        assert advice in "; ".join(load(path).notes)
        assert not load(path, reading=Reading(gyro_unit=advice.split()[-1])).notes[1:]


def test_a_device_that_corrects_itself_and_a_dead_axis_are_said(tmp_path: Path) -> None:
    still = (np.abs(GYRO - BIAS_DPS) < 0.5).all(axis=1)
    path = written(tmp_path / "a.csv", TIME, gyro=np.where(still[:, None], 0.0, GYRO))
    assert "exactly zero on all axes" in "; ".join(load(path).notes)
    dead = GYRO.copy()
    dead[:, 0] = 0.8
    path = written(tmp_path / "b.csv", TIME, gyro=dead)
    assert "x of the gyro never changes" in "; ".join(load(path).notes)


def test_a_clock_of_two_readings_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "session.csv", np.array([0.0, 0.0, 0.0, 0.02, 0.02]), gyro=GYRO[:5])
    assert "2 different times in 5 rows" in refusal(path)
