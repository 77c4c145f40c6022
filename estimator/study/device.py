"""Simulated sensors of Wang et al. 2024: truth from the paper's turntable results, noise from configs/devices."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic

import numpy as np
from msgspec import Struct

from bridge.recording import Recording
from bridge.sim.imu_errors import ImuErrorModel, ImuSpec, Truth
from bridge.sim.motion import Motion, Piece
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, flat, session
from bridge.toml.loader import load
from bridge.toml.shipped import file_of
from estimator.noise.device_model import load_model
from estimator.study.study import FOLDERS, Floats, S

Axes = tuple[float, float, float]
_ROOM_C = 22.0
_USUAL_ACCEL_NOISE = 0.02


class PaperColumn(Struct, frozen=True, forbid_unknown_fields=True):
    """Result of one method in tables 2 and 3 of Wang et al. 2024: scale factors k (no unit), b (°/s) and duration (s).

    The paper's b is minus the bias.
    """

    k: Axes
    b_dps: Axes
    time_s: float


class _File(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    label: str
    model: str
    rate_hz: float
    range_dps: float
    paper: dict[str, PaperColumn]


class Device(Struct, frozen=True, kw_only=True):
    """Simulated sensor: sample rate, noise, and true scale factors and bias.

    name, label: short name, and title in figures. rate_hz: sample rate, Hz. spec: noise model.
    zero_g: ± limit of the accelerometer's offset, m/s².
    paper: the paper's results by method; those of `turntable` are the truth of the simulation.
    """

    name: str
    label: str
    rate_hz: float
    spec: ImuSpec
    zero_g: float
    paper: dict[str, PaperColumn]

    @property
    def k(self) -> Floats:
        """True scale factors (3,), no unit."""
        return np.array(self.paper["turntable"].k)

    @property
    def b_dps(self) -> Floats:
        """True bias (3,) with the paper's sign, °/s: the paper's b is minus the reading at rest."""
        return np.array(self.paper["turntable"].b_dps)


def load_device(name: str) -> Device:
    """Load a sensor of configs/study/sensors by name, or from a .toml file.

    Raises ConfigError if the sensor is unknown or its file invalid.
    """
    file = load(file_of(name, "sensor", [folder / "sensors" for folder in FOLDERS]), _File)
    model = load_model(file.model)
    white = (file.rate_hz / 2) ** 0.5
    return Device(
        name=Path(name).stem,
        label=file.label,
        rate_hz=file.rate_hz,
        spec=ImuSpec(
            noise_dps=float(np.degrees(model.arw.max())) * white,
            rrw_dps_per_sqrt_s=float(np.degrees(model.rrw.max())),
            bias_instability_dps=float(np.degrees(model.bias_instability.max())),
            range_dps=file.range_dps,
            step_dps=float(np.degrees(model.step.max())),
            accel_noise=_USUAL_ACCEL_NOISE if model.accel_noise is None else model.accel_noise * white,
            temperature_c=(_ROOM_C, _ROOM_C),
        ),
        zero_g=model.zero_g or 0.0,
        paper=file.paper,
    )


class WithSensors(Struct, Generic[S], frozen=True):
    """Scenario together with the files of its sensors: everything that its sessions depend on."""

    scenario: S
    devices: dict[str, Device]


class Hand(Struct, frozen=True, forbid_unknown_fields=True):
    """Motion of a calibration by hand: lengths of rests and turns (s), and the hand's errors (degrees).

    rest_s: length of a rest. turn_s: shortest and longest turn, s.
    wobble_deg, tilt_deg, replacement_deg: wobble during a turn, tilt of its axis, and attitude error at its end.
    """

    rest_s: float
    turn_s: tuple[float, float]
    wobble_deg: float
    tilt_deg: float
    replacement_deg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Motion of the paper's session as pieces: rest, turn about x, rest, turn about y, rest, turn about z, rest.

        Each turn is −360° about the positive axis. Lengths, wobble, tilt and re-placement error are those of the fields.
        """
        turns = tuple(TurnPlan(axis, -360.0) for axis in range(3))
        plan = SessionPlan(self.rest_s, turns, self.turn_s, self.wobble_deg, self.tilt_deg, self.replacement_deg)
        return session(rng, plan)


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """Simulated recording, with its true rates (n, 3), rad/s, and the ends (m,) of the pieces of motion.

    ends_s: s since the start of the recording.
    """

    recording: Recording
    rate: Floats
    ends_s: Floats

    def until(self, time_s: float, *, accel: bool = False) -> Recording:
        """First part of the recording, up to `time_s` seconds after its start, with or without the accelerometer."""
        r = self.recording
        n = int(np.searchsorted(r.time_s, time_s + 1e-9))
        return Recording(
            r.time_s[:n], r.gyro[:n], r.accel[:n] if accel and r.accel is not None else None, None, r.rate_hz, r.name,
            gyro_range=r.gyro_range,
        )  # fmt: skip


def record(
    device: Device, pieces: Sequence[Piece], rng: np.random.Generator, *, zero_g: float | None = None
) -> Recorded:
    """Simulate a recording of one boot of the device, moved by the pieces of motion.

    rng: source of all random numbers.
    zero_g: ± limit of the accelerometer's offset, m/s²; None for the device's own limit.
    """
    ends_s = np.cumsum([piece.duration_s for piece in pieces])
    time_s = np.arange(1, int(ends_s[-1] * device.rate_hz) + 1) / device.rate_hz
    motion = Motion(pieces, flat(rng)).advance(time_s)
    none = np.zeros(3)
    offset = device.zero_g if zero_g is None else zero_g
    truth = Truth(
        matrix=np.diag(device.k),
        turn_on_bias=-np.radians(device.b_dps),
        bias_per_kelvin=none,
        accel_bias=rng.uniform(-offset, offset, 3),
        accel_scale=np.ones(3),
        bias_per_kelvin2=none,
        g_sensitivity=np.zeros((3, 3)),
    )
    read = ImuErrorModel(device.spec, rng, truth).read(motion)
    limit = np.radians(device.spec.range_dps)
    made = Recording(time_s, read.gyro, read.accel, None, device.rate_hz, device.name, gyro_range=float(limit))
    return Recorded(made, motion.rate, ends_s)
