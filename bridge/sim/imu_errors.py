"""Error model of a low-cost gyroscope and accelerometer: converts true motion to readings.

    reading = M⁻¹ rate + bias(t) + G force + noise, then clipped to the range and rounded to the step
    M       = diag(k) (I + E)
    bias(t) = turn-on bias + b₁ (T − T₀) + b₂ (T − T₀)² + random walk + flicker

reading, rate, bias: rad/s. k: scale factors, without unit. E: misalignment, rad, with a zero diagonal.
G: g-sensitivity, rad/s per m/s², zero by default. force: specific force, m/s². T: temperature, °C.
T₀: temperature at power-up in the spec. b₁, b₂: temperature coefficients, rad/s/K and rad/s/K².

Scale, misalignment and turn-on bias are drawn once per boot; the bias then drifts and follows the temperature.
Temperature coefficients, g-sensitivity and accelerometer errors belong to the part and are the same at every boot.
"""

from dataclasses import dataclass, replace

import numpy as np

from bridge.sim.motion import GRAVITY, TrueMotion
from bridge.sim.quaternion import Array

_SHORTEST_S, _LONGEST_S, _PER_DECADE = 0.5, 20_000.0, 3
_STRETCH_S = 5.0  # within which the shortest process does not decay below float resolution


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """Error limits of a simulated IMU; values drawn per boot or per part are uniform within their limits.

    scale: lowest and highest scale factor k of each axis. bias_limit_dps: turn-on bias, ± °/s.
    misalignment_deg: each off-diagonal element of E, ± °.
    noise_dps, accel_noise: white noise, standard deviation per sample at the usual output data rate, °/s and m/s².
    accel_bias: ± m/s². accel_scale: largest deviation of an accelerometer scale factor from 1, ±, without unit.
    g_sensitivity_dps_per_g: each element of G, ± °/s per g.
    rrw_dps_per_sqrt_s: rate random walk, °/s/√s.
    bias_instability_dps: B of the flicker noise, °/s; its Allan deviation is 0.664 B.
    bias_dps_per_kelvin, bias_dps_per_kelvin2: temperature coefficients b₁ (°/s/K) and b₂ (°/s/K²) per axis, ±.
    temperature_c: temperature at power-up and when warm, °C. warm_up_s: time constant of the warming, s.
    range_dps: full-scale range of the reading, ± °/s. step_dps: quantisation step of the reading, °/s; 0 for none.
    """

    scale: tuple[float, float] = (0.8, 1.2)
    bias_limit_dps: float = 5.0
    misalignment_deg: float = 0.0
    noise_dps: float = 0.03
    rrw_dps_per_sqrt_s: float = 0.0
    bias_dps_per_kelvin: float = 0.0
    temperature_c: tuple[float, float] = (25.0, 35.0)
    warm_up_s: float = 120.0
    range_dps: float = 2000.0
    step_dps: float = 0.0
    accel_noise: float = 0.02
    accel_bias: float = 0.0
    accel_scale: float = 0.0
    bias_dps_per_kelvin2: float = 0.0
    g_sensitivity_dps_per_g: float = 0.0
    bias_instability_dps: float = 0.0


DEMO_SPEC = ImuSpec(
    rrw_dps_per_sqrt_s=7e-4,
    bias_dps_per_kelvin=0.03,
    warm_up_s=60.0,
    range_dps=500.0,
    step_dps=0.0175,
    accel_bias=0.05,
)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True sensor parameters of one boot, in rate = matrix (reading − bias).

    matrix (3, 3): calibration matrix, without unit; its diagonal is k (3,). `Readings.bias` has the bias per sample.
    turn_on_bias (3,): rad/s, the bias at the temperature T₀ at power-up that the spec states.
    bias_per_kelvin (3,): rad/s/K. bias_per_kelvin2 (3,): rad/s/K². g_sensitivity (3, 3): rad/s per m/s².
    accel_bias (3,): m/s². accel_scale (3,): without unit.
    """

    matrix: Array
    turn_on_bias: Array
    bias_per_kelvin: Array
    accel_bias: Array
    accel_scale: Array
    bias_per_kelvin2: Array
    g_sensitivity: Array

    def of_part(self, part: "Truth") -> "Truth":
        """Return this boot's matrix and turn-on bias, with all other parameters taken from `part`.

        part: truth of an earlier boot of the same device; the parameters taken from it are the same at every boot.
        """
        return replace(part, matrix=self.matrix, turn_on_bias=self.turn_on_bias)

    @property
    def k(self) -> Array:
        """Scale factors (3,) of x, y and z, without unit: the diagonal of the calibration matrix."""
        return np.diag(self.matrix).copy()


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Sensor readings of n samples, in sensor axes: gyro (n, 3) rad/s, accel (n, 3) m/s², temperature_c (n,) °C.

    bias (n, 3): true bias contained in the gyro readings, rad/s.
    """

    gyro: Array
    accel: Array
    temperature_c: Array
    bias: Array


class ImuErrorModel:
    """IMU of one boot: converts true motion to readings with errors, drawn from rng.

    spec: error limits of the sensor. truth: true parameters of the sensor; None draws them from rng.
    """

    def __init__(self, spec: ImuSpec, rng: np.random.Generator, truth: Truth | None = None) -> None:
        self.spec = spec
        self.truth = truth or draw(spec, rng)
        # A separate random stream for the walk makes the readings independent of how the motion is cut.
        self._rng, self._walk_rng = rng.spawn(2)
        # A third stream only where needed, so that existing seeds give the same draws.
        unstable = np.radians(spec.bias_instability_dps)
        self._flicker = Flicker(unstable, rng.spawn(1)[0]) if unstable > 0 else None
        self._inverse = np.linalg.inv(self.truth.matrix)
        self._walk = np.zeros(3)
        self._time_s = 0.0
        self._white = 1.0

    def pace(self, faster: float) -> None:
        """Change the output data rate from the next read on, to `faster` times the usual rate.

        The white noise density stays the same, so the noise per sample grows with the square root of `faster`.
        """
        self._white = float(np.sqrt(faster))

    def read(self, motion: TrueMotion, temperature_c: Array | None = None) -> Readings:
        """Return the readings for samples of true motion, which must follow those of the last call.

        motion: its times are in s since the boot's first sample interval began. temperature_c (n,): sensor temperature;
        None for the warm-up curve of the spec.
        """
        spec, rng, n = self.spec, self._rng, len(motion.time_s)
        if temperature_c is None:
            temperature_c = self.temperature_c(motion.time_s)
        bias = self._bias(motion.time_s, temperature_c)
        noise = self._white * rng.normal(size=(n, 6))
        gyro = motion.rate @ self._inverse.T + bias + np.radians(spec.noise_dps) * noise[:, :3]
        if spec.g_sensitivity_dps_per_g > 0:
            gyro += motion.force @ self.truth.g_sensitivity.T
        limit, step = np.radians(spec.range_dps), np.radians(spec.step_dps)
        gyro = np.clip(gyro, -limit, limit)
        if step > 0:
            gyro = step * np.round(gyro / step)
        accel = motion.force * self.truth.accel_scale + self.truth.accel_bias + spec.accel_noise * noise[:, 3:]
        return Readings(gyro, accel, temperature_c, bias)

    def temperature_c(self, time_s: Array) -> Array:
        """Return the sensor temperature (n,), °C, which approaches the warm temperature exponentially.

        time_s (n,): s since the boot.
        """
        cold, warm = self.spec.temperature_c
        return np.asarray(warm + (cold - warm) * np.exp(-time_s / self.spec.warm_up_s))

    def _bias(self, time_s: Array, temperature_c: Array) -> Array:
        truth = self.truth
        warmer = (temperature_c - self.spec.temperature_c[0])[:, None]
        bias = truth.turn_on_bias + warmer * (truth.bias_per_kelvin + warmer * truth.bias_per_kelvin2)
        if self.spec.rrw_dps_per_sqrt_s > 0:
            dt = np.diff(time_s, prepend=self._time_s)[:, None]
            steps = np.sqrt(dt) * self._walk_rng.normal(size=(len(time_s), 3))
            walk = self._walk + np.radians(self.spec.rrw_dps_per_sqrt_s) * np.cumsum(steps, axis=0)
            self._walk = walk[-1]
            bias = bias + walk
        if self._flicker is not None:
            bias = bias + self._flicker.at(time_s)
        self._time_s = float(time_s[-1])
        return bias


def draw(spec: ImuSpec, rng: np.random.Generator) -> Truth:
    """Draw the true sensor parameters of a device at its first boot, uniform within the limits of `spec`.

    For later boots, `Truth.of_part` keeps the parameters that belong to the part.
    """

    def within(limit: float, shape: int | tuple[int, int] = 3) -> Array:
        return rng.uniform(-limit, limit, shape)

    def some(limit: float, shape: int | tuple[int, int] = 3) -> Array:
        # Errors that a device does not have draw nothing, so that existing seeds give the same draws.
        return within(limit, shape) if limit > 0 else np.zeros(shape)

    k = rng.uniform(*spec.scale, 3)
    across = np.radians(within(spec.misalignment_deg, (3, 3))) * (1 - np.eye(3))
    return Truth(
        matrix=k[:, None] * (np.eye(3) + across),
        turn_on_bias=np.radians(within(spec.bias_limit_dps)),
        bias_per_kelvin=np.radians(within(spec.bias_dps_per_kelvin)),
        accel_bias=within(spec.accel_bias),
        accel_scale=1 + some(spec.accel_scale),
        bias_per_kelvin2=np.radians(some(spec.bias_dps_per_kelvin2)),
        g_sensitivity=np.radians(some(spec.g_sensitivity_dps_per_g, (3, 3))) / GRAVITY,
    )


class Flicker:
    """Flicker noise (1/f) on three axes: a sum of first-order Gauss-Markov processes, drawn from rng.

    instability: bias instability B, in the unit of the noise. The correlation times are 0.5 s to 20000 s, three per
    decade. Call `at` with rising times, in batches of any size.
    """

    def __init__(self, instability: float, rng: np.random.Generator) -> None:
        n = round(np.log10(_LONGEST_S / _SHORTEST_S) * _PER_DECADE) + 1
        self._tau_s = np.geomspace(_SHORTEST_S, _LONGEST_S, n)[:, None]
        ratio = self._tau_s[1, 0] / self._tau_s[0, 0]
        self._std = instability * np.sqrt(np.log(ratio) / np.pi)
        self._rng = rng
        self._state = self._std * rng.normal(size=(n, 3))
        self._time_s = 0.0

    def at(self, time_s: Array) -> Array:
        """Return the flicker noise (n, 3), in the unit of the instability.

        time_s (n,): s, above zero, rising, and later than those of all calls before.
        """
        parts, begin = [], 0
        while begin < len(time_s):
            end = int(np.searchsorted(time_s, max(self._time_s, time_s[begin]) + _STRETCH_S, side="right"))
            parts.append(self._stretch(time_s[begin:end]))
            begin = end
        return np.concatenate(parts)

    def _stretch(self, time_s: Array) -> Array:
        dt = np.diff(time_s, prepend=self._time_s)
        if dt[0] > _STRETCH_S:  # a gap, whose values need not be drawn
            self._step(float(dt[0]), self._rng.normal(size=self._state.shape))
            dt[0] = 0.0
        fresh = self._rng.normal(size=(len(dt), *self._state.shape))
        kept = np.exp(-dt / self._tau_s)  # (tau, n)
        # x[i] = kept[i] x[i-1] + new[i], solved at once: x[i] / all_kept[i] is a cumulative sum.
        all_kept = np.exp(-np.cumsum(dt) / self._tau_s)[:, :, None]
        new = (self._std * np.sqrt(1 - kept**2))[:, :, None] * fresh.transpose(1, 0, 2)
        x = all_kept * (self._state[:, None, :] + np.cumsum(new / all_kept, axis=1))
        self._state, self._time_s = x[:, -1, :], float(time_s[-1])
        return np.asarray(x.sum(axis=0))

    def _step(self, dt_s: float, fresh: Array) -> None:
        kept = np.exp(-dt_s / self._tau_s)
        self._state = kept * self._state + self._std * np.sqrt(1 - kept**2) * fresh
