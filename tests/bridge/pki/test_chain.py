"""What `faults` says of files made elsewhere, and what a real router makes of the same files: they agree."""

import base64
import ipaddress
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage
from cryptography.x509.oid import NameOID

from bridge.bus import router_file, zenoh_settings
from bridge.pki.certificate_checks import Identity, faults
from bridge.pki.folder import utc_now
from bridge.pki.member import Member, Role
from estimator.demo.ward import free_port
from tests.bridge.bus.worlds import eventually
from tests.bridge.pki.guarded_ward import connects, running_router

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: chain")]

DAY = timedelta(days=1)
ASK, SERVE, ANY = Usage.CLIENT_AUTH, Usage.SERVER_AUTH, Usage.ANY_EXTENDED_KEY_USAGE
HERE = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])


class Made:
    """A certificate and its key, signed by another or by itself."""

    def __init__(
        self,
        name: str,
        by: "Made | None" = None,
        *,
        key: Any = None,
        ca: bool = False,
        days: tuple[int, int] = (-9, 9),
        may: tuple[x509.ObjectIdentifier, ...] = (),
        hosts: x509.SubjectAlternativeName | None = None,
    ) -> None:
        self.key = key or ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        signer = by.key if by else self.key
        made = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(by.certificate.subject if by else subject)
            .public_key(self.key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(utc_now() + days[0] * DAY)
            .not_valid_after(utc_now() + days[1] * DAY)
            .add_extension(x509.BasicConstraints(ca=ca, path_length=None), critical=True)
        )
        if may:
            made = made.add_extension(x509.ExtendedKeyUsage(may), critical=False)
        if hosts:
            made = made.add_extension(hosts, critical=False)
        self.certificate: x509.Certificate = made.sign(signer, hashes.SHA256())

    @property
    def pem(self) -> bytes:
        return self.certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def secret(self) -> bytes:
        form = serialization.PrivateFormat.PKCS8
        return bytes(self.key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption()))


ROOT = Made("a site", ca=True)
OLD = Made("an old site", ca=True, days=(-99, -1))


class Site:
    """A router of an authority that is not ours, and where its certificates lie."""

    def __init__(self, path: Path) -> None:
        self.path, self.endpoint = path, f"tls/127.0.0.1:{free_port()}"
        self.router = self.file("router", Made("router:r", ROOT, may=(ASK, SERVE), hosts=HERE))
        (path / "all.pem").write_bytes(ROOT.pem)
        places = [("w", Member.parse("bridge:b1"))]
        everybody = Identity(str(path / "all.pem"), self.router.certificate, self.router.key)
        settings = router_file.guarded([self.endpoint], everybody, places)
        (path / "router.json5").write_text(router_file.rendered(settings, "for a test"), "utf-8")

    def file(
        self, name: str, made: Made, *above: Made, ca: bytes = ROOT.pem, pem: bytes = b"", key: bytes = b""
    ) -> Identity:
        here = self.path / name
        (ca_file := Path(f"{here}.ca.pem")).write_bytes(ca)
        Path(f"{here}.pem").write_bytes(pem or made.pem + b"".join(one.pem for one in above))
        Path(f"{here}.key").write_bytes(key or made.secret)
        Path(f"{here}.key").chmod(0o600)
        return Identity(str(ca_file), f"{here}.pem", f"{here}.key")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    made = Site(tmp_path_factory.mktemp("site"))
    with running_router(made.path / "router.json5", made.endpoint):
        yield made


def b1(by: Made = ROOT, **more: Any) -> Made:
    return Made("bridge:b1", by, **more)


def over(site: Site, **more: Any) -> Identity:
    """Signed by one in between."""
    between = Made("between", ROOT, ca=True, **more)
    return site.file("over", b1(between), between)


def dos(site: Site) -> Identity:
    made = b1()
    return site.file("dos", made, pem=made.pem.replace(b"\n", b"\r\n"), key=made.secret.replace(b"\n", b"\r\n"))


CASES: dict[str, tuple[Callable[[Site], Identity], str]] = {
    "right": (lambda site: site.file("right", b1(may=(ASK,))), ""),
    "from Windows": (dos, ""),
    "for any use": (lambda site: site.file("no eku", b1()), ""),
    "P-384": (lambda site: site.file("p384", b1(key=ec.generate_private_key(ec.SECP384R1()))), ""),
    "RSA": (lambda site: site.file("rsa", b1(key=rsa.generate_private_key(65537, 2048))), ""),
    "Ed25519": (lambda site: site.file("ed", b1(key=ed25519.Ed25519PrivateKey.generate())), ""),
    "one in between": (over, ""),
    "beside an old authority": (lambda site: site.file("rolled", b1(), ca=OLD.pem + ROOT.pem), ""),
    "any extended usage": (
        lambda site: site.file("any", b1(may=(ANY,))),
        "extended key usage does not allow it to ask",
    ),
    "for servers": (lambda site: site.file("serve", b1(may=(SERVE,))), "extended key usage does not allow it to ask"),
    "one in between expired": (lambda site: over(site, days=(-9, -1)), "'between' expired"),
    "one in between too early": (lambda site: over(site, days=(1, 9)), "'between' is not valid before"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_said_of_files_is_what_a_router_makes_of_them(case: str, site: Site) -> None:
    make, words = CASES[case]
    identity = make(site)
    found = faults(identity, utc_now())
    settings = zenoh_settings.client([site.endpoint], identity)
    if words:
        assert not connects(settings)
        assert any(words in said for said in found), found
    else:
        eventually(lambda: connects(settings))
        assert found == []


def test_a_router_that_names_no_host_is_said_of(site: Site) -> None:
    wrong = site.file("nowhere", Made("router:r", ROOT, may=(ASK, SERVE)))
    assert faults(site.router, utc_now(), (Role.ROUTER,)) == []
    assert ["names no host" in words for words in faults(wrong, utc_now(), (Role.ROUTER,))] == [True]


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (b"\x06\x03\x55\x1d\x25", b"\x06\x03\x55\x1d\x13", "Duplicate 2.5.29.19 extension"),  # of usage, of constraints
        (b"\xa0\x03\x02\x01\x02", b"\xa0\x03\x02\x01\x09", "9 is not a valid X509 version"),
    ],
)
def test_what_is_packed_as_no_certificate_is_said_of(site: Site, good: bytes, bad: bytes, words: str) -> None:
    made = b1(may=(ASK,))
    der = made.certificate.public_bytes(serialization.Encoding.DER)
    assert good in der
    text = base64.encodebytes(der.replace(good, bad, 1)).decode()
    pem = f"-----BEGIN CERTIFICATE-----\n{text}-----END CERTIFICATE-----\n".encode()
    identity = site.file("odd", made, pem=pem)
    assert any(said.startswith(identity.certificate) and words in said for said in faults(identity, utc_now()))
