"""What a scan found: a table, and what to paste into the ward's file. Pure."""

import json
from collections.abc import Iterable, Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from bridge.scan.examine import Verdict


def table(verdicts: Iterable[Verdict]) -> Table:
    """A row a port."""
    made = Table(box=box.SIMPLE_HEAD)
    for heading in ("port", "USB", "protocol", "model", "rate"):
        made.add_column(heading, overflow="fold")
    for verdict in verdicts:
        guess = verdict.guess
        if guess is None:
            _row(made, *verdict.found, "–", "", "")
            continue
        model = f"{guess.identity.model} {guess.identity.firmware}".strip() if guess.identity else ""
        _row(made, *verdict.found, str(guess.candidate), model, f"{guess.rate_hz:.0f} Hz")
    return made


def _row(table: Table, *cells: str) -> None:
    """As they are: what a device says of itself may look like markup."""
    table.add_row(*map(Text, cells))


def remarks(verdicts: Iterable[Verdict]) -> list[str]:
    """What is to be said of a port, one line each."""
    return [f"{verdict.found.port}: {verdict.words}" for verdict in verdicts if verdict.words]


def snippet(verdicts: Sequence[Verdict]) -> str:
    """[[bridge.devices]] of those that were understood; empty if there are none."""
    blocks = []
    for number, verdict in enumerate((verdict for verdict in verdicts if verdict.guess is not None), 1):
        assert verdict.guess is not None
        candidate = verdict.guess.candidate
        values = {"driver": candidate.kind.name, "port": verdict.found.port, **candidate.table}
        if "rate_hz" in values:
            values["rate_hz"] = round(verdict.guess.rate_hz)  # as counted
        if verdict.baud:
            values["baud"] = verdict.baud
        lines = [
            f'id = "device-{number}"    # the name on its label',
            *(f"{k} = {_toml(v)}" for k, v in values.items()),
        ]
        blocks.append("\n".join(["[[bridge.devices]]", *lines]))
    return "\n\n".join(blocks)


def _toml(value: object) -> str:
    """A string, number or truth value: JSON writes them as TOML does."""
    return json.dumps(value, ensure_ascii=False)
