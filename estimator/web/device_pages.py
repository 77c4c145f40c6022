"""The page of one device, and the commands it can be given there."""

import time
from http import HTTPStatus

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from bridge.wire.checks import MAX_SENTENCE
from estimator.texts import texts
from estimator.web.commanding import commands
from estimator.web.desk import Desk
from estimator.web.device_page import device_page
from estimator.web.form import fields
from estimator.web.language import language
from estimator.web.pages import own, show


def routes() -> list[BaseRoute]:
    """Their places."""
    return [
        Route("/devices/{device}", device, name="device"),
        *commands("/devices/{device}", command),
    ]


async def device(request: Request) -> Response:
    """One device."""
    desk, name = Desk.of(request), request.path_params["device"]
    desk.story(name)
    await desk.remember(name)
    page = device_page(desk.known, name, time.monotonic(), time.time_ns(), texts(language(request)))
    return show(request, "device.html", {"page": page, "longest": MAX_SENTENCE})


async def command(request: Request, verb: str) -> Response:
    """Ask the estimator, and go back to the page, where its answer is shown once."""
    desk, name = Desk.of(request), request.path_params["device"]
    given = await fields(request)
    session = desk.checked(request, given.get("csrf", ""))
    reply = await desk.ask(name, verb, session.name, given.get("words", ""))
    session.said = reply.accepted, name, reply.message
    return RedirectResponse(own(given.get("to", f"/devices/{name}")), HTTPStatus.SEE_OTHER)
