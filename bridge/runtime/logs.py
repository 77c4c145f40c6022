"""Log format: one line of text per record for people, or one JSON object per line for machines.

Messages may contain texts of devices, files and users. Unprintable characters are escaped, so that these texts cannot
move a terminal's cursor or forge a log line. Private keys and password hashes are removed.
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
#: characters of a message; a longer one is cut
LONGEST = 4000
HIDDEN = "(secret)"
_SECRETS = re.compile(
    r"-----BEGIN [A-Z ]*PRIVATE KEY-----.*?(?:-----END [A-Z ]*PRIVATE KEY-----|\Z)|\$argon2[a-z]*\$[^\s'\"]*", re.DOTALL
)


def configure_logging(form: str = TEXT) -> None:
    """Configure logging to standard error, as text or JSON. form: one of FORMATS.

    With JSON, uncaught exceptions are logged too.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter() if form == JSON else TextFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # its notices of fonts and folders are noise
    if form == JSON:
        sys.excepthook = _ended
        threading.excepthook = lambda said: _ended(said.exc_type, said.exc_value, said.exc_traceback)


def printable(text: str) -> str:
    """Return a text fit for one log line: secrets hidden, cut at LONGEST characters, unprintable characters escaped."""
    hidden = _SECRETS.sub(HIDDEN, text)
    cut = hidden if len(hidden) <= LONGEST else f"{hidden[:LONGEST]}…"
    return cut if cut.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in cut)


def printable_lines(text: str) -> str:
    """Return a text of several lines with each line made printable. A secret that spans lines is hidden as a whole."""
    return "\n".join(map(printable, _SECRETS.sub(HIDDEN, text).split("\n")))


class TextFormatter(logging.Formatter):
    """Formats log records as `LEVEL logger: message`; each line of a traceback begins with a bar."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a log record as one line, plus one line for each line of its traceback."""
        lines = [f"{record.levelname} {record.name}: {printable(record.getMessage())}"]
        lines += [f"  | {printable(line)}" for line in _trace(self, record).splitlines()]
        return "\n".join(lines)


class JsonFormatter(logging.Formatter):
    """Formats log records as one JSON object per line, with time (UTC), level, logger, message, and any traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a log record as one line of JSON."""
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
    logging.getLogger("truerate").critical("the program failed", exc_info=(kind, error or kind(), trace))
