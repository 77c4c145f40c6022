"""What the programs log: a line for people, or a JSON object a line for machines. Nothing that was said makes a line of its own.

Texts of devices, files and people stand in messages. What cannot be printed is written as an escape, so that no text moves a
terminal's cursor or begins a line that looks like ours. Keys and password hashes are left out, wherever they came from.
"""

import json
import logging
import re
import sys
import threading
from datetime import UTC, datetime
from types import TracebackType

TEXT, JSON = "text", "json"
FORMATS = (TEXT, JSON)
#: of a message; what is longer is cut
LONGEST = 4000
HIDDEN = "(secret)"
_SECRETS = re.compile(
    r"-----BEGIN [A-Z ]*PRIVATE KEY-----.*?(?:-----END [A-Z ]*PRIVATE KEY-----|\Z)|\$argon2[a-z]*\$[^\s'\"]*", re.DOTALL
)


def configure_logging(form: str = TEXT) -> None:
    """Log to standard error from now on, in this form; also what ends a thread or the program."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter() if form == JSON else TextFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # of fonts and folders of its own, which nobody asked about
    if form == JSON:
        sys.excepthook = _ended
        threading.excepthook = lambda said: _ended(said.exc_type, said.exc_value, said.exc_traceback)


def printable(text: str) -> str:
    """The text on one line, with escapes for what would not be seen as it is."""
    hidden = _SECRETS.sub(HIDDEN, text)
    cut = hidden if len(hidden) <= LONGEST else f"{hidden[:LONGEST]}…"
    return cut if cut.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in cut)


def printable_lines(text: str) -> str:
    """The same, each line by itself; a key is many lines, and left out whole."""
    return "\n".join(map(printable, _SECRETS.sub(HIDDEN, text).split("\n")))


class TextFormatter(logging.Formatter):
    """`LEVEL where: message`; lines of a traceback begin with a bar."""

    def format(self, record: logging.LogRecord) -> str:
        """One line, and one for each of the traceback."""
        lines = [f"{record.levelname} {record.name}: {printable(record.getMessage())}"]
        lines += [f"  | {printable(line)}" for line in _trace(self, record).splitlines()]
        return "\n".join(lines)


class JsonFormatter(logging.Formatter):
    """A JSON object a line: time, level, logger, message, and trace where there is one."""

    def format(self, record: logging.LogRecord) -> str:
        """One line."""
        said = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": printable(record.getMessage()),
        }
        if trace := _trace(self, record):
            said["trace"] = _SECRETS.sub(HIDDEN, trace)
        return json.dumps(said)


def _trace(formatter: logging.Formatter, record: logging.LogRecord) -> str:
    parts = [formatter.formatException(record.exc_info)] if record.exc_info and record.exc_info[0] else []
    return "\n".join(_SECRETS.sub(HIDDEN, part) for part in [*parts, *filter(None, [record.stack_info])])


def _ended(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
    logging.getLogger("truerate").critical("it failed", exc_info=(kind, error or kind(), trace))
