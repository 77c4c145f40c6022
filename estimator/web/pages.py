"""Server-rendered pages of the ward, with login and logout; live.js updates them."""

import time
from collections.abc import Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route
from starlette.templating import Jinja2Templates

from estimator.language.texts import LANGUAGES, texts
from estimator.web import cookie
from estimator.web.http_error import Fault
from estimator.web.language import keep, language
from estimator.web.request_form import fields
from estimator.web.site import Desk
from estimator.web.tiles import ward_page

TEMPLATES = Jinja2Templates(Path(__file__).parent / "templates")
TEMPLATES.env.trim_blocks = TEMPLATES.env.lstrip_blocks = True


def routes() -> list[BaseRoute]:
    """Return the routes of the ward page, login and logout."""
    return [
        Route("/", ward, name="ward"),
        Route("/login", login_form, name="login"),
        Route("/login", login, methods=["POST"]),
        Route("/logout", logout, methods=["POST"], name="logout"),
    ]


def show(request: Request, template: str, values: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> Response:
    """Render a template in the reader's language, with ward, session, and messages to show once.

    values: further variables of the template. status: of the response.
    """
    desk = Desk.of(request)
    session = desk.session(request)
    frame = {
        "ward": desk.known.ward,
        "session": session,
        "said": session.take_said() if session else None,
        "draft": session.take_draft() if session else "",
        "can_log_in": bool(desk.settings.people or desk.settings.openid),
        "openid": desk.settings.openid,
        "say": texts(language(request)),
        "languages": [texts(one) for one in LANGUAGES],
    }
    return keep(request, TEMPLATES.TemplateResponse(request, template, {**frame, **values}, status_code=status))


async def ward(request: Request) -> Response:
    """Serve the ward page; ?wall=1 serves the version for a wall screen without input."""
    page = ward_page(Desk.of(request).known, time.monotonic(), time.time_ns(), texts(language(request)))
    wall = request.query_params.get("wall") == "1"  # a screen that nobody touches
    plain = wall or request.cookies.get("truerate-numbers") != "1"  # set by static/choice.js
    return show(request, "ward.html", {"page": page, "plain": plain, "wall": wall})


async def login_form(request: Request) -> Response:
    """Serve the login form, or redirect a person who is logged in already."""
    to = own(request.query_params.get("to", "/"))
    if Desk.of(request).session(request) is not None:
        return RedirectResponse(to, HTTPStatus.SEE_OTHER)
    return show(request, "login.html", {"to": to, "name": "", "wrong": ""})


async def login(request: Request) -> Response:
    """Check name and password, and start a session; if they are wrong, show the form again with the reason."""
    desk = Desk.of(request)
    given = await fields(request)
    name, to = given.get("name", "").strip(), own(given.get("to", "/"))
    try:
        await desk.let_in(request, name, given.get("password", ""))
    except Fault as fault:
        page = show(request, "login.html", {"to": to, "name": name[:64], "wrong": fault}, fault.status)
        page.headers.update(fault.headers)
        return page
    response = RedirectResponse(to, HTTPStatus.SEE_OTHER)
    role = next((one.role for one in desk.settings.people if one.name == name), "operator")
    begin(request, response, name, role)
    return response


def begin(request: Request, response: Response, name: str, role: str, *, elsewhere: bool = False) -> None:
    """Start a person's session, set its cookie in `response`, and end the browser's earlier session.

    role: which actions are allowed. elsewhere: whether an OpenID Connect provider authenticated the person.
    """
    desk = Desk.of(request)
    instead = cookie.found(request)
    value = desk.sessions.begin(name, time.monotonic(), role, elsewhere=elsewhere, instead=instead)
    cookie.give(response, request, value, desk.settings.session_hours)


async def logout(request: Request) -> Response:
    """End the session, delete its cookie, and redirect to the ward page.

    Raises Fault for a wrong session or CSRF token.
    """
    desk = Desk.of(request)
    desk.checked(request, (await fields(request)).get("csrf", ""))
    desk.sessions.end(cookie.found(request))
    response = RedirectResponse("/", HTTPStatus.SEE_OTHER)
    cookie.take(response, request)
    return response


def own(path: str) -> str:
    """Return a safe redirect target: `path` if it is a path of this site other than login and logout, else `/`."""
    ours = path.startswith("/") and not path.startswith(("//", "/\\", "/login", "/logout")) and path.isprintable()
    return path if ours else "/"
