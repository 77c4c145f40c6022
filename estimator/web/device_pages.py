"""HTTP routes of a device's page, and of the commands that a person gives there."""

import time
from contextlib import suppress
from http import HTTPStatus

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from bridge.reasons.codes import Code
from bridge.wire.messages import SEGMENTS, SIDES, CommandReply, Placement
from bridge.wire.placement import MAX_WEARER
from bridge.wire.validation import MAX_SENTENCE
from estimator.guide.guide import CALIBRATING
from estimator.language.texts import texts
from estimator.web.device_page import device_page
from estimator.web.http_error import Fault
from estimator.web.language import language
from estimator.web.pages import own, show
from estimator.web.request_form import fields
from estimator.web.site import VERBS, Desk, placed

#: choices of the placement's form
_PLACING = {"segments": tuple(SEGMENTS), "sides": SIDES, "longest_wearer": MAX_WEARER}


def routes() -> list[BaseRoute]:
    """Return the routes of the device page, and of the commands sent by forms of pages."""
    verbs = (*VERBS, "acknowledge")
    return [
        Route("/devices/{device}", device, name="device"),
        *(Route(f"/devices/{{device}}/{verb}", command, methods=["GET", "POST"]) for verb in verbs),
    ]


async def device(request: Request) -> Response:
    """Serve the page of one device. Raises Fault for an unknown device."""
    desk, name = Desk.of(request), request.path_params["device"]
    desk.story(name)
    with suppress(Fault):  # without the store's past if too many ask for it at once
        await desk.past(request, name)
    told = desk.treatment.told(name)
    page = device_page(desk.known, name, time.monotonic(), time.time_ns(), texts(language(request)), told)
    return show(request, "device.html", {"page": page, "longest": MAX_SENTENCE, **_PLACING})


async def command(request: Request) -> Response:
    """Send the command of a page's form to the estimator, then redirect to a page, which shows the reply once.

    The last part of the path is the command. A GET request, as after a reload, only redirects. Raises Fault for an
    unknown device, and for a wrong session or CSRF token.
    """
    desk, name, verb = Desk.of(request), request.path_params["device"], request.scope["path"].rpartition("/")[2]
    given = await fields(request)
    if request.method == "POST":
        session = desk.checked(request, given.get("csrf", ""))
        try:
            reply = await _asked(desk, name, verb, session.name, _said(verb, given))
            session.said = reply.accepted, name, lambda t: t.text(reply.message)
        except Fault as fault:
            if fault.status is HTTPStatus.NOT_FOUND:
                raise
            session.said, session.draft = (False, name, fault.text), given.get("words", "")[:MAX_SENTENCE]
    return RedirectResponse(own(given.get("to", f"/devices/{name}")), HTTPStatus.SEE_OTHER)


def _said(verb: str, given: dict[str, str]) -> str | Placement:
    if verb == "place":
        return placed(given.get("segment", ""), given.get("side", ""), given.get("wearer", ""))
    return given.get("words", "")


async def _asked(desk: Desk, name: str, verb: str, who: str, words: str | Placement) -> CommandReply:
    """The estimator's reply. Refuses to recalibrate from a stale page when that would undo another person's turns."""
    status = desk.story(name).status if verb == "recalibrate" else None
    if status is not None and status.state in CALIBRATING and status.axes_done:
        return CommandReply("", accepted=False, message=(Code.TURNS_WOULD_BE_LOST(),))
    return await desk.ask(name, verb, who, words)
