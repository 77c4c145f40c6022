"""Security checks around every page: Host and Origin of each request, and security headers of each response."""

from collections.abc import Callable
from http import HTTPStatus

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from bridge.runtime.health_server import own_host
from estimator.config.dashboard import Dashboard
from estimator.web.api import routes
from estimator.web.http_error import Fault

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
#: most characters of a path with its parameters
LONGEST = 8000
_SAFE = ("GET", "HEAD", "OPTIONS")
#: where pages of other origins may read; only its WebSocket comes to the check of origins, the rest of it changes nothing
STREAM = f"{routes.ROOT}/stream"
#: websocket close code for a policy violation
_POLICY = 1008
#: scheme of the asking page's origin, by scheme of the request
_SCHEMES = {"http": "http", "ws": "http", "https": "https", "wss": "https"}


class Guard:
    """ASGI middleware that refuses requests with an unknown Host or a foreign Origin, and adds security headers.

    A foreign Origin is that of a page from another site. settings: function that returns the current settings, with the
    names `hosts` and `origins`. Pages of these `origins` may nevertheless read the WebSocket with corrected rates.
    """

    def __init__(self, app: ASGIApp, settings: Callable[[], Dashboard]) -> None:
        self._app, self._settings = app, settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return

        async def dressed(message: Message) -> None:
            if message["type"] == "http.response.start":
                dress(scope["path"], MutableHeaders(scope=message))
            await send(message)

        if (refusal := self._refused(scope)) is None:
            await self._app(scope, receive, dressed)
        elif scope["type"] == "websocket":
            await WebSocket(scope, receive, send).close(_POLICY, refusal.code)
        else:
            await _answer(scope["path"], refusal)(scope, receive, dressed)

    def _refused(self, scope: Scope) -> Fault | None:
        """Why the request is refused, or None. An unknown host name may be a foreign page's, pointed at our address."""
        if len(scope["path"]) + len(scope["query_string"]) > LONGEST:
            words = f"The address is longer than {LONGEST} characters, the most that is allowed."
            return Fault(HTTPStatus.REQUEST_URI_TOO_LONG, "too_long", words)
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not own_host(host, {"localhost", *(name.lower() for name in self._settings().hosts)}):
            words = f"The host {host[:80]!r} is unknown: add it to `hosts` in [dashboard]."
            return Fault(HTTPStatus.BAD_REQUEST, "foreign_host", words)
        if scope["type"] == "http" and scope["method"] in _SAFE:
            return None
        if scope["path"] == STREAM and headers.get("origin") in self._settings().origins:
            return None
        ours, origin = f"{_SCHEMES[scope['scheme']]}://{host.lower()}", headers.get("origin")
        if origin is not None and origin.lower() != ours:
            words = f"The request comes from a page of another origin: {origin[:80]!r} is not {ours}."
            if origin.lower() == f"https:{ours.partition(':')[2]}":
                words += (
                    " If a proxy ends TLS, set `behind_proxy` in [dashboard], and let the proxy send X-Forwarded-Proto."
                )
            return Fault(HTTPStatus.FORBIDDEN, "foreign_origin", words)
        if origin is None and headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return Fault(HTTPStatus.FORBIDDEN, "foreign_origin", "The request comes from a page of another site.")
        return None


def dress(path: str, headers: MutableHeaders) -> None:
    """Add the security headers and Cache-Control to a response's headers, in place.

    path: path of the request. Only files of /static/ may be cached.
    """
    for name, value in HEADERS.items():
        headers.setdefault(name, value)
    headers.setdefault("Cache-Control", "no-cache" if path.startswith("/static/") else "no-store")


def _answer(path: str, fault: Fault) -> Response:
    """Plain refusal without a page, since a page would appear under a foreign name."""
    if path.startswith(routes.ROOT):
        return routes.refused(fault)
    return PlainTextResponse(fault.message + "\n", fault.status)
