"""What a router says of its files before it listens, and by whom it goes."""

from contextlib import nullcontext
from pathlib import Path
from typing import Self

import pytest

from bridge.pki.folder import Folder, utc_now
from bridge.pki.identity import certificates, common_name, verified
from bridge.pki.member import Member
from estimator.cli import main
from tests.bridge.pki.office import B1, DAY, run


def test_a_router_whose_key_everybody_may_read_does_not_start(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    capsys.readouterr()
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:1") == 0
    (pki / "router.json5").write_text(capsys.readouterr().out)
    (pki / "router.r.key").chmod(0o644)
    assert main(["router", "--config", str(pki / "router.json5")]) == 1
    assert "chmod 600" in capsys.readouterr().err


def test_a_router_by_whose_files_nobody_could_be_let_in_says_so_instead_of_listening(
    pki: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, router = Folder(pki), Member.parse("router:r")
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    capsys.readouterr()
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:1") == 0
    file, text = pki / "router.json5", capsys.readouterr().out
    for wrong, words in (
        (("router.r.pem", "bridge.b1.pem"), "for bridge:b1, where a router is to be run"),
        (("r.members", "x"), "x.pem: there"),
    ):
        file.write_text(text.replace(*wrong))
        assert main(["router", "--config", str(file)]) == 1
        assert words in capsys.readouterr().err
    file.write_text(text)
    folder.renew(router, utc_now(), days=0)
    assert main(["router", "--config", str(file)]) == 1
    assert "expired on" in capsys.readouterr().err
    ward = pki / "ward.toml"
    files = folder.identity(B1)
    ward.write_text(
        f'ward = "w"\n[bus]\nconnect = ["tls/localhost:7447"]\nca = "{files.ca}"\n'
        f'certificate = "{files.certificate}"\nkey = "{files.key}"\n'
    )
    assert main(["router", "--config", str(ward)]) == 2
    assert "which this one would not: `truerate pki router` writes" in capsys.readouterr().err


def test_a_router_says_what_is_unsafe_in_its_file_and_when_its_certificate_ends(
    pki: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, router = Folder(pki), Member.parse("router:r")
    folder.issue(router, utc_now() - 87 * DAY, 90, ("localhost",))
    capsys.readouterr()
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:1") == 0
    file = pki / "router.json5"
    file.write_text(capsys.readouterr().out.replace('"deny"', '"allow"'))

    class Listening:
        listen = ("tls/127.0.0.1:1",)

        def __enter__(self) -> Self:
            folder.renew(router, utc_now())  # of which a router that runs knows nothing
            return self

        def __exit__(self, *_: object) -> None: ...

    looked: list[float] = []

    class Stop:
        def wait(self, timeout_s: float) -> bool:
            looked.append(timeout_s)
            return len(looked) == 2

    monkeypatch.setattr("bridge.cli_router.Router.of_file", lambda _: Listening())
    monkeypatch.setattr("bridge.cli_router.stopped_by_signal", lambda: nullcontext(Stop()))
    assert main(["router", "--config", str(file)]) == 0
    assert caplog.text.count("the certificate that this router began with ends on") == 2
    assert 'default_permission is "allow"' in caplog.text


def test_a_router_goes_by_the_issuers_of_its_members_and_not_of_who_was_revoked(pki: Path) -> None:
    assert run(pki, "issue", "router:r", "bridge:b2", "--host", "localhost") == 0
    assert run(pki, "revoke", "bridge:b1") == 0
    assert run(pki, "issue", "bridge:b1") == 0
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:7447", "--member", "bridge:b1") == 0
    by = pki / "router.r.members.pem"
    assert [common_name(one) for one in certificates(str(by))] == ["issuer of router:r", "issuer of bridge:b1:2"]
    assert verified(f"{pki}/bridge.b1.2.pem", str(by))
    for other in ("bridge.b1", "bridge.b2", "viewer.hall"):
        assert not verified(f"{pki}/{other}.pem", str(by))
    assert run(pki, "renew", "bridge:b1") == 0
    assert verified(f"{pki}/bridge.b1.2.pem", str(by))
    assert [member.label for member, _ in Folder(pki).members()] == [
        "bridge:b1",
        "bridge:b2",
        "router:r",
        "viewer:hall",
    ]


def test_a_router_may_go_by_an_authority_from_elsewhere(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    capsys.readouterr()
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:7447", "--ca", "/etc/site.pem") == 0
    written = capsys.readouterr()
    assert '"root_ca_certificate": "/etc/site.pem"' in written.out
    assert not written.err
    assert not (pki / "router.r.members.pem").exists()
