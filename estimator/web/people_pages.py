"""Pages on which an administrator manages the ward's people, and a person chooses a password.

A one-time link opens the password page.
"""

import logging
import secrets
import time
from collections.abc import Mapping
from functools import partial
from http import HTTPStatus

import msgspec
from msgspec.structs import replace
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from estimator.config import people_file
from estimator.config.dashboard import PERSON_ROLES, Person
from estimator.web.http_error import Fault
from estimator.web.pages import show
from estimator.web.passwords import MIN_LENGTH, hashed
from estimator.web.request_form import fields
from estimator.web.site import INVITED_S, Desk

log = logging.getLogger(__name__)


def routes() -> list[BaseRoute]:
    """Return the routes of the people page and of one-time links."""
    return [
        Route("/people", people, name="people"),
        Route("/people", change, methods=["POST"]),
        Route("/welcome", welcome, name="welcome"),
        Route("/welcome", choose, methods=["POST"]),
    ]


async def people(request: Request) -> Response:
    """Serve the list of people. Raises Fault if the request is not from an administrator."""
    session = Desk.of(request).session(request)
    Desk.of(request).administrator(request, session.csrf if session else "")
    return _listed(request)


async def change(request: Request) -> Response:
    """Change the list of people as requested by an administrator's form, and show it.

    Adds or removes a person, changes a role, or makes a one-time link for a new password. Raises Fault for an invalid
    form, and for a change that would leave no administrator.
    """
    desk, given = Desk.of(request), await fields(request)
    session = desk.administrator(request, given.get("csrf", ""))
    do, there = given.get("do"), {one.name: one for one in desk.settings.people}
    person, after = there.get(name := given.get("name", "").strip()), dict(there)
    if (person is None) != (do == "add"):
        raise Fault(HTTPStatus.CONFLICT, "known_person" if person else "unknown_person", name=name[:32])
    if do == "remove":
        del after[name]
    elif do in ("add", "role"):
        unknown = await run_in_threadpool(hashed, secrets.token_urlsafe(32)) if person is None else person.password
        try:
            after[name] = msgspec.convert({"name": name, "role": given.get("role"), "password": unknown}, Person)
        except msgspec.ValidationError:
            raise Fault(HTTPStatus.BAD_REQUEST, "bad_name") from None
    elif do != "link":
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_form")
    if _administrators(there) and not _administrators(after):
        raise Fault(HTTPStatus.CONFLICT, "last_administrator")
    if after != there:
        await _write(desk, name, after)
    log.warning("%s: people: %s %s", session.name, do, name)
    if do in ("add", "link"):
        key = desk.invitations.begin(name, time.monotonic())
        return _listed(request, link=request.url_for("welcome").include_query_params(key=key), name=name)
    return RedirectResponse("/people", HTTPStatus.SEE_OTHER)


async def welcome(request: Request) -> Response:
    """Serve the form of a one-time link, on which a person chooses a password. Raises Fault for an expired link."""
    key = request.query_params.get("key", "")
    return show(request, "welcome.html", {"key": key, "person": _invited(Desk.of(request), key)})


async def choose(request: Request) -> Response:
    """Set the password that a person chose, end the one-time link, and redirect to the login.

    Shows the form again if the two passwords differ or are too short.
    """
    desk, given = Desk.of(request), await fields(request)
    person = _invited(desk, key := given.get("key", ""))
    password, again = given.get("password", ""), given.get("again", "")
    if password != again or len(password) < MIN_LENGTH:
        fault = Fault(HTTPStatus.BAD_REQUEST, "bad_password", least=MIN_LENGTH)
        return show(request, "welcome.html", {"key": key, "person": person, "wrong": fault}, fault.status)
    after = {one.name: one for one in desk.settings.people}
    after[person.name] = replace(person, password=await run_in_threadpool(hashed, password))
    await _write(desk, person.name, after)
    desk.invitations.end(key)
    return RedirectResponse("/login", HTTPStatus.SEE_OTHER)


def _listed(request: Request, **values: object) -> Response:
    desk = Desk.of(request)
    page = {"people": desk.settings.people, "roles": PERSON_ROLES, "hours": round(INVITED_S / 3600), **values}
    return show(request, "people.html", page)


def _administrators(people: Mapping[str, Person]) -> bool:
    return any(one.role == "administrator" for one in people.values())


async def _write(desk: Desk, name: str, after: Mapping[str, Person]) -> None:
    """Write what `after` says about one person."""
    if person := after.get(name):
        written = partial(people_file.put, ward=desk.known.ward, person=person)
    else:
        written = partial(people_file.remove, name=name)
    await desk.change_people(written, after.values())


def _invited(desk: Desk, key: str) -> Person:
    """Person of a one-time link; raises Fault for a link that ended."""
    found = desk.invitations.find(key, time.monotonic())
    for person in desk.settings.people:
        if found and person.name == found.name:
            return person
    raise Fault(HTTPStatus.NOT_FOUND, "link_ended")
