"""A console that prints text of devices, files and people as text: no markup, no control characters."""

from typing import Any

from rich.console import Console
from rich.text import Text

from bridge.runtime.logs import printable_lines

_WIDE = 160


class _Plain(Console):
    def render_str(self, text: str, **how: Any) -> Text:
        """Of all that is printed and was no Text before, a table's cells too."""
        return super().render_str(printable_lines(text), **how)


def plain_console(*, stderr: bool = False) -> Console:
    """A console that prints `[/x]` and `:x:` as they are; without a terminal, columns of a table have room."""
    made = _Plain(markup=False, emoji=False, stderr=stderr)
    if not made.is_terminal:
        made.width = max(made.width, _WIDE)
    return made
