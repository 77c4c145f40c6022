"""Terminal views of `truerate devices`, `truerate status`, and `truerate watch` of one device."""

import time
from collections.abc import Sequence
from contextlib import closing
from math import asin, degrees, hypot

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.text import Text

from bridge.ingest import duplicate_bridges
from bridge.reasons.catalogue import english, in_words
from bridge.reasons.codes import Code
from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import BiasRevision, CorrectedBatch, DeviceInfo, OrientationBatch, Status
from estimator.client.client import NONE_S, Client
from estimator.device.lifecycle import NEVER_S
from estimator.geometry.gyro_model import AXES, SIGMAS
from estimator.overview import summary
from estimator.overview.summary import WardSummary
from estimator.overview.ward import SILENT_S, WardView, listed
from estimator.terminal.live_messages import FIRST_S, NO_DEVICE_DO, LiveMessages, interrupted
from estimator.terminal.ward_table import table, word


def show_devices(console: Console, ward: str, endpoints: Sequence[str]) -> int:
    """Print hardware and state of every device of a ward; returns the exit code: 1 if there is no device, else 0.

    endpoints: addresses of the routers, such as `tcp/10.0.0.5:7447`.
    """
    with Client(endpoints, ward=ward) as client:
        statuses, infos = _said(client)
    if not infos and not statuses:
        console.print(f"ward {ward}: no device is heard. {NO_DEVICE_DO}")
        return 1
    console.print(_hardware(infos))
    console.print()
    console.print(
        table(statuses)
        if statuses
        else "No estimator reports these devices. Start one: truerate estimator serve WARD.toml"
    )
    for clash in duplicate_bridges.found(statuses.values()):
        console.print(Text(f"\n{english(clash)}", "bold red"))
    return 0


def show_status(console: Console, ward: str, endpoints: Sequence[str], *, as_json: bool) -> int:
    """Print a ward's summary; returns the exit code: 1 if a person has to do something, else 0.

    endpoints: addresses of the routers, such as `tcp/10.0.0.5:7447`. as_json: print JSON
    (`overview.summary.as_json`) instead of text.
    """
    with Client(endpoints, ward=ward) as client:
        bridges, estimators = client.alive("bridge"), client.alive("estimator")
        statuses, infos = _said(client)
    seen = summary.summarise(ward, statuses, infos, bridges, estimators)
    if as_json:
        console.print_json(data=summary.as_json(seen))
    else:
        console.print(_glance(seen), highlight=False)
    return 0 if seen.well else 1


def _said(client: Client) -> tuple[dict[str, Status], dict[str, DeviceInfo]]:
    """Return the current statuses and infos of a ward, by device."""
    with closing(LiveMessages(client)) as ears:
        ears.settle()
    return ears.view.statuses(time.monotonic()), ears.view.infos()


def _glance(seen: WardSummary) -> Group:
    needs = Columns([Column("device", least=20), Column("state"), Column("why", least=20)], headings=False)
    for need in seen.needs:
        worn = f" ({need.placement})" if need.placement else ""
        needs.add(f"{need.device}{worn}", word(need.state), english(*need.reason))
    corrected = f"{seen.samples_out:,} of {seen.samples_in:,}" if seen.dropped else f"All {seen.samples_in:,}"
    law = f"{corrected} samples corrected, {seen.dropped:,} dropped."
    ended = f", {seen.ended} ended" if seen.ended else ""
    rows: list[RenderableType] = [Text(f"{seen.ward}: {seen.tracking} of {seen.devices} tracking{ended}", "bold")]
    rows += [needs] if seen.needs else []
    rows += [Text(english(trouble), "bold red") for trouble in seen.troubles]
    rows += [Text(english(broken), "bold red") for broken in seen.law.values()]
    rows += [] if seen.law else [Text(law)]
    rows += _unused(seen)
    if seen.told:
        happened = Columns([Column("device", least=20), Column("what", least=20)], headings=False)
        for name, words in seen.told.items():
            happened.add(f"  {name}", words)
        rows += [Text("counted at the bridges:"), happened]
    rows.append(
        Text(f"bridges: {', '.join(seen.bridges) or 'none'}   estimators: {', '.join(seen.estimators) or 'none'}")
    )
    return Group(*rows)


def _unused(seen: WardSummary) -> list[RenderableType]:
    """Return rows on the samples that were not used, and why: of all devices together, and of the devices with most."""
    if not seen.unused:
        return []
    devices = Columns([Column("device", least=20), Column("why", least=20)], headings=False)
    for name, reasons in list(seen.unused.items())[:_MOST_UNUSED]:
        devices.add(f"  {name}", summary.most(reasons))
    if (left := len(seen.unused) - _MOST_UNUSED) > 0:
        devices.add("  …", f"and {left} more devices")
    return [Text(f"not used: {summary.most(summary.total(seen.unused))}"), devices]


def _hardware(infos: dict[str, DeviceInfo]) -> Columns:
    shown = Columns(_HARDWARE)
    for name in sorted(infos):
        shown.add(*_hardware_row(infos[name]))
    return shown


_MOST_UNUSED = 5  # devices
_HARDWARE = (
    Column("device", least=20),
    Column("model", spare=2),
    Column("bridge", spare=1),
    Column("Hz", number=True),
    Column("samples", number=True),
    Column("dropped samples or faults", least=16),
)


def _hardware_row(info: DeviceInfo) -> tuple[str, ...]:
    measured = f"{info.measured_rate_hz:.1f} of {info.rate_hz:g}" if info.measured_rate_hz else f"{info.rate_hz:g}"
    dropped = summary.most({in_words(reason): n for reason, n in info.dropped.items()})
    wrong = "; ".join(filter(None, (dropped, summary.told(info)))) or "0"
    what = f"{info.model} {info.firmware}" if info.boot else "not heard yet"
    return info.device, what, info.bridge, measured, str(info.samples), english(*info.trouble) or wrong


def watch(console: Console, ward: str, endpoints: Sequence[str], device: str, seconds: float | None) -> int:
    """Show one device until Ctrl-C, or for `seconds` s.

    endpoints: addresses of the routers, such as `tcp/10.0.0.5:7447`. Ends after a few seconds if the ward has other
    devices, but not this one.
    Returns the exit code: 1 if no corrected samples of the device arrived, else 0.
    """
    with Client(endpoints, ward=ward) as client:
        corrected = client.corrected(device, history=False, quiet=True)
        status = client.follow(device)
        revisions = client.revisions(device, history=False)
        attitudes = client.orientation(device)
        live = Live(console=console, refresh_per_second=10) if console.is_terminal else None
        view, latest = WardView(), None
        # The last batch, until a newer one comes or it is out of date: some devices send only now and then.
        batch, until = None, 0.0
        turned: OrientationBatch | None = None
        heard, waiting = False, f"waiting for {device} …"
        told = False
        shown_at = begin = time.monotonic()
        if live:
            live.start()
        try:
            while seconds is None or time.monotonic() - begin < seconds:
                new = corrected.receive(0.2)
                now = time.monotonic()
                batch, until = (new, now + SILENT_S) if new is not None or now > until else (batch, until)
                if (said := status.latest()) is not None:
                    view.take_status(said, now)
                latest = view.statuses(now).get(device)
                heard = heard or new is not None
                if (revision := revisions.receive(0.0)) is not None:
                    console.print(_revision_line(revision), highlight=False)
                if not (heard or latest or told) and time.monotonic() - begin > NONE_S:
                    why, misspelt = _who_is_there(client, device)
                    told, waiting, seconds = True, f"{waiting}\n{why}", 0.0 if misspelt else seconds
                    if not live:
                        console.print(waiting, highlight=False, soft_wrap=True)
                turned = attitudes.latest() or turned
                if live:
                    panel = _panel(device, batch, latest) if batch or latest else Text(waiting)
                    live.update(Group(panel, Text(_orientation(turned))) if turned else panel)
                elif new is not None and time.monotonic() - shown_at >= 1.0:
                    shown_at = time.monotonic()
                    console.print(_line(new, latest) + (f"  {_orientation(turned)}" if turned else ""), highlight=False)
        except KeyboardInterrupt:
            interrupted(begin, heard=heard)
        finally:
            if live:
                live.stop()
    if not heard:
        console.print(_unheard(device, ward, latest), highlight=False, soft_wrap=True)
    return 0 if heard else 1


def _orientation(turned: OrientationBatch) -> str:
    """Tilt of the device's z axis from the vertical, and heading, with the 95 % bands of both."""
    _, x, y, _ = turned.quat_wxyz[-1].astype(float).tolist()
    tilt = degrees(2 * asin(min(hypot(x, y), 1.0)))
    tilt_band, heading_band = (degrees(SIGMAS * std) for std in (turned.tilt_std, turned.heading_std))
    return f"tilt {tilt:.1f} ± {tilt_band:.1f}°, heading {degrees(turned.heading[-1]):+.1f} ± {heading_band:.1f}°"


def _who_is_there(client: Client, device: str) -> tuple[str, bool]:
    """Explain why a device is not heard, and whether it is unknown while other devices are heard."""
    with closing(LiveMessages(client)) as ears:
        ears.listen(FIRST_S)
        infos = ears.view.infos()
        names = {*ears.view.statuses(time.monotonic()), *(name for name, info in infos.items() if info.boot)}
    if (info := infos.get(device)) is not None:
        return english(*(info.trouble or (Code.NO_ESTIMATOR_SPOKE(),))), False
    if not names:
        return f"ward {client.ward}: no device is heard. {NO_DEVICE_DO}", False
    if device in names:
        return f"{device} has just been heard", False
    return f"device {device} is unknown in ward {client.ward}: heard are {listed(names)}", True


def _unheard(device: str, ward: str, status: Status | None) -> str:
    if status is None:
        return f"nothing was heard of {device} in ward {ward}: `truerate devices --ward {ward}` lists the devices"
    state = status.state.name.lower().replace("_", " ")
    return f"no sample of {device} arrived in ward {ward}; its state is {state}: {english(*status.reason)}"


def _line(batch: CorrectedBatch, status: Status | None) -> str:
    rates = " ".join(
        f"{AXES[axis]} {degrees(float(batch.rate[-1, axis])):+7.2f}±{SIGMAS * degrees(float(batch.rate_std[-1, axis])):.2f}"
        for axis in range(3)
    )
    state = status.state.name.lower().replace("_", " ") if status else "?"
    return f"{batch.sequence + len(batch) - 1:7d} {rates} °/s  {batch.quality.name.lower().replace('_', ' ')}  {state}"


def _revision_line(revision: BiasRevision) -> str:
    seconds, wide = np.ptp(revision.times_ns) / 1e9, SIGMAS * degrees(float(revision.bias_std.max()))
    return f"bias of the last {seconds:.0f} s revised, now within ± {wide:.4f} °/s (95 %): {english(*revision.reason)}"


#: columns of the panel, and the order in which they are left out on a narrow terminal; the bar has no heading
_PANEL = {"axis": 0, "rate °/s": 0, "± 95 %": 0, "": 3, "bias °/s": 0, "± 95 % °/s": 1, "scale": 2}


def _panel(device: str, batch: CorrectedBatch | None, status: Status | None) -> Group:
    rows = Columns([Column(heading, number=True, spare=spare) for heading, spare in _PANEL.items()])
    for axis, name in enumerate(AXES):
        rate = degrees(float(batch.rate[-1, axis])) if batch else float("nan")
        wide = SIGMAS * degrees(float(batch.rate_std[-1, axis])) if batch else float("nan")
        rows.add(
            name,
            f"{rate:+8.2f}",
            f"{wide:.2f}",
            _bar(rate),
            f"{degrees(status.bias[axis]):+.3f}" if status else "",
            f"{SIGMAS * degrees(status.bias_std[axis]):.4f}" if status else "",
            f"{status.scale[axis]:.4f}" if status else "",
        )
    if status is None:
        return Group(Text(device, "bold"), rows)
    head = Text.assemble((device, "bold"), "  ", word(status.state), f"  quality {status.quality.name.lower()}")
    parts: list[RenderableType] = [head, Text(english(*status.reason)), rows]
    if status.progress < 1:
        parts.append(ProgressBar(total=1.0, completed=status.progress, width=40))
    temperature = "" if np.isnan(status.temperature_c) else f"   {status.temperature_c:.1f} °C"
    age_s = status.evidence_age_s
    rest = f"last rest {age_s:.0f} s ago" if age_s < NEVER_S else "no rest yet"
    parts.append(Text(f"{status.rate_hz:.1f} Hz   {rest}{temperature}", "dim"))
    return Group(*parts)


def _bar(rate_dps: float, half: int = 12, full_dps: float = 200.0) -> str:
    """Draw a rate as a bar to the left or right of the middle."""
    if np.isnan(rate_dps):
        return " " * (2 * half + 1)
    length = min(half, round(abs(rate_dps) / full_dps * half))
    left, right = ("█" * length, "") if rate_dps < 0 else ("", "█" * length)
    return f"{left:>{half}}│{right:<{half}}"
