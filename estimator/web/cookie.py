"""Session cookie: readable by the server only, and under TLS bound to this host."""

from starlette.requests import HTTPConnection
from starlette.responses import Response

NAME = "truerate"


def name(connection: HTTPConnection) -> str:
    """Name of the cookie. Under TLS the `__Host-` prefix keeps other hosts and pages without TLS from setting it."""
    return f"__Host-{NAME}" if _secure(connection) else NAME


def found(connection: HTTPConnection) -> str:
    """Session cookie sent by the browser; empty if there is none."""
    return connection.cookies.get(name(connection), "")


def give(response: Response, connection: HTTPConnection, value: str, hours: float) -> None:
    """Set the session cookie."""
    response.set_cookie(
        name(connection),
        value,
        max_age=round(hours * 3600),
        httponly=True,
        samesite="strict",
        secure=_secure(connection),
    )


def take(response: Response, connection: HTTPConnection) -> None:
    """Delete the session cookie."""
    response.delete_cookie(name(connection), httponly=True, samesite="strict", secure=_secure(connection))


def _secure(connection: HTTPConnection) -> bool:
    return connection.url.scheme in ("https", "wss")
