"""`truerate watch --once`: no line wider than the terminal, and nothing said twice."""

import io

from rich.console import Console
from rich.text import Text

from estimator import watch_ward


def test_a_long_line_is_wrapped_and_loses_no_word() -> None:
    console = Console(file=io.StringIO(), width=80)
    words = " ".join(f"word{i}" for i in range(90))
    shown = watch_ward._wrapped(console, Text(words, no_wrap=True, overflow="ellipsis"), 80).plain
    assert max(map(len, shown.splitlines())) <= 80
    assert shown.split() == words.split()
