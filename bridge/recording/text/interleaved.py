"""Splits a log in which rows of several sensors alternate, such as `GYRO;1.20;…` and `ACCE;1.21;…`."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from bridge.recording.text.layout import COMMENT, is_number, split

_SEPARATORS = (",", ";", "\t", "|", " ")
#: a tag stands in one of the first columns
_COLUMNS = 3
_LINES = 400
#: share of lines with a tag, and largest number of different tags
_TAGGED, _MOST_TAGS = 0.8, 20
_GYRO = re.compile(r"gyr|angular ?vel|rotation ?rate", re.IGNORECASE)
_ACCEL = re.compile(r"acc", re.IGNORECASE)
_DERIVED = re.compile(r"lin|user|uncal|raw|bias", re.IGNORECASE)


class Tags(NamedTuple):
    """Tags of the sensors in a log with one reading of one sensor per row, such as `GYRO;1.20;…`.

    separator: separator of the cells. column: index, from 0, of the cell with the tag. all: all tags in the log.
    gyro, accel: tags of these sensors; accel is empty if the log has no accelerometer.
    """

    separator: str
    column: int
    all: frozenset[str]
    gyro: str
    accel: str

    def rows_of(self, tag: str, blocks: Iterable[list[str]]) -> Iterator[list[str]]:
        """Yield blocks of lines in which only lines with one tag are kept; other lines are empty.

        Line numbers therefore stay those of the file.
        """
        others = self.all - {tag}
        for lines in blocks:
            yield ["" if _cell(line, self.separator, self.column) in others else line for line in lines]


def tags_of(lines: list[str]) -> Tags | None:
    """Return the sensor tags of a log that begins with these lines; None if its rows have no tags, as in a plain table."""
    sample = [line for line in lines[:_LINES] if line.strip() and not COMMENT.match(line)]
    for separator in _SEPARATORS:
        for column in range(_COLUMNS):
            cells = Counter(_cell(line, separator, column) for line in sample)
            repeated = {cell: n for cell, n in cells.items() if n > 2 and cell and not is_number(cell)}
            if not 2 <= len(repeated) <= _MOST_TAGS or sum(repeated.values()) < _TAGGED * len(sample):
                continue
            if gyro := _plainest(repeated, _GYRO):
                return Tags(separator, column, frozenset(repeated), gyro, _plainest(repeated, _ACCEL))
    return None


def _plainest(tags: Iterable[str], pattern: re.Pattern[str]) -> str:
    """Return the tag of a sensor's own readings: neither derived nor uncalibrated, if there is a choice."""
    alike = sorted((bool(_DERIVED.search(tag)), len(tag), tag) for tag in tags if pattern.search(tag))
    return alike[0][2] if alike else ""


def _cell(line: str, separator: str, column: int) -> str:
    cells = split(COMMENT.sub("", line, count=1), separator)
    return cells[column].strip().strip('"') if column < len(cells) else ""
