"""Files that another authority made."""

import os
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa

from bridge.pki.authority import new_authority
from bridge.pki.certificate_checks import Identity, certificates, common_name, faults
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member, Role
from tests.bridge.pki.office import B1


def other_key(pki: Path) -> Identity:
    return Identity(f"{pki}/ca.pem", f"{pki}/bridge.b1.pem", f"{pki}/viewer.hall.key")


def open_key(pki: Path) -> Identity:
    (pki / "bridge.b1.key").chmod(0o644)
    return Folder(pki).identity(B1)


def locked_key(pki: Path) -> Identity:
    key = rsa.generate_private_key(65537, 2048)
    form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    (pki / "bridge.b1.key").write_bytes(key.private_bytes(*form, serialization.BestAvailableEncryption(b"x")))
    return Folder(pki).identity(B1)


def other_of_its_name(pki: Path) -> Identity:
    ward = common_name(certificates(str(pki / "ca.pem"))[0])
    (pki / "ca.pem").write_bytes(new_authority(ward, utc_now()).certificate)
    return Folder(pki).identity(B1)


def no_file(pki: Path) -> Identity:
    (pki / "bridge.b1.key").unlink()
    return Folder(pki).identity(B1)


def no_certificate(pki: Path) -> Identity:
    (pki / "bridge.b1.pem").write_text("hello")
    return Folder(pki).identity(B1)


def pipe_for_a_key(pki: Path) -> Identity:
    (pki / "bridge.b1.key").unlink()
    os.mkfifo(pki / "bridge.b1.key")  # reading it would wait for a writer
    return Folder(pki).identity(B1)


def endless_certificate(pki: Path) -> Identity:
    (pki / "ca.pem").unlink()
    (pki / "ca.pem").symlink_to("/dev/zero")
    return Folder(pki).identity(B1)


def huge_certificate(pki: Path) -> Identity:
    os.truncate(pki / "bridge.b1.pem", 1 << 32)
    return Folder(pki).identity(B1)


def anybodys_authority(pki: Path) -> Identity:
    (pki / "ca.pem").chmod(0o666)
    return Folder(pki).identity(B1)


def anybodys_folder(pki: Path) -> Identity:
    pki.chmod(0o777)
    return Folder(pki).identity(B1)


def for_a_viewer(pki: Path) -> Identity:
    return Folder(pki).identity(Member.parse("viewer:hall"))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (other_key, "not the key of"),
        (open_key, "chmod 600"),
        (locked_key, "the key has a password"),
        (other_of_its_name, "another authority of the same name"),
        (no_file, "there is no such file"),
        (no_certificate, "not a PEM certificate"),
        (pipe_for_a_key, "a pipe or a device"),
        (endless_certificate, "a pipe or a device"),
        (huge_certificate, "the file has more than"),
        (anybodys_authority, "ca.pem: every user of this machine can change it"),
        (anybodys_folder, "pki: every user of this machine can change it"),
        (for_a_viewer, "for viewer:hall, but this program is a bridge"),
    ],
)
def test_files_from_elsewhere_are_looked_through(make: object, words: str, pki: Path) -> None:
    assert callable(make)
    assert [fault for fault in faults(make(pki), utc_now(), (Role.BRIDGE,)) if words in fault]
