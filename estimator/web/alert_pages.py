"""HTTP route by which a person acknowledges an alert on the ward page."""

from collections.abc import Iterator
from http import HTTPStatus

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal
from estimator.web.http_error import Fault
from estimator.web.pages import own
from estimator.web.request_form import fields
from estimator.web.site import Desk


def routes() -> Iterator[BaseRoute]:
    """Yield the POST route /alerts/acknowledge, which the button on the ward page calls."""
    yield Route("/alerts/acknowledge", acknowledge, methods=["POST"])


async def acknowledge(request: Request) -> Response:
    """Acknowledge the alert named in the form (`id`: SUBJECT/KIND), then redirect to the page in `to`.

    That page shows the reply once. Raises Fault for a malformed id and for a wrong session or CSRF token.
    """
    desk, given = Desk.of(request), await fields(request)
    session = desk.checked(request, given.get("csrf", ""))
    subject, _, kind = given.get("id", "").partition("/")
    try:
        check_id(subject, "device")
    except Refusal:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_form") from None
    try:
        reply = await desk.ask(subject, "acknowledge", session.name, kind)
        session.said = reply.accepted, subject, lambda t: t.text(reply.message)
    except Fault as fault:
        session.said = False, subject, fault.text
    return RedirectResponse(own(given.get("to", "/")), HTTPStatus.SEE_OTHER)
