"""`truerate bridge scan` on terminals and connections: what is there, and what to do where nothing is."""

import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest

from bridge.cli import scan as cli_scan
from bridge.config.schema import Root, load
from bridge.diagnose.port_probe import Verdict, bauds, examine
from bridge.diagnose.protocol_guess import candidates
from bridge.diagnose.serial_ports import Found
from bridge.drivers import registry
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import VirtualDevice, demo_device
from estimator.cli.main import main
from tests.bridge.diagnose.protocol import KINDS, Talker, lines, only_at
from tests.bridge.drivers.mtdata2_device import item, message, reals
from tests.bridge.drivers.witmotion_device import motion

TRIED = candidates(KINDS)


def scan(port: object, seconds: float = 0.4, speeds: list[int] | None = None) -> Verdict:
    return examine(Found(str(port)), TRIED, speeds or bauds(TRIED), seconds, lambda _: None)


def talking(link: Path, said: bytes, pace: float = 3000.0) -> PtyPort:
    return PtyPort(cast("VirtualDevice", Talker(said, pace)), link)


def what(verdict: Verdict) -> tuple[str, int]:
    assert verdict.guess is not None, verdict.words
    return str(verdict.guess.candidate), verdict.baud


def test_a_device_is_found_and_not_sent_anything(tmp_path: Path) -> None:
    with PtyPort(demo_device("d", 1), tmp_path / "port") as port:
        heard: list[bytes] = []
        port.device.receive = heard.append  # type: ignore[method-assign,assignment]
        verdict = scan(port.link, 1.5)
        assert what(verdict) == ("native", 115_200)
        assert verdict.guess is not None
        assert verdict.guess.rate_hz == pytest.approx(104, rel=0.1)
        assert b"".join(heard) == b""


def test_the_right_speed_is_found(tmp_path: Path) -> None:
    with talking(tmp_path / "port", lines(n=3000), 2500) as port:
        port.byte_fault = cast("Any", only_at(lambda: port, 57_600))
        assert what(scan(port.link)) == ("line", 57_600)
        wrong = scan(port.link, speeds=[9600])
        assert wrong.guess is None
        assert "perhaps a speed other than 9600 (try --baud), or a protocol without a driver" in wrong.words


def test_nothing_and_nonsense_have_their_own_words(tmp_path: Path) -> None:
    with talking(tmp_path / "port", b"") as silent:
        assert "no data at 115200, 57600: switch the device on" in scan(silent.link, 0.1).words
    with talking(tmp_path / "port", b"ax=1 ay=2 az=3\n" * 9) as text:
        assert "text that no driver understands at 115200, such as 'ax=1 ay=2 az=3'" in scan(text.link, 0.2).words
    assert scan(tmp_path / "gone").words.startswith(f"{tmp_path / 'gone'} is missing. Plug the device in")
    (tmp_path / "file").touch()
    assert scan(tmp_path / "file").words.startswith(f"{tmp_path / 'file'} is not a serial port.")


def test_a_port_that_somebody_has_is_left_alone(tmp_path: Path) -> None:
    with talking(tmp_path / "port", lines()) as port:
        hold = "import sys; held = open(sys.argv[1]); print(flush=True); sys.stdin.read()"
        holder = subprocess.Popen(
            [sys.executable, "-c", hold, str(port.link)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        with holder:
            assert holder.stdout is not None
            holder.stdout.readline()
            assert f"(process {holder.pid})" in scan(port.link).words
            holder.kill()


def test_a_capture_is_examined_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "capture").write_bytes(lines("#"))
    assert what(scan(f"file://{tmp_path}/capture?bytes_per_s=1e6", 5.0)) == ("signed #", 0)
    (tmp_path / "capture").write_bytes(bytes(range(256)))
    assert "bytes that no driver understands, such as 00 01 02" in scan(f"file://{tmp_path}/capture").words


@pytest.mark.parametrize(
    ("driver", "frame", "said"),
    [
        ("witmotion", motion(0x53, (1, 2, 3)), "sends no gyro readings"),
        ("mtdata2", message(0x36, reals(0x8030, (1, 0, 0, 0))), "sends no gyro readings"),
        ("mtdata2", message(0x36, item(0xA010, bytes(20))), "sends raw gyro counts"),
        ("mtdata2", message(0x32, bytes(30)), "sends legacy MTData"),
    ],
)
def test_known_frames_without_a_rate_are_named(tmp_path: Path, driver: str, frame: bytes, said: str) -> None:
    (tmp_path / "capture").write_bytes(200 * frame)
    tried = candidates(registry.kinds().values())
    verdict = examine(Found(f"file://{tmp_path}/capture?bytes_per_s=1e6"), tried, bauds(tried), 5.0, lambda _: None)
    assert verdict.guess is None
    assert f"data of {driver}, but no angular rates" in verdict.words
    assert said in verdict.words


def run(*arguments: str) -> int:
    return main(["bridge", "scan", *arguments])


def test_what_is_printed_can_be_pasted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds = {kind.name: kind for kind in KINDS}
    monkeypatch.setattr(registry, "kinds", lambda: kinds)
    (tmp_path / "capture").write_bytes(lines("#"))
    with talking(tmp_path / "odd [name]", lines()) as port:
        capture = f"file://{tmp_path}/capture?bytes_per_s=1e6"
        assert run("--seconds", "0.4", "--port", str(port.link), "--port", capture, "--port", f"{tmp_path}/gone") == 0
        shown, pasted = capsys.readouterr().out.split("For the ward file:\n")
        assert f"{tmp_path}/gone is missing. Plug" in shown
        config = tmp_path / "ward.toml"
        config.write_text(f'ward = "w"\n[bridge]\nid = "b"\n{pasted}')
        bridge = load(config, Root).bridge
    assert bridge is not None
    serial, file = bridge.devices
    assert (serial.driver, serial.options.port, serial.options.baud) == ("line", str(port.link), 115_200)  # type: ignore[attr-defined]
    assert (file.driver, file.options.sign, file.options.port) == ("signed", "#", capture)  # type: ignore[attr-defined]


def test_wrong_use_and_an_empty_machine_are_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli_scan, "find", list)
    assert run() == 1
    assert "No serial port found" in capsys.readouterr().out
    for arguments, said in [
        (("--port", "tcp://here"), "has no port from 1 to 65535"),
        (("--baud", "7"), "baud is 7: use 300 to"),
        (("--seconds", "0"), "--seconds is 0: use 0.1 to 60"),
    ]:
        assert run(*arguments) == 2
        assert said in capsys.readouterr().err
