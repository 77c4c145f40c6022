"""What is printed is what was said."""

import pytest
from rich.table import Table

from bridge.terminal.console import plain_console
from bridge.terminal.tables import Column, Columns

SAID = "[/foo] :x: [red]left[/red]"


@pytest.mark.parametrize("in_a_table", [False, True])
def test_what_looks_like_markup_is_printed_as_it_is(in_a_table: bool, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(box=None)
    table.add_column(SAID)
    table.add_row(SAID)
    plain_console().print(table if in_a_table else SAID, soft_wrap=True)
    assert capsys.readouterr().out.count(SAID) == 1 + in_a_table


@pytest.mark.parametrize("kind", ["words", "table", "columns"])
def test_what_moves_a_cursor_is_printed_as_an_escape(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    said, table, columns = "\x1b]0;hi\x07 \x9b31m \u2028", Table("a"), Columns([Column("a")])
    table.add_row(said)
    columns.add(said)
    plain_console().print({"words": said, "table": table, "columns": columns}[kind], soft_wrap=True)
    printed = capsys.readouterr().out
    assert r"\x1b]0;hi\x07 \x9b31m \u2028" in printed
    assert printed.replace("\n", "").isprintable()


def test_a_pipe_has_room_for_a_table(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    table = Table(*"abcde", box=None)
    table.add_row(*["+3.065±0.046 and more"] * 5)
    plain_console().print(table)
    assert capsys.readouterr().out.count("+3.065±0.046 and more") == 5
