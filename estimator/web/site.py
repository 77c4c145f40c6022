"""Shared services of all pages: ward state, login sessions, and commands to the estimator."""

import asyncio
import logging
import secrets
import time
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from math import ceil
from pathlib import Path
from typing import Any
from unicodedata import category

from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection, Request

from bridge.bus.contract import BusError
from bridge.reasons.codes import Code
from bridge.toml.loader import ConfigError
from bridge.wire.keys import boot_id
from bridge.wire.messages import Calibration, CommandReply, Placement
from bridge.wire.placement import MAX_WEARER, placement
from bridge.wire.refusal import Refusal
from bridge.wire.validation import MAX_SENTENCE
from estimator.client import Client
from estimator.config.dashboard import Dashboard, Person
from estimator.config.device_settings import Treatment
from estimator.config.people_file import with_people
from estimator.database import StoreError
from estimator.guide.guide import Guide
from estimator.service import history
from estimator.service.history import History
from estimator.service.store_reader import StoreReader
from estimator.web import cookie
from estimator.web.client_address import neighbourhood
from estimator.web.http_error import Fault
from estimator.web.hub import Hub
from estimator.web.login_attempts import Attempts
from estimator.web.passwords import Passwords
from estimator.web.sessions import Session, Sessions
from estimator.web.shared_work import SharedWork
from estimator.web.stream.feeds import Feeds
from estimator.web.ward_state import Known, Story

log = logging.getLogger(__name__)

#: how long what was read of a device from the store is used, s
PAST_S = 30.0
#: how long a chart is reused, s: drawing one costs a third of a second of a core
DRAWN_S = 5.0
#: how long a one-time link is good, s
INVITED_S = 24 * 3600.0
#: how a program must authenticate; a browser shows no prompt for it
CHALLENGE = {"WWW-Authenticate": 'Bearer realm="truerate"'}
VERBS = ("recalibrate", "cancel", "note", "place")


class Desk:
    """Shared services of a dashboard, used by all requests: ward state, sessions, passwords, commands and store.

    known: collected messages of the ward. store: file of the estimator's store. treatment: settings of each device.
    people: file that lists the people.
    """

    def __init__(
        self,
        known: Known,
        settings: Dashboard,
        store: Path | None = None,
        treatment: Treatment | None = None,
        people: Path | None = None,
    ) -> None:
        self.known, self.hub, self.settings = known, Hub(), settings
        self.treatment = treatment or Treatment()
        self.sessions = Sessions(settings.session_hours * 3600, settings.idle_minutes * 60)
        #: one-time links with which people choose their passwords
        self.invitations = Sessions(INVITED_S, INVITED_S)
        #: file that lists the people, for changes; None if there is none
        self._people = people
        #: subscriptions of programs that read the stream
        self.feeds = Feeds()
        #: client for data, and one for commands on a bus session of its own; None until a router is first connected
        self.client: Client | None = None
        self.control: Client | None = None
        self._attempts, self._passwords = Attempts(), Passwords(settings.people)
        self._one_at_a_time = asyncio.Lock()
        #: charts, and what the store has, by device
        self.pictures, self._pasts = SharedWork[bytes](DRAWN_S), SharedWork[History](PAST_S)
        self._store = store

    def use(self, settings: Dashboard, treatment: Treatment) -> None:
        """Apply changed settings; end the sessions of people who were removed, or whose role or password changed.

        treatment: settings of each device.
        """
        stay = {person.name for person in settings.people if person in self.settings.people}
        self.sessions.use(settings.session_hours * 3600, settings.idle_minutes * 60, stay)
        self.settings, self.treatment, self._passwords = settings, treatment, Passwords(settings.people)

    async def change_people(self, change: Callable[[Path], None], people: Iterable[Person]) -> None:
        """Change the file that lists the people by `change(path)`, and apply the new list `people` at once.

        Raises Fault if there is no such file, or it cannot be written.
        """
        if self._people is None:
            raise Fault(HTTPStatus.CONFLICT, "people_elsewhere")
        try:
            await run_in_threadpool(change, self._people)
        except (OSError, ConfigError) as error:
            log.error("the people in %s cannot be changed: %s", self._people, error)
            raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "people_not_written", file=self._people) from error
        self.use(with_people(self.settings, tuple(people)), self.treatment)

    @classmethod
    def of(cls, connection: HTTPConnection) -> "Desk":
        """Return the Desk of the application that received a request."""
        desk = connection.app.state.desk
        assert isinstance(desk, cls)
        return desk

    # ---- who asks -------------------------------------------------------------------------------------------------

    def session(self, connection: HTTPConnection) -> Session | None:
        """Return the login session of the request's cookie, or None."""
        return self.sessions.find(cookie.found(connection), time.monotonic())

    def checked(self, connection: HTTPConnection, csrf: str) -> Session:
        """Return the session of a person who gives a command. Raises Fault without a valid cookie and CSRF token."""
        session = self.session(connection)
        if session is None:
            raise Fault(HTTPStatus.UNAUTHORIZED, "log_in", headers=CHALLENGE)
        if not secrets.compare_digest(session.csrf.encode(), csrf.encode("utf-8", "replace")):
            raise Fault(HTTPStatus.FORBIDDEN, "stale_page")
        return session

    def administrator(self, request: Request, csrf: str) -> Session:
        """Return the session of an administrator who gives a command. Raises Fault for any other person."""
        session = self.checked(request, csrf)
        if session.role != "administrator":
            raise Fault(HTTPStatus.FORBIDDEN, "not_administrator")
        return session

    async def let_in(self, request: Request, name: str, password: str) -> None:
        """Check a name and password. Raises Fault if they are wrong, or after too many wrong attempts."""
        if not name or not password:
            raise Fault(HTTPStatus.BAD_REQUEST, "empty")
        address = neighbourhood(request.client.host if request.client else "")
        counted = name[:64]
        async with self._one_at_a_time:
            wait_s = self._attempts.wait_s(address, counted, time.monotonic())
            if wait_s > 0:
                raise Fault(
                    HTTPStatus.TOO_MANY_REQUESTS,
                    "too_many_tries",
                    headers={"Retry-After": f"{ceil(wait_s)}"},
                    seconds=ceil(wait_s),
                )
            if not await run_in_threadpool(self._passwords.right, name, password):
                self._attempts.failed(address, counted, time.monotonic())
                log.warning("a wrong name or password from %s", address)
                raise Fault(HTTPStatus.UNAUTHORIZED, "wrong_password", headers=CHALLENGE)
            self._attempts.succeeded(address, counted)

    # ---- devices --------------------------------------------------------------------------------------------------

    def story(self, device: str) -> Story:
        """Return the collected messages of a device. Raises Fault for an unknown device."""
        story = self.known.stories.get(device)
        if story is None:
            there = ", ".join(sorted(self.known.stories)[:20]) or "–"
            raise Fault(HTTPStatus.NOT_FOUND, "unknown_device", device=device[:64], names=there)
        return story

    def guide(self, device: str) -> Guide:
        """Create a new guide for the calibration of a device by hand, with the settings of the device."""
        story = self.known.stories.get(device)
        knobs = self.treatment.of(device, story.info.model if story and story.info else "")
        return Guide(knobs.method, knobs.prior.noise_std, horizontal=knobs.horizontal_turns)

    async def ask(self, device: str, verb: str, who: str, words: str | Placement = "") -> CommandReply:
        """Send a command to the estimator and return its reply.

        device: device id, or for `acknowledge` also an estimator's id. verb: `recalibrate`, `cancel`, `note`, `place`
        or `acknowledge`. who: name of the person.
        words: text of the command; for `place` the placement.
        Raises Fault for an unknown device or an invalid text, or if no estimator answers.
        """
        if verb != "acknowledge" or device not in self.known.alive["estimator"]:
            self.story(device)
        if isinstance(words, str):
            words = plain(words)
            if len(words) > MAX_SENTENCE or not words.isprintable():
                raise Fault(HTTPStatus.BAD_REQUEST, "bad_text", most=MAX_SENTENCE)
        if verb == "note" and not str(words).strip():
            raise Fault(HTTPStatus.BAD_REQUEST, "bad_text", reason=(Code.NOTE_EMPTY(),))
        if self.control is None:
            raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "no_router")
        commands: dict[str, Callable[[str, str, Any], CommandReply]] = {
            "recalibrate": self.control.recalibrate,
            "cancel": self.control.cancel,
            "note": self.control.note,
            "place": self.control.place,
            "acknowledge": self.control.acknowledge,
        }
        try:
            return await run_in_threadpool(commands[verb], device, who, words)
        except BusError as error:
            log.warning("%s: no answer to %s: %s", device, verb, error)
            raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "no_answer") from error

    async def past(self, request: Request, device: str) -> list[Calibration]:
        """Return all calibrations of a known device, oldest first: received ones, and older ones from the store.

        Also adds the device's stored history to the ward's state; the store is read at most every PAST_S seconds. A
        store that cannot be read is logged. Raises Fault for an unknown device.
        """
        story, store, stored = self.story(device), self._store, list[Calibration]()
        if store is not None and store.is_file():
            try:
                boot = boot_id(story.boot)
                key = f"{device} {story.serial} {boot}"
                past = await self._pasts.get(request, key, partial(_read, store, device, boot))
                self.known.take_past(past)
                stored.extend(past.calibrations)
            except (StoreError, OSError) as error:
                log.warning("the store %s cannot be read: %s", store, error)
        found = {one.id: one for one in stored} | story.calibrations
        return sorted(found.values(), key=lambda one: one.time_ns)


def _read(path: Path, device: str, boot: str) -> History:
    """Read what pages show of a device from the store: of its bias only that of one boot, which may be long enough."""
    with closing(StoreReader.reading(path)) as store:
        found = history.read(store, device)
    return replace(found, commands=(), biases=[one for one in found.biases if one.boot == boot])


def placed(segment: str, side: str, wearer: str) -> Placement:
    """Build a Placement from the fields of a form or request body; if all are empty, nobody wears the device.

    Raises Fault for an invalid one.
    """
    try:
        return placement(segment, side, plain(wearer))
    except Refusal:
        raise Fault(HTTPStatus.CONFLICT, "bad_placement", most=MAX_WEARER) from None


def plain(words: str) -> str:
    """Normalise a text for the store: every kind of space becomes a plain space, and format characters are removed."""
    kinds = ((letter, category(letter)) for letter in words)
    return "".join(" " if kind == "Zs" else letter for letter, kind in kinds if kind != "Cf")
