"""The cookie of a session: for the server alone, and under TLS for this host alone."""

from starlette.requests import HTTPConnection
from starlette.responses import Response

NAME = "truerate"


def name(connection: HTTPConnection) -> str:
    """Under TLS one that no neighbouring host and no page without TLS can set, as a browser sees to by its prefix."""
    return f"__Host-{NAME}" if _secure(connection) else NAME


def found(connection: HTTPConnection) -> str:
    """What the browser says; nothing when it has none."""
    return connection.cookies.get(name(connection), "")


def give(response: Response, connection: HTTPConnection, value: str, hours: float) -> None:
    """Let the browser keep it."""
    response.set_cookie(
        name(connection),
        value,
        max_age=round(hours * 3600),
        httponly=True,
        samesite="strict",
        secure=_secure(connection),
    )


def take(response: Response, connection: HTTPConnection) -> None:
    """Let the browser forget it."""
    response.delete_cookie(name(connection), httponly=True, samesite="strict", secure=_secure(connection))


def _secure(connection: HTTPConnection) -> bool:
    return connection.url.scheme in ("https", "wss")
