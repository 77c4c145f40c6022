"""How a kind of device is to be treated: its noise model turned into the knobs of stillness, prior and tracking."""

from collections.abc import Mapping
from dataclasses import replace
from math import log, pi, sqrt
from typing import TYPE_CHECKING

from estimator.calibration.bias_wander import WanderKnobs
from estimator.device.session_knobs import SessionKnobs
from estimator.noise.device_model import GENERIC, NoiseModel, load_model

if TYPE_CHECKING:
    from estimator.config.schema import Estimator

#: readings a second at which the noise of one reading is guessed before a rest has shown it
_USUAL_HZ = 100.0
#: Allan deviation of a bias instability of 1 (IEEE Std 952, √(2 ln 2 / π)); and at which averaging time a walk is to reach it, s
_FLAT, _WITHOUT_REST_S = 0.664, 1000.0
#: standard deviation of a flicker of bias instability 1 (IEEE Std 952: its two-sided density is B²/2πf) from once in that time to
#: once a second, above which noise hides it: √(ln 1000 / π)
FLICKER = sqrt(log(_WITHOUT_REST_S) / pi)
#: times a model's scale_tolerance that no gyro of the kind is off: sheets say limits (MPU-6050: ±3 % as MIN and MAX at 25 °C)
#: or typical values with all of temperature in them (ICM-20948); and what a hand's turn may always miss by, 3.6°
_TOLERANCES, _BY_HAND = 2.0, 0.01


def knobs_of(model: NoiseModel, knobs: SessionKnobs | None = None) -> SessionKnobs:
    """The knobs of a session of such a device; what the model does not tell stays as in `knobs`. The worst axis counts."""
    knobs = knobs or SessionKnobs()
    noise = float(model.arw.max()) * (_USUAL_HZ / 2) ** 0.5
    track = knobs.track
    # The flat of the Allan deviation, as a walk that comes to it where a device may well be without rest.
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
        stillness=replace(knobs.stillness, noise_guess=noise),
        track=replace(track, bias=bias, gravity=gravity),
    )


class Treatment:
    """How each device of a ward is treated, as its [estimator] table says; the same for whoever has to agree with it."""

    def __init__(
        self, usual: SessionKnobs | None = None, model: str = GENERIC, models: Mapping[str, str] | None = None
    ) -> None:
        self.usual = knobs_of(load_model(model), usual)
        self._others = {device: knobs_of(load_model(other), usual) for device, other in (models or {}).items()}

    def of(self, device: str) -> SessionKnobs:
        """Of one device."""
        return self._others.get(device, self.usual)


def treatment(told: "Estimator | None") -> Treatment:
    """As the estimator of the same file treats its devices; without one, as it does where nothing is said."""
    if told is None:
        return Treatment()
    usual = SessionKnobs(method=told.method, warming_s=told.warming_s, horizontal_turns=told.horizontal_turns)
    return Treatment(usual, told.model, told.models)
