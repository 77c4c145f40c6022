"""Session cookie: readable by the server only, and under TLS bound to this host."""

from starlette.requests import HTTPConnection
from starlette.responses import Response

NAME = "truerate"


def name(connection: HTTPConnection) -> str:
    """Return the session cookie's name.

    Under TLS the `__Host-` prefix keeps other hosts and pages without TLS from setting it.
    """
    return f"__Host-{NAME}" if _secure(connection) else NAME


def found(connection: HTTPConnection) -> str:
    """Return the value of the session cookie that the browser sent; empty if there is none."""
    return connection.cookies.get(name(connection), "")


def give(response: Response, connection: HTTPConnection, value: str, hours: float) -> None:
    """Set the session cookie in a response: its value, valid for `hours` hours, hidden from scripts and other sites."""
    response.set_cookie(
        name(connection),
        value,
        max_age=round(hours * 3600),
        httponly=True,
        samesite="strict",
        secure=_secure(connection),
    )


def take(response: Response, connection: HTTPConnection) -> None:
    """Delete the session cookie by a header of the response."""
    response.delete_cookie(name(connection), httponly=True, samesite="strict", secure=_secure(connection))


def _secure(connection: HTTPConnection) -> bool:
    return connection.url.scheme in ("https", "wss")
