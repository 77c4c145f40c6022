"""An address that is none is refused at the door, with one that is."""

import time
from pathlib import Path

import pytest

from bridge.drivers.byte_stream import StreamOptions
from bridge.transport import address, ble_port, file_port, tcp_port, udp_port
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.file_port import FilePort


@pytest.mark.parametrize(
    ("port", "said"),
    [
        ("tcp://10.0.0.5", "'10.0.0.5' has no port from 1 to 65535: write for example 'tcp://10.0.0.5:8000'"),
        ("tcp://10.0.0.5:0", "has no port from 1 to 65535"),
        ("tcp://10.0.0.5:70000", "has no port from 1 to 65535"),
        ("tcp://:8000", "has no host"),
        ("tcp://", "has no port"),
        ("tcp://fe80::1:8000", r"put an IPv6 address in brackets: \[fe80::1\]:8000"),
        ("tcp://a b:8000", "has no host"),
        ("tcp://a:8000/path", "has no port"),
        ("tcp://a:8000?from=b", "unknown option 'from'; there are none"),
        ("udp://:8000?form=b", "unknown option 'form'; did you mean 'from'?"),
        ("udp://:8000?from=", "is not a host"),
        ("udp://:8000?from", "write name=value after '\\?'"),
        ("udp://:8000?from=a&from=b", "an option is given twice"),
        ("file://", "names no file: write for example 'file:///"),
        ("file:///a?bytes_per_s=0", "bytes_per_s is '0': use 1 to 1e\\+09"),
        ("file:///a?bytes_per_s=fast", "bytes_per_s is 'fast'"),
        ("usb://a", "unknown scheme 'usb'; "),
        ("tpc://a:1", "did you mean 'tcp'"),
        ("", "port is empty"),
    ],
)
def test_an_address_that_is_none_says_what_one_is(port: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        StreamOptions(port=port)


@pytest.mark.parametrize(
    "port",
    [
        *(kind.EXAMPLE for kind in (tcp_port, udp_port, file_port, ble_port)),
        "tcp://wrist-1.local:8000",
        "tcp://[fe80::1%eth0]:8000",
        "udp://[::]:8000?from=[fe80::1]",
        "udp://0.0.0.0:8000",
        "file://captures/with%20space.bin?bytes_per_s=3000",
        "/dev/ttyUSB0",
    ],
)
def test_an_address_is_taken(port: str) -> None:
    assert StreamOptions(port=port).port == port
    assert address.transport(port, 9600).place == port


def played(port: FilePort) -> tuple[bytes, DeviceLost]:
    data = b""
    while True:
        try:
            data += port.read(0.1).data
        except DeviceLost as lost:
            return data, lost


def test_a_capture_is_played_to_its_end_each_time(tmp_path: Path) -> None:
    sent = bytes(range(256)) * 200
    path = tmp_path / "with space.bin"
    path.write_bytes(sent)
    port = FilePort(f"{str(path).replace(' ', '%20')}?bytes_per_s=1e9", 9600)
    for _ in range(2):
        port.open()
        port.write(b"nobody hears it")
        data, lost = played(port)
        assert data == sent
        assert lost.over
        assert "has ended" in str(lost)
        port.close()
    with pytest.raises(DeviceLost, match="closed"):
        port.read(0.1)


def test_a_capture_comes_at_the_speed_of_its_line(tmp_path: Path) -> None:
    path = tmp_path / "capture"
    path.write_bytes(bytes(100_000))
    for address_of, pace in ((str(path), 960.0), (f"{path}?bytes_per_s=1e6", 1e6)):
        began, port, got = time.monotonic(), FilePort(address_of, 9600), 0
        port.open()
        for _ in range(3):
            got += len(port.read(0.1).data)
        port.close()
        # A read waits for 10 ms, and longer where the machine is busy.
        assert 0.02 * pace < got <= pace * (time.monotonic() - began)


def test_a_capture_that_is_not_there_says_so(tmp_path: Path) -> None:
    for path, said in [
        (tmp_path / "none", "there is no such file"),
        (tmp_path, "a folder, but a file is expected"),
    ]:
        assert address.state(f"file://{path}") == said
        with pytest.raises(DeviceUnavailable, match=said):
            FilePort(str(path), 9600).open()
