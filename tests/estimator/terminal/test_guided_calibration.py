"""`truerate calibrate --live`: the guide as lines, in a ward in memory."""

import io
import threading
from collections.abc import Callable

import pytest
from rich.console import Console

from bridge.sim.motion import Piece, Still
from estimator.cli.main import main
from estimator.client import Client
from estimator.language.texts import texts
from estimator.overview import ward
from estimator.terminal import guided_calibration
from estimator.terminal.guided_calibration import calibrate
from tests.estimator.stream import NAME
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.web.played import Played
from tests.web.talk import WARD, Talk, about, until
from tests.web.test_guide import rests_between, turn


def terminal() -> tuple[Console, io.StringIO]:
    file = io.StringIO()
    return Console(file=file, width=100), file


def guided(pieces: list[Piece], language: str = "en", reads: dict[int, str] | None = None) -> tuple[int, str]:
    """What is printed while a hand does its pieces, and the exit code; after some pieces the hand first reads these words."""
    broker = MemoryBroker()
    talk = Talk(broker)
    played = Played(talk)
    played.switch_on(pieces)
    console, file = terminal()
    bus = MemoryBus(broker)
    found: list[int] = []

    def run() -> None:
        with Client(ward=WARD, bus=bus) as client:
            found.append(calibrate(console, client, NAME, "nurse", texts(language), seconds=60.0))

    thread = threading.Thread(target=run)
    thread.start()
    for piece, words in (reads or {}).items():
        played.play_piece(piece)
        until(lambda words=words: words in file.getvalue())  # type: ignore[misc]
    played.play_piece(len(pieces) - 1)
    played.play(2.0)
    thread.join(60)
    talk.close()
    return found[0], file.getvalue()


def test_it_follows_the_hand_to_the_verdict() -> None:
    reads = {0: "Turn it round once, flat", 4: "Again: roll it over"}
    code, printed = guided(rests_between(turn(2), turn(0, 180.0), turn(0), turn(1)), reads=reads)
    assert code == 0
    for words in ("Put it at the edge of the table, and let go", "Turn the device once all the way round."):
        assert words in printed
    assert printed.index("Turn it round once, flat") < printed.index("Again: roll it over") < printed.index("Done:")
    assert "scale ± 95 %" in printed


def test_it_says_it_in_chinese() -> None:
    code, printed = guided(rests_between(turn(2), turn(0), turn(1)), "zh")
    assert code == 0
    assert "完成：设备已校准" in printed


def test_what_somebody_else_asked_for_goes_on_and_that_is_said() -> None:
    broker = MemoryBroker()
    talk = Talk(broker)
    Played(talk).switch_on([Still(3.0)])
    console, file = terminal()
    with Client(ward=WARD, bus=MemoryBus(broker)) as client:
        assert calibrate(console, client, NAME, "nurse", texts("en"), seconds=1.0) == 1
    assert talk.asked == []
    talk.close()
    said = file.getvalue().splitlines()[-1]
    assert said == f"Given up after 1 s. The calibration goes on; `truerate cancel chest --ward {WARD}` stops it."


def test_a_device_nobody_hears_of() -> None:
    console, file = terminal()
    with Client(ward=WARD, bus=MemoryBus(MemoryBroker())) as client:
        assert calibrate(console, client, "nobody", "nurse", texts("en"), seconds=0.2) == 1
    assert "Nothing is heard of it" in file.getvalue()


@pytest.mark.parametrize("gone", [Talk.die, Talk.hush])
def test_what_the_ward_cannot_hear_is_no_fault_of_the_device(
    gone: Callable[[Talk], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Estimator and bridge are gone, or nothing is said any more."""
    broker = MemoryBroker()
    talk = Talk(broker)
    played = Played(talk)
    played.switch_on([Still(3.0)])
    console, file = terminal()
    monkeypatch.setattr(ward, "SILENT_S", 0.5)
    threading.Timer(0.5, gone, (talk,)).start()
    with Client(ward=WARD, bus=MemoryBus(broker)) as client:
        assert calibrate(console, client, NAME, "nurse", texts("en"), seconds=4.5) == 1
    talk.close()
    said = file.getvalue()
    assert said.index("Put it at the edge of the table") < said.index("The ward's computer does not answer")
    assert "The device is well" in said


def test_a_name_that_is_mistyped_is_answered_by_those_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guided_calibration, "MISNAMED_S", 0.2)
    broker = MemoryBroker()
    talk = Talk(broker)
    talk(about("chest", boot=1), about("ankle", boot=1))
    console, file = terminal()
    with Client(ward=WARD, bus=MemoryBus(broker)) as client:
        assert calibrate(console, client, "chset", "nurse", texts("en"), seconds=3.0) == 1
    talk.close()
    assert file.getvalue().count("No device chset was heard; there are: ankle, chest.") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["calibrate"], "give a file, or --live DEVICE"),
        (["calibrate", "a.npz", "--live", "chest"], "omit one of the two"),
    ],
)
def test_it_says_how_to_use_it(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err
