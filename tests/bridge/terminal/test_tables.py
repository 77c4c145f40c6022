"""Tables at every width: a number is whole, or its column is not there."""

import io
import re

import pytest
from rich.console import Console
from rich.text import Text

from bridge.terminal.tables import Column, Columns

COLUMNS = (
    Column("device", least=10),
    Column("state"),
    Column("Hz", number=True, spare=2),
    Column("seen", number=True, spare=1),
    Column("samples", number=True),
    Column("why", least=16),
)
NUMBERS = {"Hz": "104.25", "seen": "2026-11-21", "samples": "12345678901"}


def printed(table: Columns, width: int) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def made(*, headings: bool = True) -> Columns:
    table = Columns(COLUMNS, headings=headings)
    table.add(
        "wrist-left-of-bed-3", Text("turning", "cyan"), *NUMBERS.values(), "turn about y taken; still needed: x, z"
    )
    table.add("b", "lost")
    return table


@pytest.mark.parametrize("width", [*range(12, 130, 3), 400])
def test_no_number_is_cut_at_any_width(width: int) -> None:
    shown = printed(made(), width)
    lines = shown.splitlines()
    assert "…" not in shown
    assert max(map(len, lines)) <= width
    assert NUMBERS["samples"] in shown
    for heading, number in NUMBERS.items():
        if heading in lines[0].split():
            assert number in shown
    assert re.sub(r"\W", "", "turn about y taken") in re.sub(r"\W", "", shown) or width > 40


def test_what_matters_least_is_left_out_first() -> None:
    headings = [printed(made(), width).splitlines()[0].split() for width in (120, 65, 55)]
    assert [[name for name in NUMBERS if name in line] for line in headings] == [
        ["Hz", "seen", "samples"],
        ["seen", "samples"],
        ["samples"],
    ]


def test_with_room_every_cell_is_whole_and_in_one_line() -> None:
    shown = printed(made(headings=False), 200)
    assert len(shown.splitlines()) == 2
    assert "turn about y taken; still needed: x, z" in shown


def test_what_looks_like_markup_is_shown_as_it_is() -> None:
    table = Columns([Column("model")])
    table.add("[bold]x[/bold] [/y] :smile:")
    assert "[bold]x[/bold] [/y] :smile:" in printed(table, 80)
