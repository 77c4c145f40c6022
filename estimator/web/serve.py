"""Command `truerate dashboard`: waits for a router, serves the application, and handles signals."""

import asyncio
import contextlib
import gc
import logging
import socket
import threading
import time
from pathlib import Path

from msgspec.structs import replace

from bridge.bus.access_self_test import self_test
from bridge.bus.contract import Bus
from bridge.bus.routers import Routers
from bridge.bus.startup import wait_for_router
from bridge.config.schema import listening
from bridge.config.ward_file import WardFile
from bridge.diagnose.finding import Level
from bridge.diagnose.router import page_certificate, renewal
from bridge.pki.member import Role
from bridge.runtime import os_errors
from bridge.runtime.service_manager import supervised
from bridge.runtime.signals import asked_by
from estimator.client import Client
from estimator.config.alerts import Alerts
from estimator.config.dashboard import Dashboard
from estimator.config.device_settings import Treatment, treatment
from estimator.config.people_file import with_people
from estimator.config.schema import Ward
from estimator.web.app import application
from estimator.web.broadcast import Broadcast
from estimator.web.listener import CONNECTIONS, Listener, room
from estimator.web.site import Desk
from estimator.web.ward_state import Known

log = logging.getLogger(__name__)

#: settings of the ward's file that take effect in a running dashboard
LIVE = (
    *(f"dashboard.{name}" for name in ("people", "hosts", "origins", "session_hours", "idle_minutes", "due_days")),
    *(f"estimator.{name}" for name in ("method", "model", "models", "horizontal_turns", "warming_s")),
    *(f"alerts.{name}" for name in Alerts.__struct_fields__),
)
_LOOK_S = 0.5
#: time between warnings that the page's certificate expires
_SELDOM_S = 12 * 3600.0
#: allocations between garbage collections: an answer of the stream makes thousands of objects, none of them in a cycle
_CYCLES = 50_000
#: addresses that mean every address of this machine
_ANY = ("0.0.0.0", "::")  # noqa: S104 - compared with, not bound


class Server:
    """Web server of one ward's dashboard.

    store: file of the estimator's store, or None. people: file that lists the people, or None. connections: largest
    number of open connections.
    The server runs before a router is found; `connect` attaches the router's sessions later.
    """

    def __init__(
        self,
        ward: str,
        settings: Dashboard,
        store: Path | None = None,
        treatment: Treatment | None = None,
        connections: int = CONNECTIONS,
        people: Path | None = None,
    ) -> None:
        self.desk = Desk(Known(ward), settings, store, treatment, people)
        self._broadcast = Broadcast(self.desk)
        self.app = application(self.desk, self._broadcast)
        self.uvicorn = Listener(
            self.app,
            behind_proxy=settings.behind_proxy,
            connections=connections,
            certificate=settings.certificate,
            key=settings.key,
        )

    async def serve(self) -> None:
        """Serve until `stop` is called. Raises OSError if the address, or the certificate for TLS, cannot be used."""
        settings = self.desk.settings
        try:
            self.uvicorn.config.load()
        except OSError as error:
            files = f"{settings.certificate} and {settings.key}"
            why = os_errors.why(error)
            raise OSError(f"dashboard: certificate and key for TLS, {files}, cannot be used: {why}") from error
        host, port = listening(settings.listen)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            listener = socket.create_server((host, port), family=family, backlog=128)
        except OSError as error:
            why = os_errors.why(error)
            raise OSError(f"dashboard: cannot listen on {host}:{port}: {why}; choose another with --listen") from error
        log.info(
            "the dashboard of ward %s is at %s",
            self.desk.known.ward,
            _place(host, listener.getsockname()[1], tls=bool(settings.certificate)),
        )
        with listener, supervised():
            await self.uvicorn.serve([listener])

    def use(self, ward: Ward) -> None:
        """Apply the changed settings of the ward file to the running dashboard."""
        self.desk.use(ward.dashboard, treatment(ward.estimator))
        self.desk.known.alert_settings = ward.alerts

    def stop(self) -> None:
        """Stop serving once open responses are sent; a second call stops at once."""
        self.uvicorn.force_exit = self.uvicorn.should_exit
        self.uvicorn.should_exit = True

    def connect(self, data: Bus, control: Bus) -> None:
        """Attach the bus sessions of a router that was found: one for data, one for liveliness and commands.

        Must be called in the event loop.
        """
        ward = self.desk.known.ward
        self._broadcast.connect(Client(ward=ward, bus=data), Client(ward=ward, bus=control))


def _place(host: str, port: int, *, tls: bool) -> str:
    """Address for a browser, in words."""
    if host in _ANY:
        return f"port {port} of every address of this machine, {socket.gethostname()}"
    return f"http{'s' * tls}://{f'[{host}]' if ':' in host else host}:{port}"


def run(ward: Ward, file: WardFile[Ward] | None = None, people: WardFile[Ward] | None = None) -> int:
    """Serve the dashboard until SIGINT or SIGTERM, and return the exit code.

    file: the ward file, which may change. people: its `people_file`. While no router is found, every page says so.
    """
    gc.set_threshold(_CYCLES)
    settings = _settings(ward, people)
    store = Path(ward.estimator.store) if ward.estimator else None
    if settings.commanded and not settings.local and not settings.behind_proxy and not settings.certificate:
        log.warning(
            "%s is reached over the network without TLS: passwords can be intercepted; see “On a network” in docs/dashboard.md",
            settings.listen,
        )
    listed = people or file
    server = Server(ward.ward, settings, store, treatment(ward.estimator), room(), listed.path if listed else None)
    server.desk.known.alert_settings = ward.alerts
    asyncio.run(_serve(server, ward, file, people))
    return 0


def _settings(ward: Ward, people: WardFile[Ward] | None) -> Dashboard:
    return with_people(ward.dashboard, people.root.dashboard.people) if people else ward.dashboard


def routers_of(ward: Ward) -> Routers:
    """Return the ward's routers, with the dashboard's role there: commander, or viewer if no person may give commands.

    Logs a warning if the dashboard has a viewer's certificate, which does not permit raw readings.
    """
    if ward.dashboard.commanded:
        return ward.bus.routers_as(Role.COMMANDER)
    routers = ward.bus.routers_as(Role.VIEWER, Role.COMMANDER)
    if routers.identity is not None:
        from bridge.pki.certificate_checks import member_of  # noqa: PLC0415 - as in bridge.bus.routers

        if (member := member_of(routers.identity)).role is Role.VIEWER:
            log.warning(
                "%s may not receive raw readings: a device's page shows no rates and no heading, and the guide cannot follow"
                " the turns. Use a commander's certificate: truerate pki issue commander:%s",
                member.label,
                member.name,
            )
    return routers


async def _serve(server: Server, ward: Ward, file: WardFile[Ward] | None, people: WardFile[Ward] | None) -> None:
    routers = routers_of(ward)
    stop = threading.Event()
    loop = asyncio.get_running_loop()
    for number in asked_by():
        loop.add_signal_handler(number, server.stop)
    buses: list[Bus] = []

    def find() -> None:
        data, control = (wait_for_router(routers, stop, patient=True) for _ in range(2))
        buses.extend(bus for bus in (data, control) if bus is not None)
        for words in self_test(control, routers, ward.ward) if control is not None else ():
            log.error("%s", words)
        if file is not None and control is not None:
            file.answer(control, routers, Role.COMMANDER, "dashboard")
        if data is not None and control is not None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: the server has stopped
                loop.call_soon_threadsafe(server.connect, data, control)

    finding = threading.Thread(target=find, name="find a router", daemon=True)
    finding.start()
    looking = asyncio.create_task(_look(server, file, people)) if file else None
    try:
        await server.serve()
    finally:
        if looking:
            looking.cancel()
        stop.set()
        finding.join(5.0)
        for bus in buses:
            bus.close()


async def _look(server: Server, file: WardFile[Ward], people: WardFile[Ward] | None) -> None:
    """Use the settings again when the ward file or the people's file changes, and a changed certificate."""
    said_s = -_SELDOM_S
    while True:
        await asyncio.sleep(_LOOK_S)
        server.uvicorn.renew()
        if (certificate := file.root.dashboard.certificate) and time.monotonic() - said_s >= _SELDOM_S:
            said_s, finding = time.monotonic(), page_certificate(certificate, renewal(file.path, file.root.ward))
            if finding.level is not Level.OK:
                log.warning("%s: %s", finding.said, finding.do)
        if any(one.look(time.monotonic()) for one in (file, people) if one):
            server.use(replace(file.root, dashboard=_settings(file.root, people)))
