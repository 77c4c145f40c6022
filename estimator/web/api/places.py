"""Where programs ask: /api/v1."""

import time
from http import HTTPStatus
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal
from estimator.web import form
from estimator.web.api import answers, openapi
from estimator.web.commanding import commands
from estimator.web.desk import CHALLENGE, Desk
from estimator.web.fault import Fault

ROOT = "/api/v1"
_JSON = "application/json"


def routes() -> list[BaseRoute]:
    """Their places."""
    return [
        Route(f"{ROOT}/openapi.json", document),
        Route(f"{ROOT}/devices", devices),
        Route(f"{ROOT}/devices/{{device}}", device),
        Route(f"{ROOT}/devices/{{device}}/calibrations", calibrations),
        *commands(f"{ROOT}/devices/{{device}}", command),
    ]


def answer(content: Any, status: HTTPStatus = HTTPStatus.OK, headers: dict[str, str] | None = None) -> Response:
    """JSON."""
    return Response(msgspec.json.encode(content), status, headers, _JSON)


def refused(fault: Fault) -> Response:
    """Why not, as JSON."""
    return answer(answers.Error(answers.ErrorWords(fault.code, fault.message)), fault.status, fault.headers)


async def document(request: Request) -> Response:  # noqa: ARG001 - an endpoint
    """What can be asked, and what is answered."""
    return answer(openapi.document())


async def devices(request: Request) -> Response:
    """All of them, or with ?only= those in a state, or whose id matches."""
    desk = Desk.of(request)
    _parameters(request, "only")
    rows = desk.known.rows(time.monotonic())
    only = request.query_params.getlist("only")
    if "" in only:
        raise Fault(HTTPStatus.BAD_REQUEST, "unknown_parameter", "'only' is empty; it takes a state, or an id.")
    return answer(answers.devices(desk.known, rows, only))


async def device(request: Request) -> Response:
    """One."""
    desk, name = Desk.of(request), _named(request)
    return answer(answers.device(desk.known.row(name, time.monotonic()), desk.story(name)))


async def calibrations(request: Request) -> Response:
    """Those of one."""
    desk, name = Desk.of(request), _named(request)
    await desk.remember(name)
    return answer(answers.calibrations(name, desk.story(name)))


def _parameters(request: Request, *known: str) -> None:
    unknown = set(request.query_params) - set(known)
    if unknown:
        there = f"there is {', '.join(map(repr, known))}" if known else "there are none here"
        message = f"There is no parameter {min(unknown)[:40]!r}; {there}."
        raise Fault(HTTPStatus.BAD_REQUEST, "unknown_parameter", message)


def _named(request: Request) -> str:
    """The device of the path; Fault when it is no id, or none that was heard of."""
    name = request.path_params["device"]
    _parameters(request)
    try:
        check_id(name, "device")
    except Refusal as refusal:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_id", refusal.detail) from None
    Desk.of(request).story(name)
    return str(name)


async def command(request: Request, verb: str) -> Response:
    """Ask the estimator; 409 when it does not do it."""
    desk = Desk.of(request)
    who = await _who(desk, request)
    words = await _words(request)
    reply = await desk.ask(_named(request), verb, who, words)
    if not reply.accepted:
        raise Fault(HTTPStatus.CONFLICT, "not_accepted", reply.message)
    return answer(answers.Reply(accepted=True, message=reply.message))


async def _who(desk: Desk, request: Request) -> str:
    """Who asks: by `Authorization: Bearer name.secret`, or by a page's cookie with its X-CSRF-Token."""
    kind, _, credentials = request.headers.get("authorization", "").partition(" ")
    if not kind:
        return desk.checked(request, request.headers.get("x-csrf-token", "")).name
    name, _, secret = credentials.strip().partition(".")
    if kind.lower() != "bearer" or not secret:
        raise Fault(HTTPStatus.UNAUTHORIZED, "log_in", "Authorization is taken as `Bearer name.secret`.", CHALLENGE)
    await desk.let_in(request, name, secret)
    return name


async def _words(request: Request) -> str:
    body = await form.body(request)
    if not body:
        return ""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != _JSON:
        raise Fault(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "not_json", f"{kind[:40] or 'Nothing'} is not taken; {_JSON} is."
        )
    try:
        return msgspec.json.decode(body, type=answers.Words).words
    except msgspec.ValidationError as error:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_body", f"{error}.") from None
    except msgspec.DecodeError as error:
        raise Fault(HTTPStatus.BAD_REQUEST, "not_json", f"{error}.") from None
