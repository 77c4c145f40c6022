"""Report on the noise of a device at rest, as sentences and table in degrees and as JSON in SI units."""

from collections.abc import Iterator
from dataclasses import asdict
from math import degrees
from typing import Any

from bridge.terminal.tables import Column, Columns
from estimator.geometry.gyro_model import AXES
from estimator.noise.allan_fit import Coefficient, Noise
from estimator.offline.noise_identification import AtRest

#: name in Noise, words, unit, and the number of these units per SI unit
COEFFICIENTS = (
    ("arw", "angle random walk", "°/s/√Hz", degrees(1)),
    ("bias_instability", "bias instability", "°/h", degrees(3600)),
    ("rrw", "rate random walk", "°/s/√s", degrees(1)),
)
_POOR = 3.0  # misfit above which the model explains an axis poorly


def as_json(rest: AtRest) -> dict[str, Any]:
    """Return the noise of a gyro at rest as JSON-compatible values, in SI units.

    Keys: used_s (start and end of the rest); recorded_s; rate_hz; bias_rad_s, noise_std_rad_s and step_rad_s (3 each);
    temperature_c (lowest, highest); axes. `axes` has for x, y and z the fields of `Noise`, with the unit in the key,
    without the interval of the Allan deviation. If `seen` of a noise coefficient is false, only its upper limit `high`
    is known.
    """
    return {
        "used_s": [rest.start_s, rest.end_s],
        "recorded_s": rest.total_s,
        "rate_hz": rest.rate_hz,
        "bias_rad_s": rest.mean.tolist(),
        "noise_std_rad_s": rest.std.tolist(),
        "step_rad_s": rest.step.tolist(),
        "temperature_c": rest.temperature_c,
        "axes": {name: _axis(noise) for name, noise in zip(AXES, rest.axes, strict=True)},
    }


def _axis(noise: Noise) -> dict[str, Any]:
    found = {name: getattr(noise, name) for name, *_ in COEFFICIENTS}
    return {name: asdict(c) | {"seen": c.seen} for name, c in found.items()} | {
        "drift_rad_s2": noise.drift,
        "fitted_from_s": noise.fitted_from,
        "misfit": noise.misfit,
        "tau_s": noise.tau.tolist(),
        "allan_deviation_rad_s": noise.deviation.tolist(),
    }


_COLUMNS = (
    Column("noise", least=9),
    Column("unit", least=6),
    Column("axis"),
    *(Column(heading, number=True) for heading in ("value", "from", "to")),
)


def as_table(rest: AtRest) -> Columns:
    """Return a table with a row per noise coefficient and axis: value and 95 % interval, or only the upper limit.

    Units: angle random walk °/s/√Hz, bias instability °/h, rate random walk °/s/√s.
    """
    table = Columns(_COLUMNS)
    for field, words, unit, scale in COEFFICIENTS:
        for number, (axis, noise) in enumerate(zip(AXES, rest.axes, strict=True)):
            found: Coefficient = getattr(noise, field)
            ends = [f"{end * scale:.3g}" for end in (found.low, found.high)] if found.seen else []
            table.add(*((words, unit) if number == 0 else ("", "")), axis, said(found, scale), *ends)
    return table


def said(coefficient: Coefficient, scale: float) -> str:
    """Format a coefficient times `scale`: `0.0123`, or `< 0.004` if only its upper limit is known.

    scale: number of display units per SI unit.
    """
    value, high = coefficient.value * scale, coefficient.high * scale
    return f"{value:.3g}" if coefficient.seen else f"< {high:.2g}"


def sentences(rest: AtRest) -> Iterator[str]:
    """Yield sentences on the part of the recording that was used, and on what limits the result."""
    yield (
        f"longest rest: {rest.duration_s:.0f} s of {rest.total_s:.0f} s, from {rest.start_s:.1f} to "
        f"{rest.end_s:.1f} s, at {rest.rate_hz:.2f} Hz"
    )
    celsius = "" if rest.temperature_c is None else "; {:.1f} to {:.1f} °C".format(*rest.temperature_c)
    yield f"resolution: {' '.join(f'{degrees(step):.2g}' for step in rest.step)} °/s{celsius}"
    for name, words, *_ in COEFFICIENTS:
        if unseen := [axis for axis, noise in zip(AXES, rest.axes, strict=True) if not getattr(noise, name).seen]:
            yield f"{words} of {', '.join(unseen)}: not seen in {rest.duration_s:.0f} s, the table gives an upper limit"
    named = dict(zip(AXES, rest.axes, strict=True))
    if filtered := [
        f"{noise.fitted_from:.2g} s of {axis}" for axis, noise in named.items() if noise.fitted_from > noise.tau[0]
    ]:
        yield f"not used: averaging times below {', '.join(filtered)}, where a filter or a vibration dominates"
    for axis, noise in named.items():
        if noise.drift:
            yield f"{axis}: steady drift of {degrees(noise.drift) * 3600:.2g} °/s per hour; warm the device up before recording"
        if noise.misfit > _POOR:
            yield f"{axis}: the noise model fits poorly (misfit {noise.misfit:.1f} instead of 1), so the intervals are wider"
