"""Who has no business on a ward gets no session; a real router, and real certificates, wrong in one thing each."""

from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage

from bridge.bus import zenoh_settings
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.authority import Pair, issue, new_authority, new_issuer
from bridge.pki.certificate_checks import Identity
from bridge.pki.folder import utc_now
from bridge.pki.member import Member
from bridge.wire import keys
from tests.bridge.bus.worlds import eventually
from tests.bridge.pki.guarded_ward import MEMBERS, WARD, GuardedWard, connects, stranger

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: bad_identities")]

B1, LOST, UNKNOWN = (Member.parse(who) for who in ("bridge:b1", "bridge:lost", "viewer:stranger"))
DAY = timedelta(days=1)
RAW = keys.build(WARD, "raw", bridge="b1", device="d1")


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GuardedWard]:
    made = GuardedWard(tmp_path_factory.mktemp("pki"), (*MEMBERS, "bridge:lost"))
    made.folder.revoke(LOST, utc_now(), "left on a bus")
    made.folder.issue(LOST, utc_now())
    made.write()
    made.folder.issue(UNKNOWN, utc_now())  # the router's files are older
    with made.running():
        yield made


def session(endpoint: str, identity: Identity | None) -> zenoh_settings.Settings:
    return zenoh_settings.client([endpoint], identity)


def made(ward: GuardedWard, name: str, pair: Pair) -> Identity:
    return stranger(ward, f"{ward.folder.path}/ca.pem", pair.certificate, pair.key, name)


def of_b1(ward: GuardedWard, begins: timedelta, ends: timedelta, **more: Any) -> Pair:
    """Signed by who may sign for b1: only its dates, or its usage, are wrong."""
    return issue(ward.folder.issuer(B1), B1, utc_now() + begins, utc_now() + ends, **more)


def other_authority(ward: GuardedWard) -> Identity:
    other = new_authority("somebody else", utc_now())
    pair = issue(new_issuer(other, B1), B1, utc_now() - DAY, utc_now() + DAY)
    return made(ward, "other", pair)


def expired(ward: GuardedWard) -> Identity:
    return made(ward, "expired", of_b1(ward, -2 * DAY, timedelta(seconds=-1)))


def not_yet_valid(ward: GuardedWard) -> Identity:
    return made(ward, "early", of_b1(ward, DAY, 2 * DAY))


def only_a_server(ward: GuardedWard) -> Identity:
    return made(ward, "server", of_b1(ward, -DAY, DAY, usages=[Usage.SERVER_AUTH]))


def of_a_role_it_does_not_know(ward: GuardedWard) -> Identity:
    return ward.folder.identity(UNKNOWN)


def stolen_then_revoked(ward: GuardedWard) -> Identity:
    return ward.folder.identity(LOST)


def no_certificate(ward: GuardedWard) -> zenoh_settings.Settings:
    settings = session(ward.endpoint, None)
    settings["transport"]["link"]["tls"] = {"root_ca_certificate": f"{ward.folder.path}/ca.pem"}
    return settings


def no_tls(ward: GuardedWard) -> zenoh_settings.Settings:
    return session(ward.endpoint.replace("tls/", "tcp/"), None)


@pytest.mark.parametrize(
    "make",
    [
        no_certificate,
        other_authority,
        expired,
        not_yet_valid,
        of_a_role_it_does_not_know,
        only_a_server,
        no_tls,
        stolen_then_revoked,
    ],
)
def test_none_of_eight_bad_identities_gets_a_session(
    make: Callable[[GuardedWard], Identity | zenoh_settings.Settings], ward: GuardedWard
) -> None:
    bad = make(ward)
    assert not connects(session(ward.endpoint, bad) if isinstance(bad, Identity) else bad)
    right = made(ward, "right", of_b1(ward, -DAY, DAY))  # as some of them, with nothing wrong
    for good in (right, ward.routers("bridge:lost").identity):  # whose holder goes on with the next generation
        eventually(lambda good=good: connects(session(ward.endpoint, good)))  # type: ignore[misc]


def test_a_router_of_another_authority_or_by_another_name_is_not_talked_to(tmp_path: Path, ward: GuardedWard) -> None:
    mine = ward.routers("bridge:b1").identity
    assert mine is not None
    other = tmp_path / "other.pem"
    other.write_bytes(new_authority("somebody else", utc_now()).certificate)
    assert not connects(session(ward.endpoint, Identity(str(other), mine.certificate, mine.key)))
    elsewhere = ward.endpoint.replace("127.0.0.1", "127.0.0.2")
    assert not connects(session(elsewhere, mine))  # it listens there, but is not called so
    eventually(lambda: connects(session(f"{elsewhere}#verify_name_on_connect=false", mine)))


def by_authority(path: Path) -> GuardedWard:
    """A site's own authority, or a folder of an earlier truerate: routers have no more than the names to go by."""
    made = GuardedWard(path)
    made.write(by_issuers=False)
    return made


def test_without_issuers_a_stolen_name_that_was_revoked_passes_nothing_and_its_holder_goes_on(tmp_path: Path) -> None:
    ward = by_authority(tmp_path / "pki")
    stolen = ward.routers("bridge:b1")
    gone = ward.folder.revoke(B1, utc_now(), "left on a bus")
    anew = ward.folder.issue(B1, utc_now())
    assert (gone.common_name, ward.folder.current(B1).common_name) == ("bridge:b1", "bridge:b1:2")
    assert anew.certificate.endswith("bridge.b1.2.pem")
    ward.write(by_issuers=False)
    with ward.running(), ZenohBus(stolen) as thief, ward.bus("bridge:b1") as b1, ward.bus("estimator:e1") as e1:
        heard = e1.subscribe(keys.pattern(WARD, "raw"), history=True)
        statuses = thief.subscribe(keys.pattern(WARD, "status"), history=True)
        thief.publisher(f"{RAW}x", cache=10).put(b"forged")
        e1.publisher(keys.build(WARD, "status", device="d1"), cache=1).put(b"secret")
        b1.publisher(RAW, cache=10).put(b"true")
        message = heard.receive(30.0)
        assert message is not None
        assert message.payload == b"true"
        assert heard.receive(0.3) is None
        assert statuses.receive(0.3) is None
