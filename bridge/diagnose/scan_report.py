"""Report of a port scan: a table for the terminal, and TOML to paste into the ward file. No I/O."""

import itertools
import json
from collections.abc import Container, Iterable, Sequence

from bridge.diagnose.port_probe import Verdict
from bridge.terminal.tables import Column, Columns

_COLUMNS = (
    Column("port", least=14),
    Column("USB", spare=1),
    Column("protocol", least=10),
    Column("model"),
    Column("rate", number=True),
)


def table(verdicts: Iterable[Verdict]) -> Columns:
    """Build the terminal table of a scan, with one row per port: port, USB device, protocol, model, sample rate in Hz."""
    made = Columns(_COLUMNS)
    for verdict in verdicts:
        guess = verdict.guess
        if guess is None:
            made.add(*verdict.found, "–")
            continue
        model = f"{guess.identity.model} {guess.identity.firmware}".strip() if guess.identity else ""
        made.add(*verdict.found, str(guess.candidate), model, f"{guess.rate_hz:.0f} Hz")
    return made


def snippet(verdicts: Sequence[Verdict], taken: Container[str] = ()) -> str:
    """Return the [[bridge.devices]] tables (TOML) of the recognised devices; "" if there are none.

    The device ids are `device-1`, `device-2` and so on, without those in `taken`. taken: device ids already in use.
    """
    blocks = []
    free = (name for name in (f"device-{number}" for number in itertools.count(1)) if name not in taken)
    for verdict in verdicts:
        if verdict.guess is None:
            continue
        candidate = verdict.guess.candidate
        values = {"driver": candidate.kind.name, "port": verdict.found.port, **candidate.table}
        if "rate_hz" in values:
            values["rate_hz"] = round(verdict.guess.rate_hz)  # as counted
        if verdict.baud:
            values["baud"] = verdict.baud
        lines = [
            f'id = "{next(free)}"    # the name on its label',
            *(f"{k} = {_toml(v)}" for k, v in values.items()),
        ]
        blocks.append("\n".join(["[[bridge.devices]]", *lines]))
    return "\n\n".join(blocks)


def _toml(value: object) -> str:
    """A string, number or boolean as TOML; JSON writes these the same way."""
    return json.dumps(value, ensure_ascii=False)
