"""`truerate pki`: pairs that are whole, keys that nobody else reads, words on what is wrong, an exit code for monitoring."""

import json
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.pki.certificate_checks import certificates, common_name, hosts_of
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member, Role
from estimator.cli.main import main
from tests.bridge.pki.office import DAY, run


@pytest.mark.parametrize("text", ["bridge:b1", "router:r-1", "estimator:e_1:2"])
def test_a_common_name_says_the_member_and_back(text: str) -> None:
    assert Member.parse(text).common_name == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "bridge",
        "bridge:",
        "nurse:n1",
        "bridge:B1",
        "bridge:../x",
        "bridge:b1:1",
        "bridge:b1:",
        "bridge:b1:x",
        "bridge:*",
    ],
)
def test_what_is_no_member_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"not ROLE:NAME|is not valid|generation"):
        Member.parse(text)


def test_private_keys_are_for_their_owner_alone(pki: Path) -> None:
    keys = list(pki.rglob("*.key"))
    assert len(keys) == 5
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    assert {stat.S_IMODE(folder.stat().st_mode) for folder in (pki, pki / "issuers")} == {0o700}


def test_a_renewal_keeps_key_name_and_hosts_and_lasts_longer(pki: Path) -> None:
    assert run(pki, "issue", "router:r", "--host", "10.0.0.5", "--host", "ward.example", "--days", "3") == 0
    path, key = pki / "router.r.pem", (pki / "router.r.key").read_bytes()
    before = certificates(str(path))[0]
    assert run(pki, "renew", "router:r", "--days", "90") == 0
    after = certificates(str(path))[0]
    assert (pki / "router.r.key").read_bytes() == key
    assert hosts_of(after) == hosts_of(before) == ["ward.example", "10.0.0.5"]
    assert after.issuer == before.issuer
    assert common_name(after) == "router:r"
    assert after.not_valid_after_utc - before.not_valid_after_utc > 80 * DAY
    assert not list(pki.glob(".*"))


def test_show_warns_fourteen_days_before_and_says_what_to_do(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pki, "show") == 0
    Folder(pki).issue(Member(Role.ESTIMATOR, "e1"), utc_now() - 77 * DAY, 90)
    capsys.readouterr()
    assert run(pki, "show", "--json") == 1
    shown = json.loads(capsys.readouterr().out)["certificates"]
    assert {one["who"]: one["trouble"] for one in shown} == {
        "": "",
        "b1": "",
        "hall": "",
        "e1": "expires soon: truerate pki renew estimator:e1",
    }
    assert [one["role"] for one in shown] == ["authority", "bridge", "estimator", "viewer"]


def test_a_revoked_name_is_listed_and_never_used_again(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pki, "revoke", "bridge:b1", "--reason", "left\non a bus") == 0
    assert run(pki, "renew", "bridge:b1") == 2
    capsys.readouterr()
    assert run(pki, "issue", "bridge:b1") == 0
    assert "bridge:b1:2: the name is new. Enter the new certificate and key in [bus]" in capsys.readouterr().out
    assert run(pki, "revoke", "bridge:b1", "--reason", "again") == 0
    assert run(pki, "issue", "bridge:b1") == 0
    capsys.readouterr()
    assert run(pki, "revoke-list") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["bridge:b1", "bridge:b1:2"]
    assert lines[0].endswith("left on a bus")
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    capsys.readouterr()
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:7447") == 0
    written = capsys.readouterr().out
    assert '"cert_common_names": ["bridge:b1:3"]' in written
    assert '"bridge:b1"' not in written
    assert '"bridge:b1:2"' not in written


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["init"], "an authority exists already"),
        (["issue", "bridge:b1"], "exists already"),
        (["issue", "router:r"], "give each with --host"),
        (["issue", "nurse:n"], "is not ROLE:NAME"),
        (["issue", "bridge:b2", "--days", "0"], "use 1 to 36500"),
        (["issue", "bridge:b2", "--days", "99999999999"], "use 1 to 36500"),
        (["issue", "router:r", "--host", "10.0.0.5:7447"], "'10.0.0.5:7447' is neither a name nor an address"),
        (["issue", "router:r", "--host", "tls/10.0.0.5"], "is neither a name nor an address"),
        (["issue", "router:r", "--host", "localhost", "--host", ""], "is neither a name nor an address"),
        (["issue", "router:r", "--host", "10.0.0.256"], "is neither a name nor an address"),
        (["issue", "router:r", "--host", "[::1]"], "is neither a name nor an address"),
        (["issue", "bridge:b2", "--days", "9999"], "the authority expires on"),
        (["renew", "bridge:b2"], "bridge.b2.pem is missing, and a renewal needs"),
        (["revoke", "bridge:b2"], "no certificate to revoke"),
        (["router", "viewer:hall", "--ward", "w", "--listen", "tls/127.0.0.1:1"], "is not a router"),
        (["router", "router:r", "--ward", "w", "--listen", "here"], "is not an endpoint"),
        (["router", "router:r", "--ward", "w", "--listen", "tcp/127.0.0.1:1"], "needs tls"),
        (["router", "router:r", "--ward", "w", "--listen", "tls/a:1", "--join", "tcp/b:1"], "needs tls"),
        (["router", "router:r", "--ward", "w", "--listen", "tls/a:1"], "router:r: no certificate in"),
        (["issue", "bridge:b2", "--host", "10.0.0.5"], "--host applies only to certificates of routers and pages"),
    ],
)
def test_what_cannot_be_is_said(
    arguments: list[str], words: str, pki: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(pki, *arguments) == 2
    assert words in capsys.readouterr().err


def test_what_lacks_of_an_authority_is_named_and_not_made_anew(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (pki / "ca.key").rename(pki / "kept.key")
    assert run(pki, "issue", "bridge:b2") == 2
    assert "ca.pem or ca.key is missing: copy the missing file here" in capsys.readouterr().err
    (pki / "kept.key").rename(pki / "ca.key")
    (pki / "ca.pem").unlink()
    for verb in (["issue", "bridge:b2"], ["show"]):
        assert run(pki, *verb) == 2
        assert "ca.pem or ca.key is missing: copy the missing file here" in capsys.readouterr().err
    assert run(pki, "init") == 2


def test_a_certificate_without_its_issuer_s_is_said(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    path, end = pki / "bridge.b1.pem", "-----END CERTIFICATE-----\n"
    path.write_text(path.read_text().partition(end)[0] + end)
    assert run(pki, "router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:1") == 2
    assert f"{path} holds only one certificate" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (lambda text: b"\xff\xfe" + text.decode().encode("utf-16-le"), "is not UTF-8 text"),
        (lambda text: b" " + text, "'' is not ROLE:NAME"),
        (lambda text: b"// " + text, "'//' is not ROLE:NAME"),
        (lambda _: b"", "bridge:b1 was revoked before"),
        (None, "bridge:b1 was revoked before"),
    ],
    ids=["utf-16", "indented", "commented", "empty", "gone"],
)
def test_no_spoilt_list_lets_in_again_whoever_was_revoked(
    spoilt: Callable[[bytes], bytes] | None, words: str, pki: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(pki, "issue", "router:r", "--host", "localhost") == 0
    assert run(pki, "revoke", "bridge:b1") == 0
    assert run(pki, "issue", "bridge:b1") == 0
    file = pki / "revoked.txt"
    text = file.read_bytes()
    router = ("router", "router:r", "--ward", "w", "--listen", "tls/127.0.0.1:7447")
    file.write_bytes(b"\xef\xbb\xbf" + text + b"\n")  # as some editors leave it
    capsys.readouterr()
    assert run(pki, *router) == 0
    assert '"bridge:b1"' not in capsys.readouterr().out
    file.unlink()
    if spoilt is not None:
        file.write_bytes(spoilt(text))
    for verb in (router, ("show",), ("renew", "bridge:b1")):
        assert run(pki, *verb) == 2
        assert words in capsys.readouterr().err


def test_a_reason_is_listed_without_what_moves_a_cursor(pki: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pki", "revoke", "bridge:b1", "--reason", "left\x1b[2J on a\nbus", "--folder", str(pki)]) == 0
    capsys.readouterr()
    assert main(["pki", "revoke-list", "--folder", str(pki)]) == 0
    assert capsys.readouterr().out.endswith("left\\x1b[2J on a bus\n")
