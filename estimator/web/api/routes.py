"""Routes of the HTTP API for programs, /api/v1."""

import time
from http import HTTPStatus
from typing import Any, TypeVar

import msgspec
from starlette.datastructures import QueryParams
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from bridge.wire.keys import check_id
from bridge.wire.messages import Placement
from bridge.wire.refusal import Refusal
from estimator.web import request_form
from estimator.web.api import answers, openapi
from estimator.web.http_error import Fault
from estimator.web.site import CHALLENGE, VERBS, Desk, placed

ROOT = "/api/v1"
_JSON = "application/json"
T = TypeVar("T", answers.Words, answers.Placing)


def routes() -> list[BaseRoute]:
    """Return the routes of the HTTP API, all below /api/v1."""
    return [
        Route(f"{ROOT}/openapi.json", document),
        Route(f"{ROOT}/devices", devices),
        Route(f"{ROOT}/devices/{{device}}", device),
        Route(f"{ROOT}/devices/{{device}}/calibrations", calibrations),
        Route(f"{ROOT}/alerts", standing),
        Route(f"{ROOT}/alerts/{{device}}/acknowledge", command, methods=["POST"]),
        *(Route(f"{ROOT}/devices/{{device}}/{verb}", command, methods=["POST"]) for verb in VERBS),
    ]


def answer(content: Any, status: HTTPStatus = HTTPStatus.OK, headers: dict[str, str] | None = None) -> Response:
    """Build a JSON response from `content`, encoded by msgspec, with status and headers."""
    return Response(msgspec.json.encode(content), status, headers, _JSON)


def refused(fault: Fault) -> Response:
    """Build the JSON error response (`answers.Error`) of a fault, with its status and headers."""
    return answer(
        answers.Error(answers.ErrorWords(fault.code, fault.message, answers.said(fault.reason))),
        fault.status,
        fault.headers,
    )


async def document(request: Request) -> Response:
    """Serve the OpenAPI document as JSON. Raises Fault for any query parameter."""
    known_parameters(request)
    return answer(openapi.document())


async def devices(request: Request) -> Response:
    """Serve all devices of the ward as JSON (`answers.Devices`); devices that need a person come first."""
    known_parameters(request)
    return answer(answers.devices(Desk.of(request).known, time.monotonic()))


async def device(request: Request) -> Response:
    """Serve one device as JSON (`answers.Device`). Raises Fault for a malformed or unknown id."""
    known_parameters(request)
    desk, name = Desk.of(request), _named(request)
    return answer(answers.device(desk.known.row(name, time.monotonic()), desk.story(name)))


async def calibrations(request: Request) -> Response:
    """Serve a device's calibrations as JSON (`answers.Calibrations`), latest first.

    With ?before=ID, only those older than the calibration ID. ?limit=N bounds their number. Raises Fault for an unknown
    device or calibration.
    """
    asked = known_parameters(request, "before", "limit")
    desk, name = Desk.of(request), _named(request)
    found = await desk.past(request, name)
    before = asked.get("before")
    if before is not None:
        ids = [calibration.id for calibration in found]
        if before not in ids:
            raise Fault(HTTPStatus.NOT_FOUND, "unknown_calibration", id=before[:64], device=name)
        found = found[: ids.index(before)]
    return answer(answers.calibrations(name, desk.story(name), found, _limit(asked.get("limit", f"{answers.PAGE}"))))


def known_parameters(request: HTTPConnection, *names: str) -> QueryParams:
    """Return the query parameters of a request. Raises Fault if one is not in `names`."""
    unknown = set(request.query_params) - set(names)
    if unknown:
        there = f"use {', '.join(names)}" if names else "this address takes no parameters"
        words = f"Unknown parameter {min(unknown)[:40]!r}: {there}."
        raise Fault(HTTPStatus.BAD_REQUEST, "unknown_parameter", words)
    return request.query_params


def _limit(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 9 and 1 <= int(text) <= answers.MOST):
        words = f"'limit' is {text[:40]!r}; allowed: 1 to {answers.MOST}."
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_parameter", words)
    return int(text)


def _named(request: Request) -> str:
    """Device id in the path; raises Fault if the id is malformed or unknown."""
    name = _checked(request)
    Desk.of(request).story(name)
    return name


def _checked(request: Request) -> str:
    try:
        return check_id(request.path_params["device"], "device")
    except Refusal as refusal:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_id", refusal.detail) from None


async def standing(request: Request) -> Response:
    """Serve the ward's standing alerts (raised and not yet cleared) as JSON (`answers.Standings`)."""
    known_parameters(request)
    return answer(answers.alerts(Desk.of(request).known, time.monotonic()))


async def command(request: Request) -> Response:
    """Send a command to the estimator, and answer with its reply as JSON (`answers.Reply`).

    The last part of the path is the command; the body is `answers.Placing` for `place`, else `answers.Words`.
    Raises Fault: 401 or 403 without the right to command, 409 if the estimator refuses, 503 if it does not answer.
    """
    desk, verb = Desk.of(request), request.scope["path"].rpartition("/")[2]
    known_parameters(request)
    who = await _who(desk, request)
    words: str | Placement
    if verb == "place":
        worn = await _body(request, answers.Placing)
        words = placed(worn.segment, worn.side, worn.wearer)
    else:
        words = (await _body(request, answers.Words)).words
    name = _checked(request) if verb == "acknowledge" else _named(request)
    reply = await desk.ask(name, verb, who, words)
    if not reply.accepted:
        raise Fault(HTTPStatus.CONFLICT, "not_accepted", reason=reply.message)
    return answer(answers.Reply(accepted=True, message=answers.said(reply.message)))


async def _who(desk: Desk, request: Request) -> str:
    """Name of the caller: from `Authorization: Bearer name.secret`, or a page's cookie with its X-CSRF-Token."""
    kind, _, credentials = request.headers.get("authorization", "").partition(" ")
    if not kind:
        return desk.checked(request, request.headers.get("x-csrf-token", "")).name
    name, _, secret = credentials.strip().partition(".")
    if kind.lower() != "bearer" or not name or not secret:
        raise Fault(
            HTTPStatus.UNAUTHORIZED,
            "log_in",
            "The Authorization header is invalid: send `Bearer name.secret`.",
            CHALLENGE,
        )
    await desk.let_in(request, name, secret)
    return name


async def _body(request: Request, kind: type[T]) -> T:
    body = await request_form.body(request)
    if not body:
        return kind()
    told = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if told != _JSON:
        raise Fault(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
            "not_json",
            f"Content-Type {told[:40] or '(none)'} is not supported: send {_JSON}.",
        )
    try:
        return msgspec.json.decode(body.decode(), type=kind)
    except UnicodeDecodeError:
        raise Fault(HTTPStatus.BAD_REQUEST, "not_json", "The body is not UTF-8.") from None
    except msgspec.ValidationError as error:
        raise Fault(HTTPStatus.BAD_REQUEST, "bad_body", f"{error}.") from None
    except msgspec.DecodeError as error:
        raise Fault(HTTPStatus.BAD_REQUEST, "not_json", f"{error}.") from None
