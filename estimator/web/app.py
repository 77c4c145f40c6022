"""Dashboard as an ASGI application: routes, security checks, and error responses."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from http import HTTPStatus
from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Mount
from starlette.staticfiles import StaticFiles

from estimator.web import device_pages, guide_pages, live, openid, pages, people_pages, report_pages
from estimator.web.api import routes as places
from estimator.web.broadcast import Broadcast
from estimator.web.guard import Guard, dress
from estimator.web.http_error import Fault
from estimator.web.site import Desk
from estimator.web.stream import routes as stream

STATIC = Path(__file__).parent / "static"
#: answers that are not compressed: 50 programs that poll the stream would keep all cores busy, and pages waiting
_AS_IT_IS = (*DEFAULT_EXCLUDED_CONTENT_TYPES, "application/json")


def routes() -> list[BaseRoute]:
    """Return all routes of the dashboard: those of each part (a module with `routes()`), and the static files.

    New parts must be listed here.
    """
    parts = (pages, people_pages, device_pages, guide_pages, report_pages, places, stream, live)
    return [*(route for part in parts for route in part.routes()), Mount("/static", StaticFiles(directory=STATIC))]


def application(desk: Desk, broadcast: Broadcast) -> Starlette:
    """Build the ASGI application of one dashboard: routes, security checks, compression and error pages.

    desk: services shared by all requests. broadcast: loop that sends live content to pages; it runs while the
    application runs.
    """

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        running = asyncio.create_task(broadcast.run())
        try:
            yield
        finally:
            running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await running
            desk.hub.close()
            desk.feeds.close()
            broadcast.close()

    app = Starlette(
        routes=[*openid.routes(desk.settings), *routes()],
        middleware=[
            Middleware(Guard, settings=lambda: desk.settings),
            Middleware(GZipMiddleware, minimum_size=2000, exclude_content_types=_AS_IT_IS),
        ],
        exception_handlers={Fault: _refused, HTTPException: _not_there, Exception: _failed},
        lifespan=lifespan,
    )
    app.router.redirect_slashes = False  # a redirect would be built from the client's own Host header
    app.state.desk = desk
    return app


async def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, Fault)
    return _answer(request, error)


async def _not_there(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    status = HTTPStatus(error.status_code)
    known = status in (HTTPStatus.NOT_FOUND, HTTPStatus.METHOD_NOT_ALLOWED)
    code, message = status.phrase.lower().replace(" ", "_"), "" if known else error.detail
    fault = Fault(status, code, message, dict(error.headers or {}), method=request.method)
    return _answer(request, fault)


async def _failed(request: Request, error: Exception) -> Response:  # noqa: ARG001 - the server logs the error
    """Error response sent outside the guard, so its headers are added here."""
    answer = _answer(request, Fault(HTTPStatus.INTERNAL_SERVER_ERROR, "failed"))
    dress(request.url.path, answer.headers)
    return answer


def _answer(request: Request, fault: Fault) -> Response:
    if request.url.path.startswith(places.ROOT):
        return places.refused(fault)
    response = pages.show(request, "fault.html", {"fault": fault, "back": _back(request)}, fault.status)
    response.headers.update(fault.headers)
    return response


def _back(request: Request) -> str:
    """Page of the device in the path, if that device is known; else the ward page."""
    device = request.path_params.get("device", "")
    return f"/devices/{device}" if device in Desk.of(request).known.stories else "/"
