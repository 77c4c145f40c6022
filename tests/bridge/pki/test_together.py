"""A ward's file says who a program is; what does not fit is said before anybody is asked, across files too."""

from collections.abc import Callable
from contextlib import nullcontext
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest

from bridge.bus import router_file
from bridge.config.schema import Bus
from bridge.pki.authority import issue
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from estimator.cli.main import main

TEXT = """
ward = "w"
[bus]
connect = ["tls/127.0.0.1:7447"]
ca = "{pki}/ca.pem"
certificate = "{pki}/{who}.pem"
key = "{pki}/{who}.key"
"""
BRIDGE = """
[bridge]
id = "b1"
[[bridge.devices]]
id = "{device}"
driver = "simulated"
"""
ESTIMATOR = """
[estimator]
id = "e1"
"""


class Files:
    """An authority with members, a router's file, and the files of two machines."""

    def __init__(self, path: Path) -> None:
        self.pki = Folder(path / "pki")
        self.pki.make("w", utc_now())
        router = Member.parse("router:r")
        self.pki.issue(router, utc_now(), hosts=("127.0.0.1",))
        for who in ("bridge:b1", "estimator:e1", "viewer:hall", "bridge:b2"):
            self.pki.issue(Member.parse(who), utc_now())
        self.router, self.one, self.two = (path / name for name in ("router.json5", "one.toml", "two.toml"))
        places = [("w", Member.parse(who)) for who in ("bridge:b1", "estimator:e1", "viewer:hall")]
        self.pki.admit(router, [who for _, who in places])
        settings = router_file.guarded(["tls/0.0.0.0:7447"], self.pki.gate(router), places)
        self.router.write_text(router_file.rendered(settings, "a router"), "utf-8")
        self.write("bridge.b1", "estimator.e1")

    def write(self, one: str, two: str, *, device: str = "d1", more: str = "") -> None:
        self.one.write_text(TEXT.format(pki=self.pki.path, who=one) + BRIDGE.format(device=device), "utf-8")
        self.two.write_text(TEXT.format(pki=self.pki.path, who=two) + ESTIMATOR + more, "utf-8")

    def check(self) -> int:
        return main(["config", "check", str(self.one), str(self.two), str(self.router)])


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def test_files_that_go_together_are_right(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    assert files.check() == 0
    assert capsys.readouterr().out.count(": valid.") == 3


def another_bridge(files: Files) -> None:
    files.write("bridge.b2", "estimator.e1")


def a_viewers(files: Files) -> None:
    files.write("bridge.b1", "router.r")


def another_port(files: Files) -> None:
    files.two.write_text(files.two.read_text().replace(":7447", ":7448"))


def one_device_twice(files: Files) -> None:
    files.write("bridge.b1", "estimator.e1", more=BRIDGE.format(device="d1").replace("b1", "b7"))


def other_knobs(files: Files) -> None:
    files.write("bridge.b1", "estimator.e1")
    text = ESTIMATOR.replace("e1", "e2") + "silence_s = 5.0\n"
    files.one.write_text(files.one.read_text("utf-8") + text, "utf-8")


def other_devices(files: Files) -> None:
    other_knobs(files)
    text = files.one.read_text("utf-8").replace("silence_s = 5.0\n", "")
    files.one.write_text(text + '[devices]\nenrolled = ["b1/d1", "d2"]\n', "utf-8")
    files.two.write_text(files.two.read_text("utf-8") + '[devices]\nenrolled = ["d1", "d2"]\n', "utf-8")


def by_another_name(files: Files) -> None:
    files.two.write_text(files.two.read_text().replace("tls/127.0.0.1", "tls/localhost"))


def expired(files: Files) -> None:
    here = files.pki.path
    b1, key, day = Member.parse("bridge:b1"), (here / "bridge.b1.key").read_bytes(), timedelta(days=1)
    pair = issue(files.pki.issuer(b1), b1, utc_now() - 2 * day, utc_now() - day, key=key)
    (here / "bridge.b1.pem").write_bytes(pair.certificate)


def not_let_in(files: Files) -> None:
    files.pki.admit(Member.parse("router:r"), [Member.parse("estimator:e1")])


def one_of_its_two_files(files: Files) -> None:
    """After a revocation the rules alone were copied to the router's machine."""
    files.pki.revoke(Member.parse("bridge:b1"), utc_now(), "")
    files.router.write_text(files.router.read_text("utf-8").replace('"bridge:b1', '"bridge:b1:2'), "utf-8")


def a_key_for_all(files: Files) -> None:
    (files.pki.path / "bridge.b1.key").chmod(0o644)


def unknown(files: Files) -> None:
    files.router.write_text(
        files.router.read_text().replace("bridge:b1", "bridge:b9").replace("bridge/b1", "bridge/b9")
    )


def another_ward(files: Files) -> None:
    files.one.write_text(files.one.read_text("utf-8").replace('ward = "w"', 'ward = "w2"'), "utf-8")


def own_for_authority(files: Files) -> None:
    files.one.write_text(files.one.read_text("utf-8").replace("ca.pem", "bridge.b1.pem"), "utf-8")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (another_bridge, "is for bridge:b2, but this program needs a certificate for bridge:b1"),
        (a_viewers, "for router:r, but this program is a"),
        (another_port, "no router listens at tls/127.0.0.1:7448; use tls/0.0.0.0:7447"),
        (one_device_twice, "device 'd1' of ward 'w' is in"),
        (other_knobs, "[estimator] silence_s differs from"),
        (other_devices, "[devices] differs from"),
        (by_another_name, "the router's certificate names only 127.0.0.1"),
        (expired, "expired on"),
        (a_key_for_all, "chmod 600"),
        (unknown, "ROUTER has no rules for bridge:b1 in ward 'w'"),
        (another_ward, "has no rules for bridge:b1 in ward 'w2' (only rules for bridge:b1 in ward w)"),
        (own_for_authority, "the certificate of 'bridge:b1' is not an authority's"),
        (not_let_in, "refuses bridge:b1, viewer:hall, although access rules name them"),
        (one_of_its_two_files, "accepts bridge:b1, but has no access rules for them"),
        (one_of_its_two_files, "refuses bridge:b1:2, although access rules name them"),
    ],
)
def test_what_does_not_go_together_is_said(
    wrong: Callable[[Files], None], words: str, files: Files, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong(files)
    assert files.check() == 2
    words = words.replace("ROUTER", str(files.router)).replace("ONE", str(files.one))
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"connect": ("tls/10.0.0.5:7447",)}, "needs pki, or ca, certificate and key"),
        ({"connect": ("tls/10.0.0.5:7447",), "ca": "a", "key": "b"}, "certificate missing"),
        ({"connect": ("tcp/10.0.0.5:7447",), "ca": "a", "key": "b", "certificate": "c"}, "uses no certificate"),
    ],
)
def test_a_bus_table_is_whole_or_refused(given: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Bus(**given)  # type: ignore[arg-type]


def test_a_role_that_would_be_denied_silently_says_so_itself(
    files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    files.write("viewer.hall", "viewer.hall")
    session = tmp_path / "session.csv"
    session.write_text("t_s,gx_dps,gy_dps,gz_dps\n" + "".join(f"{n / 100},0,0,0\n" for n in range(50)))
    for arguments, needed in (
        (["bridge", "run", str(files.one)], "needs a certificate for bridge:b1"),
        (["estimator", "serve", str(files.two)], "needs a certificate for estimator:e1"),
        (["recalibrate", "d1", "--config", str(files.one)], "needs a certificate for commander"),
        (["note", "d1", "sat up", "--config", str(files.one)], "needs a certificate for commander"),
        (["record", "--config", str(files.one)], "needs a certificate for recorder"),
        (
            ["bridge", "replay", str(session), "--device", "d1", "--config", str(files.one)],
            "for bridge:replay-d1",
        ),
    ):
        assert main(arguments) == 2
        assert needed in capsys.readouterr().err
    assert not (tmp_path / "truerate.sqlite3").exists(), "who may not serve leaves no store behind"


def test_the_second_of_two_routers_is_to_know_everybody_too(
    files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    second, router = tmp_path / "second.json5", Member.parse("router:r2")
    files.pki.issue(router, utc_now(), hosts=("127.0.0.2",))
    files.one.write_text(files.one.read_text().replace(":7447", ':7447", "tls/127.0.0.2:7447'))
    for known in (["bridge:b1", "estimator:e1"], ["estimator:e1"]):
        members = [Member.parse(who) for who in known]
        files.pki.admit(router, members)
        places = [("w", member) for member in members]
        settings = router_file.guarded(["tls/0.0.0.0:7447"], files.pki.gate(router), places, ["tls/127.0.0.1:7447"])
        second.write_text(router_file.rendered(settings, "a router"), "utf-8")
        assert main(["config", "check", *map(str, (files.one, files.router, second))]) == (0 if len(known) == 2 else 2)
    assert f"{second} has no rules for bridge:b1 in ward 'w'" in capsys.readouterr().err


def test_a_port_that_is_there_twice_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ward = tmp_path / "ward.toml"
    ward.write_text('ward = "w"\n[bus]\nconnect = ["tcp/127.0.0.1:1", "tcp/127.0.0.1:1"]\n', "utf-8")
    assert main(["config", "check", str(ward)]) == 2
    assert "'tcp/127.0.0.1:1' is listed twice" in capsys.readouterr().err
    ward.write_text('ward = "w"\n[estimator]\nid = "e"\nhealth = "127.0.0.1:8090"\n', "utf-8")
    assert main(["config", "check", str(ward)]) == 2
    assert "and the dashboard's listen is '127.0.0.1:8090'" in capsys.readouterr().err


def test_a_router_that_others_reach_without_a_certificate_is_said(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ward = tmp_path / "ward.toml"
    words = "tcp/0.0.0.0:7447: every machine in reach can read and command the ward"
    ward.write_text('ward = "w"\n[router]\nlisten = ["tcp/0.0.0.0:7447"]\n', "utf-8")
    assert main(["config", "check", str(ward)]) == 2
    assert words in capsys.readouterr().err
    monkeypatch.setattr("bridge.cli.router.Router", lambda *_, **__: nullcontext(SimpleNamespace(listen=())))
    monkeypatch.setattr(
        "bridge.cli.router.stopped_by_signal", lambda: nullcontext(SimpleNamespace(wait=lambda _: True))
    )
    for how in (["--config", str(ward)], ["--listen", "tcp/0.0.0.0:7447"]):
        caplog.clear()
        assert main(["router", *how]) == 0
        assert words in caplog.text
    caplog.clear()
    assert main(["router"]) == 0
    assert "read and command" not in caplog.text
