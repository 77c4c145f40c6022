"""Reader of a text table's rows as numbers; lines that are not rows are left out and counted."""

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bridge.recording.error import RecordingError
from bridge.recording.recording import Floats
from bridge.recording.text.columns import Clock, Triple
from bridge.recording.text.layout import Layout, split
from bridge.recording.text.times import seconds_of
from bridge.terminal.plurals import count

_MOST = 1 << 25  # rows: eight hours at 1165 Hz


@dataclass(slots=True)
class Read:
    """Columns of n rows, read from a text table.

    columns: indices in the file, from 0, of the c columns read as numbers. numbers (n, c): their values in the file's
    units, NaN if a cell is not a number. texts: columns as written, by index. odd: number of lines that are not rows,
    by description. lines: line numbers of the rows, from 1; one sequence for each block of
    lines that was read.
    """

    columns: list[int]
    numbers: Floats = field(default_factory=lambda: np.empty((0, 0)))
    texts: dict[int, list[str]] = field(default_factory=dict)
    odd: dict[str, int] = field(default_factory=dict)
    lines: list[Sequence[int]] = field(default_factory=list)

    def column(self, at: int) -> Floats:
        """Return one column of numbers (n,), in the file's unit. at: its index in the file, from 0."""
        return self.numbers[:, self.columns.index(at)]

    def vector(self, triple: Triple) -> Floats:
        """Return the vector (n, 3) in three columns, in SI units, or in the file's unit if that unit is unknown.

        triple: the three columns, with the factor that converts their numbers to SI.
        """
        first, second, third = (self.columns.index(at) for at in triple.at)
        beside = (second, third) == (first + 1, first + 2)  # then no copy is needed
        values = self.numbers[:, slice(first, first + 3) if beside else [first, second, third]]
        return values if triple.factor in (None, 1.0) else values * triple.factor

    def times(self, clock: Clock) -> Floats:
        """Return the times (n,) in a time column, in the column's own unit.

        Times written as text are returned in s since the midnight before the first. clock: the column.
        """
        return seconds_of(self.texts[clock.at]) if clock.text else self.column(clock.at)

    def line(self, row: int) -> int:
        """Return the line number in the file, from 1, of a row counted from 0; 0 if there is no such row."""
        for block in self.lines:
            if row < len(block):
                return block[row]
            row -= len(block)
        return 0


def read_rows(path: Path, blocks: Iterable[list[str]], layout: Layout, columns: list[int], texts: list[int]) -> Read:
    """Read the rows of a text table: some columns as numbers, others as written.

    blocks: lines of the file, in lists. columns, texts: indices, from 0, of the columns to read as numbers, and as
    written. Lines that are not rows are left out and counted. Raises RecordingError for more than 2**25 rows.
    """
    parts, read, begins, n = list[Floats](), Read(columns, texts={at: [] for at in texts}), 0, 0
    for block in blocks:
        first = max(0, layout.first - begins)
        lines = block[first:]
        numbers: Sequence[int] = range(begins + first + 1, begins + len(block) + 1)
        part = _quick(lines, layout, read)
        if part is None:
            part, numbers = _slow(lines, numbers, layout, read)
        begins += len(block)
        parts.append(part)
        read.lines.append(numbers)
        n += len(part)
        if n > _MOST:
            raise RecordingError(f"{path}: the file has more than {count(_MOST, 'row')}: split the file")
    read.numbers = np.empty((n, len(columns)))
    while parts:  # each part is freed once it is copied
        part = parts.pop()
        read.numbers[n - len(part) : n] = part
        n -= len(part)
    return read


def _quick(lines: list[str], layout: Layout, read: Read) -> Floats | None:
    """Read a faultless block of rows with NumPy's reader; None if the block has any fault."""
    separator, last, columns = layout.separator, layout.width - 1, read.columns
    if not lines or not columns:
        return None
    if separator is not None:
        if sum(map(str.count, lines, [separator] * len(lines))) != last * len(lines):
            return None
        # With equal totals, a longer line may hide a line without its last column.
        if last not in columns and any(line.count(separator) != last for line in lines):
            return None
    text = [line.replace(",", ".") for line in lines] if layout.decimal == "," else lines
    try:
        part = np.loadtxt(text, delimiter=separator, usecols=columns, comments=None, ndmin=2, quotechar='"')
    except ValueError:
        return None
    if len(part) != len(lines):
        return None
    for at, cells in read.texts.items():
        cells += [line.split(separator)[at] for line in lines]
    return part


def _slow(lines: list[str], numbers: Sequence[int], layout: Layout, read: Read) -> tuple[Floats, Sequence[int]]:
    part, good, columns = array("d"), array("l"), read.columns
    for number, line in zip(numbers, lines, strict=True):
        if not line or line.isspace():
            continue
        cells = split(line, layout.separator)
        if len(cells) == layout.width + 1 and not cells[-1].strip():
            cells.pop()
        values = [_number(cells[at], layout.decimal) for at in columns] if len(cells) == layout.width else []
        if not values or all(value is None for value in values):
            what = (
                "more or fewer cells than the other rows" if len(cells) > 1 and not values else "not a row of numbers"
            )
            read.odd[what] = read.odd.get(what, 0) + 1
            continue
        part.extend([np.nan if value is None else value for value in values])
        for at, texts in read.texts.items():
            texts.append(cells[at])
        good.append(number)
    return np.array(part, np.float64).reshape(-1, len(columns)), good


def _number(cell: str, decimal: str) -> float | None:
    cell = cell.strip().strip('"')
    if decimal == ",":
        cell = cell.replace(",", ".")
    try:
        return float(cell)
    except ValueError:
        return None
