"""Texts that are SQL, paths, markup or a terminal's commands: kept as texts where they may be any, refused where they are ids."""

import io
from pathlib import Path

import pytest

from bridge.terminal.console import plain_console
from bridge.wire import codec, keys
from bridge.wire import truerate_pb2 as wire
from bridge.wire.messages import Command
from bridge.wire.refusal import Reason, Refusal
from estimator.cli.main import main
from estimator.reports import history as report_history
from estimator.service import history
from estimator.service.store import Store
from tests.bridge.wire.test_keys import HOSTILE
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, info

SQL = ["'; DROP TABLE audit; --", '" OR "1"="1', "a' UNION SELECT payload FROM calibrations --", "?1", ":x", "%", "\\"]
MARKUP = [
    "[bold]x[/bold]",
    "[/x]",
    ":smile:",
    "<script>alert(1)</script>",
    "{{7*7}}",
    "%s%n",
    "$(reboot)",
    "`id`",
    "../../x",
]
UNSEEN = ["a\nb", "\x1b[2J", "\x1b]0;x\x07", "a\rb", "a\x00b", "\u2028", "\u202e", "\x9b31m"]


def test_what_people_write_is_kept_and_shown_as_they_wrote_it(ward: Ward, once: Stream) -> None:
    ward.send(once.batches()[:20], info(1))
    texts = [*SQL, *MARKUP]
    for text in texts:
        assert ward.command(lambda text=text: ward.client.note(NAME, text, text)).accepted  # type: ignore[misc] # asked now
    rows = ward.store.database.rows("audit")
    assert [(row["who"], row["reason"]) for row in rows] == [(text, text) for text in texts]
    assert {row["device"] for row in rows} == {NAME}
    shown = io.StringIO()
    console = plain_console()
    console.file = shown
    console.width = 400
    for table in report_history.as_tables(history.read(ward.store, NAME)):
        console.print(table)
    for text in texts:
        assert text in shown.getvalue()


@pytest.mark.parametrize("text", UNSEEN, ids=ascii)
@pytest.mark.parametrize("field", ["request_id", "who", "reason"])
def test_what_cannot_be_seen_is_no_command(text: str, field: str) -> None:
    said = wire.Command(version=1, request_id="r", who="nurse", reason="x")
    setattr(said, field, text)
    with pytest.raises(Refusal) as refused:
        codec.decode_command(keys.build("w", "rpc", device=NAME, verb="note"), said.SerializeToString())
    assert refused.value.reason is Reason.MALFORMED
    sent = codec.decode_command(
        keys.build("w", "rpc", device=NAME, verb="note"),
        codec.encode_command(Command("r", "n", text) if field != "who" else Command("r", text, "x")),
    )
    assert (sent.who + sent.reason).isprintable(), "nor do we send it"


@pytest.mark.parametrize("text", [*HOSTILE, *SQL, *MARKUP], ids=lambda text: ascii(text[:12]))
def test_a_hostile_id_names_no_file_and_no_row(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if text.startswith("-") or "\ud800" in text or "\0" in text:
        text = f"x{text[:5]}'"  # no argument of a command line
    store = tmp_path / "s.sqlite3"
    Store(store).close()
    before = sorted(tmp_path.rglob("*"))
    for words in (
        ["history", text, "--store", str(store)],
        ["recalibrate", text],
        ["note", text, "x"],
        ["watch", text],
    ):
        assert main(words) == 2
        said = capsys.readouterr()
        assert all(line.isprintable() for line in (said.out + said.err).split("\n"))
    assert sorted(tmp_path.rglob("*")) == before
