"""Numbers as people read them. Degrees live here, not in the core."""

from collections.abc import Sequence
from datetime import UTC, datetime
from math import degrees, isfinite

from estimator.ward_view import age

MINUS = "\N{MINUS SIGN}"


def signed(value: float, digits: int) -> str:
    """With its sign, as wide whichever it is."""
    return f"{value:+.{digits}f}".replace("-", MINUS)


def bias(bias: Sequence[float], std: Sequence[float]) -> str:
    """`+0.12 −0.40 +0.03 ± 0.004 °/s`: each axis of rad/s, and the largest of their standard deviations."""
    digits = 3 if degrees(max(std)) < 0.1 else 2
    return f"{' '.join(signed(degrees(b), digits) for b in bias)} ± {degrees(max(std)):.{digits}f} °/s"


def rate(measured_hz: float, told_hz: float) -> str:
    """`103.9 of 104 Hz`."""
    if not measured_hz:
        return f"{told_hz:g} Hz told" if told_hz else ""
    return f"{measured_hz:.1f} of {told_hz:g} Hz" if told_hz else f"{measured_hz:.1f} Hz"


def gaps(count: int, missing: int) -> str:
    """`none`, or `3, 12 samples`."""
    return f"{count}, {missing} samples" if count else "none"


def temperature(celsius: float) -> str:
    """Nothing when it is not known."""
    return f"{celsius:.1f} °C" if isfinite(celsius) else ""


def battery(percent: float | None, *, charging: bool) -> str:
    """`82 %`, with whether it is charging."""
    return "" if percent is None else f"{percent:.0f} %{' charging' if charging else ''}"


def ago(then_ns: int, now_ns: int) -> str:
    """`2 h ago`."""
    return f"{age(max(0.0, (now_ns - then_ns) / 1e9))} ago"


def clock(time_ns: int) -> str:
    """A date and a time, of the server's zone."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")
