"""Who has no business on a ward gets no session, or no sample; a real router, and real certificates, wrong in one thing each."""

import json
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import pytest
import zenoh
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage

from bridge.bus import zenoh_settings
from bridge.bus.contract import BusError
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.authority import Pair, issue, new_authority
from bridge.pki.folder import utc_now
from bridge.pki.identity import Identity
from bridge.pki.member import Member
from bridge.wire import keys
from tests.bridge.pki.guarded_ward import WARD, GuardedWard, stranger

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: bad_identities")]

B1, DAY = Member.parse("bridge:b1"), timedelta(days=1)
RAW = keys.build(WARD, "raw", bridge="b1", device="d1")


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GuardedWard]:
    made = GuardedWard(tmp_path_factory.mktemp("pki"))
    with made.running():
        yield made


def connects(endpoint: str, identity: Identity | None) -> bool:
    """Whether zenoh itself gets a session: our own door, which would not even try, is left out."""
    settings = zenoh_settings.client([endpoint], identity)
    try:
        with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
            return bool(session.info.routers_zid())
    except zenoh.ZError:
        return False


def pair_of(ward: GuardedWard) -> Pair:
    folder = ward.folder.path
    return Pair((folder / "ca.pem").read_bytes(), (folder / "ca.key").read_bytes())


def other_authority(ward: GuardedWard) -> Pair:
    other = new_authority("somebody else", utc_now())
    return issue(other, B1, utc_now() - DAY, utc_now() + DAY)


def expired(ward: GuardedWard) -> Pair:
    return issue(pair_of(ward), B1, utc_now() - 2 * DAY, utc_now() - timedelta(seconds=1))


def not_yet_valid(ward: GuardedWard) -> Pair:
    return issue(pair_of(ward), B1, utc_now() + DAY, utc_now() + 2 * DAY)


def only_a_server(ward: GuardedWard) -> Pair:
    return issue(pair_of(ward), B1, utc_now() - DAY, utc_now() + DAY, usages=[Usage.SERVER_AUTH])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (other_authority, "not signed by"),
        (expired, "expired on"),
        (not_yet_valid, "not valid before"),
        (only_a_server, "does not let it ask a router"),
    ],
)
def test_a_bad_certificate_gets_no_session_and_says_itself_why(
    make: Callable[[GuardedWard], Pair], words: str, ward: GuardedWard
) -> None:
    pair = make(ward)
    files = stranger(ward, f"{ward.folder.path}/ca.pem", pair.certificate, pair.key, make.__name__)
    assert not connects(ward.endpoint, files)
    with pytest.raises(BusError, match=words):
        ZenohBus(type(ward.routers("bridge:b1"))((ward.endpoint,), files))
    assert connects(ward.endpoint, ward.routers("bridge:b1").identity)


def test_nobody_without_a_certificate_and_nobody_without_tls(ward: GuardedWard) -> None:
    settings = zenoh_settings.client([ward.endpoint])
    settings["transport"]["link"]["tls"] = {"root_ca_certificate": f"{ward.folder.path}/ca.pem"}
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    assert not connects(ward.endpoint.replace("tls/", "tcp/"), None)
    assert connects(ward.endpoint, ward.routers("bridge:b1").identity)


def test_a_router_of_another_authority_or_by_another_name_is_not_talked_to(tmp_path: Path, ward: GuardedWard) -> None:
    mine = ward.routers("bridge:b1").identity
    assert mine is not None
    other = tmp_path / "other.pem"
    other.write_bytes(new_authority("somebody else", utc_now()).certificate)
    assert not connects(ward.endpoint, Identity(str(other), mine.certificate, mine.key))
    assert not connects(ward.endpoint.replace("127.0.0.1", "127.0.0.2"), mine)  # it listens there, but is not called so
    assert connects(f"{ward.endpoint.replace('127.0.0.1', '127.0.0.2')}#verify_name_on_connect=false", mine)


@pytest.mark.parametrize("who", ["viewer:stranger", "bridge:b9"])
def test_a_name_the_router_does_not_know_passes_nothing(who: str, ward: GuardedWard) -> None:
    member = Member.parse(who)
    pair = issue(pair_of(ward), member, utc_now() - DAY, utc_now() + DAY)
    files = stranger(ward, f"{ward.folder.path}/ca.pem", pair.certificate, pair.key, "stranger")
    with ward.bus("bridge:b1") as b1, ward.bus("estimator:e1") as e1:
        routers = type(ward.routers("bridge:b1"))((ward.endpoint,), files)
        with ZenohBus(routers) as foreign:
            heard = e1.subscribe(keys.pattern(WARD, "raw"), history=True)
            taken = foreign.subscribe(keys.everything(WARD), history=True)
            own, forged = b1.publisher(RAW, cache=10), foreign.publisher(f"{RAW}x", cache=10)
            for n in range(50):
                own.put(b"%d" % n)
                forged.put(b"forged")
            messages = heard.drain(50, 5.0)
            while len(messages) < 50 and (more := heard.drain(50, 2.0)):
                messages += more
            assert [m.payload for m in messages] == [b"%d" % n for n in range(50)]
            taken_here = taken.drain(1000, 0.3)  # its own, which never left its session
            assert {m.payload for m in taken_here} <= {b"forged"}
            assert not heard.drain(10, 0.2)


def test_a_stolen_name_that_was_revoked_passes_nothing_and_its_holder_goes_on(tmp_path: Path) -> None:
    ward = GuardedWard(tmp_path / "pki")
    stolen = ward.routers("bridge:b1")
    gone = ward.folder.revoke(B1, utc_now(), "left on a bus")
    anew = ward.folder.issue(B1, utc_now())
    assert (gone.common_name, ward.folder.current(B1).common_name) == ("bridge:b1", "bridge:b1:2")
    assert anew.certificate.endswith("bridge.b1.2.pem")
    ward.write()
    with ward.running(), ZenohBus(stolen) as thief, ward.bus("bridge:b1") as b1, ward.bus("estimator:e1") as e1:
        heard = e1.subscribe(keys.pattern(WARD, "raw"), history=True)
        statuses = thief.subscribe(keys.pattern(WARD, "status"), history=True)
        thief.publisher(f"{RAW}x", cache=10).put(b"forged")
        e1.publisher(keys.build(WARD, "status", device="d1"), cache=1).put(b"secret")
        b1.publisher(RAW, cache=10).put(b"true")
        message = heard.receive(5.0)
        assert message is not None
        assert message.payload == b"true"
        assert heard.receive(0.3) is None
        assert statuses.receive(0.3) is None
