"""`truerate watch` without a device: all of a ward, live in a terminal's height, or as it is now, or as JSON."""

import sys
import time
from collections.abc import Sequence

import msgspec
from rich.cells import cell_len
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from bridge.reasons.catalogue import english
from estimator.client import Client
from estimator.listening import FIRST_S, Ears, interrupted
from estimator.screen import STYLES
from estimator.ward_view import TRACKING, WORDS, Row, age, chosen, counted, head_line, listed, strangers

_REDRAW_S = 1.0
_STYLE = {WORDS[state]: style for state, style in STYLES.items()}
_TROUBLE = "bold red"
HEADINGS = ("device", "state", "quality", "Hz", "gaps", "rest", "battery", "why")
_ALWAYS, _NUMBERS = ("device", "state", "why"), ("Hz", "gaps", "rest", "battery")
#: what is left out first where there is no room for the reason
_DISPENSABLE = ("quality", "rest", "gaps", "Hz", "battery")
_MIN_WHY = 30


def watch_ward(
    console: Console,
    client: Client,
    only: Sequence[str] = (),
    *,
    once: bool = False,
    as_json: bool = False,
    seconds: float | None = None,
) -> int:
    """The client's ward until Ctrl-C, for so many seconds, or once; 1 when no device was heard of."""
    ears, heard, said, strange = Ears(client), False, dict[str, str](), list[str]()
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
            rows = chosen(everything, only)
            heard = heard or bool(everything)
            head = f"{client.ward}: {head_line(everything)}" + ("" if client.connected else "; no router is there now")
            strange = strangers(everything, only)
            head += f"; none is {' or '.join(only)}" if only and not rows and not strange else ""
            head += f"; {_strange(strange, everything)}" if strange else ""
            if as_json:
                _print_json(client.ward, everything, rows)
            elif live:
                screen.update(Group(*lines(rows, head, console.width, console.height)), refresh=True)
            elif once:
                width = console.width if console.is_terminal else None
                for text in lines(rows, head, width, cut=False):
                    console.print(
                        text if width is None else _wrapped(console, text, width), highlight=False, soft_wrap=True
                    )
            else:
                _print_changes(console, rows, said)
            if once or (seconds is not None and now - begin >= seconds):
                break
    except KeyboardInterrupt:
        interrupted(begin, heard=heard)
    finally:
        screen.stop()
    if not heard:
        words = f"ward {client.ward}: no device is heard. Is a bridge running? Is the ward's name right?"
        print(words, file=sys.stderr)  # noqa: T201
    elif strange and (as_json or not (live or once)):
        print(_strange(strange, everything), file=sys.stderr)  # noqa: T201
    return 0 if heard and not strange else 1


def _strange(words: list[str], heard: Sequence[Row]) -> str:
    states = ", ".join(word.replace(" ", "-") for word in WORDS.values())
    there = f"; heard are {listed(row.device for row in heard)}" if heard else ""
    return f"no device that is heard, and no state, is {' or '.join(words)}; states are {states}{there}"


def lines(
    rows: Sequence[Row], head: str, width: int | None = None, height: int | None = None, *, cut: bool = True
) -> list[Text]:
    """A head line, headings and a line a device, cut to width and height where there are any; the last line tells of the rest.

    Without `cut` the width only decides which columns there are.
    """
    room = len(rows) if height is None else max(1, height - 2)
    shown, rest = (rows, ()) if len(rows) <= room else (rows[: room - 1], rows[room - 1 :])
    cells = [_cells(row) for row in shown]
    columns = _fitting([max(map(cell_len, column)) for column in zip(HEADINGS, *cells, strict=True)], cells, width)
    found = [_text(head, "bold"), _line(HEADINGS, columns, dict.fromkeys(HEADINGS, "dim"))]
    for row, line in zip(shown, cells, strict=True):
        styles = {"state": _STYLE.get(row.state, _TROUBLE), "battery": _TROUBLE if row.low_battery else ""}
        found.append(_line(line, columns, styles))
    if rest:
        found.append(_text(f"… and {len(rest)} more: {counted(rest)}", "dim"))
    if width is not None and cut:
        for text in found:
            text.truncate(width, overflow="ellipsis")
    return found


def _wrapped(console: Console, text: Text, width: int) -> Text:
    """A line in as many as it takes, none wider than the width."""
    whole = Text(text.plain, text.style, spans=text.spans)
    return Text("\n  ").join(whole.wrap(console, max(1, width - 2), no_wrap=False, overflow="fold"))


def _fitting(widths: list[int], cells: Sequence[Sequence[str]], width: int | None) -> dict[str, int]:
    """Columns and their widths: those with something in them, and of these the dispensable only where there is room."""
    columns = {name: widths[i] for i, name in enumerate(HEADINGS) if name in _ALWAYS or any(line[i] for line in cells)}
    if width is None:
        return columns
    for name in _DISPENSABLE:
        if width - _taken(columns) < _MIN_WHY:
            columns.pop(name, None)
    return columns


def _taken(columns: dict[str, int]) -> int:
    return sum(width + 2 for name, width in columns.items() if name != "why")


def _line(cells: Sequence[str], columns: dict[str, int], styles: dict[str, str]) -> Text:
    text = _text()
    for name, cell in zip(HEADINGS, cells, strict=True):
        if name == "why":
            text.append(cell, styles.get(name, ""))
        elif name in columns:
            space = " " * (columns[name] - cell_len(cell))
            text.append(space + cell if name in _NUMBERS else cell + space, styles.get(name, ""))
            text.append("  ")
    return text


def _text(words: str = "", style: str = "") -> Text:
    return Text(words, style, no_wrap=True, overflow="ellipsis")


def _cells(row: Row) -> tuple[str, ...]:
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


def _print_json(ward: str, everything: Sequence[Row], rows: Sequence[Row]) -> None:
    tracking = sum(row.state == TRACKING for row in everything)
    found = {"ward": ward, "tracking": tracking, "of": len(everything), "devices": [row.as_dict() for row in rows]}
    print(msgspec.json.encode(found).decode(), flush=True)  # noqa: T201


def _print_changes(console: Console, rows: Sequence[Row], said: dict[str, str]) -> None:
    """On anything but a terminal a line for every device whose state is new."""
    for row in rows:
        if said.get(row.device) != row.state:
            said[row.device] = row.state
            console.print(
                f"{row.device}: {row.state}: {english(*row.reason)}", highlight=False, soft_wrap=True, markup=False
            )
