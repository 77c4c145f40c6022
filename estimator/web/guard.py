"""What every answer carries and every request is asked, whatever the page: host, origin, and headers that bind the browser."""

from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

HEADERS = {
    "Content-Security-Policy": "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
_SAFE = ("GET", "HEAD", "OPTIONS")
#: what the policy's code of a websocket says: this is not taken from there
_POLICY = 1008


class Guard:
    """An ASGI application around another."""

    def __init__(self, app: ASGIApp, hosts: tuple[str, ...]) -> None:
        self._app, self._hosts = app, {"localhost", *(host.lower() for host in hosts)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if (refusal := self._refused(scope)) is not None:
            if scope["type"] == "websocket":
                await WebSocket(scope, receive, send).close(_POLICY, refusal)
            else:
                await PlainTextResponse(refusal + "\n", 400 if "host" in refusal else 403)(scope, receive, send)
            return

        async def dressed(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                static = scope["path"].startswith("/static/")
                headers.setdefault("Cache-Control", "no-cache" if static else "no-store")
            await send(message)

        await self._app(scope, receive, dressed)

    def _refused(self, scope: Scope) -> str | None:
        """Why it is not taken, or None. A name that is not ours may be a foreign page's, led to our address."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._ours(host):
            return f"This is not the host {host[:80]!r}; name it in `hosts` of [dashboard]."
        if scope["type"] == "http" and scope["method"] in _SAFE:
            return None
        origin = headers.get("origin")
        if origin is not None and _netloc(origin) != host.lower():
            return "A page of another origin asks."
        if origin is None and headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return "A page of another site asks."
        return None

    def _ours(self, host: str) -> bool:
        try:
            split = urlsplit(f"//{host}")
            name = split.hostname or ""
            if split.username is not None or split.port == 0:  # a port that is none is a ValueError
                return False
        except ValueError:
            return False
        if name in self._hosts:
            return True
        try:
            ip_address(name)
        except ValueError:
            return False
        return True  # an address cannot be led elsewhere


def _netloc(origin: str) -> str | None:
    """Host and port of an origin; None of what is none."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None
