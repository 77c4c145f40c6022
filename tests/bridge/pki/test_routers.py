"""What a router says of its files before it listens, and by whom it goes."""

from pathlib import Path

import pytest

from bridge.pki.certificate_checks import Identity, certificates, common_name, faults
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from estimator.cli.main import main
from tests.bridge.pki.office import B1, run


def test_a_router_by_whose_files_nobody_could_be_let_in_says_so_instead_of_listening(
    pki: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, router = Folder(pki), Member.parse("router:r")
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    capsys.readouterr()
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:1") == 0
    file, text = pki / "router.json5", capsys.readouterr().out
    for wrong, words in (
        (("router.r.pem", "bridge.b1.pem"), "for bridge:b1, but this program is a router"),
        (("r.members", "x"), "x.pem: there"),
    ):
        file.write_text(text.replace(*wrong))
        assert main(["router", "--config", str(file)]) == 2
        assert words in capsys.readouterr().err
    file.write_text(text)
    folder.renew(router, utc_now(), days=0)
    assert main(["router", "--config", str(file)]) == 2
    assert "expired on" in capsys.readouterr().err
    ward = pki / "ward.toml"
    files = folder.identity(B1)
    ward.write_text(
        f'ward = "w"\n[bus]\nconnect = ["tls/localhost:7447"]\nca = "{files.ca}"\n'
        f'certificate = "{files.certificate}"\nkey = "{files.key}"\n'
    )
    assert main(["router", "--config", str(ward)]) == 2
    assert "would not check them. Write a router" in capsys.readouterr().err


def test_a_router_goes_by_the_issuers_of_its_members_and_not_of_who_was_revoked(pki: Path) -> None:
    assert run(pki, "issue", "router:r", "bridge:b2", "--host", "localhost") == 0
    assert run(pki, "revoke", "bridge:b1") == 0
    assert run(pki, "issue", "bridge:b1") == 0
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:7447", "--member", "bridge:b1") == 0
    by = pki / "router.r.members.pem"
    assert [common_name(one) for one in certificates(str(by))] == ["issuer of router:r", "issuer of bridge:b1:2"]

    def let_in(name: str) -> bool:
        return not faults(Identity(str(by), f"{pki}/{name}.pem", f"{pki}/{name}.key"), utc_now())

    assert let_in("bridge.b1.2")
    assert not any(let_in(other) for other in ("bridge.b1", "bridge.b2", "viewer.hall"))
    assert run(pki, "renew", "bridge:b1") == 0
    assert let_in("bridge.b1.2")
    assert [member.label for member, _ in Folder(pki).members()] == [
        "bridge:b1",
        "bridge:b2",
        "router:r",
        "viewer:hall",
    ]
