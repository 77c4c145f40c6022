"""A file that does not fit is refused with its file, table, key and the nearest valid name."""

from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct

from bridge.config.schema import ConfigError, Root, check_endpoints, load
from bridge.drivers import registry
from bridge.drivers.byte_stream import StreamDriver
from bridge.drivers.native import NativeOptions

GOOD = """
ward = "demo"
[bus]
connect = ["tcp/127.0.0.1:7447"]
[bridge]
id = "b1"
batch_ms = 40
[[bridge.devices]]
id = "wrist-01"
driver = "native"
port = "/dev/x"
[[bridge.devices]]
id = "wrist-02"
driver = "replayed"
file = "a.npz"
speed = 2
[estimator]
anything = { goes = true }
"""


def refusal(tmp_path: Path, text: str, kind: type[Any] = Root) -> str:
    path = tmp_path / "ward.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load(path, kind)
    said = str(refused.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    return said.removeprefix(f"{path}: ")


def test_a_good_file_is_typed(tmp_path: Path) -> None:
    path = tmp_path / "ward.toml"
    path.write_text(GOOD)
    root = load(path, Root)
    assert root.bridge is not None
    first, second = root.bridge.devices
    assert (first.id, first.driver, first.options) == ("wrist-01", "native", NativeOptions(port="/dev/x"))
    assert isinstance(first.make(), StreamDriver)
    assert second.driver == "replayed"
    assert root.bridge.batch_ms == 40
    assert root.router.listen == ("tcp/127.0.0.1:7447",)
    assert root.estimator == {"anything": {"goes": True}}


class Knobs(Struct, frozen=True, forbid_unknown_fields=True):
    window_s: float = 1.0


class Typed(Root, frozen=True, forbid_unknown_fields=True, kw_only=True):
    estimator: Knobs = Knobs()


def test_a_root_of_its_own_types_the_estimators_table(tmp_path: Path) -> None:
    path = tmp_path / "ward.toml"
    path.write_text('ward = "w"\n[estimator]\nwindow_s = 2.5\n')
    assert load(path, Typed).estimator.window_s == 2.5
    said = refusal(tmp_path, 'ward = "w"\n[estimator]\nwindows_s = 2.5\n', Typed)
    assert said == "[estimator]: unknown key 'windows_s'; did you mean 'window_s'?"


DEVICE = (
    'ward = "w"\n[bridge]\nid = "b"\n[[bridge.devices]]\nid = "d1"\ndriver = "native"\nport = "p"\n[[bridge.devices]]\n'
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            DEVICE + 'id = "d2"\ndriver = "native"\nprot = "p"',
            "[[bridge.devices]] #2: unknown key 'prot'; did you mean 'port'?",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "natve"',
            "[[bridge.devices]] #2: unknown driver 'natve'; did you mean 'native'?",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = 3',
            f"[[bridge.devices]] #2: unknown driver 3; there are {', '.join(sorted(registry.kinds()))}",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = ["native"]',
            "[[bridge.devices]] #2: unknown driver ['native']; did you mean 'native'?",
        ),
        (DEVICE + 'id = "d2"\ndriver = "native"', "[[bridge.devices]] #2: the key 'port' is missing: add it"),
        (DEVICE + 'driver = "native"', "[[bridge.devices]] #2: the key 'id' is missing: add it"),
        (
            DEVICE + 'id = "d2"\ndriver = "native"\nport = "p"\nbaud = "fast"',
            "[[bridge.devices]] #2: key 'baud': expected a whole number, got text in quotes",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "simulated"\nspeed = 0',
            "[[bridge.devices]] #2: speed is 0: use 0.01 to 100",
        ),
        (DEVICE + 'id = "d1"\ndriver = "simulated"', "[bridge]: devices #1 and #2 have the same id 'd1': rename one"),
        ('ward = "w"\n[brigde]', "unknown key 'brigde'; did you mean 'bridge'?"),
        ('[bridge]\nid = "b"', "the key 'ward' is missing: add it"),
        (
            'ward = "w"\n[devices]\nenrolled = ["a"]\nfile = "more.txt"',
            "[devices]: unknown key 'file'; list the ids in `enrolled`: a change of the ward file takes effect at once",
        ),
        (
            'ward = "w"\n[bridge]\nid = "b"\nbatch_ms = "5"',
            "[bridge]: key 'batch_ms': expected a number, got text in quotes",
        ),
        ('ward = "w"\n[bridge]\nid = "b"\nbatch_ms = 1', "[bridge]: batch_ms is 1: use 5 to 1000 milliseconds"),
        ('ward = "w"\nbridge = 3', "key 'bridge': expected a table, got a whole number"),
        (
            'ward = "w"\n[bus]\nconnect = ["tcp/a:1", 2]',
            "[bus]: key 'connect' #2: expected text in quotes, got a whole number",
        ),
        ('ward = "w"\n[bus]\nconnect = []', "[bus]: connect needs at least one endpoint, such as 'tcp/127.0.0.1:7447'"),
        (
            'ward = "w"\n[bus]\nconnect = ["local"]',
            "[bus]: connect: 'local' is not an endpoint: write PROTOCOL/HOST:PORT, such as 'tcp/127.0.0.1:7447'",
        ),
        (
            'ward = "w"\n[bus]\nconnect = ["tpc/127.0.0.1:7447"]',
            "[bus]: connect: 'tpc/127.0.0.1:7447': unknown protocol 'tpc'; did you mean 'tcp'?",
        ),
        (
            'ward = "w"\n[bus]\nconnect = ["tcp/127.0.0.1:99999"]',
            "[bus]: connect: 'tcp/127.0.0.1:99999': invalid port 99999: use 1 to 65535",
        ),
        (
            'ward = "w"\n[router]\nlisten = ["tcp/0.0.0.0"]',
            "[router]: listen: 'tcp/0.0.0.0' has no port: write PROTOCOL/HOST:PORT, such as 'tcp/127.0.0.1:7447'",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "native"\nport = "p"',
            "[bridge]: devices 'd1' and 'd2' have the same port 'p': give each device its own port",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "native"\nport = "q"\nbaud = -9600',
            "[[bridge.devices]] #2: baud is -9600: use 300 to 4000000, usually 115200",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "native"\nport = ""',
            "[[bridge.devices]] #2: port is empty: name one; `truerate bridge scan` lists the connected devices",
        ),
        (
            'ward = "w"\n[bridge]\nid = "b"\n[bridge.devices]\nid = "x"',
            "[bridge]: key 'devices': expected a list, got a table",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "simulated"\nlife = "nope"',
            "[[bridge.devices]] #2: key 'life': unknown value 'nope'; there are lively, ward",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "simulated"\nlife = "livly"',
            "[[bridge.devices]] #2: key 'life': unknown value 'livly'; did you mean 'lively'?",
        ),
        (
            DEVICE + 'id = "d2"\ndriver = "replayed"\nfile = "p"\nrate_hz = nan',
            "[[bridge.devices]] #2: rate_hz is nan: use a number above 0, up to 10000",
        ),
        ('ward = "w"\n[bridge]\nid = "b"\ndevices = [3]', "[[bridge.devices]] #1: expected a table, got int"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(tmp_path: Path, text: str, said: str) -> None:
    assert refusal(tmp_path, text) == said


@pytest.mark.parametrize("bad", ['"Ward 3"', '"a/b"', '"*"', '""', '"' + "a" * 33 + '"'])
def test_a_bad_id_is_refused_and_says_what_one_looks_like(tmp_path: Path, bad: str) -> None:
    assert "begin" in refusal(tmp_path, f"ward = {bad}")
    assert refusal(tmp_path, f'ward = "w"\n[bridge]\nid = {bad}').startswith("[bridge]: id ")
    assert refusal(tmp_path, DEVICE + f'id = {bad}\ndriver = "native"').startswith("[[bridge.devices]] #2: id ")


def test_a_mark_that_an_editor_put_before_the_text_is_no_fault(tmp_path: Path) -> None:
    marked = tmp_path / "marked.toml"
    marked.write_bytes(b'\xef\xbb\xbfward = "w"\r\n')
    assert load(marked, Root).ward == "w"


def test_a_file_that_cannot_be_read_says_so(tmp_path: Path) -> None:
    assert "line 2" in refusal(tmp_path, 'ward = "w"\nbus = = 3')
    for odd in (f"ward = {'1' * 5000}", f"ward = {'[' * 3000}"):
        assert refusal(tmp_path, odd).startswith("not TOML: ")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\0")
    (tmp_path / "latin.toml").write_bytes("ward = 'w'\n# Kücke\n".encode("latin-1"))
    for path, said in [
        (tmp_path / "none.toml", "no such file"),
        (tmp_path, "a folder, but a file is expected"),
        (tmp_path / "binary.toml", "line 1 is not UTF-8 text: save the file as UTF-8"),
        (tmp_path / "latin.toml", "line 2 is not UTF-8 text"),
    ]:
        with pytest.raises(ConfigError, match=said) as refused:
            load(path, Root)
        assert "Errno" not in str(refused.value)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tls/router.ward:7447", "quic/a:1", "ws/a:1", "udp/a:1",
        "tcp/10.0.0.5:7447#iface=eth0", "tcp/a:1?prio=1-3", "unixsock-stream/run/truerate.sock",
    ],
)  # fmt: skip
def test_every_kind_of_endpoint_is_taken(endpoint: str) -> None:
    assert check_endpoints([endpoint], "connect") == (endpoint,)


def test_two_names_of_one_serial_port_are_one_port(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    devices = [
        f'[[bridge.devices]]\nid = "{name}"\ndriver = "native"\nport = "{tmp_path / name}"'
        for name in ("by-id", "ttyusb0")
    ]
    path = tmp_path / "w.toml"
    path.write_text("\n".join(['ward = "w"\n[bridge]\nid = "b"', *devices]).replace("/ttyusb0", "/ttyUSB0"))
    with pytest.raises(ConfigError, match="devices 'by-id' and 'ttyusb0' have the same port"):
        load(path, Root)
