"""A ward behind a router that asks for certificates: an authority, its members, and `truerate router` as a process."""

import contextlib
import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import zenoh

from bridge.bus import router_file, zenoh_settings
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.certificate_checks import Identity
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from estimator.demo.ward import free_port

WARD = "w"
#: name -> role: what the cells are tried by
MEMBERS = ("bridge:b1", "bridge:b2", "estimator:e1", "estimator:e2", "viewer:v1", "commander:c1", "recorder:r1")
HOSTS = ("127.0.0.1", "localhost")
STARTS_S = 60.0  # where others work on the machine, too


class GuardedWard:
    """Files in a folder, and a router of them."""

    def __init__(self, folder: Path, members: Sequence[str] = MEMBERS, router: str = "router:r") -> None:
        self.folder = Folder(folder)
        now = utc_now()
        self.folder.make("a ward", now)
        self.router = Member.parse(router)
        self.folder.issue(self.router, now, hosts=HOSTS)
        for name in members:
            self.folder.issue(Member.parse(name), now)
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        self.file = folder / "router.json5"
        self.write()

    def write(self, wards: Sequence[str] = (WARD,), join: Sequence[str] = (), *, by_issuers: bool = True) -> None:
        """The router's files anew, for all members there are now; or one that goes by the authority as a whole."""
        members = [member for member, _ in self.folder.members() if member != self.router]
        places = [(ward, member) for member in members for ward in wards]
        listen = [
            self.endpoint,
            self.endpoint.replace("127.0.0.1", "127.0.0.2"),
        ]  # the second is not in its certificate
        if by_issuers:
            self.folder.admit(self.router, members)
        identity = self.folder.gate(self.router) if by_issuers else self.folder.identity(self.router)
        settings = router_file.guarded(listen, identity, places, join)
        self.file.write_text(router_file.rendered(settings, "for a test"), "utf-8")

    def routers(self, who: str) -> Routers:
        return Routers((self.endpoint,), self.folder.identity(self.folder.current(Member.parse(who))))

    def bus(self, who: str) -> ZenohBus:
        return ZenohBus(self.routers(who), open_timeout_s=STARTS_S)

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        with running_router(self.file, self.endpoint):
            yield


@contextlib.contextmanager
def running_router(file: Path, endpoint: str) -> Iterator[None]:
    """`truerate router --config FILE`, from when it listens until the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", "estimator.cli.main", "router", "--config", str(file)], stderr=subprocess.PIPE, text=True
    )
    try:
        address, _, port = endpoint.partition("/")[2].rpartition(":")
        deadline = time.monotonic() + STARTS_S
        while True:
            with contextlib.suppress(OSError), socket.create_connection((address, int(port)), 0.5):
                break
            if process.poll() is not None or time.monotonic() > deadline:
                process.kill()
                raise RuntimeError(process.communicate()[1] or f"the router does not listen after {STARTS_S:g} s")
            time.sleep(0.02)
        yield
    finally:
        process.terminate()
        try:
            process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def connects(settings: zenoh_settings.Settings) -> bool:
    """Whether zenoh itself gets a session at the first try; our own checks, which would refuse to try, are left out."""
    try:
        with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as opened:
            return bool(opened.info.routers_zid())
    except zenoh.ZError:
        return False


def stranger(ward: GuardedWard, ca: str, certificate: bytes, key: bytes, name: str) -> Identity:
    """Files of a certificate that the folder's own door would never make."""
    here = ward.folder.path / name
    Path(f"{here}.pem").write_bytes(certificate)
    Path(f"{here}.key").write_bytes(key)
    Path(f"{here}.key").chmod(0o600)
    return Identity(ca, f"{here}.pem", f"{here}.key")
