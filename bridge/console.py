"""Where words are printed: what devices and people say is text, never markup, and a file or a pipe is not narrow."""

from rich.console import Console

_WIDE = 160


def plain_console(*, stderr: bool = False) -> Console:
    """A console that prints `[/x]` and `:x:` as they are; without a terminal, columns of a table have room."""
    made = Console(markup=False, emoji=False, stderr=stderr)
    if not made.is_terminal:
        made.width = max(made.width, _WIDE)
    return made
