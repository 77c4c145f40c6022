"""Terminal view of `truerate watch` of a ward: live, once, or as JSON."""

import sys
import time
from collections.abc import Sequence

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from bridge.reasons.catalogue import english
from estimator.client import Client
from estimator.overview.ward import TRACKING, WORDS, DeviceRow, age, counted, head_line, listed
from estimator.terminal.live_messages import FIRST_S, NO_DEVICE_DO, LiveMessages, interrupted
from estimator.terminal.ward_table import STYLES

_REDRAW_S = 1.0
_STYLE = {WORDS[state]: style for state, style in STYLES.items()}
_TROUBLE = "bold red"
#: columns, and the least terminal width at which each is shown
_COLUMNS = {"device": 0, "state": 0, "quality": 100, "Hz": 70, "gaps": 100, "rest": 100, "battery": 70, "why": 0}
_NUMBERS = ("Hz", "gaps", "rest", "battery")
_WHOLE = 10_000


def watch_ward(
    console: Console,
    client: Client,
    only: str = "",
    *,
    once: bool = False,
    as_json: bool = False,
    seconds: float | None = None,
) -> int:
    """Show the client's ward until Ctrl-C, for `seconds` s, or once.

    only: id of the device to show; empty shows all. once: show the ward once and end. as_json: print one JSON object at
    each update. Its keys: ward; tracking and of (numbers of tracking devices and of all); devices (`DeviceRow.as_dict`).
    Returns the exit code: 0 if the ward has the device `only`, or with an empty `only` any device; else 1.
    """
    ears, heard, said, strange = LiveMessages(client), False, dict[str, str](), ""
    listen = ears.settle if once else ears.listen
    begin = time.monotonic()
    screen = Live(console=console, auto_refresh=False, screen=True)
    live = console.is_terminal and not once and not as_json
    try:
        if live:
            screen.start()
            screen.update(_text(f"{client.ward}: listening …"), refresh=True)
        while True:
            listen(_REDRAW_S if heard else FIRST_S)
            now = time.monotonic()
            everything = ears.view.rows(now)
            rows = [row for row in everything if only in ("", row.device)]
            heard = heard or bool(everything)
            head = f"{client.ward}: {head_line(everything)}" + ("" if client.connected else "; no router answers")
            there = listed(row.device for row in everything)
            strange = f"{only} is not heard; heard are {there}" if everything and not rows else ""
            head += f"; {strange}" if strange else ""
            if as_json:
                _print_json(client.ward, everything, rows)
            elif live:
                screen.update(shown(rows, head, console.width, console.height), refresh=True)
            elif once:
                if not console.is_terminal:
                    console.width = _WHOLE  # one line per device, for other programs
                console.print(shown(rows, head, console.width))
            else:
                _print_changes(console, rows, said)
            if once or (seconds is not None and now - begin >= seconds):
                break
    except KeyboardInterrupt:
        interrupted(begin, heard=heard)
    finally:
        screen.stop()
    if not heard:
        words = f"ward {client.ward}: no device is heard. {NO_DEVICE_DO}"
        print(words, file=sys.stderr)  # noqa: T201
    elif strange and (as_json or not (live or once)):
        print(strange, file=sys.stderr)  # noqa: T201
    return 0 if heard and not strange else 1


def shown(rows: Sequence[DeviceRow], head: str, width: int, height: int | None = None) -> Group:
    """Lay out a ward for a terminal: a head line, headings, and a line per device.

    width: columns of the terminal. height: its lines; devices without room are counted in the last line, and reasons
    are shortened. If height is None, all devices are shown and reasons wrapped. Columns without a value are left out.
    """
    room = len(rows) if height is None else max(1, height - 2)
    listed, rest = (rows, ()) if len(rows) <= room else (rows[: room - 1], rows[room - 1 :])
    cells = [_cells(row) for row in listed]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    kept = [
        at
        for at, least in enumerate(_COLUMNS.values())
        if not least or (width >= least and any(line[at] for line in cells))
    ]
    names = [*_COLUMNS]
    for at in kept:
        table.add_column(names[at], justify="right" if names[at] in _NUMBERS else "left", no_wrap=names[at] != "why")
    for row, line in zip(listed, cells, strict=True):
        styles = {"state": _STYLE.get(row.state, _TROUBLE), "battery": _TROUBLE if row.low_battery else ""}
        table.add_row(*(_text(line[at], styles.get(names[at], ""), cut=height is not None) for at in kept))
    more = [_text(f"… and {len(rest)} more: {counted(rest)}", "dim")] if rest else []
    return Group(_text(head, "bold", cut=height is not None), table, *more)


def _text(words: str, style: str = "", *, cut: bool = True) -> Text:
    return Text(words, style, no_wrap=cut or None, overflow="ellipsis" if cut else "fold")


def _cells(row: DeviceRow) -> tuple[str, ...]:
    battery = "" if row.battery_percent is None else f"{row.battery_percent:.0f} %{'+' if row.charging else ''}"
    said = (*row.notices, *row.reason) if row.state == TRACKING else (*row.reason, *row.notices)
    return (
        row.device,
        row.state,
        row.quality,
        f"{row.rate_hz:.1f}" if row.rate_hz else "",
        f"{row.gaps}" if row.quality else "",
        age(row.evidence_age_s) if row.evidence_age_s is not None else "none" if row.quality else "",
        battery,
        english(*(one for i, one in enumerate(said) if one not in said[:i])),
    )


def _print_json(ward: str, everything: Sequence[DeviceRow], rows: Sequence[DeviceRow]) -> None:
    tracking = sum(row.state == TRACKING for row in everything)
    found = {"ward": ward, "tracking": tracking, "of": len(everything), "devices": [row.as_dict() for row in rows]}
    print(msgspec.json.encode(found).decode(), flush=True)  # noqa: T201


def _print_changes(console: Console, rows: Sequence[DeviceRow], said: dict[str, str]) -> None:
    """Print a line for every device whose state is new."""
    for row in rows:
        if said.get(row.device) != row.state:
            said[row.device] = row.state
            console.print(
                f"{row.device}: {row.state}: {english(*row.reason)}", highlight=False, soft_wrap=True, markup=False
            )
