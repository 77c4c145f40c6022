"""The page of one device, and the commands it can be given there."""

import time
from http import HTTPStatus

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from bridge.wire.checks import MAX_SENTENCE
from estimator.web.desk import VERBS, Desk
from estimator.web.device_page import device_page
from estimator.web.form import fields
from estimator.web.pages import own, show


def routes() -> list[BaseRoute]:
    """Their places."""
    return [
        Route("/devices/{device}", device, name="device"),
        *(Route(f"/devices/{{device}}/{verb}", _commanding(verb), methods=["POST"]) for verb in VERBS),
    ]


async def device(request: Request) -> Response:
    """One device."""
    desk, name = Desk.of(request), request.path_params["device"]
    desk.story(name)
    await desk.remember(name)
    page = device_page(desk.known, name, time.monotonic(), time.time_ns())
    return show(request, "device.html", {"page": page, "longest": MAX_SENTENCE})


def _commanding(verb: str):  # type: ignore[no-untyped-def]
    async def command(request: Request) -> Response:
        """Ask the estimator, and go back to the page, where its answer is shown once."""
        desk, name = Desk.of(request), request.path_params["device"]
        given = await fields(request)
        session = desk.checked(request, given.get("csrf", ""))
        reply = await desk.ask(name, verb, session.name, given.get("words", ""))
        session.said = reply.accepted, f"{name}: {reply.message}"
        return RedirectResponse(own(given.get("to", f"/devices/{name}")), HTTPStatus.SEE_OTHER)

    return command
