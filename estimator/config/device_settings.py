"""Conversion of a device's noise model to the estimator's settings: rest detection, prior and bias tracking."""

from collections.abc import Mapping
from dataclasses import replace
from math import log, pi, sqrt
from typing import TYPE_CHECKING

from estimator.calibration.bias_wander import WanderKnobs
from estimator.device.session_knobs import SessionKnobs
from estimator.noise.device_model import GENERIC, NoiseModel, load_model, model_stated

if TYPE_CHECKING:
    from estimator.config.schema import Estimator

#: output data rate, Hz, for guessing the noise of a reading before a rest has shown it
_USUAL_HZ = 100.0
#: Allan deviation of bias instability 1 (IEEE Std 952, √(2 ln 2 / π)); averaging time, s, at which a walk reaches it
_FLAT, _WITHOUT_REST_S = 0.664, 1000.0
#: standard deviation of flicker noise of bias instability 1, between periods of _WITHOUT_REST_S and one second, above
#: whose frequency noise hides it: √(ln 1000 / π). IEEE Std 952: its two-sided density is B²/2πf
FLICKER = sqrt(log(_WITHOUT_REST_S) / pi)
#: largest scale error, as a multiple of the model's scale_tolerance; and the least such limit, for the error of a
#: turn by hand, 3.6°. Sheets give limits (MPU-6050: ±3 % as MIN and MAX at 25 °C) or typical values that include
#: temperature (ICM-20948)
_TOLERANCES, _BY_HAND = 2.0, 0.01


def knobs_of(model: NoiseModel, knobs: SessionKnobs | None = None) -> SessionKnobs:
    """Derive the estimator's settings for one device, in SI units, from its noise model; the worst axis decides.

    The bias instability, the flat part of the Allan deviation, enters twice: as a rate random walk and as flicker
    noise.
    knobs: settings that the model does not determine; None for the defaults.
    """
    knobs = knobs or SessionKnobs()
    noise = float(model.arw.max()) * (_USUAL_HZ / 2) ** 0.5
    track = knobs.track
    # The flat of the Allan deviation, as a random walk that reaches it after a usual time without rest.
    instability = float(model.bias_instability.max())
    walk = max(float(model.rrw.max()), _FLAT * instability * (3 / _WITHOUT_REST_S) ** 0.5)
    flicker = FLICKER * instability
    bias = replace(track.bias, rate_random_walk=walk, per_kelvin=model.bias_per_kelvin, flicker=flicker)
    gravity = track.gravity if model.zero_g is None else replace(track.gravity, accel_bias=model.zero_g)
    return replace(
        knobs,
        gyro_range=model.gyro_range,
        wander=WanderKnobs(bias_instability=instability, rate_random_walk=float(model.rrw.max())),
        scale_limit=max(_TOLERANCES * model.scale_tolerance, _BY_HAND),
        prior=replace(knobs.prior, bias_std=model.turn_on_bias, scale_std=model.scale_tolerance, noise_std=noise),
        track=replace(track, bias=bias, gravity=gravity),
    )


def knobs_of_stated(words: str, knobs: SessionKnobs | None = None) -> SessionKnobs:
    """Return the estimator's settings for one device, by the sensor name that the device reports.

    Used for a device whose noise model is not in the ward file.
    words: description reported by the device, such as `Arduino Nano 33 BLE (LSM9DS1)`; empty if unknown. A sensor name
    in it selects the noise model; if no name is recognised, the generic model is used.
    knobs: settings that a noise model does not determine; None for the defaults.
    Full-scale range, scale tolerance and scale limit are always those of the generic model. A sensor name does not
    determine them, and no turn is refused because of a name.
    """
    usual, name = knobs_of(load_model(GENERIC), knobs), model_stated(words)
    if not name:
        return usual
    own = knobs_of(load_model(name), knobs)
    prior = replace(own.prior, scale_std=usual.prior.scale_std)
    return replace(own, gyro_range=usual.gyro_range, scale_limit=usual.scale_limit, prior=prior)


class Treatment:
    """Estimator settings for each device of a ward: by the noise model in the ward file, else by the reported sensor.

    The estimator uses these settings, as do programs whose results must agree with the estimator.
    usual: settings that a noise model does not determine; None for the defaults.
    model: name or file of the noise model for all devices; empty to use the sensor name in each device's description.
    models: name or file of the noise model by device id, for devices that differ.
    """

    def __init__(
        self, usual: SessionKnobs | None = None, model: str = "", models: Mapping[str, str] | None = None
    ) -> None:
        self._usual, self._model, self._models = usual, model, models or {}
        self._made = dict[tuple[str, str], SessionKnobs]()

    def of(self, device: str, words: str = "") -> SessionKnobs:
        """Return the estimator's settings for one device.

        words: description reported by the device, which may name its sensor; empty if unknown.
        """
        told = self.told(device)
        key = (told, "" if told else model_stated(words))
        if key not in self._made:
            self._made[key] = knobs_of(load_model(told), self._usual) if told else knobs_of_stated(words, self._usual)
        return self._made[key]

    def told(self, device: str) -> str:
        """Return the noise model (a name or a file) that the ward file states for a device; empty if it states none."""
        return self._models.get(device, self._model)


def treatment(told: "Estimator | None") -> Treatment:
    """Return the estimator's settings for the devices of a ward, from the [estimator] table of the ward's file.

    told: the table; None for the defaults.
    """
    if told is None:
        return Treatment()
    usual = SessionKnobs(method=told.method, warming_s=told.warming_s, horizontal_turns=told.horizontal_turns)
    return Treatment(learning(usual) if told.learn_matrix else usual, told.model, told.models)


def learning(knobs: SessionKnobs) -> SessionKnobs:
    """Return a copy of the settings with `learn_matrix` on: gravity refines scale and misalignment of a worn device."""
    return replace(knobs, track=replace(knobs.track, learn_matrix=True))
