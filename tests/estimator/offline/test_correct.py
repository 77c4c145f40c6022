"""A recording corrected as the service corrects a stream: against the truth, against the live path, and however it is cut."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.drivers.replayed import Playback, ReplaySegment
from bridge.ingest.intake import Intake
from bridge.recording import Recording, RecordingError, load
from bridge.sim.imu_errors import DEMO_SPEC, ImuSpec
from bridge.sim.motion import Piece, Still
from bridge.sim.motion_scripts import SessionPlan, swing
from bridge.wire.messages import Quality, Verdict
from estimator.config.device_settings import knobs_of
from estimator.device.session import DeviceSession
from estimator.noise.device_model import GENERIC, load_model
from estimator.offline.corrected_recording import CorrectedRecording
from estimator.offline.recordings import calibrate, correct
from tests.estimator.stream import NAME, Stream, calibration, feed, rates, stream

Floats = NDArray[np.float64]
COLUMNS = ("time_s", "rate", "rate_std", "bias", "bias_std", "quality", "matrix")
README = Path(__file__).parents[3] / "README.md"


def pieces(seed: int, bursts: int) -> list[Piece]:
    rng = np.random.default_rng(seed)
    return [p for _ in range(bursts) for p in (swing(rng, 3.0, np.radians(100.0)), Still(4.0))]


def recorded(of: Stream) -> Recording:
    return replace(of.recording(), temperature_c=of.temperature_c, time_s=of.time - of.time[0])


def same(one: CorrectedRecording, other: CorrectedRecording) -> bool:
    return (one.calibration, one.events, one.said) == (other.calibration, other.events, other.said) and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in COLUMNS
    )


def rms(of: Floats) -> float:
    return float(np.sqrt(np.mean(of**2)))


@pytest.fixture(scope="module")
def day() -> Stream:
    """Calibrated within 30 s, then worn for two minutes."""
    return calibration(seed=1, after=pieces(1, 18), spec=replace(DEMO_SPEC, accel_bias=0.0))


@pytest.fixture(scope="module")
def corrected(day: Stream) -> CorrectedRecording:
    return correct(recorded(day))


@pytest.fixture(scope="module")
def worn() -> Stream:
    """Worn from the first second on, without any turn for a calibration."""
    after = pieces(2, 6)
    return stream([Still(1.0), *after], 43.0, seed=3, spec=ImuSpec(bias_limit_dps=2.0, noise_dps=0.05))


# ---- row for row, as live -----------------------------------------------------------------------------------------


def test_against_the_truth(day: Stream, corrected: CorrectedRecording) -> None:
    assert len(corrected) == len(day)
    good = corrected.quality == Quality.GOOD
    assert good[corrected.time_s > 32.0].all()
    assert not good[corrected.time_s < 20.0].any()
    np.testing.assert_allclose(np.diag(corrected.matrix), day.truth.k, atol=3e-4)
    error, bias_error = (corrected.rate - day.rate)[good], (corrected.bias - day.bias)[good]
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.06
    assert 0.3 < rms(error / corrected.rate_std[good]) < 1.5, "the deviation is that of the error"
    # Timid: how the bias follows temperature is not known beforehand, and rests of four seconds tell it slowly.
    assert 0.1 < rms(bias_error / corrected.bias_std[good]) < 1.5


def test_at_an_even_temperature_the_deviation_of_the_bias_is_that_of_its_error() -> None:
    even = replace(DEMO_SPEC, accel_bias=0.0, temperature_c=(30.0, 30.0))
    day = calibration(seed=1, after=pieces(1, 18), spec=even)
    found = correct(recorded(day))
    good = found.quality == Quality.GOOD
    assert 0.5 < rms((found.bias - day.bias)[good] / found.bias_std[good]) < 1.5


@pytest.mark.parametrize("batch", [None, 1])
def test_after_a_silence_the_bias_is_as_uncertain_as_it_is_long_from_the_first_sample_on(
    worn: Stream, batch: int | None
) -> None:
    of, silence_s = recorded(worn), 6 * 3600.0
    at = worn.at(30.3)
    time = of.time_s + silence_s * (np.arange(len(of)) >= at)
    found = correct(replace(of, time_s=time), batch=batch, warmed_up=True)
    before, first, later = found.bias_std[at - 1], found.bias_std[at], found.bias_std[at + 300]
    walked = knobs_of(load_model(GENERIC)).track.bias.rate_random_walk * np.sqrt(silence_s)
    assert (before < 0.9 * walked).all()
    assert (first > walked).all()
    assert (first < 1.1 * later).all(), "and no more uncertain than seconds later"


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e39])
def test_a_recording_with_a_sample_that_is_no_number_is_refused(day: Stream, odd: float) -> None:
    of = recorded(day)
    gyro = of.gyro.copy()
    gyro[500, 1] = odd
    with pytest.raises(RecordingError, match="sample 500 is not a finite number"):
        correct(replace(of, gyro=gyro))


@pytest.mark.parametrize("ranged", [False, True])
def test_a_replay_through_the_bridge_gives_the_same_bits(day: Stream, ranged: bool) -> None:
    """Playback, the bridge's door, and the session as the service feeds it."""
    kept = np.delete(np.arange(len(day)), slice(day.at(60.0), day.at(61.0)))
    of = recorded(day.only(kept))
    # The fastest turn just reaches what counts as clipped.
    gyro_range = float(np.abs(day.gyro[: day.at(30.0)]).max()) / 0.995 if ranged else 0.0
    playback = Playback([ReplaySegment.of_recording(of, 1, gyro_range)], 1.0)
    intake = Intake(NAME, "bridge", "replayed", "file")
    batches = []
    for _, until in pairwise(np.arange(0.0, of.time_s[-1] + 1.0, 0.5)):
        for event in playback.due(until, int(until * 1e9) + 1):
            batches += intake.take(event)
    live = feed(DeviceSession(NAME, knobs_of(load_model(GENERIC))), batches).corrected
    found = correct(of, gyro_range=gyro_range)
    np.testing.assert_array_equal(found.rate, rates(live))
    np.testing.assert_array_equal(found.quality, np.concatenate([np.full(len(b), b.quality) for b in live]))
    np.testing.assert_allclose(found.rate_std, np.concatenate([b.rate_std for b in live]), rtol=1e-6)
    assert found.events["missing_samples"] == len(day) - len(kept)
    if ranged:
        assert not (found.quality == Quality.GOOD).any(), "a clipped turn does not count"
        assert any("too fast for the gyro's range" in words for words in found.said)


# ---- what `calibrate` takes ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def prompt() -> Recording:
    """Three seconds of rest, then the first turn: live, a device just switched on would still warm up in that rest."""
    return recorded(calibration(seed=1, before_s=0.0, after=pieces(1, 3), plan=SessionPlan(rests_s=3.0)))


def agree(found: CorrectedRecording, of: Recording) -> None:
    result, _ = calibrate(of)
    assert result.verdict is Verdict.ACCEPTED
    assert found.calibration == of.name
    k_std = np.sqrt(np.diag(result.covariance)[3:6])
    assert (np.abs(np.diag(found.matrix - result.matrix)) < 0.2 * k_std).all(), "but for a window of the first rest"


def test_turns_that_calibrate_are_not_lost_to_warming_up(prompt: Recording) -> None:
    found = correct(prompt)
    agree(found, prompt)
    assert found.quality[-1] == Quality.GOOD
    assert found.said[0].startswith("the device is assumed to have been on before the recording began")
    been_on = correct(prompt, knobs=replace(knobs_of(load_model(GENERIC)), warming_s=0.0))
    assert same(replace(found, said=found.said[1:]), been_on), "to the bit as of one that has not to warm up"


# ---- a calibration that was made before ---------------------------------------------------------------------------


def test_a_calibration_of_the_same_boot_is_used_at_once_and_its_bias_doubted_until_a_rest(day: Stream) -> None:
    result, _ = calibrate(recorded(day))
    found = correct(recorded(day.part(day.at(40.0), len(day))), result)
    assert found.quality[0] == Quality.DEGRADED
    assert found.quality[-1] == Quality.GOOD
    assert found.bias_std[0].min() >= np.radians(0.2)
    np.testing.assert_array_equal(found.matrix, result.matrix)
    np.testing.assert_allclose(found.bias[0], result.bias, atol=1e-6)


def test_of_another_boot_the_scale_is_a_prior_and_the_bias_forgotten(worn: Stream, day: Stream) -> None:
    result, _ = calibrate(recorded(day))
    found = correct(recorded(worn), result, other_boot=True)
    assert found.quality[0] == Quality.PRIOR
    assert found.quality.max() == Quality.BIAS_ONLY
    assert found.bias_std[0].min() > np.radians(1.0)
    moving = np.abs(found.rate).argmax()
    assert found.rate_std.flat[moving] > 0.019 * abs(found.rate.flat[moving]), "the scale moves between boots"
    np.testing.assert_array_equal(found.matrix, result.matrix)


def test_of_another_range_it_is_no_more_than_another_boots(day: Stream, worn: Stream) -> None:
    from estimator.offline.calibration_file import of_result

    of, narrow = recorded(worn), float(np.radians(500))
    known = of_result(calibrate(recorded(day))[0], recorded(day), gyro_range=float(np.radians(2000)))
    found = correct(of, known, gyro_range=narrow)
    assert found.quality[0] == Quality.PRIOR
    assert "a range of 2000 °/s, but chest has 500 °/s" in found.said[0]
    assert correct(of, known).quality[0] != Quality.PRIOR, "a range that is not known is no other"
    assert correct(replace(of, gyro_range=narrow), known).quality[0] == Quality.PRIOR


def test_of_a_boot_that_is_known_to_be_another_it_is_no_more_than_that_and_of_another_device_nothing(
    day: Stream, worn: Stream
) -> None:
    from estimator.offline.calibration_file import of_result

    known = of_result(calibrate(recorded(day))[0], replace(recorded(day), device="chest", boot=1))
    of = replace(recorded(worn), device="chest", boot=1)
    assert correct(of, known).quality[0] > Quality.PRIOR
    assert correct(replace(of, boot=0), known).quality[0] > Quality.PRIOR, "a boot that is not known is no other"
    found = correct(replace(of, boot=2), known)
    assert found.quality[0] == Quality.PRIOR
    assert "of boot 0000000000000001, but recording chest is of boot 0000000000000002" in found.said[0]
    assert same(replace(found, said=found.said[1:]), correct(of, known, other_boot=True))
    with pytest.raises(RecordingError, match="is of chest, but recording chest is of wrist"):
        correct(replace(of, device="wrist"), known, other_boot=True)


def test_what_was_not_accepted_corrects_nothing(day: Stream) -> None:
    result, _ = calibrate(recorded(day.part(0, day.at(6.0))))
    assert result.verdict is not Verdict.ACCEPTED
    with pytest.raises(ValueError, match="REPEAT"):
        correct(recorded(day), result)


# ---- smoothed -----------------------------------------------------------------------------------------------------


def test_smoothed_the_calibration_holds_for_all_of_the_boot(day: Stream) -> None:
    found = correct(recorded(day), smooth=True)
    assert found.smoothed
    assert (found.quality == Quality.GOOD).all(), "before the turns too"
    error = found.rate - day.rate
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.06
    assert 0.5 < rms(error / found.rate_std) < 1.5
    assert 0.1 < rms((found.bias - day.bias) / found.bias_std) < 1.5


# ---- as a library, and on real recordings -------------------------------------------------------------------------


def test_the_example_of_the_readme_runs(
    day: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    section = README.read_text(encoding="utf-8").split("## Calibrate a device")[1].split("\n## ")[0]
    code = section.split("```python\n")[1].split("```")[0]
    for name, of in (("session", day.part(0, day.at(32.0))), ("day", day.part(day.at(32.0), len(day)))):
        np.savez(tmp_path / f"{name}.npz", gyro_rad_s=of.gyro, accel_m_s2=of.accel, t_s=of.time)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(README), "exec"), {})
    printed = capsys.readouterr().out
    assert printed.startswith("ACCEPTED The closure error of the three turns is ")
    assert 70 <= int(printed.split("% good")[0].rsplit("\n", 1)[-1]) <= 100


@pytest.mark.data
def test_a_real_session_is_calibrated_within_and_used_from_there_on(shared_data: Path) -> None:
    found = correct(load(shared_data / "imucal" / "ferraris_session.npz"))
    np.testing.assert_allclose(np.diag(found.matrix), [0.9728, 1.0179, 1.0018], atol=2e-3)
    assert found.calibration == "ferraris_session"
    assert found.quality[-1] == Quality.GOOD


@pytest.mark.data
def test_a_real_bias_is_tracked_through_rests(shared_data: Path) -> None:
    """BROAD, slow rotations with breaks: what the tracker says after the last rest is that rest's mean."""
    path = shared_data / "broad" / "04_undisturbed_slow_rotation_with_breaks_A.npz"
    moving = np.load(path)["moving"]
    of = load(path)
    found = correct(of)
    rest = of.gyro[np.flatnonzero(moving)[-1] + round(of.rate_hz) :]
    assert (found.quality[-1]) == Quality.BIAS_ONLY
    np.testing.assert_allclose(np.degrees(found.bias[-1]), np.degrees(rest.mean(axis=0)), atol=0.01)
