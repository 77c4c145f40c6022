"""Pages that guide a person through calibrations: of one device, and of a whole ward."""

import time
from contextlib import suppress

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from estimator.language.texts import texts
from estimator.overview.ward import to_calibrate
from estimator.web.guide_view import guide_view
from estimator.web.http_error import Fault
from estimator.web.language import language
from estimator.web.pages import show
from estimator.web.site import Desk
from estimator.web.tiles import ward_page


def routes() -> list[BaseRoute]:
    """Return the routes of the two guides: for one device, and for all devices that wait for a calibration."""
    return [
        Route("/devices/{device}/calibrate", calibrate, name="calibrate"),
        Route("/calibrate", queue, name="queue"),
    ]


async def queue(request: Request) -> Response:
    """Serve the page for calibrating the devices of a ward, several at once."""
    desk = Desk.of(request)
    now = time.monotonic()
    waiting = to_calibrate(desk.known.rows(now))
    page = ward_page(desk.known, now, time.time_ns(), texts(language(request)))
    return show(request, "queue.html", {"page": page, "waiting": waiting})


async def calibrate(request: Request) -> Response:
    """Serve the guide page of one device with its present content; the live stream then updates it.

    Raises Fault for an unknown device.
    """
    desk, name = Desk.of(request), request.path_params["device"]
    story = desk.story(name)
    with suppress(Fault):  # without the store's past if too many ask for it at once
        await desk.past(request, name)
    guide = desk.guide(name)
    if story.status is not None:
        guide.take_status(story.status)
    page = guide_view(guide.told(), desk.known, name, time.monotonic())
    return show(request, "guide.html", {"page": page, "told": page.say[language(request)], "quiet": True})
