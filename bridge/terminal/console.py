"""Console for text of devices, files and users: interprets no markup and prints no control characters."""

from typing import Any

from rich.console import Console
from rich.text import Text

from bridge.runtime.logs import printable_lines

_WIDE = 160


class _Plain(Console):
    def render_str(self, text: str, **how: Any) -> Text:
        """Make every plain string printable; rich calls this for table cells, too."""
        return super().render_str(printable_lines(text), **how)


def plain_console(*, stderr: bool = False) -> Console:
    """Create a console that prints `[/x]` and `:x:` literally, and control characters escaped.

    stderr: True prints to standard error. Without a terminal, the console is at least 160 columns wide.
    """
    made = _Plain(markup=False, emoji=False, stderr=stderr)
    if not made.is_terminal:
        made.width = max(made.width, _WIDE)
    return made
