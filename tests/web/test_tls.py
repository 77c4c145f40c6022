"""The page over TLS, with a certificate of the ward's own authority."""

import asyncio
import ssl
import urllib.error
import urllib.request
from datetime import UTC, datetime
from pathlib import Path

import pytest

from bridge.pki.certificate_checks import Identity, faults
from bridge.pki.folder import Folder
from bridge.pki.member import Member, Role
from estimator.config.dashboard import Dashboard
from estimator.web.serve import Server
from tests.web.asking import PASSWORD
from tests.web.conftest import served
from tests.web.talk import WARD


@pytest.fixture
def identity(tmp_path: Path) -> Identity:
    folder = Folder(tmp_path / "pki")
    folder.make("truerate ward", datetime.now(UTC))
    return folder.issue(Member(Role.PAGE, "ward"), datetime.now(UTC), hosts=("127.0.0.1",))


def test_a_browser_that_trusts_the_wards_authority_logs_in_over_tls(identity: Identity) -> None:
    site = served(certificate=identity.certificate, key=identity.key)
    trusting = ssl.create_default_context(cafile=identity.ca)
    form = f"name=nurse&password={PASSWORD.replace(' ', '+')}".encode()
    request = urllib.request.Request(f"{site.url}/login", form, {"Origin": site.url})

    class Stay(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, *_: object) -> None:
            return None

    opener = urllib.request.build_opener(urllib.request.HTTPSHandler(context=trusting), Stay)
    with opener.open(f"{site.url}/") as answer:
        assert answer.status == 200
    with pytest.raises(urllib.error.HTTPError) as redirected:
        opener.open(request)
    redirected.value.close()
    assert redirected.value.code == 303
    assert redirected.value.headers["set-cookie"].startswith("__Host-truerate=")
    assert "; Secure" in redirected.value.headers["set-cookie"]
    with pytest.raises(urllib.error.URLError, match="CERTIFICATE_VERIFY_FAILED"):
        urllib.request.urlopen(f"{site.url}/")
    site.stop()


def test_the_pages_certificate_lets_nobody_onto_the_bus(identity: Identity) -> None:
    assert not faults(identity, datetime.now(UTC), (Role.PAGE,))
    wrong = faults(identity, datetime.now(UTC), (Role.VIEWER, Role.ROUTER))
    assert any("for page:ward, but this program is a viewer or router" in words for words in wrong)


def test_a_certificate_that_cannot_be_used_is_named(tmp_path: Path, identity: Identity) -> None:
    broken = tmp_path / "broken.pem"
    broken.write_text("no certificate")
    for certificate in (str(tmp_path / "missing.pem"), str(broken)):
        settings = Dashboard(listen="127.0.0.1:8090", certificate=certificate, key=identity.key)
        with pytest.raises(OSError, match=f"certificate and key for TLS, {certificate} and .*cannot be used"):
            asyncio.run(Server(WARD, settings).serve())
    with pytest.raises(ValueError, match="key is missing"):
        Dashboard(certificate="page.pem")
