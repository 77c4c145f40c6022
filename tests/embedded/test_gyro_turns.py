"""The C version of Algorithm 1: against the Python method, under sanitizers, and on an emulated Cortex-M3 with 20 KB of RAM."""

import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.framing.cobs_frames import Deframer, frame
from bridge.framing.packets import decode, encode_own
from bridge.recording import load
from bridge.recording.recording import Recording
from bridge.sim.calibration_session import simulate_session
from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import DeviceCalibration
from estimator.device.own_calibration import BIAS_STD, SCALE_STD
from estimator.offline.recordings import calibrate
from tests.embedded.host_program import (
    BOOT,
    OK,
    SENSITIVITY,
    SEQUENCE,
    SOURCE,
    STILL_STD,
    STRICT,
    Counts,
    Found,
    counted,
    run,
)

NO_REST, MISSING_TURN, CLIPPED, TOO_LONG, SAME_AXIS, NOT_ONE_TURN, IMPLAUSIBLE, BAD_SETTING = (
    -1,
    -2,
    -3,
    -4,
    -5,
    -6,
    -8,
    -9,
)

needs_arm = pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="needs gcc-arm-none-eabi and qemu-system-arm (Debian)",
)


def session(seed: int, turns: tuple[TurnPlan, ...] | None = None, rests_s: float = 3.2) -> tuple[Counts, float]:
    made = simulate_session(seed, noise_dps=0.05, wobble_deg=2.0, replacement_deg=0.2, turns=turns, rests_s=rests_s)
    return counted(made.gyro), made.rate_hz


def in_python(counts: Counts, rate_hz: float, sensitivity: float = SENSITIVITY) -> Found:
    recording = Recording(
        np.arange(len(counts)) / rate_hz, np.asarray(counts * sensitivity, float), None, None, rate_hz, "session"
    )
    result, _ = calibrate(recording, "turn360")
    assert result.scale is not None
    assert result.bias is not None
    return Found(OK, result.scale, result.bias)


@pytest.mark.parametrize("part", range(4))
def test_it_agrees_with_the_python_method(program: Path, part: int) -> None:
    """A hundred sessions in four parts."""
    for seed in range(25 * part, 25 * part + 25):
        counts, rate_hz = session(seed)
        found, expected = run(program, counts, rate_hz), in_python(counts, rate_hz)
        assert found.status == OK
        np.testing.assert_allclose(found.k, expected.k, atol=1e-4)
        np.testing.assert_allclose(found.bias, expected.bias, atol=np.radians(1e-3))


def test_its_packet_is_the_native_protocol_s(program: Path) -> None:
    """Byte for byte as the bridge would write it."""
    for seed in range(20):
        found = run(program, *session(seed))
        own = DeviceCalibration(BOOT, SEQUENCE, tuple(found.k.tolist()), tuple(found.bias.tolist()))
        assert found.packet == frame(encode_own(own))
        [payload] = Deframer().feed(found.packet)
        got = decode(payload)
        assert isinstance(got, DeviceCalibration)
        assert (got.boot, got.sequence) == (BOOT, SEQUENCE)
        assert np.array_equal([*got.scale, *got.bias], np.array([*found.k, *found.bias], np.float32))


@pytest.mark.parametrize(("wobble_deg", "replacement_deg", "noise_dps"), [(2.0, 0.2, 0.05), (5.0, 1.0, 0.1)])
def test_the_estimator_s_uncertainty_of_it_holds(
    program: Path, wobble_deg: float, replacement_deg: float, noise_dps: float
) -> None:
    """A careful and a careless hand, 100 sessions each, against the simulator's truth: no error exceeds what is assumed."""
    k_errors, bias_errors = [], []
    for seed in range(100):
        made = simulate_session(
            seed, noise_dps=noise_dps, wobble_deg=wobble_deg, replacement_deg=replacement_deg, rests_s=3.2
        )
        found = run(program, counted(made.gyro), made.rate_hz)
        assert found.status == OK
        k_errors.append(found.k - made.truth.k)
        bias_errors.append(found.bias - made.bias[0])
    assert np.sqrt(np.square(k_errors).mean()) < SCALE_STD
    assert np.abs(k_errors).max() < 3 * SCALE_STD
    assert np.sqrt(np.square(bias_errors).mean()) < BIAS_STD
    assert np.abs(bias_errors).max() < 3 * BIAS_STD


@pytest.mark.data
def test_it_agrees_on_a_real_session(program: Path, shared_data: Path) -> None:
    """Movements between poses before the turns are passed over."""
    real = load(shared_data / "imucal" / "ferraris_session.npz")
    sensitivity = float(np.float32(np.radians(0.061)))
    counts = counted(real.gyro, sensitivity)
    result, _ = calibrate(replace(real, gyro=np.asarray(counts * sensitivity, float)), "turn360")
    found = run(program, counts, real.rate_hz, sensitivity)
    assert found.status == OK
    np.testing.assert_allclose(found.k, result.scale, atol=1e-4)
    np.testing.assert_allclose(found.bias, result.bias, atol=np.radians(1e-3))


def faulty(kind: str) -> tuple[Counts, float]:
    counts, rate_hz = session(1)
    x, y, z = (TurnPlan(axis, 360.0) for axis in range(3))
    match kind:
        case "no rest":
            return np.round(2000 * np.sin(np.arange(2000)[:, None] * [0.11, 0.13, 0.17])).astype(np.int64), rate_hz
        case "two turns":
            return session(1, (x, y))
        case "same axis":
            return session(1, (x, y, x))
        case "two revolutions":
            return session(1, (x, TurnPlan(1, 720.0), z))
        case "short turn":
            return session(1, (x, TurnPlan(1, 255.0), z))
        case "clipped":
            return np.where(np.abs(counts) > 0.8 * np.abs(counts).max(), np.sign(counts) * 32767, counts), rate_hz
        case "too long":
            moving = np.tile(np.round(3000 * np.sin(np.arange(2000) * 0.05)).astype(np.int64)[:, None], (2, 3))
            return np.vstack([counts[:330], moving]), rate_hz
    raise ValueError(kind)


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        ("no rest", NO_REST),
        ("two turns", MISSING_TURN),
        ("same axis", SAME_AXIS),
        ("two revolutions", NOT_ONE_TURN),
        ("short turn", IMPLAUSIBLE),
        ("clipped", CLIPPED),
        ("too long", TOO_LONG),
    ],
)
def test_a_fault_gives_an_error_and_no_number(program: Path, kind: str, status: int) -> None:
    found = run(program, *faulty(kind))
    assert found.status == status
    assert not found.k.any()
    assert not found.bias.any()


def test_a_wrong_setting_is_an_error(program: Path) -> None:
    counts, _ = session(1)
    assert run(program, counts, 0.0).status == BAD_SETTING


@needs_arm
def test_it_fits_a_cortex_m3(program: Path, tmp_path: Path) -> None:
    """20 KB of RAM hold data and stack (the linker script says so), and a calibration takes less than a second at 72 MHz."""
    counts, rate_hz = session(4)
    rows = ",\n".join(f"{{{x}, {y}, {z}}}" for x, y, z in counts.tolist())
    (tmp_path / "session.h").write_text(
        f"#include <stdint.h>\n#define SESSION_RATE_HZ {rate_hz}f\n#define SESSION_SENSITIVITY {SENSITIVITY!r}f\n"
        f"#define SESSION_STILL_STD {STILL_STD!r}f\nstatic const int16_t session[][3] = {{\n{rows}}};\n"
    )
    built = tmp_path / "firmware.elf"
    target = [
        "-mcpu=cortex-m3",
        "-mthumb",
        "-O2",
        "-ffreestanding",
        "-nostartfiles",
        "--specs=nano.specs",
        f"-I{tmp_path}",
    ]
    link = [f"-Wl,-T,{SOURCE / 'cortex_m3' / 'link.ld'},--gc-sections"]
    sources = [SOURCE / "gyro_turns.c", SOURCE / "cortex_m3" / "main.c"]
    subprocess.run(["arm-none-eabi-gcc", *STRICT, *target, *link, *sources, "-lm", "-o", built], check=True)
    emulator = ["qemu-system-arm", "-M", "mps2-an385", "-nographic", "-icount", "shift=4"]
    said = subprocess.run(
        [*emulator, "-semihosting-config", "enable=on,target=native", "-kernel", built],
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    status, *numbers, ticks, stack = (said.stdout + said.stderr).split()
    on_host = run(program, counts, rate_hz)
    values = np.array([struct.unpack(">f", bytes.fromhex(number))[0] for number in numbers])
    assert int(status, 16) == on_host.status == OK
    np.testing.assert_allclose(values, [*on_host.k, *on_host.bias], rtol=1e-5)
    instructions = int(ticks, 16) * 40 / 16  # a tick of the emulated clock is 40 ns, an instruction 16 ns
    assert instructions < 72e6
    assert int(stack, 16) < 1536
