"""Number formats for people, in their language; converts SI units to degrees."""

from collections.abc import Sequence
from datetime import UTC, datetime
from math import degrees, isfinite

from estimator.geometry.gyro_model import SIGMAS
from estimator.language.texts import Texts
from estimator.overview.ward import age

MINUS = "\N{MINUS SIGN}"
#: a space where no line breaks
SPACE = "\N{NO-BREAK SPACE}"


def signed(value: float, digits: int) -> str:
    """Format `value` with its sign and `digits` decimals; plus and minus have the same width."""
    return f"{value:+.{digits}f}".replace("-", MINUS)


def bias(bias: Sequence[float], std: Sequence[float]) -> str:
    """Format a bias (3,) in rad/s as °/s: `+0.12 −0.40 +0.03 ± 0.004 °/s`.

    std (3,): its standard deviation, rad/s. The interval is the 95 % interval of the least known axis.
    """
    wide = SIGMAS * degrees(max(std))
    digits = 3 if wide < 0.1 else 2
    return f"{' '.join(signed(degrees(b), digits) for b in bias)} ±{SPACE}{wide:.{digits}f}{SPACE}°/s"


def interval(value: float, std: float, digits: int) -> str:
    """Format a value with its 95 % interval, `1.0123 ± 0.0008`, in the unit of `value`.

    std: standard deviation; if it is not finite, only the value is shown. digits: number of decimals.
    """
    shown = f"{value:.{digits}f}".replace("-", MINUS)
    return f"{shown} ±{SPACE}{SIGMAS * std:.{digits}f}" if isfinite(std) else shown


def rate(measured_hz: float, told_hz: float, t: Texts) -> str:
    """Format measured and configured output data rate in Hz, `103.9 of 104 Hz`; an unknown rate (0) is left out."""
    if not measured_hz:
        return t("words.rate_told", told=f"{told_hz:g}") if told_hz else ""
    measured = f"{measured_hz:.1f}"
    return t("words.rate_of", measured=measured, told=f"{told_hz:g}") if told_hz else f"{measured} Hz"


def gaps(count: int, missing: int, t: Texts) -> str:
    """Format numbers of missing samples and of gaps: `none`, `3, in one gap`, or `12, in 2 gaps`.

    count: number of gaps. missing: number of samples missing in them.
    """
    if count == 1:
        return t("words.gap", missing=missing)
    return t("words.gaps", count=count, missing=missing) if count else t("words.no_gaps")


def temperature(celsius: float) -> str:
    """Format a temperature in °C: `31.5 °C`; empty for NaN."""
    return f"{celsius:.1f} °C" if isfinite(celsius) else ""


def battery(percent: float | None, t: Texts, *, charging: bool) -> str:
    """Format a battery's charge in percent: `82 %`, and whether it is charging; empty for None."""
    if percent is None:
        return ""
    return t("words.charging", percent=f"{percent:.0f}") if charging else f"{percent:.0f} %"


def ago(then_ns: int, now_ns: int, t: Texts) -> str:
    """Format the time between two host times (ns since the Unix epoch) as text: `2 h ago`."""
    return t("words.ago", age=lasting(max(0.0, (now_ns - then_ns) / 1e9), t))


def lasting(seconds: float, t: Texts) -> str:
    """Format a duration in s as text, by the largest unit (s, min, h, d) of which it has at least two: `2 h`."""
    n, _, unit = age(seconds).partition(" ")
    return t(f"words.{unit}", n=n)


def clock(time_ns: int) -> str:
    """Format a time, ns since the Unix epoch, in the server's time zone: `2026-11-21 13:39:19 UTC+01:00`."""
    local = datetime.fromtimestamp(time_ns / 1e9, UTC).astimezone()
    return f"{local:%Y-%m-%d %H:%M:%S} {zone_name(local)}"


def zone_name(local: datetime) -> str:
    """Return the offset of a time's zone from UTC: `UTC`, or `UTC+01:00`."""
    offset = local.isoformat()[-6:]
    return "UTC" if offset == "+00:00" else f"UTC{offset.replace('-', MINUS)}"
