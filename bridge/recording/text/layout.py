"""Recognition of a text table's layout from its first lines: separator, decimal mark, preamble and header."""

import csv
import re
from collections import Counter
from itertools import groupby
from typing import NamedTuple

from bridge.text.units import ACCEL, GYRO, TIME, spelling

_SEPARATORS = (",", ";", "\t", "|", " ", None)
#: most lines and characters examined
_LINES, _CHARACTERS = 400, 400_000
_LEAST_NUMBERS = 3
COMMENT = re.compile(r"\s*(//|#|%|\*)+\s?")
_SEP = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
_RATE = re.compile(
    r"(?<!baud)(?<!baud[ _])(?<!frame[ _])(?:rate|frequency|freq|odr|fs)\b[^0-9\n]{0,24}?(\d+(?:[.,]\d+)?)\s*(k?hz|sps|samples)?",
    re.IGNORECASE,
)
_GYRO_UNIT = re.compile(
    r"(?:gyr|angular|rate of turn|rotation)[^\n]*?(rad/s(?:ec)?|deg/s(?:ec)?|°/s|m?dps)\b", re.IGNORECASE
)
#: properties of a sensor whose unit need not be the unit of its columns
_NO_UNIT = re.compile(r"range|scale|fsr|noise|bias|density|resolution|sensitivity|threshold", re.IGNORECASE)
_ACCEL_UNIT = re.compile(r"acc[^\n]*?(m/s\^?2|m/s²|\bmg\b|\bg\b)", re.IGNORECASE)


class Layout(NamedTuple):
    """Layout of a text table.

    separator: None for any run of blanks. decimal: decimal mark. names: column names, empty if there is no header.
    width: number of cells per row. first: index, from 0, of the first line of numbers.
    rate_hz, gyro_unit, accel_unit: as the preamble states them; 0 and empty if it does not.
    """

    separator: str | None
    decimal: str
    names: list[str]
    width: int
    first: int
    rate_hz: float = 0.0
    gyro_unit: str = ""
    accel_unit: str = ""


def layout_of(lines: list[str]) -> Layout | None:
    """Recognise the layout of a text table that begins with these lines; None if no row of numbers is found."""
    told = next((match[1] for line in lines[:3] if (match := _SEP.fullmatch(line.strip()))), "")
    sample, size = list[tuple[int, str]](), 0
    for at, line in enumerate(lines[:_LINES]):
        size += len(line)
        if size > _CHARACTERS and len(sample) > 3:
            break
        if line.strip():
            sample.append((at, line))
    best: tuple[int, int, int] = (0, 0, 0)
    found: tuple[str | None, str, int, int] | None = None
    for separator in [told] if told else _SEPARATORS:
        for decimal in ".," if separator != "," else ".":
            widths = [(at, _width_of_numbers(line, separator, decimal)) for at, line in sample]
            modal, rows = (
                Counter(width for _, width in widths if width).most_common(1)[0]
                if any(w for _, w in widths)
                else (0, 0)
            )
            if not rows:
                continue
            first = next(at for at, width in widths if width == modal)
            numbers = _numbers(lines[first], separator, decimal)
            headed = any(len(split(line, separator)) == modal for at, line in sample if at < first)
            score = (rows, numbers, int(headed))
            if score > best:
                best, found = score, (separator, decimal, modal, first)
    if found is None:
        return None
    separator, decimal, width, first = found
    names, header_from = _header(lines[:first], separator, width)
    preamble = "\n".join(COMMENT.sub("", line) for line in lines[:header_from])
    return Layout(separator, decimal, names, width, first, *_facts(preamble))


def split(line: str, separator: str | None) -> list[str]:
    """Split a line into cells, as texts; a quoted cell may contain the separator.

    separator: None for any run of blanks.
    """
    if '"' in line and separator is not None:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return line.split(separator)


def is_number(cell: str, decimal: str = ".") -> bool:
    """Return True if a cell holds a number with this decimal mark; quotes and blanks around the number are ignored."""
    cell = cell.strip().strip('"')
    if decimal == ",":
        if "." in cell and "," not in cell:
            return False
        cell = cell.replace(",", ".")
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _numbers(line: str, separator: str | None, decimal: str) -> int:
    return sum(is_number(cell, decimal) for cell in split(line, separator))


def _width_of_numbers(line: str, separator: str | None, decimal: str) -> int:
    """Return the number of cells in a row of numbers; 0 for any other line."""
    cells = split(line, separator)
    if len(cells) < _LEAST_NUMBERS:
        return 0
    filled = [cell for cell in cells if cell.strip()]
    numbers = sum(is_number(cell, decimal) for cell in filled)
    return len(cells) if numbers >= _LEAST_NUMBERS and 2 * numbers >= len(filled) else 0


def _header(lines: list[str], separator: str | None, width: int) -> tuple[list[str], int]:
    """Return the column names from the rows above the first numbers, and the index of the first of those rows."""
    rows, begins = list[list[str]](), len(lines)
    if lines and '"' in lines[-1] and len(lines) > 1 and lines[-1].count('"') % 2:
        lines = [*lines[:-2], f"{lines[-2]} {lines[-1]}"]  # a quoted name that contains a line break
    for at in range(len(lines) - 1, -1, -1):
        line = COMMENT.sub("", lines[at], count=1) if COMMENT.match(lines[at]) else lines[at]
        if not line.strip():
            if rows:
                break
            continue
        cells = [cell.strip().strip('"').strip() for cell in split(line, separator)]
        # A sentence above the header is not a row of names.
        whole = abs(len(cells) - width) <= 1 and (not rows or (separator or " ") != " ")
        gaps = bool(rows) and (separator or " ") != " " and 2 < len(cells) < width and "" in cells
        if len(rows) == 3 or not (whole or gaps) or sum(bool(cell) for cell in cells) < 2:
            break
        rows.insert(0, [*cells, *[""] * width][: max(width, 1)])
        begins = at
    return _joined(rows, width), begins


def _joined(rows: list[list[str]], width: int) -> list[str]:
    """Join header rows into one name per column: groups above, units below."""
    names = [""] * width
    units = [""] * width
    for number, row in enumerate(rows):
        if number and all(not cell or _is_unit(cell) for cell in row):
            units = row
            continue
        if number < len(rows) - 1 and "" in row[1:]:
            units_follow = all(not c or _is_unit(c) for c in rows[number + 1])
            row = _by_axis(_spread(row)) if units_follow else _spread(row)  # noqa: PLW2901
        names = [f"{name} {cell}".strip() for name, cell in zip(names, row, strict=True)]
    return [f"{name} ({unit.strip('()[]')})" if unit else name for name, unit in zip(names, units, strict=True)]


def _by_axis(row: list[str]) -> list[str]:
    """Append the axis to a name that stands over three columns."""
    named = list[str]()
    for name, alike in groupby(row):
        n = len(list(alike))
        named += [f"{name} {axis}" for axis in "xyz"] if name and n == 3 else [name] * n
    return named


def _spread(row: list[str]) -> list[str]:
    """Repeat a name that stands over several columns, above the first of them."""
    last, spread = "", []
    for cell in row:
        last = cell or last
        spread.append(last)
    return spread


def _is_unit(cell: str) -> bool:
    return spelling(cell) in {
        *GYRO,
        *ACCEL,
        *TIME,
        "degc",
        "c",
        "ut",
        "hpa",
        "mt",
        "%",
        "-",
        "nt",
        "mgauss",
        "gauss",
        "pa",
        "kpa",
        "m",
        "deg",
    }


def _facts(preamble: str) -> tuple[float, str, str]:
    rate = 0.0
    if match := _RATE.search(preamble):
        rate = float(match[1].replace(",", ".")) * (1000 if (match[2] or "").lower() == "khz" else 1)
    parts = [part for part in re.split(r"[\n,;]", preamble) if not _NO_UNIT.search(part)]
    gyro = next((match[1] for part in parts if (match := _GYRO_UNIT.search(part))), "")
    accel = next((match[1] for part in parts if (match := _ACCEL_UNIT.search(part))), "")
    return rate, gyro, accel
