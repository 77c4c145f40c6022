"""Terminal tables: text is folded and never cut; a column of numbers is shown whole or left out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from bridge.runtime.logs import printable

_GAP = 2


@dataclass(frozen=True, slots=True)
class Column:
    """Column of a terminal table.

    number: True aligns right and never folds. least: smallest width, in characters, to which text may be folded.
    spare: priority for leaving the column out when the table is too wide; highest first, 0 never.
    """

    heading: str
    number: bool = False
    spare: int = 0
    least: int = 8


class Columns:
    """Terminal table for a rich console, at most as wide as the terminal: rows of cells, with or without headings.

    If even the columns with `spare` 0 do not fit, each row is printed as one text, its cells separated by commas.
    """

    def __init__(self, columns: Sequence[Column], *, title: str = "", headings: bool = True) -> None:
        self._columns, self._title, self._headings = tuple(columns), title, headings
        self._rows: list[tuple[Text, ...]] = []

    def add(self, *cells: str | Text) -> None:
        """Add a row of cells, one per column; missing cells at the end stay empty."""
        given = [cell if isinstance(cell, Text) else Text(printable(cell)) for cell in cells]
        self._rows.append((*given, *(Text() for _ in self._columns[len(given) :])))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        shown = self._fitting(options.max_width)
        if shown is None:
            yield from self._stacked()
            return
        table = Table(
            title=self._title or None,
            title_justify="left",
            box=None,
            pad_edge=False,
            padding=(0, _GAP, 0, 0),
            show_header=self._headings,
        )
        for at, width in shown.items():
            column = self._columns[at]
            justify = "right" if column.number else "left"
            table.add_column(column.heading, justify=justify, width=width, overflow="fold")  # type: ignore[arg-type] # one of two
        for row in self._rows:
            table.add_row(*(row[at] for at in shown))
        yield table

    def _fitting(self, width: int) -> dict[int, int] | None:
        """Return the columns to show with their widths; None if the required columns do not fit."""
        natural = [self._natural(at) for at in range(len(self._columns))]
        least = [
            whole if column.number else min(whole, column.least)
            for column, whole in zip(self._columns, natural, strict=True)
        ]
        kept = list(range(len(self._columns)))
        while _taken(kept, least) > width:
            spare = max(kept, key=lambda at: self._columns[at].spare)
            if not self._columns[spare].spare:
                return None
            kept.remove(spare)
        level = max(natural, default=0)
        while (
            _taken(kept, widths := [min(max(level, low), high) for low, high in zip(least, natural, strict=True)])
            > width
        ):
            level -= 1
        return {at: widths[at] for at in kept}

    def _natural(self, at: int) -> int:
        """Return the width of a column's widest cell."""
        heading = self._columns[at].heading if self._headings else ""
        return max([1, cell_len(heading), *(row[at].cell_len for row in self._rows)])

    def _stacked(self) -> Iterator[Text]:
        if self._title:
            yield Text(self._title)
        for row in self._rows:
            cells = [
                Text.assemble(f"{column.heading} " if self._headings and at else "", cell)
                for at, (column, cell) in enumerate(zip(self._columns, row, strict=True))
                if cell.plain.strip()
            ]
            yield Text(", ", overflow="fold").join(cells)


def _taken(kept: Sequence[int], widths: Sequence[int]) -> int:
    return sum(widths[at] for at in kept) + _GAP * (len(kept) - 1)
